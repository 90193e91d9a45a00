"""Change of a machine since its present calibration: one figure over the measured volume, and lines by ISO 230-1.

The figure is the RMS of the difference of the deviations that the new model and the present one predict, at the
measured states and in the directions that the instrument measures, less the shift and the rotation of the workpiece
that clamping and probing compensate. Its uncertainty is that of the difference; both models count as independent, which
makes it rather too large for the same machine.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.evaluation.volumetric import rigid_columns
from calibration.fit.datum import line_at_centre, split_locations
from calibration.fit.linear import column_space
from calibration.measurement.measurement import Measurement
from kinematics.deviation import UM_PER_MM, exact_deviation
from kinematics.effects import Effect, Scale
from kinematics.effects.base import own_component, own_motion
from kinematics.error_model.effect_sums import Design
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.machine import Machine
from kinematics.transforms import Array

MOST_CHANGE_STATES = 400
"""Largest number of states, evenly spread, at which both models are compared."""
CHANGED = 2.0
"""Standard uncertainties from which a difference is a change."""
DETERMINED = 1e-12


@dataclass(frozen=True)
class MachineChange:
    """Difference between the new model of a machine and its present calibration."""

    rms_um: float
    """RMS length of the difference of the deviations."""
    max_um: float
    """Largest length."""
    u_um: float
    """RMS standard uncertainty of the difference, k = 1: the figure that the uncertainties alone would give."""
    lines: tuple[Effect, ...]
    """Differences of the location errors and scales of all axes, with their standard uncertainties."""
    moved_um: tuple[float, ...]
    """RMS length, um, of the displacement by each of them."""

    @property
    def significant(self) -> bool:
        """True where the difference exceeds its uncertainty."""
        return self.rms_um > CHANGED * self.u_um

    @property
    def changed(self) -> list[Effect]:
        """The differences of lines that exceed their uncertainty, the clearest first."""
        clear = [line for line in self.lines if abs(line.parameters[0]) > CHANGED * line.uncertainties[0]]
        return sorted(clear, key=lambda line: -abs(line.parameters[0]) / max(line.uncertainties[0], 1e-300))


def machine_change(measurement: Measurement, kept: np.ndarray, present: ErrorModel, new: ErrorModel) -> MachineChange:
    """The change of a machine from the calibration `present` to `new`; kept: mask `(n,)` of the states that count."""
    machine = measurement.machine
    rows = np.flatnonzero(kept)
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), MOST_CHANGE_STATES)).astype(int)]
    some = measurement.rows(rows)
    q, tool = some.state.positions, some.tool
    seen = directions_seen(measurement)
    transform = error_transform_with_tool(machine, q, tool)[:, :seen]
    rigid = column_space(_seen(rigid_columns(tool_point(machine, q, tool)), seen), DETERMINED)

    def predicted(model: ErrorModel) -> tuple[Array, Array]:
        """Deviations `(seen n,)` and their variances, um, a rigid motion apart."""
        own = model.part(lambda effect: effect.ACTS_ON != "instrument")
        errors = own.errors(machine, measurement.state)[rows]
        deviation = _seen(exact_deviation(machine, q, errors, tool).position.reshape(-1, 1), seen)
        design = Design(own.effects, machine, measurement.state, with_instrument=False).of(rows, transform)
        apart = rigid.removed(design.reshape(len(deviation), -1)).reshape(design.shape)
        return rigid.removed(deviation)[:, 0] * UM_PER_MM, (own.propagated(apart).reshape(-1) * UM_PER_MM) ** 2

    def moved(line: Effect) -> float:
        alone = msgspec.structs.replace(no_errors(machine), effects=(line,))
        columns = alone.design(machine, some.state, transform).reshape(-1, 1) * line.parameters[0]
        return float(np.linalg.norm(rigid.removed(columns)) / np.sqrt(len(rows))) * UM_PER_MM

    lines = tuple(_differences(machine, present, new, some.arms))
    (now, u_now), (before, u_before) = predicted(new), predicted(present)
    squares = np.sum((now - before).reshape(-1, seen) ** 2, axis=1)
    return MachineChange(
        float(np.sqrt(squares.mean())),
        float(np.sqrt(squares.max())),
        float(np.sqrt((u_now + u_before).sum() / len(rows))),
        lines,
        tuple(moved(line) for line in lines),
    )


def directions_seen(measurement: Measurement) -> int:
    """Number of the directions x, y, z in which the instrument observes the tool: of a part in a plane two."""
    return 2 if measurement.instrument.planar else 3


def _seen(columns: Array, directions: int) -> Array:
    """Columns `(directions n, k)` of the first directions among columns `(3 n, k)` in x, y and z."""
    return columns.reshape(-1, 3, columns.shape[1])[:, :directions].reshape(-1, columns.shape[1])


class _Size(NamedTuple):
    """A location error or scale of a model."""

    effect: Effect
    value: float
    variance: float


def _differences(machine: Machine, present: ErrorModel, new: ErrorModel, arms: Mapping[str, Array]) -> Iterator[Effect]:
    """Differences of the lines at the measured points, whose `arms` are those of `arms_of`."""
    before = {size.effect.name: size for size in _sizes(machine, present, arms)}
    for size in _sizes(machine, new, arms):
        _, value, variance = before.get(size.effect.name, _Size(size.effect, 0.0, 0.0))
        u = float(np.sqrt(size.variance + variance))
        yield size.effect.with_parameters((size.value - value,), (u,))


def _sizes(machine: Machine, model: ErrorModel, arms: Mapping[str, Array]) -> Iterator[_Size]:
    """Location errors of a model, those in its error motions too, and the scales of its linear axes."""
    if not model.effects:
        return
    functions: dict[str, tuple[Effect, Array]] = {}

    def add(effect: Effect, row: Array) -> None:
        before = functions[effect.name][1] if effect.name in functions else 0.0
        functions[effect.name] = effect, before + row

    located, matrix = split_locations(machine, model, arms)
    for effect, row in zip(located[: len(located) - len(model.effects)], matrix, strict=False):
        add(effect, row)
    for effect, part in zip(model.effects, model.slices, strict=True):
        if effect.OF_AXIS_LINE:
            add(effect, np.eye(len(model.parameters))[part.start])
    for motion, _ in model.error_motions:
        if motion.axis[0] not in "ABC" and motion.component == own_component(motion.axis):
            row = line_at_centre(model, motion, arms).slope * own_motion(machine, motion.axis)[2] * UM_PER_MM
            add(Scale(motion.axis, 0.0), row)
    for effect, row in functions.values():
        u = float(model.propagated(row[None, None])[0, 0])
        yield _Size(effect, float(row @ model.parameters), u**2)
