"""What no cause explains, as a smooth function without a name: added on request, and only where it predicts.

A Gaussian process over the variables that what is left depends on, written in products of Legendre polynomials: its
lengths say which terms are needed and how large each may be, the evidence how large the whole is in each direction of
the tool. What the model and the registration can hold stays theirs: of any combination of the terms most has to survive
them, or the term with most of it goes.
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

from calibration.diagnosis.residual.dependence import EVIDENCE, LENGTHS, Unexplained
from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.selection import WORTH, Selector, Stage, chosen_of, predicts
from kinematics.effects import Unnamed
from kinematics.effects.unnamed import DEGREE
from kinematics.state import TEMPERATURE, TIME
from kinematics.transforms import Array, read_only

Direction = Literal["X", "Y", "Z"]
COMPONENTS: tuple[Direction, ...] = ("X", "Y", "Z")
AGAIN = 2
"""Times that the bases are chosen anew with what was added."""
HELD = 0.998
"""Share of the function's variance that its terms hold."""
MOST_TERMS, MOST_IN_ODDS = 120, 300
ROWS_PER_TERM = 2
OWN = 0.45
"""Share of the squares of any combination of terms that the model and the registration have to leave."""
AMPLITUDES = read_only(np.geomspace(0.02, 20.0, 16))
"""Standard deviation of the function, in terms of the typical size of a coefficient."""
PASSES = 2
"""Times that each length is looked at."""
NODES = 64
"""Of the integrals over a variable."""
RIDGE = 1e-6


class Added(NamedTuple):
    """What came of the wish to add what no cause explains."""

    selector: Selector
    """With the bases that the error motions need now."""
    stage: Stage
    says: str


def add_unnamed(selector: Selector, named: Stage, left: Unexplained) -> Added:
    """What is left as unnamed effects beside the causes of a stage; the stage as it was where they don't predict."""
    over = f"what is left, a function of {', '.join(left.variables)},"
    strange = [name for name in left.variables if not may_depend_on(named.linearised, name)]
    if strange:
        says = f"{over} was not added: an unnamed effect is no function of {', '.join(strange)}"
        return Added(selector, named, says)
    stage, shown = _with_unnamed(selector, named, left)
    if stage is named:
        return Added(selector, named, f"{over} was not added: held-out blocks are not predicted better with it")
    for _ in range(AGAIN):
        base = selector.chosen_again(stage)
        if base.choice == selector.base.choice:
            break
        # error motions had become finer than they are, to do some of it
        other = replace(selector, base=base)
        trial = other.stage(chosen_of(stage.accepted))
        for index in range(len(named.accepted), len(trial.accepted)):
            trial, shown = _tuned(other, trial, index, shown)
        if trial.heldout_um >= stage.heldout_um:
            break
        selector, stage = other, trial
    says = f"{over} was added without a name: it says nothing of a cause, nor of what was not measured"
    return Added(selector, stage, says)


def _with_unnamed(selector: Selector, named: Stage, left: Unexplained) -> tuple[Stage, Unexplained]:
    """The stage with an unnamed effect in each direction in which that predicts, and the lengths that it shows."""
    stage, missing = named, COMPONENTS
    while True:
        best = next(iter(propose(stage.linearised, left, missing)), None)
        if best is None:
            return stage, left
        first = selector.stage([*chosen_of(stage.accepted), (best, np.zeros(len(best.prior)))])
        trial, shown = _tuned(selector, first, -1, left)
        added = trial.accepted[-1]
        if added.score.delta_bic < WORTH and predicts(added.held_out_gains) and trial.heldout_um < stage.heldout_um:
            stage, left = trial, shown
        missing = tuple(component for component in missing if component != best.axis)


def _tuned(selector: Selector, stage: Stage, index: int, left: Unexplained) -> tuple[Stage, Unexplained]:
    """The stage with the most likely lengths of one of its unnamed effects, once the fit knows the noise; and these.

    The stage as it was where that predicts no better.
    """
    linearised = stage.without(index)
    own = [component for component in COMPONENTS if component == stage.accepted[index].candidate.axis]
    shown, best = left, odds_of(linearised, own[0], left)
    for _ in range(PASSES):
        for i, length in product(range(len(left.lengths)), LENGTHS):
            tried = shown._replace(lengths=(*shown.lengths[:i], length, *shown.lengths[i + 1 :]))
            odds = odds_of(linearised, own[0], tried)
            if odds > best:
                best, shown = odds, tried
    candidates = propose(linearised, shown, own)
    if not candidates:
        return stage, left
    chosen = chosen_of(stage.accepted)
    chosen[index] = candidates[0], np.zeros(len(candidates[0].prior))
    again = selector.stage(chosen)
    return (again, shown) if again.heldout_um < stage.heldout_um else (stage, left)


def propose(
    linearised: LinearisedFit, left: Unexplained, components: Sequence[Direction] = COMPONENTS
) -> list[Candidate]:
    """Unnamed effects in the directions of the tool in which what is left is plain, the plainest first."""
    found = []
    for component in components:
        effect, spread = _effect(linearised, component, left, min(MOST_TERMS, len(linearised.rows) // ROWS_PER_TERM))
        columns = linearised.columns(effect) * spread
        left_of = linearised.projected(columns).left
        kept = surviving(columns.T @ columns, left_of)
        if not len(kept):
            continue
        odds, size = evidence(left_of[np.ix_(kept, kept)], columns[:, kept].T @ linearised.residual)
        terms = tuple(effect.terms[i] for i in kept.tolist())
        own = Unnamed(component, effect.variables, effect.ranges, terms, (0.0,) * len(terms))
        found.append((odds, Candidate(own, prior=tuple((size * spread[kept]).tolist()))))
    return [candidate for odds, candidate in sorted(found, key=lambda pair: -pair[0]) if odds > EVIDENCE]


def odds_of(linearised: LinearisedFit, component: Direction, left: Unexplained) -> float:
    """Log odds of an error of the tool in a direction, a function of these variables, against none."""
    effect, spread = _effect(linearised, component, left, MOST_IN_ODDS)
    columns = linearised.columns(effect) * spread
    return evidence(linearised.projected(columns).left, columns.T @ linearised.residual)[0]


def evidence(left: Array, along: Array) -> tuple[float, float]:
    """Log odds of a function against nothing, and its most likely standard deviation, one of `AMPLITUDES`.

    left: what model and registration leave of its columns `(k, k)`; along: the columns on the residual `(k,)`.
    """
    values, ways = np.linalg.eigh(left)
    variances = AMPLITUDES[:, None] ** 2
    scaled = variances * np.maximum(values, 0.0)
    odds = 0.5 * np.sum(variances * (ways.T @ along) ** 2 / (1.0 + scaled) - np.log1p(scaled), axis=1)
    best = int(np.argmax(odds))
    return float(odds[best]), float(AMPLITUDES[best])


def _effect(linearised: LinearisedFit, component: Direction, left: Unexplained, most: int) -> tuple[Unnamed, Array]:
    """An effect of zero size with at most so many terms of these lengths, and their standard deviations `(k,)`."""
    state, machine = linearised.measurement.state, linearised.measurement.machine
    columns = [state.variable(machine, name, "unnamed") for name in left.variables]
    ranges = tuple((float(column.min()), float(column.max())) for column in columns)
    terms, spread = terms_of(left.lengths, most)
    degrees = tuple(map(tuple, terms.tolist()))
    return Unnamed(component, left.variables, ranges, degrees, (0.0,) * len(terms)), spread


@lru_cache(maxsize=256)
def terms_of(lengths: tuple[float, ...], most: int) -> tuple[np.ndarray, Array]:
    """Degrees `(k, variables)` of the terms that hold most of a function's variance, and their standard deviations.

    lengths: by variable, in parts of its range; the function has a standard deviation of 1.
    """
    each = [_coefficients(length) for length in lengths]
    norms = reduce(np.multiply.outer, [2 * np.arange(len(own)) + 1 for own in each]).reshape(-1)
    sizes = reduce(np.multiply.outer, each).reshape(-1)
    held = sizes**2 / norms
    least = np.partition(held, max(len(held) - most, 0))[max(len(held) - most, 0)]
    some = np.flatnonzero(held >= least)
    order = some[np.argsort(-held[some], kind="stable")]
    count = int(np.searchsorted(np.cumsum(held[order]), HELD * held.sum())) + 1
    chosen = np.sort(order[: min(count, most)])
    degrees = np.stack(np.unravel_index(chosen, [len(own) for own in each]), axis=1)
    return read_only(degrees), read_only(sizes[chosen])


@lru_cache(maxsize=64)
def _coefficients(length: float) -> Array:
    """Standard deviations `(DEGREE + 1,)` of the Legendre coefficients of a Gaussian process on -1 ... 1."""
    places, weights = legendre.leggauss(NODES)
    kernel = np.exp(-0.5 * ((places[:, None] - places) / (2.0 * length)) ** 2)
    ways = legendre.legvander(places, DEGREE) * weights[:, None] * (np.arange(DEGREE + 1) + 0.5)
    return read_only(np.asarray(np.sqrt(np.maximum(np.einsum("ai,ab,bi->i", ways, kernel, ways), 0.0))))


def surviving(whole: Array, left: Array) -> np.ndarray:
    """Numbers of the columns, of whose any combination at least `OWN` survives; `whole` and `left` `(k, k)`."""
    sizes = np.sqrt(np.maximum(np.diag(whole), 0.0))
    kept = np.flatnonzero(sizes > 0.0)
    while len(kept):
        some, unit = np.ix_(kept, kept), np.outer(sizes[kept], sizes[kept])
        shares, ways = linalg.eigh(left[some] / unit, whole[some] / unit + RIDGE * np.eye(len(kept)))
        if shares[0] >= OWN:
            break
        kept = np.delete(kept, int(np.argmax(np.abs(ways[:, 0]))))
    return kept


def may_depend_on(linearised: LinearisedFit, name: str) -> bool:
    """True for a variable that an unnamed effect can be a function of."""
    return name == TIME or name.startswith(TEMPERATURE) or name in linearised.measurement.machine.names
