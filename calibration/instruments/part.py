"""The machined workpiece as an instrument."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from calibration.instruments.exact_numbers import joined
from calibration.instruments.of_points import OfPoints
from kinematics.forward import tool_point
from kinematics.machine import Machine
from kinematics.transforms import Array, Pose, rotation_vector_matrix

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.states import MeasurementStates
    from calibration.measurement.text_table import Table
    from calibration.registration.registration import Registration

PART_SHIFT_MM, PART_ROTATION_RAD = 0.1, 5e-4
"""Half-widths of the shift and the rotation of a virtual part against its nominal frame on the measuring machine."""


class Part(OfPoints, frozen=True, tag="part"):
    """Features of a machined workpiece in the part's frame, measured for example on a coordinate measuring machine."""

    PARTS = ("x", "y", "z")
    COORDINATES = True
    OBSERVED = ("nominal_x", "nominal_y", "nominal_z", "x", "y", "z")
    HEADER_KEYS = ("part_offset",)
    IN_ORDER_OF_MOVES = False
    CLOCK_OF_MACHINE = False

    u_um: float = 0.0
    """Standard uncertainty of each coordinate, um."""
    u_um_per_m: float = 0.0
    """Length-dependent part of it, um per m of distance from the part's zero."""
    components: Literal[2, 3] = 3
    """Number of observed values in a row."""

    @property
    def planar(self) -> bool:
        """True for a part without the column z."""
        return self.components == 2

    @classmethod
    def in_plane(cls, planar: bool) -> dict[str, int]:
        """Two components where only x and y are measured."""
        return {"components": 2 if planar else 3}

    @classmethod
    def read_own(cls, table: Table) -> dict[str, Any]:
        """The number of components: two without the column z."""
        return cls.in_plane("z" not in table.names)

    @classmethod
    def read_observed(cls, table: Table, machine: Machine, states: MeasurementStates) -> Array:
        """Features `(n, components)`, mm, in the part's frame."""
        points = ["x", "y", "z"] if "z" in table.names else ["x", "y"]
        table.need_columns(points, cls.kind())
        table.need_columns([f"nominal_{letter}" for letter in points], cls.kind())
        return np.stack(list(table.numbers(points).values()), axis=1)

    @classmethod
    def typical(cls) -> Part:
        """See `InstrumentBase.typical`."""
        return cls(u_um=1.0, u_um_per_m=1.5)

    def drawn_registration(
        self, blank: Measurement, poses: Mapping[str, Pose] | None, rng: np.random.Generator
    ) -> Registration:
        """The stated alignment, else a random one."""
        if poses is None:
            groups = np.unique(blank.groups).tolist()
            poses = {group: _alignment(self.planar, rng) for group in groups}
        return super().drawn_registration(blank, poses, rng)

    def row_covariances(self, measurement: Measurement) -> Array:
        """The same in each coordinate; it grows from the part's zero."""
        u = (self.u_um + self.u_um_per_m * 1e-3 * np.linalg.norm(measurement.observed, axis=1)) * 1e-3
        return np.asarray(u[:, None, None] ** 2 * np.eye(self.components))

    def header_lines(self, measurement: Measurement) -> Iterator[str]:
        """The zero of the part's frame."""
        yield f"part_offset: {joined(measurement.part_zero)}"

    def observed_columns(self, measurement: Measurement) -> dict[str, np.ndarray]:
        """Nominal and measured features."""
        positions, letters = measurement.state.positions, "xyz"[: self.components]
        nominal = tool_point(measurement.machine, positions, measurement.tool) - measurement.part_zero
        columns = {f"nominal_{letter}": nominal[:, i] for i, letter in enumerate(letters)}
        return columns | {letter: measurement.observed[:, i] for i, letter in enumerate(letters)}


def _alignment(planar: bool, rng: np.random.Generator) -> Pose:
    """Random pose of a part on a measuring machine, near the nominal one."""
    free = np.array([1.0, 1.0, 0.0] if planar else [1.0, 1.0, 1.0])
    turns = rng.uniform(-PART_ROTATION_RAD, PART_ROTATION_RAD, 3) * (free if not planar else [0.0, 0.0, 1.0])
    return Pose(rotation_vector_matrix(turns), (rng.uniform(-PART_SHIFT_MM, PART_SHIFT_MM, 3) * free)[None])
