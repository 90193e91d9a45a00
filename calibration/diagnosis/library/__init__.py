"""The causes that are tried on given data, and changes of a machine since its calibration."""
