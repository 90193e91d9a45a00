"""The JSON of a diagnosis (contract 4.3)."""

from __future__ import annotations

import math
from typing import Any

from calibration.diagnosis.conclusion.cause import Cause
from calibration.diagnosis.conclusion.fitted_rows import by_direction
from calibration.diagnosis.conclusion.result import Diagnosis
from calibration.diagnosis.contract import fields_of
from calibration.fit.set_up.run_zeros import run_zeros
from calibration.reports.diagnosis.registered import registered_rows
from calibration.reports.machine_change import machine_change_json
from calibration.reports.separability import separability_json
from kinematics.files.number_text import LARGEST_LOG_ODDS


def diagnosis_json(answer: Diagnosis) -> dict[str, Any]:
    """The diagnosis for programs by contract 4.3; further keys at the end."""
    structure = answer.structure
    before, after = answer.figures
    return {
        "before": before._asdict(),
        "after": after._asdict(),
        "noise_um": answer.noise_um,
        "n_observations": structure.whitener.observed,
        "n_parameters": len(answer.model.parameters),
        "rank": answer.rank,
        "not_visible": answer.not_visible,
        "accepted": answer.accepted,
        "reason": answer.reason,
        "effects": [_cause(cause) for cause in answer.causes],
        "unexplained": _unexplained(answer),
        "next_measurement": answer.next_measurement,
        **_further(answer),
    }


def _further(answer: Diagnosis) -> dict[str, Any]:
    """Keys beyond the stable part of the contract."""
    structure, given = answer.structure, answer.as_given
    return {
        "estimated_noise": {
            "instrument_factor": math.sqrt(structure.noise.factor),
            "non_repeatability": answer.not_repeating,
            "misfit": {},
        },
        "forced": answer.objection if answer.forced else "",
        "confirmed": answer.confirmed,
        "worse_than_none": given is not None and given.worse,
        "widened": 1.0,
        "held_out": {"nothing_rms_um": answer.held_out.nothing, "new_rms_um": answer.held_out.with_all},
        "unexplained_functions": [
            {"name": each.term.name, "variables": list(each.variables), "rms_um": answer.rms_of([each])}
            for each in answer.unexplained
        ],
        "unexplained_periods": [period for each in answer.unexplained for period in each.periods],
        "added": [each.term.name for each in answer.added],
        "sanity": [{"what": finding.check, "says": finding.message} for finding in answer.findings],
        "zeros": [zero.json() for zero in run_zeros(registered_rows(answer))],
        "by_direction_um": {"before": by_direction(answer.bare), "after": by_direction(structure)},
        "volume_um": answer.volume._asdict(),
        "visibility": {each.effect.name: each.log_odds / math.log(10.0) for each in answer.expected},
        "would_show_from": [each.smallest._asdict() for each in answer.expected if each.visible and each.smallest],
        "not_tested": [{"name": name, "lacks": lacks} for name, lacks in answer.untested],
        "outliers": [answer.measurement.where(row) for row in answer.outliers],
        "machine_change": machine_change_json(answer.machine_change),
        "significant_share": answer.significant_share,
        "design": [
            {**row, "log10_odds": each.log_odds / math.log(10.0)}
            for row, each in zip(separability_json(answer.design), answer.design, strict=True)
        ],
        "moves": [
            {"move": each.name, "minutes": each.minutes, "gain_per_minute": each.gain_per_minute, "says": each.text}
            for each in answer.proposals
        ],
        "calibration": answer.model.id,
    }


def _cause(cause: Cause) -> dict[str, Any]:
    effect, present = cause.effect, cause.present
    return {
        "kind": cause.kind,
        "where": cause.where,
        "axis": cause.axis,
        **fields_of(effect),
        "parameters": effect.by_key(effect.parameters),
        "u": effect.by_key(effect.uncertainties),
        "log10_odds": cause.log_odds / math.log(10.0),
        "heldout_gain_um": cause.heldout_gain_um,
        "share": cause.share,
        "verdict": cause.verdict,
        "alternatives": [each._asdict() for each in cause.alternatives],
        "notes": list(effect.remarks),
        "present": None if present is None else present.by_key(present.parameters),
    }


def _unexplained(answer: Diagnosis) -> dict[str, Any] | None:
    """Functions without a name and waves of an open period; None without any.

    `p_value` is the probability of the likeliest of them not to be there.
    """
    some = answer.unexplained
    if not some:
        return None
    return {
        "variables": list(dict.fromkeys(variable for each in some for variable in each.variables)),
        "p_value": 1.0 / (1.0 + math.exp(min(max(each.log_odds for each in some), LARGEST_LOG_ODDS))),
        "rms_um": answer.rms_of(some),
    }
