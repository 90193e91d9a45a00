"""Mistakes in the circles of a ballbar: units, columns, radius and centre, single rows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calibration.instruments.ballbar import LENGTH_ERROR, Ballbar
from calibration.measurement.measurement import Measurement
from calibration.plausibility.finding import Finding
from calibration.plausibility.misfit import misfit
from calibration.plausibility.reversed_runs import reversed_runs
from kinematics.transforms import Array

IMPOSSIBLE_READING_MM = 0.5
"""Difference of the readings from the circles, mm, that no machine in use has."""
WRONG_LENGTH_MM = 2.0
"""Difference of the readings from the stated length, mm, from which the radius is wrong: a bar's travel is 1 mm."""
OTHER_CENTRE_MM = 0.5
"""Distance of the centre of a run from that of the others, mm, from which the run has another table ball."""
SHIFT_SEEN_SHARE = 0.1
"""Share of the best seen direction of a shift below which a direction is not seen: that across a circle."""
WRONG_CENTRE_MM = 3.0
"""Distance of the table ball from the stated centre, mm, from which one of the two is wrong."""
LOST_MM = 20.0
"""Distance from which the data cannot be used."""
MM_PER_INCH = 25.4
PLANE_SHARE = 1e-4
"""Share of the largest singular value below which points do not leave their plane."""
TURNED_BACK = 0.2
"""Angle, rad, of steps back in a run from which it contains two directions."""
OUT_OF_PLANE = 0.2
"""Sine of the angle of a row to the plane of its run from which the run contains two planes."""
WRONG_FEED_FACTOR = 3.0
"""Factor between the feed and the speed by positions and times from which one of them is wrong."""


def circle_mistakes(measurement: Measurement) -> Iterator[Finding]:
    """Findings for each mistake in the circles of a ballbar."""
    bar = Ballbar.expect(measurement.instrument)
    radius, length = float(np.median(measurement.observed)), bar.length_mm
    if abs(radius - length) > WRONG_LENGTH_MM:
        read = f"radius_mm reads {radius:.6g} mm in the median, but the bar is {length:g} mm long"
        yield Finding("units", f"{read}{_why(radius / length)}", True)
        return
    points, own = measurement.nominal_points, np.array(next(iter(measurement.spheres.values())))
    driven = float(np.median(np.linalg.norm(points - own, axis=1)))
    if abs(driven - length) > WRONG_LENGTH_MM and _best_circle(points)[1] > IMPOSSIBLE_READING_MM:
        yield Finding("radius", _wrong_radius(measurement, points, driven, length), True)
        return
    residual, registration = misfit(measurement)
    off = np.abs(residual[:, 0])
    if float(np.median(off)) > IMPOSSIBLE_READING_MM or abs(registration.zeros[LENGTH_ERROR]) > WRONG_LENGTH_MM:
        yield Finding("radius", _wrong_radius(measurement, points, driven, length), True)
        return
    mixed = list(_mixed_runs(measurement, points))
    yield from mixed
    if mixed:
        return
    yield from _other_feeds(measurement, points)
    yield from _other_centres(measurement, points)
    reverse, fatal = reversed_runs(measurement, points - own)
    if reverse:
        yield Finding("order", reverse, fatal)
    for row in np.flatnonzero(off > IMPOSSIBLE_READING_MM).tolist()[:3]:
        away = f"radius_mm is {1e3 * residual[row, 0]:+.4g} um off its circle, and not used"
        yield Finding("outliers", f"{measurement.where(row)}: {away}", False)
    for name, centre in registration.sphere_centres.items():
        apart = float(np.linalg.norm(centre - np.array(measurement.spheres[name])))
        if apart > WRONG_CENTRE_MM:
            words = "correct the centre, or columns of axes that are exchanged"
            yield Finding(
                "centre", f"the table ball is {apart:.4g} mm from its stated centre: {words}", apart > LOST_MM
            )


def _why(ratio: float) -> str:
    for factor, words in (
        (MM_PER_INCH, "the bar's length is in inch"),
        (1.0 / MM_PER_INCH, "the readings are in inch"),
    ):
        if abs(ratio / factor - 1.0) < 0.05:
            return f": {words}?"
    return ": the length is wrong, or the readings are deviations from it (radius_mm is the distance of the balls)"


def _wrong_radius(measurement: Measurement, points: Array, driven: float, length: float) -> str:
    """The message for circles that the bar cannot have measured."""
    machine, (radius, rms) = measurement.machine, _best_circle(points)
    names = [axis.name for axis in machine.axes if axis.rotary]
    swapped = ""
    if names and np.ptp(measurement.state.positions[:, machine.rotary], axis=0).max() > np.radians(1.0):
        swapped = f", or columns in mm and in degrees ({', '.join(names)}) are exchanged"
    own = f"; their own circle has a radius of {radius:.6g} mm" if rms < IMPOSSIBLE_READING_MM else ""
    return (
        f"the commanded positions are {driven:.6g} mm (median) from the stated centre, but the bar is "
        f"{length:g} mm long{own}: the centre, the radius of the program or the unit of the "
        f"axes is wrong{swapped}"
    )


def _best_circle(points: Array) -> tuple[float, float]:
    """Radius, mm, of the sphere that fits the commanded positions best, and the RMS of their distances from it, mm."""
    centre, radius = _sphere(points)
    away = np.linalg.norm(points - centre, axis=1) - radius
    return radius, float(np.sqrt(np.mean(away**2)))


def _sphere(points: Array) -> tuple[Array, float]:
    """Centre `(3,)` and radius, mm, of the sphere that fits points best; of a circle, the centre in its plane."""
    middle = points.mean(axis=0)
    rows = np.column_stack([2.0 * (points - middle), np.ones(len(points))])
    solution = np.linalg.lstsq(rows, np.sum((points - middle) ** 2, axis=1), rcond=PLANE_SHARE)[0]
    return middle + solution[:3], float(np.sqrt(max(solution[3] + solution[:3] @ solution[:3], 0.0)))


def _mixed_runs(measurement: Measurement, points: Array) -> Iterator[Finding]:
    """Runs of more than one circle: the first that turns back, or that leaves its plane."""
    assert measurement.run is not None
    for run in dict.fromkeys(measurement.run.tolist()):
        rows = np.flatnonzero(measurement.run == run)
        if len(rows) < 3:
            continue
        arms = points[rows] - _sphere(points[rows])[0]
        unit = arms / np.linalg.norm(arms, axis=1)[:, None]
        turns = np.cross(unit[:-1], unit[1:])
        normal = np.linalg.eigh(turns.T @ turns)[1][:, -1]
        steps = turns @ normal
        steps = steps * np.sign(steps[np.flatnonzero(steps)[:1]].sum())
        row, what = -1, ""
        if -float(steps[steps < 0.0].sum()) > TURNED_BACK:
            row, what = int(rows[np.argmax(steps < 0.0) + 1]), "turns back"
        elif (off := np.abs(unit @ normal) > OUT_OF_PLANE).any():
            row, what = int(rows[np.argmax(off)]), "leaves its plane"
        if what:
            why = f"run {run} {what}: give each circle, in each direction, a run of its own"
            yield Finding("order", f"{measurement.where(row)}: {why}", True)
            return


def _other_feeds(measurement: Measurement, points: Array) -> Iterator[Finding]:
    """Runs whose feed is not that of their positions and times."""
    time, feed = measurement.state.time, measurement.feed
    if time is None or feed is None or measurement.run is None:
        return
    for run in dict.fromkeys(measurement.run.tolist()):
        rows = np.flatnonzero(measurement.run == run)
        steps, seconds = np.linalg.norm(np.diff(points[rows], axis=0), axis=1), np.diff(time[rows])
        if len(rows) < 6 or seconds.min() <= 0.0:
            continue
        driven, stated = 60.0 * float(np.median(steps / seconds)), float(np.median(feed[rows]))
        if not 1.0 / WRONG_FEED_FACTOR < driven / stated < WRONG_FEED_FACTOR:
            yield Finding(
                "units",
                f"run {run}: column feed has {stated:g} mm/min, but its positions and times give {driven:.4g} mm/min: "
                "correct the feed, the unit of one of them, or leave out time_s",
                True,
            )
            return


def _other_centres(measurement: Measurement, points: Array) -> Iterator[Finding]:
    """Runs whose circle is about another point than that of the other runs."""
    assert measurement.run is not None
    for run in np.unique(measurement.run).tolist():
        mine = measurement.run == run
        if mine.all() or mine.sum() < 6:
            continue
        others = measurement.rows(np.flatnonzero(~mine))
        _, registration = misfit(others)
        centre = next(iter(registration.sphere_centres.values()))
        arms = points[mine] - centre
        length = np.linalg.norm(arms, axis=1)
        away = measurement.observed[mine, 0] - length - registration.zeros[LENGTH_ERROR]
        good = np.abs(away - np.median(away)) < 20.0
        shift = np.linalg.lstsq(-arms[good] / length[good, None], away[good], rcond=SHIFT_SEEN_SHARE)[0]
        if float(np.linalg.norm(shift)) > OTHER_CENTRE_MM:
            yield Finding(
                "centre",
                f"run {run} is about a point {np.linalg.norm(shift):.4g} mm from the centre of the other runs: the "
                "table ball or a work offset was moved; give this run as a file of its own",
                True,
            )
            return
