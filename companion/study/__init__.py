"""The paper's studies, each from one command, with our numbers beside the paper's.

A study (`study`) plans trials, runs one trial, sums up and draws; `catalogue` lists them. Trials are pure functions of
a specification and a seed, and a `TrialRunner` (`trials`; `local` processes or a `cluster`) carries them out, so the
numbers do not depend on where. `report` writes JSON and the HTML page. `paths`, `link` and `angles` are what the
simulated studies share, `virtual_*` the mission they fly without waiting for a clock. Touches the report's folder and
the processes of its trials; the service imports nothing of this.
"""
