"""Proposed measurements: follow-up designs, ranked by predicted information per minute.

A design is evaluated before it is made, with the unknowns that it brings. A dependence that no cause explains ranks
before all others: a design must part a residual that recurs with the position from one that recurs with the time. A
tie counts as separated when each of the two causes, at its fitted size, would be found with the other one fitted too.
Causes whose columns stay parallel have a power of 0. A weak cause is confirmed by its evidence and on held-out blocks.
Causes that the data do not show are listed elsewhere: no measurement is proposed for them alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy import special

from calibration.diagnosis.next.predicted_information import Information, PredictedInformation
from calibration.diagnosis.next.unexplained_shape import UnexplainedShape
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.unexplained import shared_rms
from calibration.diagnosis.search.evaluation import SEEN, WORTH
from calibration.diagnosis.search.stage import Stage
from calibration.diagnosis.unseen.swing import FoundSwing
from calibration.diagnosis.verdict import CLEAR, Named, tied_with
from calibration.fit.fit import Fit
from calibration.follow_up.design import FollowUpDesign
from calibration.follow_up.designs import follow_up_designs
from kinematics.effects import Effect
from kinematics.transforms import Array

DIGITS = 2
"""Digits of a power in the report."""
SURE = 0.8
"""Power from which a design separates a tie or confirms a cause."""
MARGIN = 2.33
"""Standard deviations above the threshold for a power of 0.99; more information is not counted."""
OTHER_PLACE = (
    "Measure the same positions once more with the tracker at another place, and test it (two faces, bar): the "
    "dependence on {} is then separated from errors of the machine."
)
"""Measurement that an unexplained error of the tracker's readings needs."""
PERIODS = 3
"""Periods over which a swing is to be recorded."""
AT_REST = (
    "Let the machine rest for {:.0f} min, and record {} of the tool, the temperatures of the hall, the coolant and the "
    "column, and all switching: the cause has a period of {:.4g} s. Stop it, and measure again."
)
"""Measurement that a swing needs."""
WEIGHTS = {"unexplained": 1.0, "tied": 1.0, "weak": 0.5}
Kind = Literal["unexplained", "tied", "weak"]


class _Best(NamedTuple):
    """The proposed measurement with the largest power for a question; of equal ones, the shortest."""

    power: float
    """Rounded to DIGITS: powers that are equal but for rounding are equal."""
    minus_minutes: float
    name: str


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
    size: Array
    """Parameters in units of typical sizes."""
    shapes: int = 0
    beside: int | None = None
    """The other cause that is fitted along."""
    without: slice | None = None
    """Columns of the model that belong to the cause itself."""

    def noncentrality(self, known: Information) -> float:
        """Squares of the part of the signal that nothing else imitates.

        0 where model and registration imitate nearly all of it, or where the other cause is parallel to it.
        """
        alone = float(self.size @ known.schur(self.cause, without=self.without) @ self.size)
        if alone <= SEEN**2 * known.squares(self.cause, self.size):
            return 0.0
        if self.beside is None:
            return alone
        left = float(self.size @ known.schur(self.cause, self.beside, self.without) @ self.size)
        return left if left > SEEN**2 * alone else 0.0


@dataclass(frozen=True, eq=False)
class Question:
    """An open question, answered when all its signals would be found."""

    kind: Kind
    name: str
    other: str
    signals: tuple[Signal, ...]
    sureness: float = np.inf
    """Standard errors of a weak cause's gain on held-out blocks: they grow with the root of the information."""

    def needed(self, signal: Signal, known: Information) -> tuple[int, float]:
        """Degrees of freedom of a signal, and the gain from which its cause is named."""
        own = known.causes[signal.cause]
        degrees_of_freedom = own.stop - own.start + signal.shapes
        worth = CLEAR * WORTH if self.kind == "weak" else WORTH
        return degrees_of_freedom, -worth + degrees_of_freedom * float(np.log(known.scalars))

    def information(self, known: Information, now: Information) -> float:
        """Non-centrality of the weakest signal, at most the amount that is needed."""
        found = []
        for signal in self.signals:
            enough = float(self.needed(signal, known)[1] ** 0.5 + MARGIN) ** 2
            if 0.0 < self.sureness < np.inf:
                enough = max(enough, signal.noncentrality(now) * ((CLEAR + MARGIN) / self.sureness) ** 2)
            found.append(min(signal.noncentrality(known), enough))
        return min(found)

    def power(self, known: Information, now: Information) -> float:
        """Least of the chances that each signal by itself would be found; 0 where one of them cannot be."""
        chances = []
        for signal in self.signals:
            noncentrality = signal.noncentrality(known)
            if noncentrality == 0.0:
                return 0.0
            degrees_of_freedom, threshold = self.needed(signal, known)
            chances.append(1.0 - float(special.chndtr(threshold, degrees_of_freedom, noncentrality)))
            if self.sureness < np.inf:
                growth = (noncentrality / max(signal.noncentrality(now), 1e-300)) ** 0.5
                chances.append(float(special.ndtr(self.sureness * growth - CLEAR)))
        return min(chances)


def proposed_measurements(
    stage: Stage, causes: Sequence[Named], dependence: Unexplained | None, swing: FoundSwing | None = None
) -> Iterator[ProposedMeasurement]:
    """Designs that answer a question, the best first; then the questions that none of them answers.

    dependence: the one that no cause explains; its open questions come first. Then the question whether residuals that
    are larger than specified are noise. swing: the swing that the dependence is, if it is one.
    """
    if dependence is not None and dependence.of_readings:
        yield ProposedMeasurement("remedy", 0.0, 0.0, OTHER_PLACE.format(dependence.listed))
        dependence = None
    if swing is not None:
        minutes = PERIODS * swing.period / 60.0
        text = AT_REST.format(minutes, swing.component, swing.period)
        yield ProposedMeasurement("remedy", 0.0, 0.0, text)
        dependence = None
    noise = stage.fit.measurement.noise
    if dependence is None and noise is not None and noise.undecided:
        yield from _measured_again(stage.fit, noise.larger)
    effects, questions = _questions(stage, causes, dependence)
    if not questions:
        return
    shape = None if dependence is None else UnexplainedShape(stage.linearised, dependence)
    predicted = PredictedInformation(stage.linearised, effects, shape)
    now = predicted.now
    first: list[ProposedMeasurement] = []
    others: list[ProposedMeasurement] = []
    best: dict[Question, _Best | None] = dict.fromkeys(questions)
    answered: set[Question] = set()
    for follow_up in follow_up_designs(stage.fit.measurement, stage.fit.registration):
        after = predicted.after(now, follow_up)
        gains = {q: WEIGHTS[q.kind] * max(q.information(after, now) - q.information(now, now), 0.0) for q in questions}
        powers = {q: q.power(after, now) if gains[q] > 0.0 else 0.0 for q in questions}
        for question, power in powers.items():
            one = _Best(round(power, DIGITS), -follow_up.minutes, follow_up.name)
            best[question] = max(best[question] or one, one)
        answers = [(q, power) for q, power in powers.items() if power >= SURE]
        answered.update(question for question, _ in answers)
        if answers:
            found = _proposed(follow_up, sum(gains.values()), _expected(answers, stage, dependence))
            (first if any(q.kind == "unexplained" for q, _ in answers) else others).append(found)
    without = [
        (question.kind, ProposedMeasurement("remedy", 0.0, 0.0, _unanswered(question, effects, most)))
        for question, most in best.items()
        if question not in answered
    ]
    yield from sorted(first, key=lambda proposed: -proposed.gain_per_minute)
    yield from (text for kind, text in without if kind == "unexplained")
    yield from sorted(others, key=lambda proposed: -proposed.gain_per_minute)
    yield from (text for kind, text in without if kind != "unexplained")


def _proposed(follow_up: FollowUpDesign, gain: float, expected: str) -> ProposedMeasurement:
    """A design with its gain, and what it is expected to do."""
    does = f"{follow_up.does[0].upper()}{follow_up.does[1:]}"
    text = f"{does} ({follow_up.minutes:.0f} min): this {expected}."
    return ProposedMeasurement(follow_up.name, follow_up.minutes, gain / follow_up.minutes, text)


def _measured_again(fit: Fit, noise: str) -> Iterator[ProposedMeasurement]:
    """The same positions once more, which show a larger noise; nothing for instruments without follow-up designs."""
    for again in itertools.islice(follow_up_designs(fit.measurement, fit.registration), 1):
        does = f"{again.does[0].upper()}{again.does[1:]} ({again.minutes:.0f} min)"
        text = f"{does}: this shows whether {noise}, or the model lacks errors."
        yield ProposedMeasurement(again.name, again.minutes, 0.0, text)


def _questions(
    stage: Stage, causes: Sequence[Named], dependence: Unexplained | None
) -> tuple[list[Effect], list[Question]]:
    """Effects in question, and the questions: an unexplained dependence, ties and weak causes."""
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
            alone = (Signal(i, accepted.size, own.shapes, without=part),)
            found.append(Question("weak", effect.name, "", alone, accepted.sureness))
        for sibling in tied_with(accepted) if verdict == "tied" else []:
            other = sibling.evaluated.candidate
            j = number(other.effect)
            one = Signal(i, accepted.size, own.shapes, j, part)
            two = Signal(j, sibling.evaluated.score.size, other.shapes, i, part)
            found.append(Question("tied", effect.name, other.effect.name, (one, two)))
    if dependence is not None:
        i, whole = len(effects), np.ones(1)
        both = (Signal(i, whole, beside=i + 1), Signal(i + 1, whole, beside=i))
        found.append(Question("unexplained", f"the dependence on {', '.join(dependence.variables)}", "", both))
    return effects, found


def _expected(answers: Sequence[tuple[Question, float]], stage: Stage, dependence: Unexplained | None) -> str:
    """Expected result of a design, as text."""
    parts = []
    for question, power in answers:
        if question.kind == "unexplained" and dependence is not None:
            rms = stage.fit.rms_um
            left = max(rms**2 - shared_rms(stage.linearised, dependence) ** 2, 0.0) ** 0.5
            parts.append(
                f"shows whether {question.name}, which no cause explains, recurs with the position or with the time "
                f"(power {_chance(power)}): a recurring error can be predicted, and the residual falls from {rms:.2f} "
                f"to {left:.2f} {stage.fit.measurement.unit} RMS"
            )
    parts += [f"separates {q.name} from {q.other} (power {_chance(power)})" for q, power in answers if q.kind == "tied"]
    parts += [f"confirms {q.name} (power {_chance(power)})" for q, power in answers if q.kind == "weak"]
    return "; ".join(parts)


def _unanswered(question: Question, effects: Sequence[Effect], best: _Best | None) -> str:
    """The result for a question that no design answers, as text.

    best: the design with the largest power; None without designs.
    """
    does = {
        "unexplained": f"shows whether {question.name} recurs with the position or with the time",
        "tied": f"separates {question.name} from {question.other}",
        "weak": f"confirms {question.name}",
    }[question.kind]
    text = f"No proposed measurement {does}"
    if best is not None and best.power > 0.0:
        return f"{text}: the best one, '{best.name}', would do so with a power of {best.power:.{DIGITS}f} only."
    if question.kind == "unexplained":
        return f"{text}. Measure the same positions again in another order."
    if best is not None and question.kind == "tied":
        one, other = (effects[signal.cause] for signal in question.signals)
        alike = (one.ACTS_ON == "instrument", one.REMEDY) == (other.ACTS_ON == "instrument", other.REMEDY)
        same = " The remedy is the same for both." if alike else ""
        return f"{text}: in each of them one can have the same signal as the other.{same}"
    return f"{text}. It may need {effects[question.signals[-1].cause].SHOWN_BY}."


def _chance(power: float) -> str:
    return "above 0.99" if power > 0.99 else f"{power:.2f}"
