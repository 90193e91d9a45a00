"""Calibration on the fly: a laser tracker follows the machine along the path of an NC program, which never stops."""
