"""Checks of the plausibility of a measurement, without a model of the machine's errors.

Mistakes that have alternatives are compared in `calibration.plausibility.mistakes`. Machine errors of 0.1 mm and
0.1 mrad do not cause a finding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from scipy import special

from calibration.measurement.measurement import Measurement
from calibration.plausibility.circles import circle_mistakes
from calibration.plausibility.finding import Finding
from calibration.plausibility.lengths import length_mistakes
from calibration.plausibility.misfit import centred
from calibration.plausibility.mistakes import FALLS, SUSPICIOUS, gross_mistakes, noted_mistakes
from calibration.plausibility.motion import LEAST_ROWS_OF_RELATION, clock_lag, read_back
from calibration.plausibility.ranges import misstated_stations, unlocated_stations
from calibration.plausibility.repeated_positions import position_numbers
from calibration.plausibility.spheres import sphere_notes
from calibration.plausibility.times import paused, repeated_times
from kinematics.transforms import Array
from kinematics.user_error import UserError

LEAST_COMMON_STATES = 5
"""Least number of measurement states common to all runs for a comparison of the first run with the others."""
SLOPE = 1e-3
"""Deviation per travel above which the cause is not an axis."""
FALSE_REFUSAL_PROBABILITY = 1e-3
BACKWARD_TIME_SHARE = 0.1
"""Share of rows with an earlier time than the row before, above which the rows are not in the order of time."""
HOT = 200.0
"""Temperature, degC, above which a column is in another unit: kelvin, or hundredths."""
LONGEST_TOOL_MM = 1000.0
"""Distance of a target from the tool reference point that is possible on every machine, mm."""
DOUBTED_TRAVEL_SHARE = 0.05
"""Share of the travel of linear axes below which their unit is questioned."""


class Check(NamedTuple):
    """A check of the rows that are no copies."""

    look: Callable[[Measurement], Iterable[Finding]]
    on_the_fly: bool = False
    """True where it holds for rows in motion too; otherwise their alignment with the path finds the mistake."""


def sanity(measurement: Measurement) -> list[Finding]:
    """Findings on a measurement, fatal ones first; with a fatal finding most other checks are omitted."""
    copies = measurement.copies
    own = measurement.without_copies
    mistakes = _found_by(MISTAKES, own)
    odd = [*_copies(measurement, copies), *_found_by(NOTES, own)]
    if not any(finding.fatal for finding in mistakes):
        odd += _found_by(DOUBTS, own)
    return sorted([*mistakes, *odd], key=lambda finding: not finding.fatal)


def _found_by(checks: Sequence[Check], own: Measurement) -> list[Finding]:
    """The findings of all checks that hold for the rows, in the order of the checks."""
    return [found for check in checks if check.on_the_fly or own.across is None for found in check.look(own)]


def usable(measurement: Measurement) -> list[Finding]:
    """Findings on a measurement; UserError for fatal ones."""
    findings = sanity(measurement)
    fatal = [finding.message for finding in findings if finding.fatal]
    if fatal:
        raise UserError(f"{measurement.source}: {'; '.join(fatal)}")
    return findings


def _of_instrument(measurement: Measurement) -> Iterator[Finding]:
    """Recording mistakes, as far as the instrument shows them: of the first check that finds any."""
    each = (list(RECORDING[name](measurement)) for name in measurement.instrument.CHECKS)
    yield from next((found for found in each if found), [])


def _copies(measurement: Measurement, copies: np.ndarray) -> Iterator[Finding]:
    if copies.any():
        where = measurement.where(int(np.argmax(copies)))
        yield Finding(
            "copies",
            f"{copies.sum()} of {len(copies)} rows are copies of earlier ones to the last digit (the first: {where}), "
            "and count once",
            False,
        )


def _order(measurement: Measurement) -> Iterator[Finding]:
    """Rows that are not in the order of time, from which the direction of approach follows."""
    time = measurement.state.time
    back = 0 if time is None else int(np.count_nonzero(np.diff(time) < 0.0))
    if len(measurement) >= LEAST_ROWS_OF_RELATION and back > BACKWARD_TIME_SHARE * len(measurement):
        yield Finding(
            "order",
            f"time decreases at {back} of {len(measurement)} rows: they are not in the order of acquisition, from "
            "which the directions of approach follow; sort them by time",
            True,
        )


def _temperatures(measurement: Measurement) -> Iterator[Finding]:
    for name, kelvin in measurement.state.temperatures.items():
        mean = float(np.mean(kelvin)) + 20.0
        if mean > HOT:
            yield Finding(
                "units",
                f"temp_{name} reads {mean:.4g} in the mean: temperatures must be in degC (are these kelvin?)",
                True,
            )


def _dead(measurement: Measurement) -> Iterator[Finding]:
    """Equal observations although the machine moves; a touch probe's are all zero where it found the centres."""
    if measurement.instrument.FINDS_CENTRES:
        return
    moved = np.ptp(measurement.state.positions, axis=0).any()
    if moved and len(measurement) >= LEAST_ROWS_OF_RELATION and not np.ptp(measurement.observed, axis=0).any():
        yield Finding(
            "constant",
            f"all {len(measurement)} observations are the same although the axes move: the instrument did not measure, "
            "or the wrong column was read",
            True,
        )


def _far_targets(measurement: Measurement) -> Iterator[Finding]:
    """Targets too far from the tool reference point for a tool: the points of a single target do not show this."""
    machine = measurement.machine
    reach = max(LONGEST_TOOL_MM, float(np.ptp(machine.travel, axis=0)[~machine.rotary].max(initial=0.0)))
    for name, target in measurement.targets.items():
        away = float(np.linalg.norm(target.position))
        if target.known and away > reach:
            yield Finding(
                "targets",
                f"target {name} lies {away:.5g} mm from the tool reference point, farther than {reach:.5g} mm "
                "(the longest travel, or 1 m), and would multiply all tilts of axes. Correct its position (mm)",
                True,
            )


def _distances(measurement: Measurement) -> Iterator[Finding]:
    """Calibrated distances that differ from those of the found centres by more than any axis errs."""
    if not measurement.distances:
        return
    centres = measurement.first_registration[0].sphere_centres
    for each in measurement.distances:
        if each.one in centres and each.other in centres:
            found = float(np.linalg.norm(centres[each.one] - centres[each.other]))
            if abs(found - each.length) > max(SLOPE * each.length, SUSPICIOUS):
                yield Finding(
                    "distances",
                    f"the calibrated distance of spheres {each.one} and {each.other} is {each.length:.6g} mm, but by "
                    f"the data {found:.6g} mm: no axis errs so much. Correct the distance, or the names of its spheres",
                    True,
                )


def _recording(measurement: Measurement) -> list[Finding]:
    """Recording mistakes: of single files where only some of several have one, otherwise of all rows."""
    by_file = [list(_named(part, _of_instrument)) for part in _files(measurement)]
    if any(by_file) and not all(by_file):
        return [*chain.from_iterable(by_file)]
    return list(_of_instrument(measurement))


def _files(measurement: Measurement) -> list[Measurement]:
    """The rows of each of several files with enough of them: a mistake may be in one file alone. None for one file."""
    if measurement.file is None or measurement.axis_rows:
        return []
    names, counts = np.unique(measurement.file, return_counts=True)
    own = [name for name, count in zip(names.tolist(), counts.tolist(), strict=True) if count >= LEAST_ROWS_OF_RELATION]
    parts = [measurement.rows(np.flatnonzero(measurement.file == name)) for name in own if len(names) > 1]
    return [_with_own_targets(part) for part in parts]


def _with_own_targets(part: Measurement) -> Measurement:
    """The rows without the targets that only others have: a mistake in one file exchanges none of them."""
    used = np.array(list(part.targets))[np.unique(part.target_number)].tolist()
    return replace(part, targets={name: part.targets[name] for name in used})


def _named(part: Measurement, check: Callable[[Measurement], Iterator[Finding]]) -> Iterator[Finding]:
    """Findings of a check on the rows of one file, with its name."""
    assert part.file is not None
    yield from (each._replace(message=f"{part.file[0]}: {each.message}") for each in check(part))


def _never_seen(measurement: Measurement) -> Iterator[Finding]:
    if measurement.instrument.NEVER_SEEN:
        yield Finding("never seen", measurement.instrument.NEVER_SEEN, False)


def _noted(measurement: Measurement) -> Iterator[Finding]:
    """Smaller mistakes of the tip or of zeros: of each of several files, otherwise of all rows."""
    files = _files(measurement)
    yield from chain.from_iterable(_named(part, noted_mistakes) for part in files)
    yield from noted_mistakes(measurement) if not files else ()


def _small_volume(measurement: Measurement) -> Iterator[Finding]:
    """Several linear axes that all move over a small part of their travel: wrong unit, or a small volume."""
    machine = measurement.machine
    span, travel = np.ptp(measurement.state.positions, axis=0), np.ptp(machine.travel, axis=0)
    moving = np.flatnonzero((span > 0.0) & ~machine.rotary)
    if len(moving) > 1 and np.all(span[moving] < DOUBTED_TRAVEL_SHARE * travel[moving]):
        names = ", ".join(machine.names[i] for i in moving)
        share = float(np.max(span[moving] / travel[moving]))
        yield Finding(
            "volume",
            f"{names} move over {100 * share:.2g} % of their travel at most: is the unit of the commands right "
            "(inch or m)? The calibration is valid in this small volume only",
            False,
        )


def _readings(measurement: Measurement) -> Iterator[Finding]:
    """Deviations of an interferometer that grow with the travel more than those of any axis."""
    machine = measurement.machine
    for name, of_axis in measurement.axis_rows.items():
        rows = of_axis[measurement.positioning[of_axis]]
        if not len(rows):
            continue
        part, i = measurement.rows(rows), machine.index(name)
        x, y = centred(part, part.state.positions[:, [i]])[:, 0], centred(part, part.observed)[:, 0]
        if np.ptp(x) <= 0.0:
            continue
        slope = float(x @ y / (x @ x))
        left, all_of_it = float(np.sqrt(np.mean((y - slope * x) ** 2))), float(np.sqrt(np.mean(y**2)))
        if abs(slope) > SLOPE and left < all_of_it / FALLS:
            unit = "urad/deg" if machine.axes[i].rotary else "um/mm"
            per = slope * (1e6 * np.pi / 180.0 if machine.axes[i].rotary else 1e3)
            yield Finding(
                "units",
                f"the deviations of {name} grow by {per:.4g} {unit} along the travel: these are readings instead of "
                "deviations, or the unit or the sign of one column is wrong",
                True,
            )


def _first_cycle(measurement: Measurement) -> Iterator[Finding]:
    """A first run that differs from the later ones, at the same measurement states, more than they from each other."""
    cells = _by_run(measurement)
    if cells is None:
        return
    later = cells[:, 1:]
    middle = later.mean(axis=1, keepdims=True)
    k, dof = later.shape[1], later[:, 0].size
    first = float(np.mean((cells[:, 0] - middle[:, 0]) ** 2)) / (1.0 + 1.0 / k)
    scatter = float(np.sum((later - middle) ** 2)) / (dof * (k - 1))
    if (
        scatter > 0.0
        and special.fdtrc(dof, dof * (k - 1), first / scatter) < FALSE_REFUSAL_PROBABILITY
        and first > FALLS * scatter
    ):
        unit = "um" if float(measurement.per_micro.max()) < 1e6 else "um or urad"
        yield Finding(
            "first cycle",
            f"the first run differs from the later ones by {first**0.5:.3g} {unit} RMS at {len(cells)} positions, the "
            f"later ones from each other by {scatter**0.5:.3g}: a first cycle, or a drift that dies down",
            False,
        )


def _by_run(measurement: Measurement) -> Array | None:
    """Mean observations `(states, runs, d)`, um and urad, at the measurement states of all runs; None if too few.

    Runs are in the order of acquisition; each axis of an interferometer is centred, because its zero is unknown.
    """
    if measurement.run is None:
        return None
    names, first, run = np.unique(measurement.run, return_index=True, return_inverse=True)
    run = np.argsort(np.argsort(first))[run]
    numbers = position_numbers(measurement)
    shape = int(numbers.max()) + 1, len(names)
    count, sums = np.zeros(shape), np.zeros((*shape, measurement.observed.shape[1]))
    np.add.at(count, (numbers, run), 1.0)
    np.add.at(sums, (numbers, run), measurement.observed * measurement.per_micro)
    shared = count.all(axis=1)
    if len(names) < 3 or shared.sum() < LEAST_COMMON_STATES:
        return None
    cells = np.asarray(sums[shared] / count[shared][:, :, None])
    for rows in measurement.axis_rows.values():
        if (own := np.isin(np.flatnonzero(shared), numbers[rows])).any():
            cells[own] -= cells[own].mean(axis=0)
    return cells


def _doubts_of_instrument(measurement: Measurement) -> Iterator[Finding]:
    yield from chain.from_iterable(RECORDING[name](measurement) for name in measurement.instrument.DOUBTS)


RECORDING: Mapping[str, Callable[[Measurement], Iterable[Finding]]] = {
    "points": gross_mistakes,
    "circles": circle_mistakes,
    "lengths": length_mistakes,
    "places of stations": unlocated_stations,
    "stated stations": misstated_stations,
    "deviations": _readings,
    "spheres": sphere_notes,
    "tip": _noted,
}
"""Checks of the recording, which instruments name."""
MISTAKES = (
    Check(_order, on_the_fly=True),
    Check(_temperatures, on_the_fly=True),
    Check(_dead, on_the_fly=True),
    Check(_far_targets, on_the_fly=True),
    Check(_recording),
    Check(_distances),
)
"""Checks that may find a mistake with which the data cannot be used."""
NOTES = (Check(repeated_times), Check(paused), Check(_never_seen, on_the_fly=True))
DOUBTS = (
    Check(_doubts_of_instrument),
    Check(_small_volume),
    Check(clock_lag),
    Check(_first_cycle),
    Check(read_back),
)
"""Checks of data without a fatal mistake: observations and read-backs that do not follow the commands, and others."""
