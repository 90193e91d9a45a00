"""Virtual calibration: whole calibrations of many virtual machines, to choose the measurement before the machine stops."""
