"""`python -m tests.faults.missions`. What is flown stands in a module of its own: spawned workers cannot import this one."""

from tests.faults.missions.campaign import main

main()
