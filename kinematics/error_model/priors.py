"""What is known before any data: the sizes of what every measurement contains, and how common causes are.

Each number has its physical reason, or the data it comes from. `docs/develop/priors.md` shows how results move when one
is halved or doubled; a machine file states others under `[priors]`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.transforms import read_only

BANDS = ((0, 1), (2, 3), (4, 6), (7, 10), (11, 15), (16, 1000))
"""First and last degree of each band, whose coefficients share one size: about half an octave each."""
SIZES = read_only(np.array([0.1, 0.3, 1.0, 3.0, 10.0]))
"""Sizes of a term that may be there, in its typical sizes, equally likely: log-uniform over two decades."""
OUTLIER_SIZES = read_only(np.array([0.02, 0.06, 0.2, 0.6, 2.0]))
"""Sizes of an outlier, mm or mrad, equally likely: a touch of the reflector to a wrong point."""


@dataclass(frozen=True)
class Priors:
    """Prior sizes and probabilities."""

    error_motion_um: float = 30.0
    """Expected size of the coefficients of first degree of an error motion, um or urad: machining centres and gantries
    before a compensation have 10 to 100 (the table of effects)."""
    smoothness: float = 1.5
    """Power of the degree with which expected coefficients of an error motion fall: between a walk (1) and a guide
    whose curvature is limited (2). A finer band is expected to go on falling so from the coarser one."""
    least_share: float = 0.3
    """Least expected size of a band or a cause, as a share of its prior size."""
    band_weight: float = 4.0
    """Weight of the expected size of a band, in coefficients: an inverse gamma prior with a finite mean."""
    term_weight: float = 0.2
    """Weight of the expected size of a cause, in coefficients: its size is nearly free."""
    first_side: float = 5.0
    """Size of the error of an axis before its first move, in typical sizes of a backlash: nothing is known of it."""
    non_repeatability_um: float = 2.0
    """Median of the standard deviation of an axis from stop to stop, um or urad (half-Cauchy): machining centres repeat
    within 1 to 5 um by ISO 230-2."""
    outlier: float = 0.003
    """Probability that a row is an outlier: about one in a measurement of 300 rows."""
    left_out: float = 20.0
    """Log density of a row that is left out, against one of noise: the volume in which outliers lie."""
    most_left_out: float = 0.1
    """Largest share of rows that are outliers; more of them are no outliers."""
    common: float = 0.05
    """Probability that a kind of cause is present: there are about twenty common kinds, and a measurement that is to be
    diagnosed shows about one of them."""
    rare: float = 0.0025
    """The same of a rare kind, which imitates a common one: 20 to 1 for the common one."""
    smooth: float = 0.02
    """The same of a smooth function without a name. The table of effects names nearly all errors of machines: it is
    less likely than a common cause, and likelier than a rare one."""
    swing: float = 0.005
    """The same of an error that is periodic in time: the tool seldom swings through a whole measurement. Only
    controlled temperatures, and a pump or a lamp that switches, repeat so regularly."""
    walk: float = 0.02
    """The same of a random walk of the tool."""
    fine: float = 0.02
    """The same of errors at each position of an axis, finer than its error motions."""


PRIORS = Priors()
"""Those of a machine whose file states none."""
