"""Mistakes in the recording of a measurement: each one reversed, and the resulting fit of the points.

No model of the machine's errors is needed: the nominal machine is registered to the points as recorded, and to the
points without the mistake. Only mistakes of points are considered: of a tracker, a part or a touch probe.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from calibration.measurement.instruments import Ballbar, TouchProbe
from calibration.measurement.measurement import STANDSTILL, Measurement, Target
from calibration.measurement.observed_points import carried, derivatives_by_positions, target_points
from calibration.measurement.registration import Registration
from calibration.observation.equations import along_bar
from calibration.observation.normal_equations import residuals
from calibration.observation.outliers import first_registration
from kinematics.error_model.model import no_errors
from kinematics.machine import Vector
from kinematics.transforms import Array

FALLS = 5.0
"""Factor by which the residual must fall when a mistake is reversed."""
PLAUSIBLE = 1.0
"""Largest RMS residual of the nominal machine in data without a mistake, mm."""
TIED = 2.0
"""Factor of the residuals up to which two mistakes cannot be distinguished."""
FACTORS = {25.4: "inch and mm", 1 / 25.4: "inch and mm", 1e3: "m, mm or um", 1e-3: "m, mm or um"}
"""Factors of wrong units, and the units that were confused."""
NEAR = 5e-3
"""Largest relative difference of a scale from one of these factors."""
SCALE = 1e-3
"""Relative scale error above which the cause is not the machine."""
ROUNDS = 8
"""Largest number of iterations of the registration and the position of a target."""
TRIMMED = 50
"""One row of so many, at least one, is ignored as a possible outlier."""


SOME = 0.1
"""Least share of the rows of two targets that are exchanged at a moment, or are not."""


class Alternative(NamedTuple):
    """A measurement with one mistake reversed."""

    mistake: str
    """Kind of mistake."""
    by: str
    """Description of the reversal: `with columns X and Y exchanged`."""
    measurement: Measurement


def alternatives(measurement: Measurement) -> Iterator[Alternative]:
    """The measurement with each mistake reversed in turn, also mistakes that the data cannot distinguish."""
    yield from _units(measurement)
    yield from _signs(measurement)
    yield from _axes(measurement)
    yield from _targets(measurement)


def _signs(measurement: Measurement) -> Iterator[Alternative]:
    """Points of a left-handed frame; for the readings of an R-test see `calibration.plausibility.r_test`."""
    if isinstance(measurement.instrument, TouchProbe):
        return
    mirrored = measurement.observed * np.append(-1.0, np.ones(measurement.instrument.components - 1))
    yield Alternative(
        "mirrored", "with the points' frame mirrored (left-handed as it is)", replace(measurement, observed=mirrored)
    )


def misfit(measurement: Measurement) -> tuple[Array, Registration]:
    """Residuals `(n, d)`, mm and rad, of the nominal machine, and its registration, robust to gross errors."""
    registration, _ = first_registration(measurement)
    return residuals(measurement, no_errors(measurement.machine), registration), registration


def worst_rms(measurement: Measurement, residual: Array) -> float:
    """Largest RMS length, mm, of residuals `(n, d)`: of all rows, and of each target and station with several rows."""
    lengths, parts = np.linalg.norm(residual, axis=1), [np.ones(len(residual), bool)]
    for names in (measurement.target_number, measurement.groups):
        parts += [names == name for name in np.unique(names).tolist()]
    return max(trimmed_rms(lengths[part]) for part in parts if part.sum() > 3 or part.all())


def trimmed_rms(lengths: Array) -> float:
    """RMS of lengths `(n,)` without the largest ones."""
    spared = max(len(lengths) // TRIMMED, 1) if len(lengths) > 3 else 0
    return float(np.sqrt(np.mean(np.sort(lengths)[: len(lengths) - spared] ** 2)))


def by_axes(measurement: Measurement, registration: Registration) -> Array:
    """Derivatives `(n, d, axes)` of the observations with respect to the axis positions, per mm and rad."""
    if measurement.axis is not None:
        own = np.equal(measurement.axis[:, None], np.array(measurement.machine.names))
        return np.asarray((own & measurement.positioning[:, None])[:, None, :], float)
    slopes = registration.rotations(measurement) @ derivatives_by_positions(measurement, registration.tool(measurement))
    if isinstance(measurement.instrument, Ballbar):
        return along_bar(measurement, registration)[:, None] @ slopes
    return np.asarray(slopes[:, : measurement.instrument.components])


def _units(measurement: Measurement) -> Iterator[Alternative]:
    """Points or linear axes in another unit; points in any other scale."""
    scale = _scale(measurement)
    if scale is not None and abs(scale - 1.0) > SCALE and all(abs(scale / known - 1.0) > NEAR for known in FACTORS):
        by = f"with the points divided by {scale:.6g} (a scale {100 * (scale - 1):+.3g} % off)"
        yield Alternative("units", by, replace(measurement, observed=measurement.observed / scale))
    for factor, mixed in FACTORS.items():
        by = f"with the points divided by {factor:.6g} ({mixed} mixed up)"
        yield Alternative("units", by, replace(measurement, observed=measurement.observed / factor))
        by = f"with the commands of linear axes multiplied by {factor:.6g} ({mixed} mixed up)"
        linear = np.where(measurement.machine.rotary, 1.0, factor)
        # shorter moves leave smaller residuals of spheres, also where they are wrong
        if factor > 1.0 or not isinstance(measurement.instrument, TouchProbe) or _beyond_travel(measurement):
            yield Alternative("units", by, _with_positions(measurement, measurement.state.positions * linear))


def _beyond_travel(measurement: Measurement) -> bool:
    """True where a linear axis moves farther than its travel."""
    machine = measurement.machine
    far = np.ptp(measurement.state.positions, axis=0) > np.ptp(machine.travel, axis=0)
    return bool(np.any(far & ~machine.rotary))


def _scale(measurement: Measurement) -> float | None:
    """Ratio of the distances between points to the commanded ones; None if there are none."""
    if isinstance(measurement.instrument, TouchProbe):  # its readings are no coordinates
        return None
    points = target_points(measurement, None, measurement.tool)[:, : measurement.instrument.components]
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


def _axes(measurement: Measurement) -> Iterator[Alternative]:
    """Columns of axes that are exchanged, of wrong sign, or in rad; mm read as degrees and the reverse."""
    machine, q = measurement.machine, measurement.state.positions
    moving = np.flatnonzero(np.ptp(q / machine.scale, axis=0) > STANDSTILL).tolist()
    for i, j in combinations(moving, 2):
        if machine.rotary[i] == machine.rotary[j]:
            order = np.arange(q.shape[1])
            order[[i, j]] = j, i
            by = f"with columns {machine.names[i]} and {machine.names[j]} exchanged"
            yield Alternative("axes", by, _with_positions(measurement, q[:, order]))
        elif isinstance(measurement.instrument, TouchProbe):
            exchanged = q / machine.scale
            exchanged[:, [i, j]] = exchanged[:, [j, i]]
            by = f"with columns {machine.names[i]} and {machine.names[j]} exchanged (mm and degrees)"
            yield Alternative("axes", by, _with_positions(measurement, exchanged * machine.scale))
    for i in moving:
        signs = np.where(np.arange(q.shape[1]) == i, -1.0, 1.0)
        yield Alternative(
            "sign", f"with the sign of {machine.names[i]} reversed", _with_positions(measurement, q * signs)
        )
    rotary = [i for i in moving if machine.rotary[i]]
    for some in ([rotary] if len(rotary) > 1 else []) + [[i] for i in rotary]:
        names = " and ".join(machine.names[i] for i in some)
        for factor, by in ((180.0 / np.pi, "read as rad"), (np.pi / 180.0, "turned into degrees once less")):
            factors = np.where(np.isin(np.arange(q.shape[1]), some), factor, 1.0)
            yield Alternative("degrees", f"with {names} {by}", _with_positions(measurement, q * factors))


def _targets(measurement: Measurement) -> Iterator[Alternative]:
    """Targets on the tool that are exchanged or of wrong sign."""
    own = {name: target for name, target in measurement.targets.items() if target.known}
    for one, other in combinations(own, 2):
        changed = {one: own[other], other: own[one]}
        yield Alternative("targets", f"with targets {one} and {other} exchanged", _with_targets(measurement, changed))
        yield from _exchanged_at_a_moment(measurement, one, other)
    for name, target in own.items():
        for letter, signs in (("", (-1, -1, -1)), ("x", (-1, 1, 1)), ("y", (1, -1, 1)), ("z", (1, 1, -1))):
            turned = {name: _turned(target, signs)}
            by = f"with the sign of {f'{letter} of ' if letter else ''}target {name} reversed"
            yield Alternative("targets", by, _with_targets(measurement, turned))
    if len(own) > 1:
        for letter, signs in (("x y z", (-1, -1, -1)), ("z", (1, 1, -1))):
            turned = {name: _turned(target, signs) for name, target in own.items()}
            yield Alternative(
                "targets", f"with the sign of {letter} of all targets reversed", _with_targets(measurement, turned)
            )


def _exchanged_at_a_moment(measurement: Measurement, one: str, other: str) -> Iterator[Alternative]:
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
            yield Alternative("targets", f"with targets {one} and {other} exchanged {words}", other_names)


def misplaced(measurement: Measurement) -> Iterator[Alternative]:
    """Each target on the tool at the position that follows from the points, with the others as given in the file.

    Any position is allowed, so that other mistakes can imitate this one: it is tried after `alternatives`. Points of
    one target show its position to a touch probe only, whose spheres do not turn with an instrument.
    """
    own = {name: target for name, target in measurement.targets.items() if target.known}
    if len(own) < 2 and not isinstance(measurement.instrument, TouchProbe):
        return
    for name, target in own.items():
        other = measurement
        for _ in range(ROUNDS):
            residual, registration = misfit(other)
            rows = measurement.target_number == list(measurement.targets).index(name)
            directions = (registration.rotations(other) @ carried(other))[rows, : residual.shape[1]]
            off = residual[rows]
            if isinstance(measurement.instrument, TouchProbe):  # the centres of the spheres follow the tip
                groups = measurement.groups[rows]
                directions, off = _less_means(groups, directions), _less_means(groups, off)
            shift, *_ = np.linalg.lstsq(directions.reshape(-1, 3), off.reshape(-1), rcond=None)
            x, y, z = np.array(other.targets[name].position) + shift
            position: Vector = (float(x), float(y), float(z))
            other = _with_targets(other, {name: replace(target, position=position)})
        moved = np.linalg.norm(np.array(position) - target.position)
        by = f"with target {name} at {_mm(position)} instead of {_mm(target.position)}, {moved:.3g} mm away"
        if isinstance(measurement.instrument, TouchProbe):
            by += " (or with the lines of all rotary axes displaced alike: check the machine's file)"
        yield Alternative("targets", by, other)


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


def _with_positions(measurement: Measurement, positions: Array) -> Measurement:
    return replace(measurement, state=replace(measurement.state, positions=positions))


def _with_targets(measurement: Measurement, changed: dict[str, Target]) -> Measurement:
    return replace(measurement, targets={**measurement.targets, **changed})


def _with_names(measurement: Measurement, target: np.ndarray) -> Measurement:
    """The measurement with other names of targets by row."""
    return replace(measurement, state=replace(measurement.state, target=target))


def centred(measurement: Measurement, values: Array) -> Array:
    """Values `(n, d)` minus the mean of their registration group."""
    _, group = np.unique(measurement.groups, return_inverse=True)
    sums = np.zeros((group.max() + 1, values.shape[1]))
    np.add.at(sums, group, values)
    return np.asarray(values - (sums / np.bincount(group)[:, None])[group])
