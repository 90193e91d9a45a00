"""Mistakes in the recording of points, each reversed: of a tracker, a part or a touch probe.

Each function gives every way to reverse one kind of mistake: words, and the measurement with it reversed, also where
the data cannot distinguish it from others. For the comparison of them see `calibration.plausibility.mistakes`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from calibration.measurement.measurement import STANDSTILL_RANGE, Measurement, Target
from calibration.observation.normal_equations import residuals
from calibration.plausibility.misfit import misfit
from calibration.registration.observed_points import carried
from kinematics.error_model.model import no_errors
from kinematics.machine import Vector
from kinematics.transforms import Array

Reversed = Iterator[tuple[str, Measurement]]
"""Each way to reverse a mistake: words, `with columns X and Y exchanged`, and the measurement with it reversed."""

FACTORS = {25.4: "inch and mm", 1 / 25.4: "inch and mm", 1e3: "m, mm or um", 1e-3: "m, mm or um"}
"""Factors of wrong units, and the units that were confused."""
SCALE_DIFFERENCE = 5e-3
"""Largest relative difference of a scale from one of these factors."""
LARGEST_MACHINE_SCALE = 1e-3
"""Relative scale error above which the cause is not the machine."""
MOST_MISTAKE_ROUNDS = 8
"""Largest number of iterations of the registration and the position of a target."""
SOME = 0.1
"""Least share of the rows of two targets that are exchanged at a moment, or are not."""


def other_units(measurement: Measurement) -> Reversed:
    """Points or linear axes in another unit; points in any other scale."""
    scale = _scale(measurement)
    if (
        scale is not None
        and abs(scale - 1.0) > LARGEST_MACHINE_SCALE
        and all(abs(scale / known - 1.0) > SCALE_DIFFERENCE for known in FACTORS)
    ):
        by = f"with the points divided by {scale:.6g} (a scale {100 * (scale - 1):+.3g} % off)"
        yield by, replace(measurement, observed=measurement.observed / scale)
    for factor, mixed in FACTORS.items():
        by = f"with the points divided by {factor:.6g} ({mixed} mixed up)"
        yield by, replace(measurement, observed=measurement.observed / factor)
        by = f"with the commands of linear axes multiplied by {factor:.6g} ({mixed} mixed up)"
        linear = np.where(measurement.machine.rotary, 1.0, factor)
        # shorter moves leave smaller residuals of spheres, also where they are wrong
        if factor > 1.0 or not measurement.instrument.FINDS_CENTRES or _beyond_travel(measurement):
            yield by, with_positions(measurement, measurement.state.positions * linear)


def _beyond_travel(measurement: Measurement) -> bool:
    """True where a linear axis moves farther than its travel."""
    machine = measurement.machine
    far = np.ptp(measurement.state.positions, axis=0) > np.ptp(machine.travel, axis=0)
    return bool(np.any(far & ~machine.rotary))


def _scale(measurement: Measurement) -> float | None:
    """Ratio of the distances between points to the commanded ones; None if there are none."""
    if not measurement.instrument.COORDINATES:
        return None
    points = measurement.nominal_points[:, : measurement.instrument.components]
    nominal_spread, observed_spread = _spread(measurement, points), _spread(measurement, measurement.observed)
    if min(nominal_spread, observed_spread) <= 0.0:
        return None
    scale = observed_spread / nominal_spread
    for _ in range(3):
        scaled = replace(measurement, observed=measurement.observed / scale)
        residual, _ = misfit(scaled)
        there = _centred(measurement, scaled.observed - residual)
        observed_centred, lengths = _centred(measurement, scaled.observed), np.linalg.norm(residual, axis=1)
        good = lengths <= 3.0 * np.median(lengths)
        scale *= float(np.sum(observed_centred[good] * there[good]) / np.sum(there[good] ** 2))
    return scale if scale > 0.0 else None


def _spread(measurement: Measurement, points: Array) -> float:
    """Median distance, mm, of points `(n, d)` from the median of their station."""
    return float(np.median(np.linalg.norm(_centred(measurement, points), axis=1)))


def _centred(measurement: Measurement, values: Array) -> Array:
    """Values `(n, d)` minus the median of their station."""
    result, groups = values.copy(), measurement.groups
    for group in np.unique(groups).tolist():
        result[groups == group] -= np.median(values[groups == group], axis=0)
    return result


def mirrored_points(measurement: Measurement) -> Reversed:
    """Points of a left-handed frame; for the readings of an R-test see `TouchProbe.other_readings`."""
    mirrored = measurement.observed * np.append(-1.0, np.ones(measurement.instrument.components - 1))
    yield "with the points' frame mirrored (left-handed as it is)", replace(measurement, observed=mirrored)


def _moving(measurement: Measurement) -> list[int]:
    """Numbers of the axes that move."""
    q = measurement.state.positions / measurement.machine.scale
    return np.flatnonzero(np.ptp(q, axis=0) > STANDSTILL_RANGE).tolist()


def exchanged_axes(measurement: Measurement) -> Reversed:
    """Columns of two axes exchanged; of a linear and a rotary one for a touch probe only."""
    machine = measurement.machine
    for i, j in combinations(_moving(measurement), 2):
        alike = machine.rotary[i] == machine.rotary[j]
        if alike or measurement.instrument.FINDS_CENTRES:
            scale = np.ones(len(machine.axes)) if alike else machine.scale
            exchanged = measurement.state.positions / scale
            exchanged[:, [i, j]] = exchanged[:, [j, i]]
            by = f"with columns {machine.names[i]} and {machine.names[j]} exchanged"
            yield by if alike else f"{by} (mm and degrees)", with_positions(measurement, exchanged * scale)


def reversed_axes(measurement: Measurement) -> Reversed:
    """The column of an axis of wrong sign."""
    for i in _moving(measurement):
        yield f"with the sign of {measurement.machine.names[i]} reversed", _with_factor(measurement, [i], -1.0)


def other_angles(measurement: Measurement) -> Reversed:
    """Columns of rotary axes, all and single ones, in rad, or turned into degrees twice."""
    machine = measurement.machine
    rotary = [i for i in _moving(measurement) if machine.rotary[i]]
    for some in ([rotary] if len(rotary) > 1 else []) + [[i] for i in rotary]:
        names = " and ".join(machine.names[i] for i in some)
        yield f"with {names} read as rad", _with_factor(measurement, some, 180.0 / np.pi)
        yield f"with {names} turned into degrees once less", _with_factor(measurement, some, np.pi / 180.0)


def exchanged_targets(measurement: Measurement) -> Reversed:
    """Two targets on the tool exchanged, in all rows, or up to a row, or from one on."""
    own = known_targets(measurement)
    for one, other in combinations(own, 2):
        changed = {one: own[other], other: own[one]}
        yield f"with targets {one} and {other} exchanged", _with_targets(measurement, changed)
        yield from _exchanged_at_a_moment(measurement, one, other)


def turned_targets(measurement: Measurement) -> Reversed:
    """Targets on the tool of wrong sign, single ones and all."""
    own = known_targets(measurement)
    for name, target in own.items():
        for letter, signs in (("", (-1, -1, -1)), ("x", (-1, 1, 1)), ("y", (1, -1, 1)), ("z", (1, 1, -1))):
            by = f"with the sign of {f'{letter} of ' if letter else ''}target {name} reversed"
            yield by, _with_targets(measurement, {name: _turned(target, signs)})
    if len(own) > 1:
        for letter, signs in (("x y z", (-1, -1, -1)), ("z", (1, 1, -1))):
            turned = {name: _turned(target, signs) for name, target in own.items()}
            yield f"with the sign of {letter} of all targets reversed", _with_targets(measurement, turned)


def known_targets(measurement: Measurement) -> dict[str, Target]:
    """Targets whose positions on the tool the file states, by name."""
    return {name: target for name, target in measurement.targets.items() if target.known}


def _exchanged_at_a_moment(measurement: Measurement, one: str, other: str) -> Reversed:
    """Two targets exchanged from a row on, or up to a row: where the exchange brings most, with the registration as it
    is.
    """
    target = measurement.state.target
    assert target is not None
    exchanged = np.where(target == one, other, np.where(target == other, one, target))
    changed = _with_names(measurement, exchanged)
    registration = misfit(measurement)[1]
    squares = [
        np.sum(residuals(each, no_errors(each.machine), registration) ** 2, axis=1) for each in (measurement, changed)
    ]
    gains, pair = np.cumsum(squares[0] - squares[1]), np.isin(target, (one, other))
    rows, total = np.arange(len(target)), int(pair.sum())
    for part, words in (
        (rows <= np.argmax(gains), f"up to {measurement.where(int(np.argmax(gains)))}"),
        (rows > np.argmin(gains), f"behind {measurement.where(int(np.argmin(gains)))}"),
    ):
        # almost none and almost all are other mistakes
        if SOME * total < np.count_nonzero(pair & part) < (1.0 - SOME) * total:
            other_names = _with_names(measurement, np.where(part, exchanged, target))
            yield f"with targets {one} and {other} exchanged {words}", other_names


def misplaced(measurement: Measurement) -> Reversed:
    """Each target on the tool at the position that follows from the points, with the others as given in the file.

    Any position is allowed, so that this one can imitate other mistakes. Points of
    one target show its position to a touch probe only, whose spheres do not turn with an instrument.
    """
    for name, target in known_targets(measurement).items():
        other = measurement
        for _ in range(MOST_MISTAKE_ROUNDS):
            residual, registration = misfit(other)
            rows = measurement.target_number == list(measurement.targets).index(name)
            directions = (registration.rotations(other) @ carried(other))[rows, : residual.shape[1]]
            off = residual[rows]
            if measurement.instrument.FINDS_CENTRES:  # the centres of the spheres follow the tip
                groups = measurement.groups[rows]
                directions, off = _less_means(groups, directions), _less_means(groups, off)
            shift, *_ = np.linalg.lstsq(directions.reshape(-1, 3), off.reshape(-1), rcond=None)
            x, y, z = np.array(other.targets[name].position) + shift
            position: Vector = (float(x), float(y), float(z))
            other = _with_targets(other, {name: replace(target, position=position)})
        moved = np.linalg.norm(np.array(position) - target.position)
        by = f"with target {name} at {_mm(position)} instead of {_mm(target.position)}, {moved:.3g} mm away"
        if measurement.instrument.FINDS_CENTRES:
            by += " (or with the lines of all rotary axes displaced alike: check the machine's file)"
        yield by, other


def _less_means(groups: np.ndarray, values: Array) -> Array:
    """Values `(n, ...)` minus the mean of their group `(n,)`."""
    result = values.copy()
    for group in np.unique(groups).tolist():
        result[groups == group] -= values[groups == group].mean(axis=0)
    return result


def _mm(position: Vector) -> str:
    return "(" + ", ".join(f"{value:.5g}" for value in position) + ") mm"


def _turned(target: Target, signs: tuple[int, int, int]) -> Target:
    x, y, z = (sign * value for sign, value in zip(signs, target.position, strict=True))
    position: Vector = (x, y, z)
    return replace(target, position=position)


def with_positions(measurement: Measurement, positions: Array) -> Measurement:
    """The measurement with other positions of the axes."""
    return replace(measurement, state=replace(measurement.state, positions=positions))


def _with_factor(measurement: Measurement, axes: list[int], factor: float) -> Measurement:
    """The measurement with positions of these axes multiplied by a factor."""
    factors = np.where(np.isin(np.arange(len(measurement.machine.axes)), axes), factor, 1.0)
    return with_positions(measurement, measurement.state.positions * factors)


def _with_targets(measurement: Measurement, changed: dict[str, Target]) -> Measurement:
    return replace(measurement, targets={**measurement.targets, **changed})


def _with_names(measurement: Measurement, target: np.ndarray) -> Measurement:
    """The measurement with other names of targets by row."""
    return replace(measurement, state=replace(measurement.state, target=target))
