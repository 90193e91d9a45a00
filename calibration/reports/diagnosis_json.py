"""The JSON of a diagnosis (contract 4.3)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from calibration.diagnosis.improvement import Figures
from calibration.diagnosis.residual.whiteness import Test
from calibration.diagnosis.result import Diagnosis
from calibration.diagnosis.unseen.swing import FoundSwing
from calibration.diagnosis.verdict import Named
from calibration.fit.set_up.run_zeros import run_zeros
from calibration.reports.fit import held_out_json
from calibration.reports.machine_change import machine_change_json
from calibration.reports.separability import separability_json


def diagnosis_json(found: Diagnosis) -> dict[str, Any]:
    """The diagnosis for programs by contract 4.3; further keys at the end."""
    fit, left, seen = found.after.fit, found.unexplained, found.identifiability
    hidden = [entry.name for entry in found.not_visible]
    return {
        "before": figures_json(found.figures[0]),
        "after": figures_json(found.figures[1]),
        "noise_um": found.noise_um,
        "estimated_noise": None if found.estimated_noise is None else found.estimated_noise.json(),
        "n_observations": fit.observations,
        "n_parameters": len(fit.model.parameters),
        "rank": fit.solved.rank - fit.solved.registered,
        "not_visible": [*(seen.not_visible if seen else ()), *hidden],
        "accepted": found.accepted,
        "reason": found.reason,
        "forced": found.acceptance.objection if found.acceptance.forced else "",
        "confirmed": found.acceptance.confirmed,
        "held_out": _held_out_json(found),
        "effects": [_cause_json(cause) for cause in found.causes],
        "unexplained": None
        if left is None
        else {"variables": list(left.variables), "p_value": left.p_value, "rms_um": found.unexplained_um},
        "unexplained_periods": [] if left is None else list(left.periods),
        "swing": _swing_json(found.swing),
        "next_measurement": found.next_measurement,
        "widened": found.widened,
        "one_by_one": [dependence._asdict() for dependence in found.one_by_one],
        "moves": [
            {"move": move.name, "minutes": move.minutes, "gain_per_minute": move.gain_per_minute, "says": move.text}
            for move in found.proposed_measurements
        ],
        "origin": found.base.origin,
        "basis": {} if found.base.choice is None else {a: str(b) for a, b in found.base.choice.bases.items()},
        "finer": {effect.name: len(effect.parameters) for effect in found.finer},
        "sanity": [{"what": finding.check, "says": finding.message} for finding in found.findings],
        "zeros": [zero.json() for zero in run_zeros(fit)],
        "noise_from_repeats": None if found.repeats is None else found.repeats.text,
        "whiteness": {"before": _tests_json(found.tests), "after": _tests_json(found.tests_after)},
        "closure": found.closure,
        "by_direction_um": found.by_direction,
        "volume_um": found.volume._asdict(),
        "visibility": {each.candidate.effect.name: each.projected.visible for each in reversed(found.evaluated)},
        "would_show_from": [{"name": name, "size": size, "unit": unit} for name, size, unit in found.smallest],
        "not_tested": [{"name": entry.name, "lacks": entry.lacks} for entry in found.untested],
        "outliers": [found.measurement.where(int(row)) for row in fit.outliers],
        "disagreeing_share": float(fit.disagreeing[~fit.copies].mean()),
        "significant_share": found.significant_share,
        "calibration": found.model.id,
        "design": separability_json(found.design),
        "between_positions": {each.axis: each.json() for each in found.between_positions},
        "machine_change": machine_change_json(found.machine_change),
        "worse_than_none": found.acceptance.worse_than_none is not None,
    }


def figures_json(figures: Figures) -> dict[str, float | None]:
    """Residuals of a model; the held-out residual is None where there are too few rows to hold any out."""
    return {name: None if math.isnan(value) else value for name, value in figures._asdict().items()}


def _held_out_json(found: Diagnosis) -> dict[str, Any] | None:
    """Kind and number of the held-out blocks, and their RMS residual by the models compared."""
    none, present = found.acceptance.none, found.acceptance.present
    if none is None:
        return None
    return held_out_json(none) | {"present_rms_um": None if present is None else present.other_rms_um}


def models_compared(found: Diagnosis) -> Iterator[tuple[str, float]]:
    """Models with which the new one is compared on the held-out blocks, and their RMS residual, um."""
    none, present = found.acceptance.none, found.acceptance.present
    if none is not None:
        yield "no correction", none.other_rms_um
    if present is not None and found.base.origin == "updated":
        yield "the present calibration as it is", present.other_rms_um


def _swing_json(swing: FoundSwing | None) -> dict[str, Any] | None:
    if swing is None:
        return None
    by = {"direction": swing.component, "variables": list(swing.variables)}
    return {**by, "period_s": swing.period, "u_s": swing.u}


def _cause_json(cause: Named) -> dict[str, Any]:
    effect = cause.effect
    return {
        "kind": cause.kind,
        "where": cause.where,
        "axis": cause.axis,
        **cause.fields,
        "parameters": effect.by_key(effect.parameters),
        "u": effect.by_key(effect.uncertainties),
        "delta_bic": cause.delta_bic,
        "heldout_gain_um": cause.heldout_gain_um,
        "share": cause.share,
        "verdict": cause.verdict,
        "visible": cause.visible,
        "alternatives": [
            {"kind": other.kind, "axis": other.axis, "name": other.name, "cosine": other.cosine, "odds": other.odds}
            for other in cause.alternatives
        ],
        "notes": list(cause.notes),
        "present": None if cause.present is None else cause.present.by_key(cause.present.parameters),
    }


def _tests_json(tests: Sequence[Test]) -> list[dict[str, Any]]:
    return [{"what": test.name, "p_value": test.p_value, "statistic": test.statistic} for test in tests]
