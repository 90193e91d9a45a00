"""Programs of SINUMERIK 840D."""
