"""A drift between the touches of spheres, which the calibration must not contain: it is estimated, and left out.

A centre that is measured again shows it. The fit then has a drift with time, of the tool point or of the workpiece, as
the data make likelier; without times, the rows count as equidistant. The calibration holds for the start of the data.
The other side counts with its probability. An error that a stated basis lacks turns with the rotary axes, as the drift
of one side does: the probabilities are therefore of this basis and of the one with the next wave together.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from scipy import special

from calibration.fit.fit import Fit
from calibration.fit.set_up.explained import Explained, Wanted, explained
from calibration.instruments import TouchProbe
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import BasisChoice
from calibration.plausibility.finding import Finding
from kinematics.effects import Effect, ThermalDrift, WorkpieceDrift
from kinematics.effects.combined.where import Direction
from kinematics.error_model.covariance import COVERAGE_FACTOR
from kinematics.error_model.model import ErrorModel
from kinematics.files.number_text import uncertainty
from kinematics.transforms import Array

ROW_S = 60.0
"""Time from row to row, s, of data without times: only its proportions count."""
SPECIFIED = 1.0
"""chi2/dof of noise that is as the instrument specification states it."""
FIRST_TIME_CONSTANT_SHARE = 1.0 / 3.0
"""Time constant at the start of the fit, as a share of the duration."""
LEAST_SIDE_PROBABILITY = 1e-3
"""Probability below which the drift of the other side does not count."""
OTHER_SIDE_PROBABILITY = 0.05
"""Probability of the other side below which a report names the likelier one (odds of 19: strong evidence)."""

FALSE_SHIFT_PROBABILITY = 0.01
"""Chance that the repeated centres of a machine without drift count as shifted."""
SAME_ROTARY_RAD = 1e-5
"""Largest difference, rad, of rotary positions that are the same."""
IMPOSSIBLE_SHIFT_UM = 500.0
"""Shift, um, from which a row is wrong: no machine drifts so far. Other checks name such rows."""


@dataclass(frozen=True)
class Drift:
    """A fit, and the drift that it contains beside the calibration."""

    explained: Explained
    findings: tuple[Finding, ...]
    effects: tuple[Effect, ...]
    other: Drift | None = None
    """The same with a drift of the other side, where this is possible."""
    probability: float = 1.0
    """Probability that this side drifts, if one of both does."""

    @property
    def fit(self) -> Fit:
        """The fit."""
        return self.explained.fit

    @property
    def side(self) -> str:
        """The part of the machine that drifts."""
        return "workpiece" if self.effects[0].ACTS_ON == "workpiece" else "tool point"

    @property
    def model(self) -> ErrorModel:
        """The machine without the drift, whose uncertainty contains it.

        Where the other side may drift instead, with the probability p and parameters that differ by d, the mean square
        of the errors is (1 - p) C + p (C' + d d'): the covariances C and C' of both, and the difference (Hoeting et al.
        1999, Bayesian model averaging, equation 4, about the likelier one instead of the mean).
        """
        names = {effect.name for effect in self.effects}
        own = self.explained.model.part(lambda effect: effect.name not in names)
        if self.other is None:
            return own
        other, p = self.other.model, 1.0 - self.probability
        away = other.parameters - own.parameters
        theirs = np.array(other.covariance) + np.outer(away, away)
        return own.with_parameters(own.parameters, (1.0 - p) * np.array(own.covariance) + p * theirs)


def with_drift(measurement: Measurement, wanted: Wanted) -> Drift:
    """The fit, with a drift where a centre that was measured again shows one."""
    plain = Drift(explained(measurement, wanted), (), ())
    if not measurement.instrument.FINDS_CENTRES:
        return plain
    shown = tuple(repeat_findings(plain.fit))
    if not any(repeat_findings(plain.fit, chi2=SPECIFIED)):
        return replace(plain, findings=shown)
    # an axis that does not repeat, or a fine basis, may explain the rows as well: U contains the drift in any case
    best = _likeliest(_timed(measurement), wanted)
    kept = best.fit.kept
    # a row that a drift does not explain either is wrong
    if not any(repeat_findings(plain.fit, kept, SPECIFIED)):
        return replace(plain, findings=shown)
    if any(repeat_findings(best.fit, plain.fit.kept)):
        return replace(plain, findings=tuple(_added(each, UNEXPLAINED) for each in shown))
    shown = tuple(repeat_findings(plain.fit, kept, SPECIFIED))
    sentence = _sentence(best)
    if not any(repeat_findings(plain.fit, kept, best.fit.chi2_reduced)):
        sentence += CHANCE
    return replace(best, findings=tuple(_added(each, sentence) for each in shown))


ESTIMATED = (
    "The fit estimates it as a drift of the {} with time, and leaves it out: the calibration holds for the start of "
    "the data, and U contains the uncertainty of this drift"
)
TIED = (
    "The fit estimates it as a drift with time, and leaves it out: the calibration holds for the start of the data. "
    "The rows do not show clearly which side drifts, the {} (probability {:.0%}) or the {} ({:.0%}): U contains both"
)
CHANCE = ". If the noise is as large as the residuals, larger than u_um, the shift is chance"
UNEXPLAINED = "No drift with time explains it, and U does not contain it: the errors may differ by as much"


def _sentence(best: Drift) -> str:
    if best.other is None or 1.0 - best.probability < OTHER_SIDE_PROBABILITY:
        return ESTIMATED.format(best.side)
    return TIED.format(best.side, best.probability, best.other.side, 1.0 - best.probability)


def _likeliest(timed: Measurement, wanted: Wanted) -> Drift:
    """The fit with the drift of the likelier side, beside the other one where this is possible."""
    tried = [_with(effects, timed, wanted) for effects in _courses(timed)]
    best, other = sorted(((_log_probability(each, timed, wanted), each) for each in tried), key=lambda own: -own[0])
    probability = float(1.0 / (1.0 + np.exp(other[0] - best[0])))
    return replace(
        best[1], other=other[1] if 1.0 - probability > LEAST_SIDE_PROBABILITY else None, probability=probability
    )


def _log_probability(own: Drift, timed: Measurement, wanted: Wanted) -> float:
    """Log probability of the data, up to a constant, if this side drifts."""
    finer = _with_next_wave(own.explained.bases)
    if wanted.automatic or finer == own.explained.bases:
        return own.fit.log_probability
    stated = ",".join(f"{axis}={basis}" for axis, basis in finer.items())
    waving = _with(own.effects, timed, replace(wanted, basis=stated))
    return float(np.logaddexp(own.fit.log_probability, waving.fit.log_probability))


def _with_next_wave(bases: Mapping[str, BasisChoice]) -> dict[str, BasisChoice]:
    """Stated bases with one more wave of each axis that has waves."""
    return {
        axis: replace(basis, size=basis.size + 1) if basis.kind == "fourier" else basis for axis, basis in bases.items()
    }


def _added(finding: Finding, sentence: str) -> Finding:
    return finding._replace(message=f"{finding.message}. {sentence}")


def _timed(measurement: Measurement) -> Measurement:
    if measurement.state.time is not None:
        return measurement
    return replace(measurement, state=replace(measurement.state, time=ROW_S * np.arange(len(measurement), dtype=float)))


def _courses(measurement: Measurement) -> Sequence[tuple[Effect, ...]]:
    """Drifts of the tool point and of the workpiece, linear and exponential, from zero."""
    time = measurement.state.need("time", "drift")
    constant = (FIRST_TIME_CONSTANT_SHARE * float(np.ptp(time)),)
    return [
        tuple(kind(c, rate=0.0, amplitudes=(0.0,), time_constants_s=constant) for c in get_args(Direction))
        for kind in (ThermalDrift, WorkpieceDrift)
    ]


def _with(effects: tuple[Effect, ...], measurement: Measurement, wanted: Wanted) -> Drift:
    own = replace(wanted, effects=(*wanted.effects, *effects))
    return Drift(explained(measurement, own), (), effects)


def repeat_findings(found: Fit, rows: np.ndarray | None = None, chi2: float | None = None) -> Iterator[Finding]:
    """A finding for the centre that is farthest from where it was found first, if this is more than noise allows.

    rows: mask `(n,)` of the rows that are compared; all when None. chi2: chi2/dof of the noise, by the instrument
    specification; that of the residuals, which a drift makes larger, when None.

    Both have the same errors of the machine, so that their residuals differ by noise and drift alone. The noise is
    at least that of the specification.
    """
    measurement = found.measurement
    if not measurement.instrument.FINDS_CENTRES:
        return
    first, again = _repeats(measurement.groups, measurement.state.positions[:, measurement.machine.rotary])
    shift = -1e3 * (found.residual[again] - found.residual[first])
    near = np.linalg.norm(shift, axis=1) < IMPOSSIBLE_SHIFT_UM
    if rows is not None:
        near &= rows[first] & rows[again]
    first, again, shift = first[near], again[near], shift[near]
    if not len(again):
        return
    u = (
        TouchProbe.expect(measurement.instrument).u_um
        * (2.0 * max(found.chi2_reduced if chi2 is None else chi2, 1.0)) ** 0.5
    )
    k = int(np.argmax(np.linalg.norm(shift, axis=1)))
    if np.abs(shift[k]).max() <= u * -special.ndtri(FALSE_SHIFT_PROBABILITY / (2.0 * shift.size)):
        return
    moved = ", ".join(f"{value:+.1f}" for value in shift[k])
    times = "" if measurement.state.time is not None else ", with a column time_s,"
    yield Finding(
        "drift",
        f"{measurement.where(int(again[k]))}: the centre of sphere {measurement.groups[again[k]]} is ({moved}) um +- "
        f"{uncertainty(COVERAGE_FACTOR * u, 1)} um (k=2) from where {measurement.where(int(first[k]))} found it at the "
        "same rotary positions: spindle, table or sphere moved or warmed up in between, or one of both rows is off. "
        f"Measure again in a warm machine; ncomp diagnose{times} separates a drift (thermal-drift) from a knock "
        "(station-shift)",
        False,
    )


def _repeats(groups: np.ndarray, rotary: Array) -> tuple[np.ndarray, np.ndarray]:
    """Rows `(k,)` that repeat a sphere at the rotary positions `(n, axes)` of an earlier row: that row, and they."""
    keys = np.concatenate(
        [np.unique(groups, return_inverse=True)[1][:, None], np.round(rotary / SAME_ROTARY_RAD)], axis=1
    )
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    earlier = first[number.reshape(-1)]
    again = np.flatnonzero(earlier != np.arange(len(groups)))
    return earlier[again], again
