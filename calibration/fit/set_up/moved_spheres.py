"""Spheres of a touch probe that moved during the measurement, by a fit of coarse bases.

Bases that the evidence chooses would take up the step: they become finer, until the rows are too few for them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calibration.fit.fit import Fit
from calibration.fit.set_up.explained import coarse_fit
from calibration.measurement.measurement import Measurement
from calibration.plausibility.finding import Finding
from calibration.plausibility.spheres import moment
from kinematics.effects import Component, ThermalDrift
from kinematics.transforms import Array
from kinematics.user_error import UserError

DIRECTIONS: tuple[Component, ...] = ("X", "Y", "Z")
ROWS_ON_EACH_SIDE = 2
"""Least number of rows of a sphere before and behind its move; a single row is an outlier."""
EXAMINED_LOG_GAIN = 30.0
"""Gain in the logarithm of the likelihood from which a step is looked at."""
LEAST_STEP_RMS = 5.0
"""Least step, in units of the RMS residual."""
LARGEST_SECOND_STEP = 0.35
"""Largest second step, as a share of the first: a drift has steps of half its size before and behind each moment."""
NEAR = 1
"""Rows about the clearest moment that are tried too."""
LIKELIER = 4.0
"""Factor by which the residuals of a drift of the tool must exceed those of a step, in squares."""
TOGETHER_MOVE_SHARE = 0.5
"""Least move of a sphere, as a share of the largest, where all spheres count as moved together."""


class _Step(NamedTuple):
    """Spheres that moved, and the first row behind it."""

    spheres: tuple[str, ...]
    first: int


def moved_findings(measurement: Measurement, *, force: bool) -> list[Finding]:
    """The finding that a sphere moved; UserError without `force`."""
    moved = moved_spheres(measurement)
    if moved and not force:
        raise UserError(f"{measurement.source}: {moved}; --force fits the rows as they are")
    return [Finding("spheres", moved, False)] if moved else []


def moved_spheres(measurement: Measurement) -> str:
    """Statement, without a full stop, of the spheres that moved, by how much, and before which row; empty for none."""
    if not measurement.instrument.FINDS_CENTRES:
        return ""
    found = coarse_fit(measurement)
    tried = [(step, coarse_fit(_renamed(measurement, step))) for step in _steps(found)]
    tried = [(step, after) for step, after in tried if _together(_sizes(after, step))]
    if not tried:
        return ""
    # a row that another step leaves out counts as well, as far as a step does
    most = LEAST_STEP_RMS * min(each.rms_um for _, each in tried)
    step, after = min(tried, key=lambda each: float(np.sum(np.minimum(each[1].residual_um, most) ** 2)))
    kept, sizes = after.kept, _sizes(after, step)
    gain = 0.5 * kept.sum() * found.residual.shape[1] * np.log(_squares(found, kept) / _squares(after, kept))
    size = float(sizes.max())
    if (
        gain < EXAMINED_LOG_GAIN
        or 1e3 * size < LEAST_STEP_RMS * after.rms_um
        or _second(after, step) > LARGEST_SECOND_STEP * size
    ):
        return ""
    if _squares(_with_drift(measurement), kept) < LIKELIER * _squares(after, kept):
        return ""
    one = len(step.spheres) == 1
    names = f"sphere {step.spheres[0]}" if one else f"spheres {', '.join(step.spheres)}"
    lengths = ", ".join(f"{1e3 * length:.0f}" for length in sizes)
    cause = "its clamping is loose" if one else "the table, the clamping or the probe was knocked"
    # the name in its own file: joined files add theirs
    other = f"{step.spheres[0].rpartition(':')[2]}b"
    return (
        f"{names} moved by {lengths} um before {measurement.where(step.first)}: {cause}. Measure again, or give "
        f"{'it' if one else 'each'} another name from this row on, such as {other} with its header line # sphere."
        f"{other}:"
    )


def _steps(found: Fit) -> Iterator[_Step]:
    """Steps of each sphere, of all of one file, and of all together, that are clear in the residuals of a fit."""
    groups, file = found.measurement.groups, found.measurement.file
    names = np.unique(groups).tolist()
    by_file = [] if file is None else [tuple(np.unique(groups[file == own]).tolist()) for own in np.unique(file)]
    several = [spheres for spheres in dict.fromkeys([*by_file, tuple(names)]) if len(spheres) > 1]
    for spheres in [*((name,) for name in names), *several]:
        rows = np.flatnonzero(np.isin(groups, spheres))
        if len(rows) < 2 * ROWS_ON_EACH_SIDE * len(spheres):
            continue
        residual = found.residual[rows]
        first, removed = moment(residual, ROWS_ON_EACH_SIDE * len(spheres))
        left = float(np.sum((residual - residual.mean(axis=0)) ** 2)) - removed
        if 0.5 * residual.size * np.log1p(removed / max(left, 1e-300)) > EXAMINED_LOG_GAIN / 3.0:
            # error motions take up a part of the step, which may shift it by a row
            for near in range(
                max(first - NEAR, ROWS_ON_EACH_SIDE), min(first + NEAR, len(rows) - ROWS_ON_EACH_SIDE) + 1
            ):
                yield _Step(spheres, int(rows[near]))


def _renamed(measurement: Measurement, step: _Step) -> Measurement:
    """The measurement with other names of the spheres from a row on."""
    station = measurement.groups.astype(object)
    behind = np.isin(measurement.groups, step.spheres) & (np.arange(len(station)) >= step.first)
    station[behind] = [_moved(name) for name in station[behind]]
    return replace(measurement, state=replace(measurement.state, station=station.astype(str)))


def _moved(name: str) -> str:
    return f"{name} moved"


def _sizes(found: Fit, step: _Step) -> Array:
    """Lengths `(spheres,)` of the moves of the spheres that have rows before and behind, mm."""
    centres = found.registration.sphere_centres
    both = [name for name in step.spheres if name in centres and _moved(name) in centres]
    return np.array([np.linalg.norm(centres[_moved(name)] - centres[name]) for name in both])


def _together(sizes: Array) -> bool:
    """True where all moves are alike: otherwise some of the spheres did not move."""
    return len(sizes) > 0 and bool(sizes.min() > TOGETHER_MOVE_SHARE * sizes.max())


def _second(found: Fit, step: _Step) -> float:
    """The largest step, mm, that is left before or behind the moment."""
    largest = 0.0
    for names in (step.spheres, tuple(map(_moved, step.spheres))):
        rows = np.flatnonzero(np.isin(found.measurement.groups, names) & found.kept)
        if len(rows) < 2 * ROWS_ON_EACH_SIDE:
            continue
        largest = max(largest, _step_in(found.residual[rows], ROWS_ON_EACH_SIDE)[2])
    return largest


def _step_in(residual: Array, least: int) -> tuple[int, float, float]:
    """The first row behind the clearest step of residuals `(n, 3)`, the squares that it explains, and its length, mm.

    least: number of rows from both ends.
    """
    first, removed = moment(residual, least)
    return first, removed, float(np.linalg.norm(residual[first:].mean(axis=0) - residual[:first].mean(axis=0)))


def _with_drift(measurement: Measurement) -> Fit:
    """The coarse fit with a drift of the tool point, linear and exponential; rows without a time count evenly."""
    time = measurement.state.time
    if time is None:
        time = 60.0 * np.arange(len(measurement), dtype=float)
    timed = replace(measurement, state=replace(measurement.state, time=time - time[0]))
    constant = max(float(time[-1] - time[0]) / 3.0, 1.0)
    drifts = [ThermalDrift(c, rate=0.0, amplitudes=(1.0,), time_constants_s=(constant,)) for c in DIRECTIONS]
    return coarse_fit(timed, drifts)


def _squares(found: Fit, rows: np.ndarray) -> float:
    return float(np.sum(found.residual[rows] ** 2))
