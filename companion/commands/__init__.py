"""One module for each command of the `companion` program, loaded only when it is called.

Options come in, lines, tables and files go out. This is the only place with click, rich and progress bars, besides
`cli`, which finds the commands, and the simulator's processes (`sim.px4`), which read options of their own. A command
finds out whether its files can be written before it works (`output_files`) and says in one line what failed; what it
computes, draws or writes into a log is made in the rooms below. What several share: `recordings` (the options that
choose runs), `tables`, `terminal`, `progress`, `demo_view`.
"""
