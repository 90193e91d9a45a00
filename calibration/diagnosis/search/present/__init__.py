"""The present calibration of a machine that is measured again: its error motions in finer bases, over larger ranges."""
