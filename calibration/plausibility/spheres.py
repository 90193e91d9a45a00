"""Mistakes with the spheres of a touch probe: moved or exchanged between rows, or not where they are stated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from calibration.measurement.measurement import Measurement, Target
from calibration.plausibility.finding import Finding
from calibration.plausibility.misfit import centred, misfit
from calibration.plausibility.recording_mistakes import MOST_MISTAKE_ROUNDS, Reversed, with_positions
from calibration.registration.first import ASTRAY_MEDIANS
from calibration.registration.observed_points import carried
from kinematics.transforms import Array

DOUBTED_CENTRE_MM = 5.0
"""Distance of a sphere's centre from its stated position, mm, from which one of the two is doubted."""
NOTED_ZERO_RAD = np.deg2rad(0.01)
"""Least shift of the zero of a rotary axis, rad, that is noted: six times the expected tilts of lines."""
ZERO_SEEN_SHARE = 0.1
"""Share of the largest sensitivity to a rotary axis' zero, per rad, below which the spheres do not show one."""
LEAST_ROWS_AROUND_MOVE = 3
"""Least number of rows before and behind the moment at which a sphere moved."""


def moved_spheres(measurement: Measurement) -> Reversed:
    """The measurement with each sphere moved once, where this brings most with the other rows as they are."""
    residual, _ = misfit(measurement)
    for sphere in np.unique(measurement.groups).tolist():
        rows = np.flatnonzero(measurement.groups == sphere)
        if len(rows) < 2 * LEAST_ROWS_AROUND_MOVE:
            continue
        first = rows[moment(residual[rows])[0]]
        behind = rows[rows >= first]
        station = measurement.groups.astype(object)
        station[behind] = f"{sphere} moved"
        moved = replace(measurement, state=replace(measurement.state, station=station.astype(str)))
        shift = np.median(residual[behind], axis=0) - np.median(residual[rows[rows < first]], axis=0)
        by = f"with sphere {sphere} moved by {np.linalg.norm(shift):.3g} mm before {measurement.where(int(first))}"
        yield by, moved


def moved_tip(measurement: Measurement) -> Reversed:
    """The measurement with the single tip at another position from one row on, where this brings most.

    So it looks where a work offset or a tool length changes, or where the probe sits loose.
    """
    n = len(measurement)
    residual, registration = misfit(measurement)
    directions = (registration.rotations(measurement) @ carried(measurement))[:, : residual.shape[1]]
    off, gains = centred(measurement, residual).reshape(-1), {}
    for first in range(LEAST_ROWS_AROUND_MOVE, n - LEAST_ROWS_AROUND_MOVE + 1):
        behind = np.where((np.arange(n) >= first)[:, None, None], directions, 0.0).reshape(n, -1)
        columns = centred(measurement, behind).reshape(-1, 3)
        shift, *_ = np.linalg.lstsq(columns, off, rcond=None)
        gains[first] = (float(np.sum((columns @ shift) ** 2)), shift)
    first = max(gains, key=lambda row: gains[row][0])
    shift = gains[first][1]
    ((name, target),) = measurement.targets.items()
    x, y, z = (np.array(target.position) + shift).tolist()
    names = np.where(np.arange(n) >= first, f"{name} moved", name)
    by = (
        f"with the tip moved by {np.linalg.norm(shift):.3g} mm before {measurement.where(first)} (did a work offset or "
        "the tool length change, or does the probe sit loose?)"
    )
    moved = replace(
        measurement,
        state=replace(measurement.state, target=names),
        targets={name: target, f"{name} moved": Target((x, y, z))},
    )
    yield by, moved


def sphere_notes(measurement: Measurement) -> Iterator[Finding]:
    """Findings on spheres that are not where they are stated."""
    yield from (Finding("spheres", text, False) for text in _sphere_notes(measurement))


def _sphere_notes(measurement: Measurement) -> Iterator[str]:
    """Notes on rows whose tip is in another sphere than stated, and on centres far from their stated positions."""
    residual, registration = misfit(measurement)
    centres = registration.sphere_centres
    lengths = np.linalg.norm(residual, axis=1)
    astray = np.flatnonzero(lengths > max(1.0, ASTRAY_MEDIANS * float(np.median(lengths))))
    for row in astray.tolist():
        own = str(measurement.groups[row])
        others = {name: residual[row] - centres[own] + centres[name] for name in centres if name != own}
        near = [name for name, off in others.items() if np.linalg.norm(off) < DOUBTED_CENTRE_MM]
        where = f": it is in sphere {near[0]}. Correct the name of the sphere" if near else ""
        yield f"{measurement.where(row)}: the tip is {lengths[row]:.4g} mm from the centre of sphere {own}{where}"
    for name, centre in centres.items():
        stated = measurement.spheres.get(name)
        if stated is None:
            continue
        apart = float(np.linalg.norm(centre - stated))
        if apart > DOUBTED_CENTRE_MM:
            here = [other for other, own in centres.items() if np.linalg.norm(own - stated) < DOUBTED_CENTRE_MM]
            there = f", where sphere {here[0]} is" if here else ""
            yield (
                f"sphere {name} is at {_mm(centre)} by the data, {apart:.4g} mm from its stated position{there}: check "
                "the length of the probe, the columns and the header (workpiece frame with all axes at 0)"
            )
    for one, other in pairwise(sorted(centres)):
        if np.linalg.norm(centres[one] - centres[other]) < DOUBTED_CENTRE_MM:
            yield f"spheres {one} and {other} are at the same position: are they one sphere?"


def shifted_zeros(measurement: Measurement) -> Reversed:
    """The measurement with other zeros of the rotary axes, as far as the spheres show them.

    A rotary axis that carries the spheres alone turns its zero about them all: no sphere shows it.
    """
    machine, other = measurement.machine, measurement
    shift = np.zeros(len(machine.axes))
    for _ in range(MOST_MISTAKE_ROUNDS):
        residual, registration = misfit(other)
        slopes = other.instrument.by_axes(other, registration) * machine.rotary
        slopes = centred(other, slopes.reshape(len(other), -1)).reshape(-1, len(shift))
        sizes = np.linalg.norm(slopes, axis=0)
        seen = (sizes > ZERO_SEEN_SHARE * sizes.max()) & (sizes > 0.0)
        step, *_ = np.linalg.lstsq(slopes[:, seen], centred(other, residual).reshape(-1))
        shift[seen] += step
        other = with_positions(measurement, measurement.state.positions + shift)
    own = np.abs(shift) >= NOTED_ZERO_RAD
    if own.any():
        zeros = " and ".join(
            f"{machine.names[i]} shifted by {np.degrees(shift[i]):+.3f} deg" for i in np.flatnonzero(own)
        )
        by = (
            f"with the zero of {zeros} (or with a line of a rotary axis tilted by as much: compare it with an edge "
            "along a linear axis)"
        )
        yield by, with_positions(measurement, measurement.state.positions + np.where(own, shift, 0.0))


def moment(residual: Array, least: int = LEAST_ROWS_AROUND_MOVE) -> tuple[int, float]:
    """The row of residuals `(n, 3)` from which on another mean explains most, and the squares that it explains.

    least: number of rows from both ends.
    """
    n = len(residual)
    sums = np.cumsum(residual, axis=0)
    before = np.arange(least, n - least + 1)
    mean_before = sums[before - 1] / before[:, None]
    mean_behind = (sums[-1] - sums[before - 1]) / (n - before)[:, None]
    gain = before * (n - before) / n * np.sum((mean_behind - mean_before) ** 2, axis=1)
    best = int(np.argmax(gain))
    return int(before[best]), float(gain[best])


def _mm(position: Array) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in position) + ") mm"
