"""The work offsets that a program used: how each was obtained, its true datum, and the true offset to enter instead."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from kinematics.error_model.beyond_range import beyond_range
from kinematics.error_model.model import ErrorModel
from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.machine import Machine
from kinematics.touch_off import Datum, TouchOff
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.compensation.datum import deviations, poses
from postproc.control.setup import NO_OFFSET, Setup
from postproc.motion.frames import cartesian
from postproc.motion.motions import Motions
from postproc.motion.moves import Known

NOTED_TURN_DEG = 1e-3
"""Difference of a rotary position, degrees, above which a note is given."""
NOTE_TURNED = (
    "{name} is first used at {at}, and its touch-off is assumed elsewhere: if it was touched off there, give --datum "
    "{name}=probed@{at}"
)
LISTED_TOUCH_OFFS = 12
"""Largest number of listed touch-offs; a program that sets its work offsets itself may have any number."""


class UsedDatum(msgspec.Struct, frozen=True):
    """A touched-off work offset that a program used."""

    touch_off: TouchOff
    machine: Machine
    tcp: bool
    """True if X Y Z of the work offset are of the tool point in the workpiece frame."""
    given: Datum
    """Datum entry from the user or the machine file."""
    by_default: bool
    """True if neither of them gives one."""
    shift: Array | None = None
    """True datum minus work offset `(3,)`, mm, workpiece frame; None without an error model."""

    @property
    def instead(self) -> Array:
        """Work offset `(3,)`, mm, that gives the same part if it is entered as true."""
        offset = np.array(self.touch_off.offset)[list(cartesian(self.machine))]
        if self.shift is None:
            return offset
        if self.tcp:
            return np.asarray(offset + self.shift)
        q, tool = poses(self.machine, [self.touch_off])
        moved = linear_positions(self.machine, q, tool_point(self.machine, q, tool) + self.shift, tool)
        return np.asarray(offset + (moved - q)[0, cartesian(self.machine)])

    def facts(self) -> list[tuple[str, str]]:
        """Texts for the user: how the offset was obtained, and the true datum."""
        touch_off, name = self.touch_off, self.touch_off.name
        order = sorted(range(len(self.machine.names)), key=lambda i: (self.machine.rotary[i], self.machine.names[i]))
        position = " ".join(f"{self.machine.names[i]} {touch_off.position[i]:g}" for i in order)
        probe = f"{touch_off.length:g} mm" + ("" if self.given.probe is not None else ", the length of the first tool")
        default = " (default)" if self.by_default else ""
        touched = ("datum", f"{name}: probed{default} at {position}; probe {probe}")
        if self.shift is None:
            return [touched]
        x, y, z = (f"{1e3 * value:+.1f}" for value in self.shift)
        new = ", ".join(f"{axis} {value:.4f}" for axis, value in zip("XYZ", self.instead, strict=True))
        return [
            touched,
            (
                "true datum",
                f"{name} {x} {y} {z} um in x, y, z: the machine's error at the touch-off, which the correction takes "
                f"into account, so nothing is to be done. Only if you work with --datum {name}=true, enter {new}",
            ),
        ]

    def json(self) -> dict[str, Any]:
        """The machine-readable form."""
        touch_off = self.touch_off
        return {
            "work_offset": touch_off.name,
            "obtained": "probed",
            "position": dict(zip(self.machine.names, touch_off.position, strict=True)),
            "probe_mm": touch_off.length,
            "probe_given": self.given.probe is not None,
            "true_datum_minus_offset_um": None if self.shift is None else np.round(self.shift * 1e3, 4).tolist(),
            "true_offset_mm": dict(zip("XYZ", np.round(self.instead, 7).tolist(), strict=True)),
        }


class UsedDatums(msgspec.Struct):
    """Touch-offs of the moves of a program, collected chunk by chunk."""

    setup: Setup
    used: list[UsedDatum] = msgspec.field(default_factory=list)
    _known: set[TouchOff] = msgspec.field(default_factory=set)
    _turned_notes: dict[str, str] = msgspec.field(default_factory=dict)
    """Note, by work offset, on rotary axes whose position in its first move differs from its touch-off; or empty."""
    _outside: list[str] = msgspec.field(default_factory=list)
    """Notes on touch-offs outside the travel, or outside the range of the calibration."""

    def add(self, motions: Motions) -> None:
        """Add the moves of a chunk with programmed coordinates."""
        self._compare_rotary_positions(motions)
        for index in motions.frames_of(motions.programmed):
            frame = motions.frames[index]
            touch_off = frame.touch_off
            if touch_off is None or touch_off in self._known:
                continue
            self._known.add(touch_off)
            given, by_default = self.setup.datum(touch_off.name), self.setup.datum_by_default(touch_off.name)
            self.used.append(UsedDatum(touch_off, motions.machine, frame.tcp, given, by_default))

    def _compare_rotary_positions(self, motions: Motions) -> None:
        """Compare the rotary positions in the first move of each work offset with its assumed touch-off."""
        machine, evaluated = motions.machine, np.flatnonzero(motions.evaluated)
        for index in motions.frames_of(evaluated):
            frame = motions.frames[index]
            touch_off = frame.touch_off
            if touch_off is None or touch_off.name in self._turned_notes:
                continue
            row = evaluated[motions.frame[evaluated] == index][0]
            positions = np.array(touch_off.position)
            known = (motions.known[row] == Known.PROGRAM) & machine.rotary
            q = np.where(known, motions.target[row] + frame.offset, positions)
            away = np.flatnonzero(np.abs(q - positions) > NOTED_TURN_DEG)
            given = any(machine.names[i] in self.setup.datum(touch_off.name).at for i in np.flatnonzero(machine.rotary))
            at = ",".join(f"{machine.names[i]}{q[i]:g}" for i in away)
            self._turned_notes[touch_off.name] = (
                "" if given or frame.tcp or not at else NOTE_TURNED.format(name=touch_off.name, at=at)
            )

    def notes(self) -> list[str]:
        """Notes on doubtful touch-offs."""
        return [*filter(None, self._turned_notes.values()), *self._outside]

    def predict(self, machine: Machine, model: ErrorModel, conditions: Conditions) -> None:
        """Compute the true datums; without effects they remain unknown.

        A touch-off without a length, from moves before the first tool, is dropped if one of the same work offset has a
        length.
        """
        lengths = {used.touch_off.name for used in self.used if used.touch_off.probe is not None}
        self.used = [u for u in self.used if u.touch_off.probe is not None or u.touch_off.name not in lengths]
        if model.effects:
            shifts = deviations(machine, model, [used.touch_off for used in self.used], conditions)
            self.used = [replace(used, shift=shift) for used, shift in zip(self.used, shifts, strict=True)]
            for used in self.used[:LISTED_TOUCH_OFFS]:
                self._look_outside(machine, model, used.touch_off, conditions)

    def _look_outside(self, machine: Machine, model: ErrorModel, touch_off: TouchOff, conditions: Conditions) -> None:
        q, _ = poses(machine, [touch_off])
        for axis, value in zip(machine.axes, q[0] / machine.scale, strict=True):
            low, high = axis.travel
            if not low - NOTED_TURN_DEG <= value <= high + NOTED_TURN_DEG:
                self._outside.append(
                    f"the touch-off of {touch_off.name} takes {axis.name} to {value:.4g} {axis.unit}, outside its "
                    f"travel {low:g}..{high:g} {axis.unit}: check the work offset and the length of the probe"
                )
        beyond = model.outside(machine, conditions.state(q, np.zeros_like(q)))
        self._outside += [
            f"at the touch-off of {touch_off.name} {note}" for note in beyond_range(dict(sorted(beyond.items())))
        ]

    def facts(self, offsets: Iterable[str]) -> list[tuple[str, str]]:
        """Texts for the user: all touch-offs, and those work offsets of `offsets` that are true."""
        rows = [fact for used in self.used[:LISTED_TOUCH_OFFS] for fact in used.facts()]
        if len(self.used) > LISTED_TOUCH_OFFS:
            rows.append(("datum", f"{len(self.used) - LISTED_TOUCH_OFFS} more are not listed"))
        return [*rows, *(("datum", f"{name}: true") for name in self._true(offsets))]

    def json(self, offsets: Iterable[str]) -> list[dict[str, Any]]:
        """The machine-readable form of `facts`."""
        listed = [used.json() for used in self.used[:LISTED_TOUCH_OFFS]]
        return [*listed, *({"work_offset": name, "obtained": "true"} for name in self._true(offsets))]

    def _true(self, offsets: Iterable[str]) -> list[str]:
        return [name for name in offsets if name not in NO_OFFSET and not self.setup.datum(name).probed]
