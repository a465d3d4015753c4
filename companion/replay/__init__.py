"""A recorded flight through the service's own code: `recorded` stands where devices stood, `player` drives the handlers
in the recorded order, `check` compares what was decided, `comparison` sets two configurations side by side."""
