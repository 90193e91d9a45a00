"""Sudden changes behind which all rows are outliers: a knock at the instrument, a target that was seated again.

The rows behind a change near the end disagree with the others alike. Where they are few, the fit leaves them out, and
no search in the other rows finds the change. The same holds for the rows before a change near the beginning.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import msgspec
import numpy as np

from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.causes import jumps
from calibration.diagnosis.search.evaluation import WORTH, Evaluated, evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.selection import Selector
from calibration.diagnosis.search.stage import Accepted, Stage, chosen_of
from calibration.fit.fit import Fit
from calibration.measurement.measurement import Measurement
from calibration.observation.equations import covariance
from kinematics.effects import Effect, StationShift, TargetOffset

LEAST, STOPS = 5, 3
"""Least number of outliers in sequence that are no chance, and of their stops."""
MOST = 0.6
"""Share of the rows before or behind a change that are outliers, at least, and of the outliers that it explains."""
CHANGES = 3
"""Most changes that are looked for."""


def sudden_changes(selector: Selector) -> tuple[Accepted, ...]:
    """Jumps that explain outliers in sequence, in a fit that keeps most of these rows; empty for none."""
    stage = selector.bare
    for _ in range(CHANGES):
        found = _likeliest(stage, selector.measurement)
        if found is None:
            break
        best, sequences = found
        trial = selector.stage([*chosen_of(stage.accepted), (best.candidate, best.score.size)])
        if trial.accepted[-1].score.delta_bic > WORTH or trial.fit.kept[sequences].mean() < MOST:
            break
        stage = trial
    return stage.accepted


def with_outliers_beyond(selector: Selector, stage: Stage) -> Stage:
    """The stage with its jumps at the moments at which the outliers beside them lie behind the change, or before it.

    A bounded square says little about a row that is left out: an outlier costs a free shift of its row.
    """
    for i, own in enumerate(stage.accepted):
        for moment in _moments_beyond_outliers(stage.fit, own.candidate.effect):
            chosen = chosen_of(stage.accepted)
            moved = msgspec.structs.replace(own.candidate.effect, since_s=moment)
            chosen[i] = (replace(own.candidate, effect=moved), own.size)
            trial = selector.stage(chosen)
            if _cost_with_outliers(trial) < _cost_with_outliers(stage):
                return with_outliers_beyond(selector, trial.with_siblings_of(stage))
    return stage


def like_outliers(fit: Fit, rows: np.ndarray) -> Iterator[tuple[Effect, float]]:
    """Changes with all of some outliers `(k,)` behind them, or before them, and the log odds of these against each.

    An outlier costs a free shift of its row, a change one shift of all of them, and its moment. None for one outlier.
    """
    measurement, count = fit.measurement, len(rows)
    time = measurement.state.time
    if time is None or count < 2:
        return
    information = np.linalg.inv(covariance(measurement.rows(rows)))
    along = information @ fit.residual[rows][:, :, None]
    common = np.linalg.solve(information.sum(axis=0), along.sum(axis=0))
    apart = float(np.sum(fit.residual[rows][:, :, None] * along) - np.sum(common * along.sum(axis=0)))
    spared = (count - 1) * measurement.components * float(np.log(fit.observations))
    for effect in jumps(measurement):
        of_change = np.flatnonzero(_acts_on(measurement, effect) & ~fit.copies)
        of_change = of_change[np.argsort(time[of_change], kind="stable")]
        at_end, at_start = (np.isin(rows, some).all() for some in (of_change[-count:], of_change[:count]))
        if isinstance(effect, StationShift | TargetOffset) and at_end != at_start:
            since = float(time[of_change[-count if at_end else count]])
            odds = 0.5 * (apart - spared) + float(np.log(len(of_change)))
            yield msgspec.structs.replace(effect, since_s=since), odds


def _moments_beyond_outliers(fit: Fit, effect: Effect) -> Iterator[float]:
    """Moments of a jump beyond the outliers next to its own, before it and behind it; none for other effects."""
    measurement, since = fit.measurement, effect.moment
    if since is None or measurement.state.time is None:
        return
    rows = np.flatnonzero(_acts_on(measurement, effect) & ~fit.copies)
    rows = rows[np.argsort(measurement.state.time[rows], kind="stable")]
    times, outlying = measurement.state.time[rows], np.isin(rows, fit.outliers)
    first = int(np.searchsorted(times, since))
    before, behind = np.flatnonzero(~outlying[:first]), np.flatnonzero(~outlying[first:])
    if len(before) and before[-1] + 1 < first:
        yield float(times[before[-1] + 1])
    if len(behind) and behind[0] > 0:
        yield float(times[first + behind[0]])


def _acts_on(measurement: Measurement, effect: Effect) -> np.ndarray:
    """True `(n,)` for the rows of the station, or target, of a jump; for all rows where it has neither."""
    if isinstance(effect, StationShift):
        return np.asarray(measurement.groups == effect.station)
    if isinstance(effect, TargetOffset):
        return np.asarray(measurement.state.target == effect.target)
    return np.ones(len(measurement), bool)


def _cost_with_outliers(stage: Stage) -> float:
    """BIC of a stage, with a free shift of each outlier."""
    shifts = len(stage.fit.outliers) * stage.fit.measurement.components
    return stage.cost + shifts * float(np.log(stage.linearised.scalars))


def _likeliest(stage: Stage, measurement: Measurement) -> tuple[Evaluated, np.ndarray] | None:
    """The jump that explains most of the rows of a fit and of the outliers in sequence `(n,)`; None without these."""
    fit, time = stage.fit, measurement.state.time
    outlying = np.zeros(len(measurement), bool)
    outlying[fit.outliers] = True
    if time is None or np.count_nonzero(outlying) < LEAST:
        return None
    stop, moments, sequences = measurement.stops, set[float](), np.zeros(len(measurement), bool)
    for part in _parts(measurement):
        rows = np.flatnonzero(part & ~fit.copies)
        rows = rows[np.argsort(time[rows], kind="stable")]
        for first, sequence in _sequences(outlying[rows]):
            if np.count_nonzero(outlying[rows[sequence]]) >= LEAST and len(np.unique(stop[rows[sequence]])) >= STOPS:
                moments.add(float(time[rows[first]]))
                sequences[rows[sequence]] = True
    sequences &= outlying
    candidates = [
        Candidate(msgspec.structs.replace(effect, since_s=moment), 1, float(len(time)))
        for effect in jumps(measurement)
        for moment in sorted(moments)
    ]
    if not candidates:
        return None
    return evaluate(LinearisedFit.of(replace(fit, kept=fit.kept | sequences)), candidates)[0], sequences


def _parts(measurement: Measurement) -> Iterator[np.ndarray]:
    """Masks `(n,)` of the rows on which a jump may act alone: each station, each target, and all rows."""
    for names in (measurement.groups, measurement.target_number):
        for name in np.unique(names).tolist():
            yield names == name
    yield np.ones(len(measurement), bool)


def _sequences(outlying: np.ndarray) -> Iterator[tuple[int, slice]]:
    """The last rows, and the first, that are outliers, with the first row behind the change; rows in order of time.

    A row between them that is none counts against the others; outlying `(n,)`.
    """
    to_the_end, from_the_first = np.cumsum((outlying - MOST)[::-1])[::-1], np.cumsum(outlying - MOST)
    first, end = int(np.argmax(to_the_end)), int(np.argmax(from_the_first)) + 1
    if first and to_the_end[first] > 0.0:
        yield first, slice(first, None)
    if end < len(outlying) and from_the_first[end - 1] > 0.0:
        yield end, slice(0, end)
