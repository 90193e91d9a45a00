"""The result of the comparison of two calibrations: error motions, figures, volume."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from calibration.evaluation.volumetric import VolumetricError
from kinematics.basis import Interval
from kinematics.machine import Machine
from kinematics.transforms import Array
from rendering.shown import Shown

Straightness = Literal["end-point", "least-squares"]


class Figure(NamedTuple):
    """One number of both calibrations; um, or urad (um/m)."""

    name: str
    title: str
    unit: str
    a: float
    b: float
    U_a: float
    U_b: float

    @property
    def shown(self) -> str:
        """Its name for people: the reversal value B of ISO 230-2 in words."""
        return f"backlash {self.name.removeprefix('B ')} (B)" if self.name.startswith("B ") else self.name

    @property
    def U(self) -> float:
        """Expanded uncertainty of the difference, k = 2."""
        return float(np.hypot(self.U_a, self.U_b))

    def json(self) -> dict[str, Any]:
        """The figure as JSON."""
        numbers = {"a": self.a, "b": self.b, "difference": self.b - self.a, "U_difference": self.U}
        return {"name": self.name, "title": self.title, "unit": self.unit, **numbers}


@dataclass(frozen=True)
class Motion:
    """One error motion in both calibrations, in its convention; um or urad."""

    name: str
    axis: str
    position_unit: str
    unit: str
    convention: str
    positions: Array
    """Positions `(n,)`, mm or degrees."""
    a: Array
    b: Array
    U_a: Array
    U_b: Array
    known: tuple[bool, bool]
    """True for each calibration, A and B, that contains the error motion."""
    significant: bool
    """True if the uncertainties explain the difference, over all positions, with less than 5 % probability."""

    @property
    def difference(self) -> Array:
        """Difference B minus A `(n,)`, um or urad."""
        return self.b - self.a

    @property
    def U(self) -> Array:
        """Expanded uncertainties of the differences, k = 2, `(n,)`."""
        return np.hypot(self.U_a, self.U_b)

    @property
    def largest(self) -> int:
        """Row of the largest difference."""
        return int(np.argmax(np.abs(self.difference)))

    def json(self) -> dict[str, Any]:
        """The error motion as JSON."""
        i = self.largest
        at = f"position_{self.position_unit}"
        return {
            "name": self.name,
            "axis": self.axis,
            "unit": self.unit,
            "convention": self.convention,
            "in": [name for name, known in zip("ab", self.known, strict=True) if known],
            "range": {"a": float(np.ptp(self.a)), "b": float(np.ptp(self.b))},
            "rms_difference": float(np.sqrt(np.mean(self.difference**2))),
            "largest": {"difference": float(self.difference[i]), at: float(self.positions[i]), "U": float(self.U[i])},
            "significant": self.significant,
            "curves": {
                f"positions_{self.position_unit}": self.positions.tolist(),
                "a": self.a.tolist(),
                "b": self.b.tolist(),
                "U_a": self.U_a.tolist(),
                "U_b": self.U_b.tolist(),
            },
        }


class Volume(NamedTuple):
    """The difference B minus A of the tool point over the common volume."""

    bounds: Mapping[str, Interval]
    """Bounds of the common volume by axis, mm or degrees."""
    tool_mm: float
    difference: VolumetricError
    aligned: VolumetricError
    """The difference after a rigid alignment of one calibration to the other."""
    u_rms_um: float
    """RMS of the standard uncertainty of the difference, um: the expected difference of two calibrations that agree."""

    def json(self) -> dict[str, Any]:
        """The volume as JSON."""
        return {
            "bounds": {axis: list(ends) for axis, ends in self.bounds.items()},
            "tool_mm": self.tool_mm,
            "difference_um": {"rms": self.difference.rms, "p95": self.difference.p95, "max": self.difference.largest},
            "aligned_um": {"rms": self.aligned.rms, "p95": self.aligned.p95, "max": self.aligned.largest},
            "u_rms_um": self.u_rms_um,
        }


@dataclass(frozen=True, repr=False)
class Comparison(Shown):
    """Result of the comparison."""

    machine: Machine
    """The machine."""
    reference: Mapping[str, float]
    """Reference positions by axis, mm or degrees."""
    straightness: Straightness
    """Reference line of the straightness."""
    motions: tuple[Motion, ...]
    """Both curves of each error motion and their difference, um or urad, with U (k = 2)."""
    figures: tuple[Figure, ...]
    """Squareness, location errors of rotary axes, reversal."""
    volume: Volume
    """Difference over the volume, um."""
    left_out: tuple[str, ...]
    """Effects that were not compared, each with the reason."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        aligned = self.volume.aligned
        return f"{self.machine.name}, {aligned.rms:.3g} um RMS over the volume, at most {aligned.largest:.3g} um"

    def json(self) -> dict[str, Any]:
        """The comparison as JSON: U with k = 2; differences are B minus A."""
        return {
            "machine": self.machine.name,
            "difference": "b minus a",
            "straightness": self.straightness,
            "reference": dict(self.reference),
            "error_motions": [motion.json() for motion in self.motions],
            "figures": [figure.json() for figure in self.figures],
            "volume": self.volume.json(),
            "not_compared": list(self.left_out),
        }
