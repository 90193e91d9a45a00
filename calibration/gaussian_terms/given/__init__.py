"""A calibration that is given: over larger ranges, in finer bases, and with the changes that were found in it."""
