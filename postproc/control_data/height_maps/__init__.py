"""Height maps: of senders and firmware, read by what their files contain, and their place on a machine."""
