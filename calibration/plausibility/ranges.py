"""Mistakes in ranges: stations that the data do not locate, or that are stated elsewhere, and dead lengths."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calibration.instruments.of_points import LINE_RMS_MM, width
from calibration.instruments.ranging.multilateration import LARGEST_MM
from calibration.instruments.ranging.ranging import Ranging, dead_lengths, least_rows, stations_of
from calibration.measurement.measurement import Measurement
from calibration.plausibility.finding import Finding
from calibration.plausibility.misfit import misfit
from kinematics.transforms import Array

STATION_MM = 300.0
"""Distance of a station from where it is stated, mm, from which the statement is wrong: a rough guess is nearer."""
DOUBTED_DEAD_LENGTH_MM = 1.0
"""Difference of a dead length from the stated one, mm, that no machine in use imitates."""
MOST_BREAK_PLACEMENTS = 5
"""Most times that a break is placed again, with the stations registered without it."""
RANGES_BESIDE_BREAK = 3
"""Least number of ranges before and behind a break: fewer are outliers."""


def unlocated_stations(measurement: Measurement) -> Iterator[Finding]:
    """Findings for stations with too few ranges, with targets on one line, or with two places in question."""
    groups, names, points = measurement.groups, dead_lengths(measurement), measurement.nominal_points
    for station in np.unique(groups).tolist():
        mine = np.flatnonzero(groups == station)
        dead = len(np.unique(names[mine]))
        where, needed = measurement.where(int(mine[0])), least_rows(dead)
        if len(mine) < needed:
            yield Finding(
                "station",
                f"{where}: station {station} has {len(mine)} ranges with {dead} dead lengths, and needs {needed} to be "
                "located: measure more positions, or give fewer names in the column run",
                True,
            )
        elif width(points[mine]) < LINE_RMS_MM:
            yield Finding(
                "station",
                f"{where}: all targets of station {station} lie on one line, about which its place is open: measure "
                "some positions off the line",
                True,
            )
        elif station not in measurement.spheres:
            places = stations_of(measurement, station, np.ones(len(measurement), bool))
            if len(places) > 1 and places[0].rms < LARGEST_MM:
                both = " and ".join(_mm(place.position) for place in places[:2])
                yield Finding(
                    "station",
                    f"{where}: two places explain the ranges of station {station} equally well, on either side of its "
                    f"targets: {both}. State about where it stands: # station.{station}: x y z",
                    True,
                )


def misstated_stations(measurement: Measurement) -> Iterator[Finding]:
    """Findings for stations and dead lengths that are stated otherwise than the ranges show."""
    registration, _ = measurement.first_registration
    for station, stated in measurement.spheres.items():
        found = registration.sphere_centres.get(station)
        away = 0.0 if found is None else float(np.linalg.norm(found - stated))
        if found is not None and away > STATION_MM:
            yield Finding(
                "station",
                f"station {station} is stated at {_mm(np.array(stated))}, but its ranges put it at {_mm(found)}, "
                f"{away:.4g} mm away: it is stated in another frame or unit, or the sign of an axis is wrong. Correct "
                f"the header line '# station.{station}: x y z', or delete it, because the ranges show the place",
                True,
            )
    yield from _misstated_dead(measurement)


def _misstated_dead(measurement: Measurement) -> Iterator[Finding]:
    """Findings for dead lengths that differ from the stated ones."""
    own, names = Ranging.expect(measurement.instrument), dead_lengths(measurement)
    stated = own.stated_dead(measurement)
    if own.dead_u_um is not None:
        stated = dict.fromkeys(np.unique(names).tolist(), 0.0) | stated
    registration, _ = measurement.first_registration
    for name, length in stated.items():
        off = registration.zeros[name] - length
        if abs(off) > max(DOUBTED_DEAD_LENGTH_MM, 5e-3 * (own.dead_u_um or 0.0)):
            row = int(np.argmax(names == name))
            yield Finding(
                "run",
                f"{measurement.where(row)}: from this row on the ranges of {_in_words(measurement, row)} are "
                f"{abs(off):.5g} mm {'longer' if off > 0.0 else 'shorter'} than with the stated dead length of "
                f"{length:g} mm: it was forgotten in these ranges, or has changed at a break of the beam. Correct the "
                "ranges, or delete the header lines dead_mm and dead_u_um, so that the fit determines each dead length",
                True,
            )
            return


def broken_beams(measurement: Measurement) -> Iterator[tuple[str, Measurement]]:
    """The ranges of each dead length without the largest jump between two of its rows, with words for it."""
    names = dead_lengths(measurement)
    for name in np.unique(names).tolist():
        mine = np.flatnonzero(names == name)
        if len(mine) < 2 * RANGES_BESIDE_BREAK:
            continue
        other, first, total = measurement, -1, 0.0
        for _ in range(MOST_BREAK_PLACEMENTS):
            off = misfit(other)[0][mine, 0]
            row, jump = _largest_jump(off if first < 0 else off + np.where(np.arange(len(mine)) >= first, total, 0.0))
            settled, first, total = row == first, row, jump
            behind = mine[first:]
            observed = measurement.observed.copy()
            observed[behind] -= total
            other = replace(measurement, observed=observed)
            if settled:
                break
        where = measurement.where(int(mine[first]))
        yield (
            f"with a new run of {_in_words(measurement, int(mine[0]))} from {where} on, where its ranges jump by "
            f"{total:+.5g} mm: the beam was broken there, and the dead length is a new one (give its rows another name "
            "in the column run)",
            other,
        )


def _largest_jump(off: Array) -> tuple[int, float]:
    """The first row behind the jump that explains most of residuals `(m,)`, and its size, mm."""
    m = np.arange(RANGES_BESIDE_BREAK, len(off) - RANGES_BESIDE_BREAK + 1)
    sums = np.cumsum(off)
    before, behind = sums[m - 1] / m, (sums[-1] - sums[m - 1]) / (len(off) - m)
    best = int(np.argmax(m * (len(off) - m) * (behind - before) ** 2))
    return int(m[best]), float(behind[best] - before[best])


def _in_words(measurement: Measurement, row: int) -> str:
    """Station, target and run of a row."""
    assert measurement.state.target is not None
    run = "" if measurement.run is None else f", run {measurement.run[row]}"
    return f"station {measurement.groups[row]}, target {measurement.state.target[row]}{run}"


def _mm(position: Array) -> str:
    return "(" + ", ".join(f"{value:.5g}" for value in position.tolist()) + ") mm"
