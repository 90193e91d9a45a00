"""Unnamed effects: the unexplained residual as a smooth function, added on request and only where it predicts.

A Gaussian process over the variables of the unexplained residual, in products of Legendre polynomials. Its lengths
determine the terms and the size that each may have, the evidence its amplitude in each direction of the tool. The
model and the registration keep the part that they can imitate: of every combination of terms they must leave a share
of `OWN`; otherwise the term that contributes most to it is dropped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, reduce
from itertools import product
from typing import Literal, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from scipy import linalg

from calibration.diagnosis.residual.dependence import EVIDENCE, LENGTHS, Function, Unexplained
from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.evaluation import WORTH, predicts
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.row_sensitivity import RowSensitivity
from calibration.diagnosis.search.selection import Selector
from calibration.diagnosis.search.stage import Stage, chosen_of
from kinematics.basis import Interval
from kinematics.effects import Unnamed
from kinematics.effects.unnamed import DEGREE
from kinematics.state import TEMPERATURE, TIME
from kinematics.transforms import Array, read_only

Direction = Literal["X", "Y", "Z"]
COMPONENTS: tuple[Direction, ...] = ("X", "Y", "Z")
AGAIN = 2
"""Times that the bases are selected again with the added effects."""
HELD, HELD_OF_ALL = 0.998, 0.9
"""Shares of the function's variance, and of the part that depends on all variables, that its terms hold."""
MOST_TERMS, MOST_IN_ODDS = 120, 300
ROWS_PER_TERM = 2
OWN = 0.45
"""Least share of the squares of any combination of terms that the model and the registration must leave."""
AMPLITUDES = read_only(np.geomspace(0.02, 20.0, 16))
"""Standard deviations of the function that are tried, in typical sizes of a coefficient."""
PASSES = 2
"""Times that each length is searched."""
NODES = 64
"""Nodes of the integrals over a variable."""
RIDGE = 1e-6


class Proposed(NamedTuple):
    """An unnamed effect in one direction of the tool."""

    log_odds: float
    """Log odds of the effect against none."""
    candidate: Candidate
    effect: Unnamed
    """Effect of the candidate."""


class Added(NamedTuple):
    """Result of a request to add unnamed effects."""

    selector: Selector
    """The selector with the bases that the error motions need beside these effects."""
    stage: Stage
    text: str
    """The result as a sentence."""


def add_unnamed(selector: Selector, named: Stage, dependence: Unexplained) -> Added:
    """The stage with unnamed effects for the unexplained residual; unchanged where these do not predict."""
    over = f"The unexplained dependence on {', '.join(dependence.variables)}"
    strange = [name for name in dependence.variables if not may_depend_on(named.linearised, name)]
    if strange:
        text = f"{over} was not added: an unnamed effect cannot depend on {', '.join(strange)}."
        return Added(selector, named, text)
    stage, shown = _with_unnamed(selector, named, dependence)
    if stage is named:
        return Added(selector, named, f"{over} was not added: with it held-out blocks are not predicted better.")
    for _ in range(AGAIN):
        base = selector.chosen_again(stage)
        if base.bases == selector.base.bases:
            break
        # the error motions had become too fine, to imitate part of the function
        other = replace(selector, base=base)
        trial = other.stage(chosen_of(stage.accepted))
        for index in range(len(named.accepted), len(trial.accepted)):
            trial, shown = _tuned(other, trial, index, shown)
        if trial.held_out_um >= stage.held_out_um:
            break
        selector, stage = other, trial
    text = f"{over} was added as an unnamed effect: it names no cause and is valid within the measured ranges only."
    return Added(selector, stage, text)


def _with_unnamed(selector: Selector, named: Stage, dependence: Unexplained) -> tuple[Stage, Unexplained]:
    """The stage with an unnamed effect in each direction in which it predicts better, and the last one's lengths."""
    stage, missing = named, COMPONENTS
    while True:
        proposed = propose(stage.linearised, dependence, missing)
        if not proposed:
            return stage, dependence
        best = proposed[0].candidate
        first = selector.stage([*chosen_of(stage.accepted), (best, np.zeros(len(best.prior)))])
        trial, shown = _tuned(selector, first, -1, dependence)
        added = trial.accepted[-1]
        if added.score.delta_bic < WORTH and predicts(added.held_out_gains) and trial.held_out_um < stage.held_out_um:
            stage, dependence = trial, shown
        missing = tuple(component for component in missing if component != best.axis)


def _tuned(selector: Selector, stage: Stage, index: int, dependence: Unexplained) -> tuple[Stage, Unexplained]:
    """The stage with the most likely lengths of one of its unnamed effects, at that fit's noise; and these lengths.

    The stage is unchanged where these lengths predict no better.
    """
    linearised = stage.without(index)
    own = [component for component in COMPONENTS if component == stage.accepted[index].candidate.axis]
    shown, best = dependence, odds_of(linearised, own[0], dependence)
    for _ in range(PASSES):
        for i, length in product(range(len(dependence.lengths)), LENGTHS):
            tried = shown._replace(lengths=(*shown.lengths[:i], length, *shown.lengths[i + 1 :]))
            odds = odds_of(linearised, own[0], tried)
            if odds > best:
                best, shown = odds, tried
    candidates = propose(linearised, shown, own)
    if not candidates:
        return stage, dependence
    chosen = chosen_of(stage.accepted)
    chosen[index] = candidates[0].candidate, np.zeros(len(candidates[0].candidate.prior))
    again = selector.stage(chosen)
    return (again, shown) if again.held_out_um < stage.held_out_um else (stage, dependence)


def propose(
    linearised: LinearisedFit,
    function: Function | Unexplained,
    components: Sequence[Direction] = COMPONENTS,
    *,
    whole: bool = False,
) -> list[Proposed]:
    """Unnamed effects in the directions of the tool in which their log odds exceed `EVIDENCE`, the likeliest first.

    whole: also with the terms that the model and the registration can imitate.
    """
    found = []
    for component in components:
        most = min(MOST_TERMS, len(linearised.rows) // ROWS_PER_TERM)
        effect, spread = _effect(linearised, component, function, most)
        columns = linearised.columns(effect) * spread
        schur = linearised.projected(columns).schur
        kept = np.arange(len(spread)) if whole else surviving(columns.T @ columns, schur)
        if not len(kept):
            continue
        odds, size = evidence(schur[np.ix_(kept, kept)], columns[:, kept].T @ linearised.residual)
        terms = tuple(effect.terms[i] for i in kept.tolist())
        own = Unnamed(component, effect.variables, effect.ranges, terms, (0.0,) * len(terms))
        found.append(Proposed(odds, Candidate(own, prior=tuple((size * spread[kept]).tolist())), own))
    return sorted((each for each in found if each.log_odds > EVIDENCE), key=lambda each: -each.log_odds)


def odds_of(linearised: LinearisedFit, component: Direction, function: Function | Unexplained) -> float:
    """Log odds of an error of the tool in one direction, a function of these variables, against none."""
    effect, spread = _effect(linearised, component, function, MOST_IN_ODDS)
    tool = RowSensitivity.of_tool(linearised, component)
    return evidence(*tool.parts(tool.values(effect) * spread))[0]


def evidence(schur: Array, along: Array) -> tuple[float, float]:
    """Log odds of a function against none, and its most likely standard deviation, one of `AMPLITUDES`.

    schur: the part `(k, k)` of its columns that the model and the registration cannot imitate; along: the residual
    along its columns `(k,)`.
    """
    values, vectors = np.linalg.eigh(schur)
    variances = AMPLITUDES[:, None] ** 2
    scaled = variances * np.maximum(values, 0.0)
    odds = 0.5 * np.sum(variances * (vectors.T @ along) ** 2 / (1.0 + scaled) - np.log1p(scaled), axis=1)
    best = int(np.argmax(odds))
    return float(odds[best]), float(AMPLITUDES[best])


def _effect(
    linearised: LinearisedFit, component: Direction, function: Function | Unexplained, most: int
) -> tuple[Unnamed, Array]:
    """An effect of zero size with at most `most` terms of these lengths, and their standard deviations `(k,)`."""
    terms, spread = terms_of(function.lengths, most)
    degrees = tuple(map(tuple, terms.tolist()))
    ranges = ranges_of(linearised, function.variables)
    return Unnamed(component, function.variables, ranges, degrees, (0.0,) * len(terms)), spread


def ranges_of(linearised: LinearisedFit, variables: Sequence[str]) -> tuple[Interval, ...]:
    """Range of each variable in the measurement."""
    state, machine = linearised.measurement.state, linearised.measurement.machine
    columns = (state.variable(machine, name, "unnamed") for name in variables)
    return tuple((float(column.min()), float(column.max())) for column in columns)


@lru_cache(maxsize=256)
def terms_of(lengths: tuple[float, ...], most: int) -> tuple[np.ndarray, Array]:
    """Degrees `(k, variables)` of the terms with most of a function's variance, and their standard deviations `(k,)`.

    lengths: by variable, as fractions of its range; the function has a standard deviation of 1. A constant without
    variables.
    """
    if not lengths:
        return read_only(np.zeros((1, 0), int)), read_only(np.ones(1))
    each = [_coefficients(length) for length in lengths]
    norms = reduce(np.multiply.outer, [2 * np.arange(len(own)) + 1 for own in each]).reshape(-1)
    sizes = reduce(np.multiply.outer, each).reshape(-1)
    held = sizes**2 / norms
    least = np.partition(held, max(len(held) - most, 0))[max(len(held) - most, 0)]
    some = np.flatnonzero(held >= least)
    order = some[np.argsort(-held[some], kind="stable")]
    of_all = reduce(np.multiply.outer, [np.arange(len(own)) > 0 for own in each]).reshape(-1) * held
    count = 1 + max(
        int(np.searchsorted(np.cumsum(part[order]), share * part.sum()))
        for part, share in ((held, HELD), (of_all, HELD_OF_ALL))
    )
    chosen = np.sort(order[: min(count, most)])
    degrees = np.stack(np.unravel_index(chosen, [len(own) for own in each]), axis=1)
    return read_only(degrees), read_only(sizes[chosen])


@lru_cache(maxsize=64)
def _coefficients(length: float) -> Array:
    """Standard deviations `(DEGREE + 1,)` of the Legendre coefficients of a Gaussian process on -1 ... 1."""
    nodes, weights = legendre.leggauss(NODES)
    kernel = np.exp(-0.5 * ((nodes[:, None] - nodes) / (2.0 * length)) ** 2)
    projection = legendre.legvander(nodes, DEGREE) * weights[:, None] * (np.arange(DEGREE + 1) + 0.5)
    return read_only(np.asarray(np.sqrt(np.maximum(np.einsum("ai,ab,bi->i", projection, kernel, projection), 0.0))))


def surviving(whole: Array, schur: Array) -> np.ndarray:
    """Indices of columns of which any combination keeps a share of at least `OWN`; `whole` and `schur` `(k, k)`."""
    sizes = np.sqrt(np.maximum(np.diag(whole), 0.0))
    kept = np.flatnonzero(sizes > 0.0)
    some, unit = np.ix_(kept, kept), np.outer(sizes[kept], sizes[kept])
    left, right = schur[some] / unit, whole[some] / unit + RIDGE * np.eye(len(kept))
    while len(kept):
        shares, vectors = linalg.eigh(left, right, subset_by_index=(0, 0), check_finite=False)
        if shares[0] >= OWN:
            break
        lost = int(np.argmax(np.abs(vectors[:, 0])))
        kept = np.delete(kept, lost)
        left, right = (np.delete(np.delete(each, lost, axis=0), lost, axis=1) for each in (left, right))
    return kept


def may_depend_on(linearised: LinearisedFit, name: str) -> bool:
    """True for a variable that an unnamed effect can depend on."""
    return name == TIME or name.startswith(TEMPERATURE) or name in linearised.measurement.machine.names
