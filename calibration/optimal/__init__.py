"""Measurements laid where they tell most: positions, targets and tracker with the least volumetric uncertainty."""
