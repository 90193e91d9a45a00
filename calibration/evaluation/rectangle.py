"""Squareness of two axes from the lengths of a rectangle: both diagonals and one side.

A is the corner from which the side AD goes along the first axis of the plane, in its positive direction, and AB along
the second one. In a parallelogram AC2 + BD2 = 2 AB2 + 2 AD2, and AC2 - BD2 = 4 AB AD cos(A): the tangent of the error
of the right angle is cot(A), as firmware of printers takes it from AC, BD and AD.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import msgspec
import numpy as np

from kinematics.effects import LocationError
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.error_model.provenance import Provenance
from kinematics.files.mistaken import none_of
from kinematics.machine import Machine
from kinematics.user_error import UserError
from kinematics.version import VERSION
from rendering.shown import Shown

PLANES = {"XY": ("C", -1.0), "XZ": ("B", 1.0), "YZ": ("A", -1.0)}
"""Planes: the component of the squareness of the second axis to the first, and its sign for a lean towards plus."""
IMPOSSIBLE_ANGLE_RAD = 0.05
"""Error of the right angle, rad, that no machine in use has; share by which a given side may differ."""
DERIVATIVE_STEP_MM = 1e-4
"""Change of a length, mm, for the derivatives."""
CONTRADICTS = 4.0
"""Standard uncertainties by which the fourth length may differ."""
RECTANGLE_MM = 300.0
"""Length over which workshops state squareness, mm."""
INCHES = 40.0
"""Length below which all lengths may be in inches."""


@dataclass(frozen=True, repr=False)
class Rectangle(Shown):
    """Lengths of a rectangle that a machine made, and the squareness of its axes."""

    ac: float
    """Diagonal from A to C, mm."""
    bd: float
    """Diagonal from B to D, mm."""
    ad: float
    """Side from A to D, along the first axis, mm."""
    ab: float | None = None
    """Side from A to B, along the second axis, mm; None where it was not measured."""
    u: float = 0.5
    """Standard uncertainty (k = 1) of each length, mm."""
    plane: str = "XY"
    """The first and the second axis."""

    def __post_init__(self) -> None:
        """UserError for lengths that are not those of a rectangle."""
        if self.plane not in PLANES:
            raise UserError(f"--plane {none_of(self.plane, PLANES)}")
        given = {"--ac": self.ac, "--bd": self.bd, "--ad": self.ad, "--ab": self.ab}
        for name, length in given.items():
            if length is not None and length <= 0.0:
                raise UserError(f"{name} {length:g}: a length is above 0: give the measured distance, mm")
        if self.u <= 0.0:
            raise UserError(f"--u {self.u:g}: expected the standard uncertainty of a length, mm, above 0")
        for name in ("--ad", "--ab"):
            side = given[name]
            if side is not None and side >= min(self.ac, self.bd):
                raise UserError(
                    f"{name} {side:g}: a side is shorter than both diagonals, --ac {self.ac:g} and --bd {self.bd:g}: "
                    f"are two letters exchanged? AC and BD are the diagonals, {name[2:].upper()} is a side"
                )
        squared = self.ac**2 + self.bd**2 - 2.0 * self.ad**2
        if squared <= 0.0 or abs(self.tangent) > IMPOSSIBLE_ANGLE_RAD:
            raise UserError(
                f"--ac {self.ac:g}, --bd {self.bd:g}, --ad {self.ad:g}: the corner would be more than "
                f"{math.degrees(IMPOSSIBLE_ANGLE_RAD):.1f} degrees off 90: measure again, or set the axes by hand first"
            )
        self._refuse_contradiction()

    def _refuse_contradiction(self) -> None:
        """UserError where the fourth length is not that of the other three."""
        if self.ab is None:
            return
        expected = math.sqrt((self.ac**2 + self.bd**2) / 2.0 - self.ad**2)
        u = self.u * math.hypot(1.0, math.hypot(self.ac, self.bd) / (2.0 * expected), self.ad / expected)
        if abs(self.ab - expected) > CONTRADICTS * u:
            raise UserError(
                f"--ab {self.ab:g} contradicts the other lengths, which say {expected:.5g} mm: one of the four is "
                "wrong by more than their uncertainty: measure them again"
            )

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return f"{self.effect.name} {self.effect.value:.0f} urad, U (k=2) {2e6 * self.u_tangent:.0f} urad"

    @property
    def other_side(self) -> float:
        """The side AB, mm, as measured or from the other lengths."""
        return self.ab or math.sqrt((self.ac**2 + self.bd**2) / 2.0 - self.ad**2)

    @property
    def tangent(self) -> float:
        """Tangent of the error of the right angle; positive: the second axis leans towards plus of the first."""
        return _tangent(**self.lengths)

    @cached_property
    def u_tangent(self) -> float:
        """Its standard uncertainty: that of each length by itself."""
        slopes = []
        for name in ("ac", "bd", "ad"):
            ends = [getattr(self, name) + step for step in (-DERIVATIVE_STEP_MM, DERIVATIVE_STEP_MM)]
            low, high = (_tangent(**{**self.lengths, name: end}) for end in ends)
            slopes.append((high - low) / (2.0 * DERIVATIVE_STEP_MM))
        return self.u * math.hypot(*slopes)

    @property
    def lengths(self) -> dict[str, float]:
        """The lengths, mm, by their letters; 0 for one that was not measured."""
        return {"ac": self.ac, "bd": self.bd, "ad": self.ad, "ab": self.ab or 0.0}

    @property
    def effect(self) -> LocationError:
        """The squareness as a location error, urad."""
        component, sign = PLANES[self.plane]
        return LocationError(component, self.plane[1], sign * self.tangent * 1e6)  # type: ignore[arg-type]

    def calibration(self, machine: Machine) -> ErrorModel:
        """The calibration of a machine that has this error alone."""
        for axis in self.plane:
            if axis not in machine.names:
                raise UserError(f"--plane {self.plane}: machine {machine.name} ({machine.chain}) has no axis {axis}")
        model = msgspec.structs.replace(no_errors(machine), effects=(self.effect,))
        known = model.with_parameters(model.parameters, np.array([[(self.u_tangent * 1e6) ** 2]]))
        lengths = ", ".join(f"{name.upper()} {value:g}" for name, value in self.lengths.items() if value)
        made = Provenance(
            made_by=f"ncomp {VERSION}",
            made_at=datetime.datetime.now(datetime.UTC).replace(microsecond=0),
            source=f"rectangle in {self.plane}: {lengths} mm, each to {self.u:g} mm (k=1)",
        )
        return msgspec.structs.replace(known, provenance=made)


def _tangent(ac: float, bd: float, ad: float, ab: float) -> float:
    """The tangent by four lengths, mm; ab 0: by the other three."""
    cosine = (ac**2 - bd**2) / (4.0 * (ab or math.sqrt((ac**2 + bd**2) / 2.0 - ad**2)) * ad)
    return cosine / math.sqrt(1.0 - cosine**2)


def file_of(
    machine: Machine,
    plane: str,
    places: Mapping[str, tuple[float, float]],
    lengths: Mapping[str, float],
    u: float,
    scale_um_per_m: float | None = None,
) -> str:
    """Lengths between corners as a measurement file; places: where the machine stood, mm, by the letters of corners.

    lengths: mm, by the letters of their two corners; u: their standard uncertainty, mm.
    """
    head = [f"machine: {machine.name}", "instrument: lengths", f"u_um: {u * 1e3:g}"]
    head += [] if scale_um_per_m is None else [f"u_scale_um_per_m: {scale_um_per_m:g}"]
    lines = [*(f"# {line}" for line in head), f"name,{plane[0]}1,{plane[1]}1,{plane[0]}2,{plane[1]}2,length_mm"]
    for name, length in lengths.items():
        ends = [f"{value:g}" for letter in name for value in places[letter]]
        lines.append(f"{name},{','.join(ends)},{length:g}")
    return "\n".join(lines) + "\n"
