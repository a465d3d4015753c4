"""What stands where hardware would: the world with its radio and cameras, and the mock autopilot."""
