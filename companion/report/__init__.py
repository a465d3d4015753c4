"""A log as one HTML page: `content` gathers, `pictures` draws, `page` writes.

A log comes in, one file goes out that needs no other. It reads what was decided and decides nothing again; nothing of
the service imports this.
"""
