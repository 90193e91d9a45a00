"""Other forms of the causes that are named: another course, or another dependence on the position.

The search compares the changing parts of signals alone, since the model holds their means. Between two forms of one
cause the means may decide: where a calibration is known, or a rotary axis turns a drift, a model cannot hold them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.selection import Selector
from calibration.diagnosis.search.stage import Stage, chosen_of
from kinematics.effects import AngleHarmonic
from kinematics.transforms import Array


class Form(NamedTuple):
    """A form of a cause, with its most likely size."""

    candidate: Candidate
    size: Array
    """Linear parameters, in units of their typical sizes."""
    signal: Array
    """White `(N,)`, its mean included."""
    cost: float
    """Delta-BIC, and twice the log odds against it before the data."""


class Forms(NamedTuple):
    """The forms of a named cause."""

    number: int
    """Number of the cause."""
    without: LinearisedFit
    """The fit without it."""
    own: Form
    others: tuple[Form, ...]
    """The likeliest first."""


def forms(stage: Stage, library: Sequence[Candidate]) -> Iterator[Forms]:
    """The forms of each cause of the machine that has several; of a change of the calibration there is one.

    Also of a wave of a circle: over a part of the turn all of them look alike.
    """
    for i, own in enumerate(stage.accepted):
        known = own.candidate
        of_circle = isinstance(known.effect, AngleHarmonic)
        if known.replaces or known.changes or (known.effect.ACTS_ON == "instrument" and not of_circle):
            continue
        others = [each for each in library if each.cause == known.cause and _kind(each) != _kind(known)]
        if not others:
            continue
        without = stage.without(i)
        own_form, *found = compared(without, [known, *others])
        yield Forms(i, without, own_form, tuple(sorted(found, key=lambda form: form.cost)))


def compared(without: LinearisedFit, candidates: Sequence[Candidate]) -> Iterator[Form]:
    """Each candidate as a cause that a linearised fit lacks, its mean included."""
    responses = without.responses([each.effect for each in candidates])
    for candidate, response in zip(candidates, responses, strict=True):
        score = without.score(response, candidate.shapes, candidate.trials)
        cost = score.delta_bic + 2.0 * candidate.rarity
        yield Form(candidate, score.size, response.columns @ score.size, cost)


def with_likelier_forms(selector: Selector, stage: Stage) -> Stage:
    """The stage with likelier forms of its causes, where full fits with these are likelier and predict as well."""
    for each in forms(stage, selector.library):
        best = each.others[0]
        if best.cost >= each.own.cost:
            continue
        chosen = chosen_of(stage.accepted)
        chosen[each.number] = (best.candidate, best.size)
        trial = selector.stage(chosen)
        likelier = trial.cost + 2.0 * trial.rarity < stage.cost + 2.0 * stage.rarity
        if likelier and not trial.predicts_worse_than(stage):
            return with_likelier_forms(selector, trial.with_siblings_of(stage))
    return stage


def _kind(candidate: Candidate) -> tuple[type, int, int | None]:
    """The type, number of parameters and harmonic by which the forms of one cause differ; their shapes are fitted."""
    return type(candidate.effect), len(candidate.effect.parameters), getattr(candidate.effect, "harmonic", None)
