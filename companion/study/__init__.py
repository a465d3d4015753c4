"""The paper's studies, each from one command, with our numbers beside the paper's.

A study (`study`) plans trials, runs one trial, sums up and draws; `catalogue` lists them. Trials are pure functions of
a specification and a seed, and a `Runner` (`trials`; `local` processes or a `cluster`) carries them out, so the numbers
do not depend on where. `report` prints, writes JSON and the HTML page. `paths`, `link` and `angles` are what the
simulated studies share; `virtual_mission` flies the service's own parts at virtual time on the stand-ins of
`virtual_parts`. The service imports nothing of this.
"""
