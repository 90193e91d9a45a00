"""What no cause of the library explains: which variables it depends on, and which causes were only blamed for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import linalg

from calibration.diagnosis.dependence import Unexplained, explaining_variables
from calibration.diagnosis.frame import Frame
from calibration.diagnosis.selection import Accepted, Stage
from calibration.diagnosis.whiteness import Columns, Test, whiteness
from calibration.measurement import Measurement
from calibration.models import moving_axes
from kinematics.effects import Effect
from kinematics.transforms import Array

IMPOSTOR = 1.0
"""A cause that explains less than this multiple of what is left of its own variables is none."""
SEED = 1


class Remainder(NamedTuple):
    """What a stage leaves."""

    tests: tuple[Test, ...]
    """Of its residuals."""
    unexplained: Unexplained | None
    """Of all tests together significant, and a function of these variables."""


def tests(frame: Frame) -> list[Test]:
    """Whether the residuals of a frame are white, with what the fit took out of them taken into account."""
    measurement, rows = frame.measurement, frame.rows
    state, machine = measurement.state, measurement.machine
    moving = list(moving_axes(measurement))
    where = {axis: state.position(machine, axis)[rows] for axis in moving}
    side = {} if state.approach is None else {axis: state.approach[rows, machine.index(axis)] for axis in moving}
    columns = Columns(
        None if state.time is None else state.time[rows],
        where,
        side,
        None if measurement.run is None else measurement.run[rows],
        None if state.station is None else state.station[rows],
        {name: kelvin[rows] for name, kelvin in state.temperatures.items()},
    )
    absorbed = linalg.solve_triangular(frame.factor[0], frame.design.T, lower=True).T
    white = frame.residual.reshape(len(rows), -1)
    return whiteness(white, columns, absorbed=absorbed)


def variables(measurement: Measurement, rows: np.ndarray) -> dict[str, Array]:
    """What the residuals may depend on, `(n,)` each: axes, time, temperatures, feed, directions."""
    state, machine = measurement.state, measurement.machine
    moving = list(moving_axes(measurement))
    found = {axis: state.position(machine, axis)[rows] for axis in moving}
    if state.time is not None:
        found["time"] = state.time[rows]
    found |= {f"temperature {name}": kelvin[rows] for name, kelvin in state.temperatures.items()}
    if measurement.feed is not None:
        found["feed"] = measurement.feed[rows]
    if state.approach is not None:
        found |= {f"direction of {axis}": state.approach[rows, machine.index(axis)] for axis in moving}
    return {name: column for name, column in found.items() if np.ptp(column) > 0}


def unexplained(frame: Frame) -> Unexplained | None:
    """A smooth function that explains the residuals of a frame, and its variables; None where there is none."""
    white = frame.residual.reshape(len(frame.rows), -1)
    return explaining_variables(white, variables(frame.measurement, frame.rows), np.random.default_rng(SEED))


def impostors(stage: Stage, numbers: Sequence[int], left: Unexplained) -> list[Accepted]:
    """Accepted causes of the very variables of what is left, that explain less than that: its form is not theirs."""
    components = stage.frame.measurement.instrument.components
    energy = left.rms**2 * len(stage.frame.rows) * components
    found = []
    for each, number in zip(stage.accepted, numbers, strict=True):
        without = stage.frame.without(number)
        own = without.projected(without.columns(each.candidate.effect))
        explains = float(each.size @ own.left @ each.size)
        if set(depends_on(each.candidate.effect)) <= set(left.variables) and explains < IMPOSTOR * energy:
            found.append(each)
    return found


def depends_on(effect: Effect) -> list[str]:
    """Names of the variables that an effect is a function of."""
    found = [
        axis for axis in effect.axes if effect.kind not in ("backlash", "settling", "following-error", "first-cycle")
    ]
    if "time" in effect.needs:
        found.append("time")
    sensor = getattr(effect, "sensor", None)
    return [*found, *([f"temperature {sensor}"] if sensor else []), *_other(effect)]


def _other(effect: Effect) -> list[str]:
    """What is no function of positions, time and temperatures alone."""
    if effect.kind == "backlash":
        return [f"direction of {effect.axes[0]}"]
    plain = ("error-motion", "location", "cross-axis", "cyclic", "quantised-compensation", "racking", "wobble")
    thermal = ("thermal-drift", "thermal-scale", "thermal-drift-sensor", "thermal-scale-sensor")
    return [] if effect.kind in (*plain, *thermal) else [effect.name]
