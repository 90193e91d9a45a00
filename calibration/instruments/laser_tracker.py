"""The laser tracker: points in its own frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np

from calibration.instruments.of_points import OfPoints
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.states import MeasurementStates
    from calibration.measurement.text_table import Table
    from calibration.registration.registration import Registration
    from kinematics.transforms import Pose

MM_PER_UM, PER_M = 1e-3, 1e-6
"""Factors from um to mm, and from um/m to mm/mm."""


class LaserTracker(OfPoints, frozen=True, tag="laser-tracker"):
    """Points in the tracker's own frame, whose origin emits the beam: range, and two angles across the beam."""

    PARTS = ("x", "y", "z")
    COORDINATES = True
    OBSERVED = ("x", "y", "z")
    OPTIONAL = ("scatter_um",)
    HEADER_KEYS = ("stands_on",)
    NEEDED = (
        ("u_range_um", "u_range_um_per_m"),
        ("u_angle_um", "u_angle_um_per_m"),
    )
    STATIONED = True
    BY_BEAM = True
    READS_RANGES = True
    MAY_BE_KNOCKED = True
    FOLLOWED_UP = True
    ANY_TARGETS = True

    u_range_um: float = 0.0
    """Standard uncertainty of the range, um."""
    u_range_um_per_m: float = 0.0
    """Length-dependent part of it, um per m of range."""
    u_angle_um: float = 0.0
    """Standard uncertainty across the beam, as a length, in both directions, um."""
    u_angle_um_per_m: float = 0.0
    """Length-dependent part of it, um per m of range."""
    components: Literal[3] = 3
    """Number of observed values in a row."""

    def covariance(self, points: Array) -> Array:
        """Covariances `(n, 3, 3)`, mm2, of observed points `(n, 3)`, mm.

        The variance is that of the range along the beam b, and that of the angles across it: r2 b b' + a2 (1 - b b');
        on-the-fly paper (4)-(9) with its errata.
        """
        length = np.linalg.norm(points, axis=1)
        beam = points / np.maximum(length, np.finfo(float).tiny)[:, None]
        along = (self.u_range_um * MM_PER_UM + self.u_range_um_per_m * PER_M * length) ** 2
        across = (self.u_angle_um * MM_PER_UM + self.u_angle_um_per_m * PER_M * length) ** 2
        outer = beam[:, :, None] * beam[:, None, :]
        return np.asarray(across[:, None, None] * np.eye(3) + (along - across)[:, None, None] * outer)

    @classmethod
    def read_observed(cls, table: Table, machine: Machine, states: MeasurementStates) -> Array:
        """Points `(n, 3)`, mm, in the tracker's frame."""
        table.need_columns(cls.OBSERVED, cls.kind())
        return np.stack(list(table.numbers(cls.OBSERVED).values()), axis=1)

    @classmethod
    def typical(cls) -> LaserTracker:
        """Uncertainties by the virtual calibration paper, Table 3."""
        return cls(u_range_um_per_m=0.25, u_angle_um=10.0, u_angle_um_per_m=2.5)

    def drawn_registration(
        self, blank: Measurement, poses: Mapping[str, Pose] | None, rng: np.random.Generator
    ) -> Registration:
        """See `InstrumentBase.drawn_registration`."""
        if poses is None:
            raise UserError("the position of the laser tracker is missing: state --tracker x,y,z")
        return super().drawn_registration(blank, poses, rng)

    def row_covariances(self, measurement: Measurement) -> Array:
        """Those of the points; rows in motion are means of several readings, across the path."""
        whole, across = self.covariance(measurement.observed), measurement.across
        if across is None:
            return whole if measurement.scatter is None else _widened(whole, measurement.scatter)
        return np.asarray(across.of(whole) @ np.swapaxes(across.directions, 1, 2) / across.readings[:, None, None])

    def header_lines(self, measurement: Measurement) -> Iterator[str]:
        """The base on which the tracker stands."""
        yield f"stands_on: {measurement.stands_on}"

    def observed_columns(self, measurement: Measurement) -> dict[str, np.ndarray]:
        """The points."""
        return dict(zip(self.OBSERVED, measurement.observed.T, strict=True))


def _widened(covariances: Array, scatter: Array) -> Array:
    """Covariances `(n, 3, 3)` whose mean variance is at least that of the scatter `(n,)`."""
    surplus = scatter**2 - np.trace(covariances, axis1=1, axis2=2) / 3.0
    return np.asarray(covariances + np.maximum(surplus, 0.0)[:, None, None] * np.eye(3))
