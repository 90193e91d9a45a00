"""Proposed measurements: follow-up designs, ranked by predicted information per minute.

A design is evaluated before it is made. A tie counts as separated when each of the two causes, at its fitted size,
would be found with the other one fitted too. A cause that the data do not show has a small weight, and its
information counts only up to the amount that finds it at its typical size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import special

from calibration.diagnosis.next.predicted_information import Information, PredictedInformation
from calibration.diagnosis.next.proposals import follow_up_designs
from calibration.diagnosis.search.candidates import contract_kind
from calibration.diagnosis.search.selection import SEEN, WORTH, Evaluated, Stage
from calibration.diagnosis.verdict import CLEAR, REMEDIES, Named, tied_with
from kinematics.effects import Effect
from kinematics.transforms import Array

SURE = 0.8
"""Power from which a design separates a tie or shows a cause."""
MARGIN = 2.33
"""Standard deviations above the threshold for a power of 0.99; more information is not counted."""
WEIGHTS = {"tied": 1.0, "weak": 0.5, "hidden": 0.05}
LISTED = 3
"""Most causes that a sentence lists."""


class ProposedMeasurement(NamedTuple):
    """A proposed measurement."""

    name: str
    minutes: float
    gain_per_minute: float
    """Weighted growth per minute of the squares that separate or show causes, in units of the noise variance."""
    text: str
    """Instruction and expected result, as text for the workshop."""


class Signal(NamedTuple):
    """A cause of some size, by its index in the predicted information."""

    cause: int
    size: Array | None
    """Parameters in units of typical sizes; None: every parameter at its typical size."""
    shapes: int
    beside: int | None = None
    """The other cause that is fitted along."""
    without: slice | None = None
    """Columns of the model that belong to the cause itself."""


@dataclass(frozen=True, eq=False)
class Question:
    """An open question, answered when all its signals would be found."""

    kind: str
    name: str
    other: str
    signals: tuple[Signal, ...]

    def needed(self, signal: Signal, known: Information) -> tuple[int, float]:
        """Degrees of freedom of a signal, and the gain from which its cause is named."""
        own = known.causes[signal.cause]
        degrees_of_freedom = own.stop - own.start + signal.shapes
        worth = CLEAR * WORTH if self.kind == "weak" else WORTH
        return degrees_of_freedom, -worth + degrees_of_freedom * float(np.log(known.scalars))

    def information(self, known: Information) -> float:
        """Non-centrality of the weakest signal, at most the amount that is needed."""
        return min(self._one(signal, known) for signal in self.signals)

    def power(self, known: Information) -> float:
        """Least of the chances that each signal by itself would be found."""
        chances = []
        for signal in self.signals:
            if self.kind == "hidden" and known.share(signal.cause) < SEEN:
                return 0.0
            degrees_of_freedom, threshold = self.needed(signal, known)
            chances.append(
                1.0 - float(special.chndtr(threshold, degrees_of_freedom, max(_noncentrality(signal, known), 1e-9)))
            )
        return min(chances)

    def _one(self, signal: Signal, known: Information) -> float:
        if self.kind == "hidden" and known.share(signal.cause) < SEEN:
            return 0.0
        _, threshold = self.needed(signal, known)
        return min(_noncentrality(signal, known), float(threshold**0.5 + MARGIN) ** 2)


def proposed_measurements(
    stage: Stage, causes: Sequence[Named], evaluated: Sequence[Evaluated]
) -> Iterator[ProposedMeasurement]:
    """Designs that answer a question, the best first; then the ties that none of them separates.

    evaluated: all candidates.
    """
    effects, questions = _questions(stage, causes, evaluated)
    if not questions:
        return
    predicted = PredictedInformation(stage.linearised, effects)
    now = predicted.now
    found, answered = [], set()
    for follow_up in follow_up_designs(stage.fit):
        after = predicted.after(now, follow_up)
        gains = {q: WEIGHTS[q.kind] * max(q.information(after) - q.information(now), 0.0) for q in questions}
        answers = [(q, q.power(after)) for q in questions if gains[q] > 0.0]
        answers = [(q, power) for q, power in answers if power >= SURE]
        if answers:
            answered |= {q for q, _ in answers}
            does = f"{follow_up.does[0].upper()}{follow_up.does[1:]}"
            text = f"{does} ({follow_up.minutes:.0f} min): this {_expected(answers)}."
            found.append(
                ProposedMeasurement(follow_up.name, follow_up.minutes, sum(gains.values()) / follow_up.minutes, text)
            )
    yield from sorted(found, key=lambda proposed: -proposed.gain_per_minute)
    for question in questions:
        if question.kind == "tied" and question not in answered:
            remedy = REMEDIES.get(contract_kind(effects[question.signals[-1].cause]), "other positions")
            text = f"No proposed measurement separates {question.name} from {question.other}. It may need {remedy}."
            yield ProposedMeasurement("remedy", 0.0, 0.0, text)


def _questions(
    stage: Stage, causes: Sequence[Named], evaluated: Sequence[Evaluated]
) -> tuple[list[Effect], list[Question]]:
    """Effects in question, and the questions: ties, weak causes, and causes that the data do not show."""
    effects: list[Effect] = []
    found: list[Question] = []

    def number(effect: Effect) -> int:
        effects.append(effect)
        return len(effects) - 1

    verdicts = {cause.effect.name: cause.verdict for cause in causes}
    for accepted, index in zip(stage.accepted, stage.numbers, strict=True):
        effect = stage.fit.model.effects[index]
        verdict, own, part = verdicts.get(effect.name), accepted.candidate, stage.fit.model.slices[index]
        if verdict in ("tied", "weak"):
            i = number(own.effect)
        if verdict == "weak":
            found.append(Question("weak", effect.name, "", (Signal(i, accepted.size, own.shapes, without=part),)))
        for sibling in tied_with(accepted) if verdict == "tied" else []:
            other = sibling.evaluated.candidate
            j = number(other.effect)
            one = Signal(i, accepted.size, own.shapes, j, part)
            two = Signal(j, sibling.evaluated.score.size, other.shapes, i, part)
            found.append(Question("tied", effect.name, other.effect.name, (one, two)))
    for each in _hidden(evaluated):
        own = each.candidate
        found.append(Question("hidden", own.effect.name, "", (Signal(number(own.effect), None, own.shapes),)))
    return effects, found


def _hidden(evaluated: Sequence[Evaluated]) -> list[Evaluated]:
    """The most visible variant of each cause that the data do not show."""
    best: dict[str, Evaluated] = {}
    for each in evaluated:
        name = each.candidate.effect.name
        if name not in best or each.projected.visible > best[name].projected.visible:
            best[name] = each
    return [each for each in best.values() if each.projected.visible < SEEN]


def _noncentrality(signal: Signal, known: Information) -> float:
    schur = known.schur(signal.cause, signal.beside, signal.without)
    return float(np.trace(schur)) if signal.size is None else float(signal.size @ schur @ signal.size)


def _expected(answers: Sequence[tuple[Question, float]]) -> str:
    """Expected result of a design, as text."""
    parts = [f"separates {q.name} from {q.other} (power {_chance(power)})" for q, power in answers if q.kind == "tied"]
    parts += [f"confirms {q.name} (power {_chance(power)})" for q, power in answers if q.kind == "weak"]
    hidden = [q.name for q, _ in answers if q.kind == "hidden"]
    if hidden:
        more = f" and {len(hidden) - LISTED} more" if len(hidden) > LISTED else ""
        parts.append(f"shows {', '.join(hidden[:LISTED])}{more}")
    return "; ".join(parts)


def _chance(power: float) -> str:
    return "above 0.99" if power > 0.99 else f"{power:.2f}"
