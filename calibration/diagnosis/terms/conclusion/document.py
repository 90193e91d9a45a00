"""The document of an answer (contract 4.3), for programs."""

from __future__ import annotations

import math
from typing import Any

from calibration.diagnosis.search.candidates import fields_of, where
from calibration.diagnosis.terms.conclusion.answer import Answer, Cause
from calibration.diagnosis.terms.conclusion.verdict import Judged

LARGEST = 700.0
"""Largest logarithm of odds whose odds are a number."""


def document(answer: Answer) -> dict[str, Any]:
    """The answer by contract 4.3; further keys at the end."""
    structure, noise = answer.structure, answer.structure.noise
    before, after = answer.figures
    return {
        "before": before._asdict(),
        "after": after._asdict(),
        "noise_um": answer.noise_um,
        "n_observations": structure.whitener.scalars + int(structure.whitener.spanned.shape[1]),
        "n_parameters": len(answer.calibration.parameters),
        "rank": answer.rank,
        "not_visible": answer.not_visible,
        "accepted": answer.accepted,
        "reason": answer.reason,
        "effects": [_cause(cause) for cause in answer.causes],
        "unexplained": _unexplained(answer),
        "next_measurement": next_measurement(answer),
        "estimated_noise": {
            "instrument_factor": math.sqrt(noise.factor),
            "non_repeatability": answer.not_repeating,
            "misfit": {},
        },
        "forced": answer.objection if answer.forced else "",
        "confirmed": answer.confirmed,
        "widened": 1.0,
        "held_out": {"nothing_rms_um": answer.held_out.nothing, "new_rms_um": answer.held_out.with_all},
        "unexplained_periods": [period for each in answer.unexplained for period in each.periods],
        "sanity": [{"what": finding.check, "says": finding.message} for finding in answer.findings],
        "outliers": [answer.measurement.where(row) for row in answer.outliers],
        "calibration": answer.calibration.id,
    }


def _cause(cause: Cause) -> dict[str, Any]:
    effect = cause.effect
    return {
        "kind": cause.kind,
        "where": "instrument" if effect.ACTS_ON == "instrument" else "machine",
        "axis": where(effect),
        **fields_of(effect),
        "parameters": effect.by_key(effect.parameters),
        "u": effect.by_key(effect.uncertainties),
        "log10_odds": cause.log_odds / math.log(10.0),
        "heldout_gain_um": cause.heldout_gain_um,
        "share": cause.share,
        "verdict": cause.verdict,
        "alternatives": [
            {"kind": term.kind, "axis": term.where, "name": term.name, "cosine": cosine, "odds": odds}
            for term, odds, cosine in cause.rivals
        ],
        "present": None if cause.present is None else cause.present.by_key(cause.present.parameters),
        "notes": list(effect.remarks),
    }


def _unexplained(answer: Answer) -> dict[str, Any] | None:
    """Functions without a name and waves of an open period; None without any.

    `p_value` is the probability of the likeliest of them not to be there.
    """
    some = answer.unexplained
    if not some:
        return None
    return {
        "variables": list(dict.fromkeys(variable for each in some for variable in _variables(each))),
        "p_value": 1.0 / (1.0 + math.exp(min(max(each.log_odds for each in some), LARGEST))),
        "rms_um": answer.rms_of(some),
        "functions": [each.term.name for each in some],
    }


def _variables(each: Judged) -> tuple[str, ...]:
    """Variables of a function; of a wave its axis."""
    return each.term.variables or ((each.term.where,) if each.term.where else ())


def next_measurement(answer: Answer) -> str:
    """Recommended next measurement, as text for the workshop."""
    tied = next((cause for cause in answer.causes if cause.verdict == "tied"), None)
    if tied is not None:
        others = " or ".join(term.name for term, _, _ in tied.rivals)
        return f"To tell {tied.effect.name} from {others}, measure {tied.effect.SHOWN_BY}."
    if answer.unexplained:
        names = ", ".join(dict.fromkeys(variable for each in answer.unexplained for variable in _variables(each)))
        return f"Repeat the measurement with its positions in another order: an error depends on {names}."
    return "Correct a program with the new calibration, and measure the same positions again."
