"""The answer for people."""

from __future__ import annotations

import math
from collections.abc import Iterator

from calibration.diagnosis.search.candidates import where
from calibration.diagnosis.terms.conclusion.answer import Answer, Cause
from calibration.diagnosis.terms.conclusion.document import next_measurement
from kinematics.files.number_text import rounded
from rendering.report import Report, Section, Table


def report(answer: Answer) -> Report:
    """The verdict, the causes with their sizes, and the next measurement."""
    measurement = answer.measurement
    title, lead = f"Diagnosis of {measurement.machine.name}", f"{measurement.source} · engine of terms"
    refusal = f"NOT WRITTEN: {answer.reason}" if answer.reason else ""
    return Report(title, lead, list(_sections(answer)), _verdict(answer), refusal)


def _verdict(answer: Answer) -> str:
    before, after = answer.figures
    names = "; ".join(f"{_name(cause)}, {cause.verdict.upper()}" for cause in answer.causes)
    change = (
        f"residual {before.rms_um:.2f} -> {after.rms_um:.2f} um RMS, held-out blocks {before.heldout_rms_um:.2f} -> "
        f"{after.heldout_rms_um:.2f} um"
    )
    functions = "; ".join(each.term.name for each in answer.unexplained)
    left = f" Not explained by any cause: {functions}." if functions else ""
    found = f"Causes: {names}. With them:" if names else "No cause was found:"
    return f"{found} {change}.{left}"


def _sections(answer: Answer) -> Iterator[Section]:
    if answer.causes:
        rows = [(_name(cause), _sizes(cause), _odds(cause), cause.verdict, _rivals(cause)) for cause in answer.causes]
        yield Section("Causes", table=Table(("cause", "size (k=1)", "odds", "verdict", "or"), rows))
    repeats = ", ".join(f"{axis} to {rounded(size, 2)}" for axis, size in answer.not_repeating.items())
    if repeats:
        yield Section("Repeatability", f"Standard deviation from stop to stop, um or urad: {repeats}.")
    yield Section("Next", next_measurement(answer))


def _name(cause: Cause) -> str:
    return f"{cause.kind} {where(cause.effect) or ''}".strip()


def _sizes(cause: Cause) -> str:
    effect = cause.effect
    if effect.size_summary:
        return ", ".join(effect.size_summary)
    each = zip(effect.parameter_table, effect.parameters, effect.uncertainties, strict=True)
    return "\n".join(f"{part.name} {rounded(value, 3)} +- {rounded(u, 2)} {part.unit}" for part, value, u in each)


def _odds(cause: Cause) -> str:
    return f"10^{cause.log_odds / math.log(10.0):.1f}"


def _rivals(cause: Cause) -> str:
    return "\n".join(f"{term.name} ({odds:.2g} to 1)" for term, odds, _ in cause.rivals)
