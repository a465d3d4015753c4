"""`python -m tests.faults.missions`; in a module of its own is what spawned workers import."""

from tests.faults.missions.campaign import main

main()
