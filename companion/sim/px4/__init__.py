"""The mock PX4: airframe, commander and MAVLink link under one clock, and the process around them."""
