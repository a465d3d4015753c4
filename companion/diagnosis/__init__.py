"""What `companion doctor` looks at, each part in a module: every precondition as a line that is OK, says what to do, or
says that it could not be looked at.

Looks and listens; changes nothing, sends nothing, commands nothing. Where a running service holds what is asked for, it
is asked. `companion.radio.checks` has the lines of the card that need no more than the radio.
"""
