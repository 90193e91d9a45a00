"""Results of a fit: parameters with uncertainties, residuals, unidentifiable effects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from calibration.fit.acceptance import SIGNIFICANT_SHARE, Judged
from calibration.fit.calibrate import Calibration
from calibration.fit.cross_validation import CrossValidation
from calibration.fit.fit import Fit
from calibration.fit.identifiability import Identifiability, Unidentifiable
from calibration.fit.set_up.run_zeros import run_zeros
from calibration.measurement.measurement import Measurement
from calibration.on_the_fly.along_path import OnTheFly
from calibration.on_the_fly.planning.unidentifiable_mode import common_odd_mode
from calibration.reports.figures.fit import along_axes, by_direction, distribution, error_motions_figure
from calibration.reports.head import foot_of, measured_head
from calibration.reports.run_zeros import zeros_section
from kinematics.effects import Effect, LocationError
from kinematics.error_model.covariance import COVERAGE_FACTOR
from kinematics.error_model.model import ErrorModel
from kinematics.files.number_text import probability, rounded
from kinematics.machine import Machine
from kinematics.transforms import Array
from rendering.report import Report, Section, Table, facts, shortened
from rendering.volume import Field, uncertainty_of, volume_section

LISTED_REASONS = 20
"""Most rows that are listed with the reason for which they were left out; the JSON has all."""
IN_THE_HEAD = 4
"""Most rows that were left out in the head of a report; a table has all."""
RIGHT_HANDED = "Tool relative to workpiece, right-handed; of a table the line lies at minus the value."
LOCATION_HEAD = ("error", "meaning", "value", "U (k=2)", "unit")


def _residuals_json(found: Calibration) -> dict[str, Any]:
    """Residuals before and after the fit."""
    fitted, held = found.fit, found.cross_validation
    return {
        "before": {
            "rms_um": found.before_rms_um,
            "max_um": found.before_max_um,
            "chi2_reduced": found.before_chi2_reduced,
            "heldout_rms_um": None if held is None else held.other_rms_um,
        },
        "after": {
            "rms_um": fitted.rms_um,
            "max_um": fitted.max_um,
            "chi2_reduced": fitted.chi2_reduced,
            "p_value": fitted.p_value,
            "heldout_rms_um": None if held is None else held.rms_um,
        },
    }


def fit_json(found: Calibration, taken: OnTheFly | None) -> dict[str, Any]:
    """The result for programs; `taken`: data taken on the fly."""
    fitted, identified, held = found.fit, found.identifiability, found.cross_validation
    measurement = fitted.measurement
    return {
        **_residuals_json(found),
        "accepted": found.accepted,
        "reason": found.reason,
        "forced": found.objection if found.forced else "",
        "held_out": None if held is None else held_out_json(held),
        "noise_factor": fitted.noise_factor**0.5,
        "estimated_noise": None if measurement.noise is None else measurement.noise.json(),
        "n_observations": fitted.observations,
        "effective_parameters": fitted.effective_parameters,
        **identifiability_json(identified),
        "basis": {axis: str(choice) for axis, choice in found.bases.items()},
        "prior_scale": found.prior_scale,
        "log_evidence": fitted.log_evidence,
        "depends_on": [{"what": s.variable, "p_value": s.p_value, "hint": s.hint} for s in found.dependences],
        "outliers": [measurement.where(int(row)) for row in fitted.outliers],
        "disagreeing_share": float(fitted.disagreeing[~fitted.copies].mean()),
        "copies": [measurement.where(int(row)) for row in fitted.copies.nonzero()[0]],
        "failed_stations": list(fitted.failed),
        "significant_share": found.significant_share,
        "u_um": found.relative_deviation.json(),
        "targets": [each.json() for each in found.targets],
        "zeros": [zero.json() for zero in run_zeros(fitted)],
        "sanity": [{"what": finding.check, "says": finding.message} for finding in found.findings],
        **parameters_json(found.model),
        "calibration": found.model.id,
    } | ({} if taken is None else {"on_the_fly": _moving_json(found, taken)})


def held_out_json(held: CrossValidation) -> dict[str, Any]:
    """Kind and number of the held-out blocks, and their RMS residual without a correction and with the new model."""
    return {"blocks": held.blocks, "of": held.name, "none_rms_um": held.other_rms_um, "new_rms_um": held.rms_um}


def _moving_json(found: Calibration, taken: OnTheFly) -> dict[str, Any]:
    reduction = taken.reduction
    return {
        "readings": reduction.readings,
        "used": reduction.used,
        "left_out": {"corners": reduction.corners, "unsteady": reduction.unsteady, "astray": reduction.astray},
        "rows": reduction.rows,
        "cell_mm": reduction.cell_mm,
        "passes": reduction.passes,
        "feeds_mm_min": list(reduction.feeds),
        "length_m": reduction.length_m,
        "noise_correlation": reduction.correlation,
        "blind_mode": common_odd_mode(taken.measurement, found.fit.registration),
    }


def fit_report(found: Calibration, taken: OnTheFly | None, command: str) -> Report:
    """The result for people; `taken`: data taken on the fly; `command`: the command that made it."""
    measurement = found.fit.measurement
    lead = f"{measurement.source} · {found.model.provenance.made_at:%Y-%m-%d %H:%M} UTC"
    residual = residual_sentence(found.before_rms_um, found.fit, found.cross_validation)
    left_out = left_out_sentence(found.fit.measurement, found.fit.outliers, found.fit.residual_um)
    verdict = [*insignificant(found.significant_share), residual, *left_out, *_verdict(found.fit)]
    title = f"Calibration of {measurement.machine.name}"
    head = measured_head(measurement, found.model if found.accepted else None, command)
    foot = foot_of(title, lead, found.model if found.accepted else None)
    return Report(title, lead, list(_sections(found, taken)), "\n".join(verdict), acceptance(found), head, foot)


def residual_sentence(before_um: float, after: Fit, held: CrossValidation | None) -> str:
    """RMS residuals of the nominal machine, of the model and of the held-out rows, in a sentence."""
    unit = after.measurement.unit
    return f"Residual {before_um:.2f} -> {after.rms_um:.2f} {unit} RMS{_held_out(held, unit)}."


def left_out_sentence(measurement: Measurement, rows: np.ndarray, residual_um: Array) -> Iterator[str]:
    """Number, size and run of rows that were left out one by one; nothing where there are none.

    residual_um `(n,)`: of all rows, in the unit of the measurement.
    """
    if not len(rows):
        return
    sizes = [f"{measurement.where(int(row))} ({residual_um[row]:.3g} {measurement.unit})" for row in rows]
    runs = [] if measurement.run is None else np.unique(measurement.run).tolist()
    theirs = [] if measurement.run is None else np.unique(measurement.run[rows]).tolist()
    where = f", all of run {theirs[0]}" if len(theirs) == 1 < len(runs) and len(rows) > 1 else ""
    listed = "; ".join(shortened(sizes, IN_THE_HEAD, "rows"))
    yield (
        f"LEFT OUT: {len(rows)} of {len(measurement)} rows{where}, which disagree with the others by more than noise "
        f"allows: {listed}."
    )


def acceptance(found: Judged) -> str:
    """The first sentence of a report on a calibration against which there is a reason; empty without one."""
    if not found.objection:
        return ""
    return f"{'WRITTEN BY --force' if found.forced else 'NOT WRITTEN'}: {found.objection}."


def _held_out(held: CrossValidation | None, unit: str) -> str:
    """Clause on the prediction of held-out blocks."""
    if held is None:
        return ""
    return (
        f"; held-out {held.name} {held.other_rms_um:.2f} {unit} without a correction, {held.rms_um:.2f} {unit} with it"
    )


def insignificant(share: float) -> list[str]:
    """A sentence where most of the correction does not exceed its uncertainty; `share` of it is significant."""
    if share >= SIGNIFICANT_SHARE:
        return []
    return [
        f"NOT SIGNIFICANT: at {100 * (1 - share):.0f} % of the measured positions the correction is smaller than "
        f"{COVERAGE_FACTOR:g} times its standard uncertainty. This calibration hardly improves the machine. Measure "
        "more positions, or use an instrument with a smaller uncertainty."
    ]


def residuals(before: tuple[float, float], after: Fit, held: CrossValidation | None) -> Section:
    """Residuals, um, RMS and largest, of the nominal machine, of the model and of the held-out rows."""
    rows = [("before (nominal machine)", *before), ("after", after.rms_um, after.max_um)]
    cells = [(name, f"{rms:.2f}", f"{most:.2f}") for name, rms, most in rows]
    if held is not None:
        blocks = f"held out ({held.blocks} {held.name})"
        cells.append((f"{blocks}, nominal machine", f"{held.other_rms_um:.2f}", ""))
        cells.append((blocks, f"{held.rms_um:.2f}", f"{held.max_um:.2f}"))
    return Section(
        "Residual", table=Table((f"residual of the same rows, {after.measurement.unit}", "RMS", "max"), cells)
    )


def besides(effects: Iterable[Effect]) -> list[Effect]:
    """Effects other than error motions and location errors."""
    return [effect for effect in effects if not effect.OF_ISO_230]


def location_errors(model: ErrorModel) -> list[LocationError]:
    """The location errors of a calibration."""
    return [effect for effect, _ in model.location_errors]


def _verdict(fitted: Fit) -> Iterator[str]:
    noise = fitted.measurement.noise
    by = "by the instrument specification" if noise is None else "by the noise of the fit"
    text = f"chi2/dof {rounded(fitted.chi2 / fitted.degrees_of_freedom, 3)} {by}, {probability(fitted.p_value, 2)}."
    if noise is not None:
        yield (
            f"chi2/dof {rounded(fitted.chi2_reduced, 3)} by the instrument specification, which the residuals "
            f"contradict. The noise of the fit is that of the residuals: {noise.text}"
        )
        if noise.instrument_factor > 1.0 or noise.arms.shape[2]:
            yield "Or the model is incomplete: a missing effect looks like noise (ncomp diagnose searches for it)."
    if fitted.variance_factor != 1.0:
        factor = fitted.variance_factor**0.5
        yield f"{text} The noise was estimated from the data: {factor:.3g} times the instrument specification."
    elif fitted.doubtful:
        yield (
            f"{text} The model is incomplete, or the specified noise is too small: uncertainties are widened by "
            f"{fitted.widening**0.5:.3g}."
        )
    elif noise is None:
        yield f"{text} The model explains the data down to the noise."
    else:
        yield text


def _sections(found: Calibration, taken: OnTheFly | None) -> Iterator[Section]:
    fitted = found.fit
    yield from calibration_figures(fitted.measurement.machine, found.model)
    yield facts("Data and model", list(_facts(found, taken)))
    yield residuals((found.before_rms_um, found.before_max_um), fitted, found.cross_validation)
    yield from parameters(found.model)
    text = "Residuals are in standard uncertainties; the curve is the distribution of noise alone."
    yield Section("Unexplained residual", text, figure=partial(distribution, fitted))
    text = "A residual of noise alone has no shape. The lines are at twice the standard uncertainty of an observation."
    yield Section("Unexplained residual along time and axes", text, figure=partial(along_axes, fitted))
    if fitted.measurement.state.approach is not None:
        text = "Reversal errors that the model lacks would make the two directions differ."
        yield Section("Unexplained residual by direction", text, figure=partial(by_direction, fitted))
    yield from hidden_section(found.identifiability)
    yield from zeros_section(fitted)
    if left_out := list(_left_out(fitted)):
        yield Section(
            "Rows that disagree, or repeat",
            table=Table(("rows", "reason", f"deviation from the other rows, {fitted.measurement.unit}"), left_out),
        )


def parameters(model: ErrorModel) -> Iterator[Section]:
    """Location errors and other effects of a calibration, with their uncertainties; its error motions are figures."""
    if locations := location_errors(model):
        rows = [
            (
                e.name,
                e.meaning,
                f"{e.value:z.2f}",
                f"{2 * e.uncertainties[0]:.2f}",
                "urad" if e.angular else "um",
            )
            for e in locations
        ]
        yield Section("Location errors", RIGHT_HANDED, Table(LOCATION_HEAD, rows))
    others = [
        (effect.name, parameter.name, f"{value:.3f}", f"{2 * u:.3f}", parameter.unit)
        for effect in besides(model.effects)
        for parameter, value, u in zip(effect.parameter_table, effect.parameters, effect.uncertainties, strict=True)
    ]
    if others:
        yield Section("Other effects", table=Table(("effect", "parameter", "value", "U (k=2)", "unit"), others))


def parameters_json(model: ErrorModel) -> dict[str, Any]:
    """The same for programs."""
    return {
        "locations": {
            e.name: {"value_urad" if e.angular else "value_um": e.value, "u": e.uncertainties[0]}
            for e in location_errors(model)
        },
        "effects": [
            {"name": e.name, "parameters": e.by_key(e.parameters), "u": e.by_key(e.uncertainties)}
            for e in besides(model.effects)
        ],
    }


def identifiability_json(identified: Identifiability) -> dict[str, Any]:
    """Ranks of a fit and its unidentifiable effects, for programs."""
    return {
        "n_parameters": identified.parameters,
        "rank": identified.rank,
        "rank_registered": identified.rank_registered,
        "by_convention": identified.by_convention,
        "not_visible": identified.not_visible,
        "blind": [
            {"effects": list(b.effects), "directions": b.directions, "reason": b.reason, "remedy": b.remedy}
            for b in identified.unidentifiable
        ],
    }


def calibration_figures(machine: Machine, model: ErrorModel) -> Iterator[Section]:
    """The errors of a calibration in the volume and by axis, with their uncertainties."""
    yield from volume_section(machine, [Field("without a correction", model), uncertainty_of(model)])
    yield error_motion_figures(model)


def error_motion_figures(model: ErrorModel) -> Section:
    """The error motions of a calibration with their uncertainties."""
    text = "Means and slopes that belong to location errors are removed. The band is U (k=2)."
    return Section("Error motions", text, figure=partial(error_motions_figure, model))


def hidden_section(identified: Identifiability) -> Iterator[Section]:
    """The effects that the data do not show, with the measurement that would; nothing where they show all."""
    if hidden := unidentifiable(identified.unidentifiable):
        head = ("effect", "reason", "measurement that would show it")
        yield Section(
            "Unidentifiable effects", "These data do not show the following effects (NOT VISIBLE).", Table(head, hidden)
        )


def _facts(found: Calibration, taken: OnTheFly | None) -> Iterator[tuple[str, str]]:
    measurement, identified = found.fit.measurement, found.identifiability
    bases = ", ".join(f"{axis} {basis}" for axis, basis in found.bases.items())
    yield "data", f"{measurement.source}: {len(measurement)} rows, {found.fit.observations} observations fitted"
    if taken is not None:
        yield "on the fly", str(taken.reduction)
        if mode := common_odd_mode(taken.measurement, found.fit.registration):
            yield "HIDDEN MODE", mode
    for finding in found.findings:
        yield "note", finding.message
    sizes = "by the data" if found.prior_scale is None else f"{found.prior_scale:g} times the typical one"
    yield "model", f"{len(found.fit.prior)} parameters: {bases}; expected size of errors {sizes}"
    yield (
        "rank",
        f"{identified.rank} with the instrument's position known, {identified.rank_registered} with it fitted; "
        f"directions of the frame fixed by convention: {identified.by_convention}",
    )
    yield "uncertainty", str(found.relative_deviation)
    for dependence in found.dependences:
        yield (
            "DEPENDS ON",
            f"the residuals depend on {dependence.variable} ({probability(dependence.p_value)}): try {dependence.hint}",
        )


def unidentifiable(found: Iterable[Unidentifiable]) -> list[tuple[str, str, str]]:
    """Names of unidentifiable effects with the same reason and remedy, the reason and the remedy."""
    alike: dict[tuple[str, str], list[str]] = {}
    for each in found:
        alike.setdefault((each.reason, each.remedy), []).append(" + ".join(each.effects))
    return [(", ".join(names), reason, remedy) for (reason, remedy), names in alike.items()]


def _left_out(fitted: Fit) -> Iterator[Sequence[str]]:
    size = fitted.residual_um
    kept = np.flatnonzero(fitted.suspected)
    kinds = (
        ("outlier", fitted.outliers),
        ("disagrees, but stays", kept),
        ("copy of an earlier row", np.flatnonzero(fitted.copies)),
    )
    for reason, rows in kinds:
        for row in rows[:LISTED_REASONS].tolist():
            yield fitted.measurement.where(row), reason, f"{size[row]:.1f}"
        if len(rows) > LISTED_REASONS:
            yield f"... and {len(rows) - LISTED_REASONS} more", reason, ""
    for station in fitted.failed:
        yield f"station {station}", "most of its rows disagree with all others", ""
