"""Instruments: kinds of observations, and their uncertainties.

Standard uncertainties (k = 1) as given in a measurement file, um and um per m of range. The constant part and the part
per metre of one quantity are added, as in data sheets.
"""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np

from kinematics.transforms import Array

UM, PER_M = 1e-3, 1e-6
"""Factors from um to mm, and from um/m to mm/mm."""
SQUARENESS_URAD = 30.0
"""Squareness of linear axes of a machine in good order (k = 1), urad, the same as of its rotary axes.

Tolerances of acceptance are of this order: 0.02 mm over 500 mm, 40 urad. ISO 10791-1 and -2 are quoted with this
figure; their text was not at hand.
"""


class LaserTracker(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="laser-tracker"):
    """Points in the tracker's own frame, whose origin emits the beam: range, and two angles across the beam."""

    u_range_um: float = 0.0
    u_range_um_per_m: float = 0.0
    u_angle_um: float = 0.0
    """Standard uncertainty across the beam, as a length, in both directions, um."""
    u_angle_um_per_m: float = 0.0
    components: Literal[3] = 3

    def covariance(self, points: Array) -> Array:
        """Covariances `(n, 3, 3)`, mm2, of observed points `(n, 3)`, mm.

        The variance is that of the range along the beam b, and that of the angles across it: r2 b b' + a2 (1 - b b');
        on-the-fly paper (4)-(9) with its errata.
        """
        length = np.linalg.norm(points, axis=1)
        beam = points / np.maximum(length, np.finfo(float).tiny)[:, None]
        along = (self.u_range_um * UM + self.u_range_um_per_m * PER_M * length) ** 2
        across = (self.u_angle_um * UM + self.u_angle_um_per_m * PER_M * length) ** 2
        outer = beam[:, :, None] * beam[:, None, :]
        return np.asarray(across[:, None, None] * np.eye(3) + (along - across)[:, None, None] * outer)


class Interferometer(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="interferometer"):
    """Deviations along, or about, one axis at a time; for linear axes also straightness and angles (six degrees)."""

    u_um: float = 0.0
    """Standard uncertainty, um; urad for a rotary axis."""
    u_um_per_m: float = 0.0
    """Length-dependent part of it, um per m of travel from the first position of the run."""
    u_straightness_um: float = 0.0
    u_straightness_um_per_m: float = 0.0
    """Length-dependent part of it, um per m of travel from the first position of the run."""
    u_angle_urad: float = 0.0
    """Standard uncertainty of angular error motions of a linear axis, urad."""
    components: Literal[1] = 1


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="part"):
    """Features of a machined workpiece in the part's frame, measured for example on a coordinate measuring machine."""

    u_um: float = 0.0
    """Standard uncertainty of each coordinate, um."""
    u_um_per_m: float = 0.0
    """Length-dependent part of it, um per m of distance from the part's zero."""
    components: Literal[2, 3] = 3


class TouchProbe(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="touch-probe"):
    """A touch probe in the spindle that finds the centres of spheres on the table, or an R-test that reads them."""

    u_um: float = 0.0
    """Standard uncertainty of each coordinate of a sphere's centre, um."""
    squareness_urad: float = SQUARENESS_URAD
    """Expected size of the machine's squareness errors before the measurement (k = 1), urad."""
    components: Literal[3] = 3


class Ballbar(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="ballbar"):
    """A telescopic bar between a ball in the spindle and a ball on the table, which reads the distance of the balls."""

    u_um: float = 0.0
    """Standard uncertainty of a reading, um."""
    length_mm: float = 150.0
    """Nominal length of the bar between the centres of its balls, mm."""
    length_u_um: float | None = None
    """Standard uncertainty of the length by calibration, um; None where the length is fitted."""
    components: Literal[1] = 1


Instrument = LaserTracker | Interferometer | Part | TouchProbe | Ballbar


def kind_of(instrument: Instrument) -> str:
    """Kind of an instrument, as in the header of a measurement file: `laser-tracker`."""
    return str(type(instrument).__struct_config__.tag)
