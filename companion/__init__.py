"""The drone: decisions, edges, and one app that wires them."""
