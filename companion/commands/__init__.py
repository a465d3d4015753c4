"""One module for each command of the `companion` program, loaded only when it is called."""
