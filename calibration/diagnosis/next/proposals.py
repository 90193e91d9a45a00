"""Proposed measurements: designs that answer questions, the one first that tells most in a minute."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.candidates import Candidates
from calibration.diagnosis.conclusion.mixture import InPlace
from calibration.diagnosis.conclusion.verdict import Judged
from calibration.diagnosis.next.questions import ENOUGH_LOG_ODDS, Known, Question, questions
from calibration.diagnosis.next.stacked_rows import StackedRows
from calibration.follow_up.design import FollowUpDesign
from calibration.follow_up.designs import follow_up_designs
from calibration.gaussian_terms.structure import CLEAR_LOG_ODDS, Structure

LARGEST_POWER_OF_ODDS = 6
"""Largest power of ten of the odds that a text gives."""
CHECK = "Correct a program with the new calibration, and measure the same positions again."
"""Measurement where the data leave nothing open."""
OTHER_PLACE = (
    "Measure the same positions once more with the tracker at another place, and test it (two faces, bar): {} is then "
    "separated from errors of the machine."
)
"""Measurement that an unexplained error of the instrument's readings needs."""
AT_REST = (
    "Let the machine rest for some periods of the {}, and record {} of the tool, the temperatures of the hall, the "
    "coolant and the column, and all switching. Stop the cause, and measure again."
)
"""Measurement that an error which is periodic in time needs."""


class ProposedMeasurement(NamedTuple):
    """A proposed measurement."""

    name: str
    minutes: float
    gain_per_minute: float
    """Log odds of all questions that it is expected to bring, nats per minute."""
    text: str
    """Instruction and expected result, as text for the workshop."""


def proposed(
    candidates: Candidates, judged: Sequence[Judged], places: Sequence[InPlace], functions: Sequence[Judged]
) -> Iterator[ProposedMeasurement]:
    """Designs that answer a question, the best first; then the questions that none of them answers.

    functions: those without a name, of which none is a fine error motion.
    """
    for each in functions:
        if each.term.kind == "swing":
            yield _remedy(AT_REST.format(each.term.name, each.term.where))
        elif not each.term.effects:
            yield _remedy(OTHER_PLACE.format(each.term.name))
    recurring = [each for each in functions if each.term.kind != "swing" and each.term.effects]
    others, asked = questions(candidates, judged, places, recurring)
    if not asked:
        return
    structure = candidates.structure
    registration, _ = structure.data.observations.measurement.first_registration
    rows = StackedRows.of(structure, registration, others, _contribution(structure, recurring))
    now = Known(rows.products(), structure)
    before = {question: question.answer(now, now) for question in asked}
    found, answered = [], set()
    for design in follow_up_designs(structure.data.observations.measurement, registration):
        after = Known(rows.products(design), structure)
        odds = {question: question.answer(now, after) for question in asked}
        clear = {question: own for question, own in odds.items() if own > max(CLEAR_LOG_ODDS, before[question])}
        gain = sum(
            max(min(own, ENOUGH_LOG_ODDS) - min(before[question], ENOUGH_LOG_ODDS), 0.0)
            for question, own in odds.items()
        )
        if clear:
            found.append(_proposed(design, gain, clear))
        answered |= set(clear)
    yield from sorted(found, key=lambda each: -each.gain_per_minute)
    yield from (_remedy(_unanswered(question)) for question in asked if question not in answered)


def _contribution(structure: Structure, functions: Sequence[Judged]) -> np.ndarray:
    """What functions contribute to the observations `(n, d)`, mm and rad."""
    found = np.zeros_like(structure.data.observations.residual)
    for each in functions:
        found += each.term.columns @ structure.posterior.mean[structure.columns_of(each.number)]
    return found


def _remedy(text: str) -> ProposedMeasurement:
    return ProposedMeasurement("remedy", 0.0, 0.0, text)


def _proposed(design: FollowUpDesign, gain: float, clear: Mapping[Question, float]) -> ProposedMeasurement:
    """A design with its gain, and what it is expected to do."""
    does = f"{design.does[0].upper()}{design.does[1:]}"
    text = f"{does} ({design.minutes:.0f} min): this {'; '.join(_expected(clear))}."
    return ProposedMeasurement(design.name, design.minutes, gain / design.minutes, text)


def _expected(clear: Mapping[Question, float]) -> Iterator[str]:
    """What a design is expected to do: rivals of one cause in one clause, with the least odds."""
    ties: dict[str, list[Question]] = {}
    for question in clear:
        ties.setdefault(f"{question.kind} {question.name}", []).append(question)
    for some in ties.values():
        *first, last = [question.other for question in some]
        others = f"{', '.join(first)} and {last}" if first else last
        yield f"{_does(some[0], others)} ({_odds(min(clear[question] for question in some))})"


def _does(question: Question, others: str) -> str:
    """What an answer does."""
    if question.kind == "function":
        return f"shows whether {question.name}, which no cause explains, recurs with the position or with the time"
    if question.kind == "tie":
        return f"separates {question.name} from {others}"
    return f"{'finds the period of' if question.kind == 'period' else 'confirms'} {question.name}"


def _odds(odds: float) -> str:
    """Expected odds, as text."""
    power = odds / math.log(10.0)
    if power > LARGEST_POWER_OF_ODDS:
        return f"odds above {10**LARGEST_POWER_OF_ODDS:,} to 1 expected"
    digit = 10 ** math.floor(power)
    return f"odds {digit * math.floor(math.exp(odds) / digit):,} to 1 expected"


def _unanswered(question: Question) -> str:
    """A question that no design answers, as text."""
    text = f"No proposed measurement {_does(question, question.other)}"
    if question.kind == "function":
        return f"{text}. Measure the same positions again in another order."
    if question.term is not None and question.rival is not None:
        one, other = (term.effects[0] for term in (question.term, question.rival))
        alike = len({(each.ACTS_ON == "instrument", each.REMEDY, each.sensors) for each in (one, other)}) == 1
        return f"{text}: in each of them both may look alike.{' The remedy is the same for both.' if alike else ''}"
    return f"{text}. It may need {question.term.effects[0].SHOWN_BY}." if question.term is not None else f"{text}."
