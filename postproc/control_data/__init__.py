"""Data of controls: compensation tables, kinematic parameters, and tables of tools, written and read."""
