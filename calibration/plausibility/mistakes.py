"""Mistakes in a recording of points, or in the machine's file: one table, and the comparison of their misfits.

No model of the machine's errors is needed: the nominal machine is registered to the points as recorded, and to the
points without each mistake. A mistake is refused where its reversal reduces the residual by a factor of FALLS, to a
value that is usual for machines (PLAUSIBLE); where it may also be an error of the machine, a smaller one is noted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calibration.measurement.measurement import Measurement
from calibration.plausibility import ranges, spheres
from calibration.plausibility import recording_mistakes as recording
from calibration.plausibility.chain_order import other_chains
from calibration.plausibility.finding import Finding
from calibration.plausibility.misfit import misfit, trimmed_rms, usual_rms, worst_rms
from kinematics.transforms import Array

FALLS = 5.0
"""Factor by which the residual must fall when a mistake is reversed."""
PLAUSIBLE = 1.0
"""Largest RMS residual of the nominal machine in data without a mistake, mm."""
TIED = 2.0
"""Factor of the residuals up to which two mistakes cannot be distinguished."""
SUSPICIOUS = 0.3
"""RMS residual, mm, below which no mistake is searched for."""
HOPELESS = 5.0
"""Median residual, mm, above which the data cannot belong to the machine if no mistake explains it."""
MOST_MISTAKE_ROWS = 1500
"""Largest number of rows, chosen at random, in the search for mistakes."""
BETTER = 2.0
"""Factor by which the residual must fall with other readings, or with a smaller mistake that is noted."""
TIP_MM = 0.1
"""Least distance of a tip from its stated position, mm, that is noted: three times the expected location errors."""


def _of_any(_: Measurement) -> bool:
    return True


def _of_spheres(measurement: Measurement) -> bool:
    return measurement.instrument.FINDS_CENTRES


def _of_single_tip(measurement: Measurement) -> bool:
    return _of_spheres(measurement) and len(measurement.targets) == 1


class Mistake(NamedTuple):
    """A mistake in a recording, or in the machine's file."""

    check: str
    """Name of the check that finds it."""
    corrected: Callable[[Measurement], recording.Reversed]
    """Each way to reverse it."""
    applies: Callable[[Measurement], bool] = _of_any
    """True for a measurement that can have it, and shows it."""
    cure: str = ""
    """Sentence of a note on a smaller one, without a full stop; empty where it is refused only."""


READINGS = Mistake(
    "readings", lambda each: each.instrument.other_readings(each), lambda each: bool(each.observed.any())
)
"""Wrong readings of an instrument that also states where the tip is commanded to be."""
UNITS = Mistake("units", recording.other_units)
MISTAKES: Sequence[Sequence[Mistake]] = (
    (
        UNITS,
        Mistake("mirrored", recording.mirrored_points, lambda each: each.instrument.COORDINATES),
        Mistake("axes", recording.exchanged_axes),
        Mistake("sign", recording.reversed_axes),
        Mistake("degrees", recording.other_angles),
        Mistake("targets", recording.exchanged_targets),
        Mistake("targets", recording.turned_targets),
        Mistake("run", ranges.broken_beams, lambda each: each.instrument.ZERO_BY_BEAM),
    ),
    (Mistake("chain", other_chains),),
    (
        Mistake(
            "targets",
            recording.misplaced,
            lambda each: _of_spheres(each) or len(recording.known_targets(each)) > 1,
            "Measure the length of the probe again: the fit takes a wrong length for location errors of the rotary "
            "axes, or for scale",
        ),
        Mistake(
            "zeros",
            spheres.shifted_zeros,
            _of_spheres,
            "The fit takes a wrong zero for tilts of lines: correct it in the control, and measure again",
        ),
    ),
    (Mistake("spheres", spheres.moved_spheres, _of_spheres),),
    (
        Mistake(
            "spheres",
            spheres.moved_tip,
            lambda each: _of_single_tip(each) and len(each) >= 2 * spheres.LEAST_ROWS_AROUND_MOVE,
            "Measure again",
        ),
    ),
)
"""Mistakes of points that are compared with each other; each row is tried if none of the rows before explains the data.

Mistakes with free values are in the later rows: they can imitate the others.
"""


class Explanation(NamedTuple):
    """A mistake that explains the points."""

    rms: float
    """RMS residual without it, mm."""
    mistake: Mistake
    by: str
    """Words for its reversal: `with columns X and Y exchanged`."""


def explained(
    measurement: Measurement,
    mistakes: Sequence[Sequence[Mistake]],
    rms: Callable[[Measurement], float],
    largest: float,
    counts: Callable[[Measurement], bool] = _of_any,
) -> list[Explanation]:
    """The mistake that explains the points best, and those tied with it, in the order of their table; often none.

    rms: residual, mm, of a measurement, of which the best one leaves `largest` at most. counts: False for a corrected
    measurement that does not differ enough from the recorded one.
    """
    for row in mistakes:
        tried = [
            Explanation(rms(other), mistake, by)
            for mistake in row
            if mistake.applies(measurement)
            for by, other in mistake.corrected(measurement)
            if counts(other)
        ]
        best = min((each.rms for each in tried), default=np.inf)
        if best <= largest:
            return [each for each in tried if each.rms <= TIED * best]
    return []


def gross_mistakes(measurement: Measurement) -> Iterator[Finding]:
    """Findings: mistakes that explain the points; otherwise stations that do not fit."""
    rows = np.arange(len(measurement))
    if len(rows) > MOST_MISTAKE_ROWS:
        rows = np.sort(np.random.default_rng(0).choice(rows, MOST_MISTAKE_ROWS, replace=False))
    some = measurement.rows(rows)
    before, tied = _wrong_readings(some)
    if not tied:
        before = worst_rms(some)
        if before < SUSPICIOUS:
            return
        tied = explained(some, MISTAKES, worst_rms, min(before / FALLS, PLAUSIBLE))
    if tied:
        best = min(tied, key=lambda each: each.rms)
        open_end = "" if len(tied) == 1 else "; these data do not show which of them"
        yield Finding(
            best.mistake.check,
            f"the {'points' if len(some.instrument.PARTS) > 1 else 'ranges'} differ from the commanded positions by "
            f"{before:.4g} mm RMS, and by {best.rms:.3g} mm {_words(tied)}{open_end}",
            True,
        )
        return
    lengths = np.linalg.norm(misfit(some)[0], axis=1)
    if float(np.median(lengths)) > HOPELESS:
        still = np.array(some.machine.names)[np.ptp(some.state.positions, axis=0) == 0.0]
        column = f" {', '.join(still)} does not move in these data: is its column missing?" if len(still) == 1 else ""
        yield Finding(
            "unexplained",
            f"the points differ from the commanded positions by {np.median(lengths):.4g} mm (median, instrument "
            "registered), and no exchange of columns, targets, signs or units explains this: are these points of this "
            f"machine and of these positions?{column}",
            True,
        )
        return
    yield from _stations(some, lengths)


def _wrong_readings(measurement: Measurement) -> tuple[float, list[Explanation]]:
    """RMS residual, mm, of the readings as they are, and the others that explain the commanded positions, best first.

    The residual must fall below that with the readings as they are, and below that without readings.
    """
    others = explained(measurement, [[READINGS]], usual_rms, np.inf)
    if not others:
        return 0.0, []
    before, without = (usual_rms(replace(measurement, observed=k * measurement.observed)) for k in (1.0, 0.0))
    limit = min(before, without) / BETTER
    return before, sorted((each for each in others if each.rms <= limit), key=lambda each: each.rms)


def noted_mistakes(measurement: Measurement) -> Iterator[Finding]:
    """A finding: a tip or zeros of axes elsewhere that explain most of the residual.

    Differences of millimetres are refused (`gross_mistakes`); smaller ones may be location errors.
    """
    if len(measurement.targets) > 1:
        return
    before = usual_rms(measurement)
    limit, stated = before / BETTER, np.array(next(iter(measurement.targets.values())).position)

    def counts(other: Measurement) -> bool:
        moved = any(np.linalg.norm(target.position - stated) >= TIP_MM for target in other.targets.values())
        return moved or not np.array_equal(other.state.positions, measurement.state.positions)

    noted = [[mistake for mistake in row if mistake.cure] for row in MISTAKES]
    tied = [each for each in explained(measurement, noted, usual_rms, limit, counts) if each.rms <= limit]
    if tied:
        text = (
            f"the points differ from the commanded positions by {before:.2g} mm RMS, and by "
            f"{min(each.rms for each in tied):.2g} mm {_words(tied)}"
        )
        check = "zeros" if tied[0].mistake.check == "zeros" else "targets"
        yield Finding(check, f"{text}. {'. '.join(each.mistake.cure for each in tied)}", False)


def _words(tied: list[Explanation]) -> str:
    return ", or ".join(each.by for each in tied)


def _stations(measurement: Measurement, lengths: Array) -> Iterator[Finding]:
    """Stations with large residuals while others have small ones."""
    groups, kind = measurement.groups, "sphere" if measurement.spheres else "station"
    sizes = {name: trimmed_rms(lengths[groups == name]) for name in np.unique(groups).tolist()}
    usual = float(np.median(list(sizes.values())))
    for name, size in sizes.items():
        if len(sizes) > 1 and size > max(FALLS * usual, PLAUSIBLE):
            yield Finding(
                "station",
                f"the points of {kind} {name} differ from the commanded positions by {size:.3g} mm RMS, those of the "
                f"others by {usual:.3g} mm: it moved while it measured, or its rows are of other positions",
                False,
            )
