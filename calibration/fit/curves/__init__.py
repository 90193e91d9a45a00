"""Error motions as smooth curves between few measured positions."""
