"""What is known before any data: the sizes of what every measurement contains, and how common causes are.

Each number has its physical reason, or the data it comes from. `docs/develop/priors.md` shows how results move when one
is halved or doubled. A machine file states its kind of machine, or single numbers, under `[priors]`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kinematics.transforms import read_only

BANDS = (
    *((0, 1), (2, 3), (4, 6), (7, 10), (11, 15), (16, 22), (23, 32), (33, 46), (47, 65), (66, 92), (93, 130)),
    *((131, 185), (186, 262), (263, 1000)),
)
"""First and last degree of each band, whose coefficients share one size: about half an octave each."""
SIZES_IN_TYPICAL = read_only(np.array([0.1, 0.3, 1.0, 3.0, 10.0]))
"""Sizes of a term that may be there, in its typical sizes, equally likely: log-uniform over two decades."""
OUTLIER_SIZES = read_only(np.array([0.02, 0.06, 0.2, 0.6, 2.0]))
"""Sizes of an outlier, mm or mrad, equally likely: a touch of the reflector to a wrong point."""


@dataclass(frozen=True)
class Priors:
    """Prior sizes and probabilities."""

    error_motion_um: float = 30.0
    """Expected size of the coefficients of first degree of an error motion, um or urad: machining centres and gantries
    before a compensation have 10 to 100 (the table of effects)."""
    typical: float = 1.0
    """Sizes of causes in the machine, as multiples of those in the table of effects, which are of machining centres."""
    smoothness: float = 1.5
    """Power of the degree with which expected coefficients of an error motion fall: between a walk (1) and a guide
    whose curvature is limited (2). A finer band is expected to go on falling so from the coarser one."""
    least_share: float = 0.3
    """Least expected size of a band or a cause, as a share of its prior size."""
    band_weight: float = 4.0
    """Weight of the expected size of a band, in coefficients: an inverse gamma prior with a finite mean."""
    size_of_machine: float = 1.0
    """Standard deviation of the logarithm of the sizes of error motions in a fit that all axes share: a factor of 2.7.
    The four together are a factor of 5.6: machines err by 3 to 300 um."""
    size_of_axes: float = 1.0
    """The same of all linear, or of all rotary axes: a machine of good guides may have a poor table."""
    size_of_motion: float = 0.7
    """The same of the positioning, the straightness or the angles of an axis: a factor of 2."""
    size_of_band: float = 0.7
    """The same of a band of waves, which is nearly shared with the next bands."""
    term_weight: float = 0.2
    """Weight of the expected size of a cause, in coefficients: its size is nearly free."""
    first_side: float = 5.0
    """Size of the error of an axis before its first move, in typical sizes of a backlash: nothing is known of it."""
    non_repeatability_um: float = 2.0
    """Median of the standard deviation of an axis from stop to stop, um or urad (half-Cauchy): machining centres repeat
    within 1 to 5 um by ISO 230-2."""
    least_noise: float = 0.01
    """Least noise of an instrument, as a share of its specification: none is a hundred times better than it is stated.
    What remains of exact data is their rounding, in which any function can be found."""
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
    largest_correction_um: float = 500.0
    """Largest plausible correction of a linear axis, um: machining centres and gantries err by far less, and an offset
    or a length that is wrong shifts by more."""


PRIORS = Priors()
"""Those of a machine whose file states none."""


class Kind(NamedTuple):
    """What is known of a kind of machine."""

    priors: Priors
    source: str
    """Where its sizes are from."""


KINDS: Mapping[str, Kind] = {
    "machining-centre": Kind(PRIORS, "the table of effects; ISO 230-2 tests repeat within 1 to 5 um"),
    "gantry": Kind(
        Priors(error_motion_um=60.0),
        "a squareness of 0.02 mm over 500 mm, which ISO 10791-1 allows, is 0.06 mm over a travel of 1.5 m",
    ),
    "arm": Kind(
        Priors(error_motion_um=300.0, non_repeatability_um=20.0, typical=10.0),
        "Slamani, Nubiola, Bonev, Industrial Robot 39 (2012), an arm as delivered: positions within 650 um, "
        "orientations within 2.8 mrad, repeatability 37 um and 87 urad; joints yield by up to 2,000 urad/m",
    ),
    "printer": Kind(
        Priors(error_motion_um=300.0, non_repeatability_um=10.0, typical=10.0),
        "a belt whose turn is 0.2 % shorter than its pulley's is off by 0.7 mm in 310 mm (users of Klipper, twelve "
        "printers); belts yield by 0.05 to 0.1 mm at a reversal",
    ),
    "router": Kind(
        Priors(error_motion_um=300.0, non_repeatability_um=10.0, typical=10.0, largest_correction_um=3000.0),
        "a router with belts is off by -0.3 to 0.5 mm over 300 mm x 300 mm (users of Shapeoko, with a linear scale); "
        "belts as of printers; a board of 160 mm x 100 mm may bow by 1.5 % of its diagonal, 2.8 mm (IPC-6012B, 3.4.3)",
    ),
    "mount": Kind(
        Priors(error_motion_um=100.0, non_repeatability_um=5.0, typical=3.0),
        "worm gears of telescope mounts: 10 to 120 arcsec from peak to peak (makers and users), 24 to 290 urad; the "
        "air moves a star by about 1 arcsec, 5 urad",
    ),
    "stage": Kind(
        Priors(error_motion_um=3.0, non_repeatability_um=0.2, typical=0.1),
        "makers' sheets of stages on air bearings: straight within 1 um over 200 mm, pitch and yaw within 4 arcsec; "
        "orthogonal within 2 to 20 arcsec",
    ),
}
"""Kinds of machines, by the name that a machine file states."""
