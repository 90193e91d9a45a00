"""The first sentences of a diagnosis: what is wrong with the machine, what to do, and what it brings."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from calibration.diagnosis.conclusion.at_tool import AtTool, at_tool
from calibration.diagnosis.conclusion.cause import Cause
from calibration.diagnosis.conclusion.result import Diagnosis
from calibration.diagnosis.conclusion.verdict import Judged
from calibration.gaussian_terms.outliers import shifts
from calibration.reports.causes import text as words
from calibration.reports.fit import insignificant, left_out_sentence
from calibration.reports.machine_change import change_sentences
from kinematics.files.number_text import amount, rounded
from rendering.report import shortened

SIMILAR = 3
"""Most causes that a sentence lists in the place of one."""
CAUSES = 4
"""Most causes in the first sentences; the table has all."""
LISTED_LEFT_OUT = 4
"""Most rows that are listed as left out; the JSON has all."""
NOTED_NOISE_FACTOR = 2.0
"""Factor between noise and specification from which a sentence says so: data sheets are safe by about as much."""
LISTED_PERIODS = 8
"""Most periods that a sentence lists."""


def sentences(answer: Diagnosis) -> Iterator[str]:
    """The result: causes by their size at the tool point, residuals, and what is left."""
    yield from _given(answer)
    yield from (f"NOTE: {each.message}." for each in answer.findings if each.check == "chain")
    yield from change_sentences(answer.machine_change)
    causes = [f"{_headed(cause, size)}. {cause.effect.workshop.repair}" for cause, size in by_size(answer)]
    yield from shortened(causes, CAUSES, "causes")
    before, after = answer.figures
    unit = answer.measurement.unit
    yield (
        f"{'With these causes' if answer.causes else 'No cause was found'}: residual "
        f"{_changed(before.rms_um, after.rms_um)} {unit} RMS, held-out blocks "
        f"{_changed(before.heldout_rms_um, after.heldout_rms_um)} {unit}."
    )
    yield unexplained_sentence(answer)
    yield from _noise(answer)
    yield from insignificant(answer.significant_share)
    yield from _left_out(answer)


def by_size(answer: Diagnosis) -> list[tuple[Cause, AtTool | None]]:
    """The causes with their sizes at the tool point, the largest first; those of the instrument at the end."""
    found = [(cause, at_tool(answer.measurement, cause.effect, cause.covariance)) for cause in answer.causes]
    return sorted(found, key=lambda each: -each[1].size_um if each[1] is not None else 0.0)


def at_tool_text(size: AtTool | None) -> str:
    """The size at the tool point with its expanded uncertainty."""
    return "" if size is None else f"{words.with_uncertainty(size.size_um, size.u_um)} um"


def _headed(cause: Cause, size: AtTool | None) -> str:
    """A cause with its size, and the causes that the data do not tell from it."""
    name = words.title(cause)
    text = ", ".join(words.sizes(cause))
    if size is not None:
        text = f"{rounded(size.size_um, 3)} um (U {rounded(2.0 * size.u_um)} um) at the tool point"
    other = [words.in_full(each.name) for each in cause.alternatives]
    tie = f", TIED with {', '.join(shortened(other, SIMILAR, 'causes'))}" if other else ""
    weak = ", on weak evidence" if cause.verdict == "weak" else ""
    return f"{name[0].upper()}{name[1:]}: {text}{weak}{tie}"


def _changed(before: float, after: float) -> str:
    """A figure before and after; once where it has not changed."""
    return " -> ".join(dict.fromkeys((f"{before:.2f}", f"{after:.2f}")))


def unexplained_sentence(answer: Diagnosis) -> str:
    """What no cause explains, and the size of it."""
    after, unit = answer.figures[1], answer.measurement.unit
    noise = f"the residual is {after.rms_um:.2f} {unit} RMS, of noise alone {answer.noise_um:.2f} {unit} are expected"
    if not answer.unexplained:
        return f"Nothing {'else ' if answer.causes else ''}is missing: {noise}."
    sizes = [f"{function_name(each)} ({amount(answer.rms_of([each]), unit)} RMS)" for each in answer.unexplained]
    return f"No cause explains: {'; '.join(sizes)}. Beside these {noise}."


def function_name(each: Judged) -> str:
    """A function without a name, or a wave with the periods that are likely."""
    if not each.periods:
        return each.term.name
    axis = each.term.where or ""
    unit = "deg" if axis[:1] in ("A", "B", "C") else "mm"
    periods = shortened([_period(period, unit) for period in sorted(each.periods)], LISTED_PERIODS, "periods")
    return f"a wave along {axis} whose period is open: {', '.join(periods)} {unit}"


def _period(period: float, unit: str) -> str:
    """A period; of a rotary axis with its order, where that is a whole number."""
    order = 360.0 / period
    whole = unit == "deg" and round(order) > 0 and abs(order / round(order) - 1.0) < ORDER_DIFFERENCE
    return f"{period:.4g}" + (f" ({round(order)} per turn)" if whole else "")


ORDER_DIFFERENCE = 1e-3
"""Relative difference of a period from a whole part of the turn up to which its order is given."""


def _given(answer: Diagnosis) -> Iterator[str]:
    """The calibration that was given: worse than none, or confirmed."""
    given, unit = answer.as_given, answer.measurement.unit
    if given is not None and given.worse:
        yield (
            f"The present calibration is WORSE THAN NONE: on these rows it leaves {given.rms_um:.3g} {unit} RMS, and "
            f"the machine without a correction {given.none_rms_um:.3g} {unit}. It is of another state of the machine, "
            "or an axis was referenced anew. Do not correct with it, and repeat the diagnosis without --calibration."
        )
    if answer.confirmed:
        held = answer.held_out
        yield (
            f"CONFIRMED: these data show no change of the machine since the present calibration, which predicts "
            f"held-out blocks to {held.nothing:.2f} {unit} RMS, and updated by these data to {held.with_all:.2f} "
            f"{unit}. The new file holds the updated one."
        )


def _noise(answer: Diagnosis) -> Iterator[str]:
    """A sentence where the noise is far from the specification of the instrument."""
    factor = math.sqrt(answer.structure.noise.factor)
    if not 1.0 / NOTED_NOISE_FACTOR < factor < NOTED_NOISE_FACTOR:
        yield (
            f"The residuals contradict the stated uncertainty of the instrument: the noise is {rounded(factor, 2)} "
            "times as large. The diagnosis uses the noise that the data show."
        )


def _left_out(answer: Diagnosis) -> Iterator[str]:
    """Number, size and places of the rows that are left out."""
    rows, measurement = np.array(answer.outliers, int), answer.measurement
    if len(rows):
        residual_um = np.zeros(len(measurement))
        apart, _ = shifts(answer.structure, rows)
        residual_um[rows] = np.linalg.norm(apart * measurement.per_micro[rows], axis=1)
        yield from left_out_sentence(measurement, rows, residual_um)
