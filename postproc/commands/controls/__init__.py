"""Commands on the data of controls: compensation tables and kinematic parameters."""
