"""Virtual calibration: many virtual machines measured and fitted, to choose a measurement before it is made."""
