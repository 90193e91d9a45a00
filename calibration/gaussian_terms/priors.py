"""Prior sizes of what every measurement contains: error motions, the side of a first move, noise, outliers."""

from __future__ import annotations

import numpy as np

from kinematics.transforms import read_only

MOTION = 30.0
"""Expected size of the coefficients of first degree of an error motion, um or urad (the table of effects)."""
FALL = 1.5
"""Power of the degree with which expected coefficients of an error motion fall: between a walk (1) and a smooth
guide whose curvature is limited (2)."""
BANDS = ((0, 1), (2, 3), (4, 6), (7, 10), (11, 15), (16, 1000))
"""First and last degree of each band, whose coefficients share one size: about half an octave each."""
ROUGHER = 0.5
"""Expected square of a band's size, beyond the fall with the degree, as a share of that of the coarser band."""
LEAST_SQUARE = 0.1
"""Least expected square of a size, in squares of its prior size."""
BAND_WEIGHT = 4.0
"""Weight of the expected size of a band, in coefficients."""
TERM_WEIGHT = 0.2
"""Weight of the expected size of any other term, in coefficients: its size is nearly free."""
SIZES = read_only(np.array([0.1, 0.3, 1.0, 3.0, 10.0]))
"""Sizes of a term that may be there, in its typical sizes, equally likely: log-uniform over two decades."""
FIRST_SIDE = 5.0
"""Size of the error of an axis before its first move, in typical sizes of a backlash: nothing is known of it."""
REPEATS = 2.0
"""Median of the standard deviation of an axis from stop to stop, um or urad (half-Cauchy)."""
OUTLIER = 0.003
"""Prior probability that a row is an outlier: about one in a measurement of 300 rows."""
OUTLIER_SIZES = read_only(np.array([0.02, 0.06, 0.2, 0.6, 2.0]))
"""Sizes of an outlier, mm or mrad, equally likely: a touch of the reflector to a wrong point."""
LEFT_OUT = 20.0
"""Log density of a row that is left out, against one of noise: the volume in which outliers lie."""
MOST_LEFT_OUT = 0.1
"""Largest share of rows that are outliers; more of them are no outliers."""
