"""Follows the parameters of a machine through a log of touches: sensors, walk and implausible readings are found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import logsumexp

from calibration.diagnosis.search import PRESENT
from calibration.following.earlier import continued
from calibration.following.followed import Followed, Implausible
from calibration.following.parameters import Touches, touches_of
from calibration.following.terms import Follows, Structure
from calibration.following.walk import Sizes
from calibration.instruments import TouchProbe
from calibration.plausibility.mistakes import FALLS, PLAUSIBLE, UNITS, explained
from kinematics.effects.base import UM
from kinematics.files.number_text import odds_by_log
from kinematics.running.progress import Progress, silent
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement

FEWEST_READINGS = 3
"""Fewest readings: from two, a drift cannot be told from the scatter of the probing."""


def follow(
    measurement: Measurement,
    earlier: Sequence[Measurement] = (),
    *,
    jumps: bool = False,
    progress: Progress = silent,
) -> Followed:
    """The drift of a machine by a log of touches; UserError for a log that cannot be used.

    earlier: logs of the same machine, with which the terms and the sizes of walk and scatter are learned. jumps: the
    machine may have jumped between two readings, so that the newest ones count whatever they are.
    """
    _check(measurement)
    touches = touches_of(measurement)
    _refuse_units(measurement)
    _refuse_far(measurement, touches)
    known = continued(measurement, earlier)
    learned = known.learned
    if known.before:
        behind = touches_of(known.measurement, known.before)
        progress(f"comparing {len(touches)} readings with {known.before} of earlier logs")
        if (together := _together(behind, touches)) is not None:
            return Followed(measurement, *_plausible(measurement, behind, together, jumps, progress), learned)
        learned = known.alone("the machine does not move by it as it moved then")
    progress(f"following {len(touches.effects)} parameters by {len(touches)} readings")
    structure, implausible = _plausible(measurement, touches, _with_sensors(_alone(touches)), jumps, progress)
    return Followed(measurement, structure, implausible, learned)


def _plausible(
    measurement: Measurement, touches: Touches, structure: Structure, jumps: bool, progress: Progress
) -> tuple[Structure, tuple[Implausible, ...]]:
    """The structure by the readings that do not contradict the others; and those of the log that do.

    structure: that by all readings.
    """
    kept, implausible = np.arange(len(touches)), list[Implausible]()
    while True:
        own = kept[touches.before :] - touches.before
        if jumps or len(own) <= FEWEST_READINGS:
            break
        _refuse_jump(measurement, structure, own)
        odds = structure.of_outliers()
        worst = int(np.argmax(odds))
        if odds[worst] <= 0.0:
            break
        implausible.append(Implausible(int(own[worst]), float(odds[worst])))
        kept = np.delete(kept, touches.before + worst)
        _refuse_many(measurement, implausible)
        progress(f"following {len(touches.effects)} parameters by {len(kept)} readings")
        structure = _with_sensors(_alone(touches.rows(kept)))
    return structure, tuple(sorted(implausible))


def _together(behind: Touches, own: Touches) -> Structure | None:
    """The structure by a log and the earlier ones; None where terms and sizes of their own are likelier, by 20 to 1."""
    before = replace(behind.rows(np.arange(behind.before)), before=0)
    together, *each = (_with_sensors(_alone(touches)) for touches in (behind, before, own))
    return together if sum(one.log_likely for one in each) - together.log_likely <= PRESENT else None


def _alone(touches: Touches) -> Structure:
    """Walk and scatter without sensors."""
    variance = touches.measurement.machine.priors.non_repeatability_um**2
    walk = np.full((1, len(touches.effects)), variance)
    return Structure(touches, Sizes(walk, np.array([variance]))).with_sizes(4)


def _with_sensors(structure: Structure) -> Structure:
    """The structure with the sensors that the parameters follow: odds of 20 to 1 or more, each sensor being as likely.

    Each parameter gets its likeliest sensor, then further ones; those without which the others explain the readings as
    well go again.
    """
    while structure.sensors:
        found = [each for p in range(len(structure.touches.effects)) if (each := _likeliest(structure, p))]
        if not found:
            break
        for term in found:
            structure = structure.with_likeliest(term)
        structure = _pruned(structure.with_sizes())
    return structure


def _likeliest(structure: Structure, parameter: int) -> Follows | None:
    """The likeliest sensor of a parameter, with its lag; None where none has odds of 20 to 1."""
    candidates, sensors = structure.candidates(parameter), structure.sensors
    log_prior = -float(np.log(len(sensors) * (1 + len(structure.lags))))
    gains = structure.of_candidates(parameter, candidates) + log_prior
    totals = [float(logsumexp(gains[[each.sensor == name for each in candidates]])) for name in sensors]
    best = int(np.argmax(totals))
    own = max((k for k, each in enumerate(candidates) if each.sensor == sensors[best]), key=gains.__getitem__)
    return candidates[own]._replace(log_odds=totals[best]) if totals[best] > PRESENT else None


def _pruned(structure: Structure) -> Structure:
    """The structure without the terms that the others explain."""
    place = 0
    while place < len(structure.terms):
        rest = structure.without(place)
        if rest.log_evidence > structure.log_evidence:
            structure = rest
        else:
            place += 1
    return structure


def _check(measurement: Measurement) -> None:
    """UserError for a log without times, with times that go back, or with too few readings."""
    source, time = measurement.source, measurement.state.time
    kind = measurement.instrument.kind()
    refusal = f"{source}: a log of touches is a measurement by a touch-probe, not by {kind}"
    TouchProbe.expect(measurement.instrument, refusal)
    if time is None:
        raise UserError(f"{source}: a drift needs times: add the column time (2026-11-30 09:12:05) or time_s")
    if np.any(np.diff(time) < 0.0):
        row = int(np.argmax(np.diff(time) < 0.0)) + 1
        raise UserError(
            f"{source}:{_line(measurement, row)}: the time is before that of the last row: sort the rows by time"
        )
    if len(measurement) < FEWEST_READINGS:
        raise UserError(
            f"{source}: {len(measurement)} readings: a drift needs {FEWEST_READINGS} or more: touch the sphere again"
        )
    if not np.diagonal(measurement.instrument.row_covariances(measurement), axis1=1, axis2=2).min() > 0.0:
        raise UserError(
            f"{source}: u_um is missing: the standard uncertainty of a coordinate of a centre, um (# u_um: 1)"
        )


def _refuse_units(measurement: Measurement) -> None:
    """UserError where the tip was at the spheres in another unit only."""
    before = _from_spheres(measurement)
    for found in explained(measurement, [[UNITS]], _from_spheres, min(before / FALLS, PLAUSIBLE)):
        raise UserError(
            f"{measurement.source}: the tip is {before:.4g} mm from the stated positions of the spheres "
            f"({', '.join(np.unique(measurement.groups))}), and {found.rms:.2g} mm {found.by}: "
            "positions are machine positions of the axes, mm and degrees: correct the unit"
        )


def _refuse_far(measurement: Measurement, touches: Touches) -> None:
    """UserError for a reading that no drift explains: another offset, unit, sphere or length of the probe."""
    limit = measurement.machine.priors.largest_correction_um
    shown = np.where(np.diagonal(touches.covariances, axis1=1, axis2=2) < limit**2, np.abs(touches.values), 0.0)
    if shown.max() > limit:
        row, k = np.unravel_index(int(np.argmax(shown)), shown.shape)
        raise UserError(
            f"{measurement.source}:{_line(measurement, int(row))}: the tip is {shown.max() * 1e-3:.4g} mm from the "
            f"other readings of sphere {measurement.groups[row]} in {'XYZ'[k]}, and a machine drifts by less than "
            f"{limit * 1e-3:g} mm: the row has another work offset, length of the probe, sphere or unit (positions are "
            "machine positions of the axes, mm and degrees): correct it, or delete it"
        )


def _refuse_jump(measurement: Measurement, structure: Structure, kept: np.ndarray) -> None:
    """UserError where the readings jump: the sphere may have been knocked, and the machine stands where it was."""
    following = {term.parameter for term in structure.terms}
    hidden = [p for p in range(len(structure.touches.effects)) if p not in following]
    plain, none = structure.of_jumps(), np.full(len(kept) - 2, -np.inf)
    masked = np.logaddexp.reduce([none, *map(structure.of_masked_jumps, hidden)])
    odds = np.logaddexp(plain, masked)
    worst = int(np.argmax(odds))
    if odds[worst] <= structure.of_outliers().max():
        return
    row = f"{measurement.source}:{_line(measurement, int(kept[worst + 1]))}"
    if odds[worst] > PRESENT:
        raise UserError(
            f"{row}: from this row on the readings contradict the earlier ones (odds {odds_by_log(odds[worst])}): the "
            "sphere, the probe or the machine was knocked, or an offset was changed. Nothing is corrected. If it was, "
            "set the work offsets again, and give these rows another name in a column 'run'. If the machine moves so "
            "fast, state --accept-jumps"
        )
    if odds[worst] > -PRESENT and masked[worst] > plain[worst]:
        raise UserError(
            f"{row}: the readings do not show whether the sphere, the probe or the machine was knocked before this "
            "row while it followed a sensor, or moved so fast by itself. Nothing is corrected. If it was knocked, set "
            "the work offsets again, and give the rows from this one on another name in a column 'run'; otherwise "
            "state --accept-jumps"
        )


def _refuse_many(measurement: Measurement, implausible: list[Implausible]) -> None:
    """UserError where too many readings are implausible, or the newest ones in a row."""
    rows, n = {each.row for each in implausible}, len(measurement)
    if {n - 2, n - 1} <= rows or len(rows) > max(measurement.machine.priors.most_left_out * n, 1.0):
        raise UserError(
            f"{measurement.source}: {len(rows)} of {n} readings contradict the others, the first in line "
            f"{_line(measurement, min(rows))}: find out why. Nothing is corrected. A column 'run' begins anew, and "
            "--accept-jumps takes all readings as they are"
        )


def _from_spheres(measurement: Measurement) -> float:
    """Median distance, mm, of the tip from the stated positions of the spheres, in the directions that they show."""
    covariances = measurement.instrument.row_covariances(measurement)
    limit = measurement.machine.priors.largest_correction_um * UM
    shown = np.diagonal(covariances, axis1=1, axis2=2) < limit**2
    centres = np.array([measurement.spheres[name] for name in measurement.groups])
    off = (centres + measurement.observed - measurement.nominal_points) * shown
    return float(np.median(np.linalg.norm(off, axis=1)))


def _line(measurement: Measurement, row: int) -> int:
    return row + 1 if measurement.lines is None else int(measurement.lines[row])
