"""Optimised measurements: positions, targets and tracker position with the least volumetric uncertainty."""
