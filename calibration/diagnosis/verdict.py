"""Named causes with sizes, verdicts and siblings; causes that the data cannot show, with the remedies."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from calibration.diagnosis.residual.unexplained import against_walk
from calibration.diagnosis.search.evaluation import EVEN, WORTH, Sibling
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.shapes.sawtooth import saw_uncertainty
from calibration.diagnosis.search.shapes.spectra import aliases
from calibration.diagnosis.search.stage import Accepted, Stage
from calibration.diagnosis.search.sudden_changes import like_outliers
from calibration.diagnosis.terms.contract import contract_kind, fields_of, where
from calibration.evaluation.machine_change import MachineChange
from calibration.fit.fit import Fit
from kinematics.effects import (
    Cyclic,
    Effect,
    ErrorMotion,
    Outliers,
    QuantisedCompensation,
    UnknownApproach,
)
from kinematics.error_model.model import ErrorModel

Verdict = Literal["strong", "tied", "weak"]
LINEAR, ANGLES = "XYZ", "ABC"
CLEAR = 2.0
"""Standard errors of the held-out gain, and multiples of the required delta-BIC, of a strong verdict."""
AT_AN_END = (
    "the rows lie at one end and are off alike, as after a knock at the instrument or a target seated again: some of "
    "the other positions, measured once more, show which"
)
LARGEST = 700.0
"""Largest logarithm of odds."""
EVERYWHERE = 6
"""Number of held-out blocks from which a gain in every one of them is clear, however uneven: chance 1 in 64."""


@dataclass(frozen=True)
class Alternative:
    """Another cause that these data can hardly distinguish from the named one."""

    kind: str
    axis: str | None
    name: str
    cosine: float
    odds: float
    """Odds of the named cause against this one."""

    @property
    def tied(self) -> bool:
        """True where these data do not distinguish it from the named cause."""
        return self.odds < math.exp(EVEN)


@dataclass(frozen=True)
class Named:
    """A cause that the data support."""

    kind: str
    """Kind of the cause (docs/diagnosis.md)."""
    effect: Effect
    """The effect with its parameters and standard uncertainties."""
    delta_bic: float
    """Change of the BIC by this cause."""
    heldout_gain_um: float
    """Improvement of the prediction of held-out data, um RMS."""
    share: float
    """Share of the squares without any cause that this cause explains; squares in units of the noise."""
    verdict: Verdict
    """How sure the cause is: strong, tied or weak."""
    visible: float
    """Share of its signal that neither the model nor the registration can imitate."""
    alternatives: tuple[Alternative, ...] = ()
    """Causes that explain the data about as well."""
    notes: tuple[str, ...] = ()
    """Notes for the user."""
    present: Effect | None = None
    """Effect of the present calibration that it changes; None where it is a cause of its own."""

    @property
    def where(self) -> str:
        """The part that the cause acts on: machine or instrument."""
        return "instrument" if self.effect.ACTS_ON == "instrument" else "machine"

    @property
    def axis(self) -> str | None:
        """Axis, direction of the tool, or circle, station or target of the instrument."""
        return where(self.effect)

    @property
    def fields(self) -> dict[str, Any]:
        """Further fields that distinguish it from others: component, other axis, sensor, side, ..."""
        return fields_of(self.effect)


def named(stage: Stage, before: LinearisedFit, model: ErrorModel) -> list[Named]:
    """The accepted causes of a stage, the best first, unnamed effects last.

    before: the linearised fit without any of them. model: that of the stage, with the sizes of the result; its error
    motions are curves.
    """
    found = []
    whole = in_terms_of(before, stage.linearised)
    for i, (each, number) in enumerate(zip(stage.accepted, stage.numbers, strict=True)):
        without = stage.without(i)
        fitted = stage.fit.model.effects[number]
        sized = fitted if isinstance(fitted, ErrorMotion) else model.effects[number]
        effect = _with_uncertainty(sized, without)
        own = without.projected(without.columns(each.candidate.effect))
        share = float(each.size @ own.schur @ each.size) / whole
        walk = _random_walk(stage, i)
        alternatives = (*walk, *_alternatives(each))
        found.append(
            Named(
                each.candidate.kind,
                effect,
                each.score.delta_bic,
                without.cross_validation.rms_um - stage.held_out_um,
                min(share, 1.0),
                "tied" if walk else verdict_of(each),
                each.visible,
                alternatives,
                tuple(notes(stage.linearised, effect)),
                each.candidate.changes,
            )
        )
    return sorted(found, key=lambda cause: (not cause.effect.NAMES_CAUSE, cause.delta_bic))


def with_changed_lines(causes: Sequence[Named], change: MachineChange, given: Stage, after: Stage) -> list[Named]:
    """The causes, and the scales and location errors that differ from the calibration as it was given.

    Where a line is a cause already, its size becomes that of the whole difference.
    """
    lines = {line.name: line for line in change.lines}
    sized = [replace(cause, effect=lines.get(cause.effect.name, cause.effect)) for cause in causes]
    known = {cause.effect.name for cause in causes}
    new = [line for line in change.lines if line.name not in known]
    return [*sized, *(each for each in _changed_lines(change, given, after) if each.effect in new)]


def _changed_lines(change: MachineChange, given: Stage, after: Stage) -> Iterator[Named]:
    """Scales and location errors that differ from the calibration as it was given, with odds as of a cause.

    Their gain on held-out rows is that of all changes and causes together; the share is that of the squares of the
    residuals of the calibration as it was given, a rigid motion apart.
    """
    gain = given.held_out_um - after.held_out_um
    squares = given.fit.rms_um**2 * given.fit.measurement.components
    for line, moved_um in zip(change.lines, change.moved_um, strict=True):
        z = line.parameters[0] / max(line.uncertainties[0], 1e-300)
        delta_bic = math.log(after.linearised.scalars) - z**2
        if delta_bic < WORTH:
            kind = contract_kind(line)
            verdict: Verdict = "strong" if delta_bic < CLEAR * WORTH and gain > 0.0 else "weak"
            share = min(moved_um**2 / max(squares, 1e-300), 1.0)
            yield Named(kind, line, delta_bic, gain, share, verdict, 1.0)


def in_terms_of(before: LinearisedFit, linearised: LinearisedFit) -> float:
    """Sum of squares of the fit `before` in units of the noise of `linearised`: each may have its own estimate."""
    return max(before.squares * before.fit.variance_factor / linearised.fit.variance_factor, 1e-300)


def outliers(fit: Fit, before: LinearisedFit) -> Named | None:
    """The outliers of three-component observations as one cause; None without any, or where noise can make them.

    Rows before the first move of an axis with lost motion are no outliers where no parameter of the model holds the
    unknown side on which it stood.
    """
    rows = fit.outliers[~_of_unknown_side(fit)[fit.outliers]]
    if not len(rows) or fit.measurement.instrument.components != 3:
        return None
    frame_rows = np.isin(before.rows, rows)
    components = fit.measurement.instrument.components
    squares = float(np.sum(before.residual.reshape(-1, components)[frame_rows] ** 2))
    shift = fit.residual[rows] * 1e3
    covariances = 1e6 * _covariances(fit, rows)
    u = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    effect = Outliers(
        rows=tuple(rows.tolist()), shift_um=tuple(shift.reshape(-1).tolist()), u=tuple(u.reshape(-1).tolist())
    )
    # across the beam of a tracker x and y err together
    distance = float(np.sum(shift * np.linalg.solve(covariances, shift[:, :, None])[:, :, 0]))
    delta_bic = -distance + shift.size * math.log(max(fit.observations, 2))
    if delta_bic > WORTH:
        return None
    share = min(squares / max(before.squares, 1e-300), 1.0)
    changes = tuple(
        Alternative(contract_kind(change), where(change), change.name, 1.0, _odds(log_odds))
        for change, log_odds in like_outliers(fit, rows)
    )
    tied = any(change.tied for change in changes)
    verdict: Verdict = "tied" if tied else "strong"
    return Named("outliers", effect, delta_bic, 0.0, share, verdict, 1.0, changes, (AT_AN_END,) * tied)


def _of_unknown_side(fit: Fit) -> np.ndarray:
    """True `(n,)` for rows before the first move of an axis whose direction has an effect, but no unknown start."""
    state, machine = fit.measurement.state, fit.measurement.machine
    if state.approach is None:
        return np.zeros(len(fit.measurement), bool)
    sided = [effect for effect in fit.model.effects if "approach" in effect.needs and effect.ACTS_ON != "instrument"]
    known = {effect.axis for effect in fit.model.effects if isinstance(effect, UnknownApproach)}
    axes = [machine.index(axis) for axis in {where(effect) or "" for effect in sided} & {*machine.names} - known]
    return np.asarray(np.any(state.approach[:, axes] == 0.0, axis=1))


def tied_with(accepted: Accepted) -> list[Sibling]:
    """Siblings that these data cannot distinguish from a cause, also of its own kind and axis."""
    return [sibling for sibling in accepted.siblings if sibling.log_odds < EVEN]


def _random_walk(stage: Stage, index: int) -> tuple[Alternative, ...]:
    """A random walk of the tool where these data do not distinguish it from a course in time; it takes any course."""
    log_odds = against_walk(stage, index)
    if log_odds >= EVEN:
        return ()
    return (Alternative("random-walk", None, "random walk of the tool", 1.0, math.exp(log_odds)),)


def _alternatives(accepted: Accepted) -> Iterator[Alternative]:
    for sibling in accepted.siblings:
        candidate, odds = sibling.evaluated.candidate, _odds(sibling.log_odds)
        yield Alternative(candidate.kind, candidate.axis, candidate.effect.name, sibling.cosine, odds)


def _odds(log_odds: float) -> float:
    """Odds by their logarithm; a number for any."""
    return math.exp(min(log_odds, LARGEST))


def verdict_of(accepted: Accepted) -> Verdict:
    """Verdict of an accepted cause."""
    if tied_with(accepted):
        return "tied"
    gains = accepted.held_out_gains
    clear = accepted.sureness > CLEAR or (len(gains) >= EVERYWHERE and bool(gains.min() > 0.0))
    sure = clear and accepted.score.delta_bic < CLEAR * WORTH
    return "strong" if sure else "weak"


def _with_uncertainty(effect: Effect, without: LinearisedFit) -> Effect:
    """The effect; the steps of a compensation table with the uncertainties of their search."""
    if not isinstance(effect, QuantisedCompensation):
        return effect
    return effect.with_parameters(effect.parameters, (effect.uncertainties[0], *saw_uncertainty(without, effect)))


def notes(linearised: LinearisedFit, effect: Effect) -> Iterator[str]:
    """Notes on a cause: other periods that fit as well, and the meaning of a size with an unusual sign."""
    yield from effect.remarks
    if effect.ON_PART and not linearised.measurement.instrument.CLOCK_OF_MACHINE:
        yield effect.ON_PART
    if isinstance(effect, Cyclic):
        others = aliases(linearised.positions(effect.axis), effect.period)
        if others:
            unit = "deg" if effect.axis[0] in "ABC" else "mm"
            listed = ", ".join(f"{p:.4g}" for p in others)
            yield f"positions on a lattice do not distinguish its period from {listed} {unit}"


def _covariances(fit: Fit, rows: np.ndarray) -> np.ndarray:
    from calibration.observation.equations import covariance

    return np.asarray(covariance(fit.measurement.rows(rows)))


__all__ = ["Alternative", "Named", "contract_kind", "named", "notes", "outliers", "tied_with", "verdict_of"]
