"""A log as one HTML page: `content` gathers, `pictures` draws, `page` writes. Nothing of the service imports this."""
