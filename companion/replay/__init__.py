"""A recorded flight through the service's own code: `recorded` stands where devices stood, `player` drives the handlers
in the recorded order, `check` compares what was decided, `comparison` sets two configurations side by side. A log comes
in, decisions and a log leave; no device, vehicle or network is touched but for a page on this machine (`live_page`).
"""
