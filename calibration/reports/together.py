"""Results of a fit of several instruments: each measurement alone and together with the others, and the model."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from calibration.fit.together import Part, Together
from calibration.reports.figures.fit import in_uncertainties
from calibration.reports.fit import (
    acceptance,
    calibration_figures,
    held_out_json,
    hidden_section,
    identifiability_json,
    parameters,
    parameters_json,
)
from calibration.reports.head import foot_of, instrument_text
from kinematics.files.number_text import probability
from kinematics.files.report_head import calibration_text
from rendering.figures import Figure, Panel, against_normal, grid
from rendering.report import Report, Section, Table, facts


def together_json(found: Together) -> dict[str, Any]:
    """The result for programs."""
    return {
        "measurements": [_part_json(part) for part in found.parts],
        "accepted": found.accepted,
        "reason": found.reason,
        "forced": found.objection if found.forced else "",
        **identifiability_json(found.identifiability),
        "basis": {name: basis.size for name, basis in found.bases.items()},
        "sanity": [{"what": finding.check, "says": finding.message} for finding in found.findings],
        **parameters_json(found.model),
        "calibration": found.model.id,
    }


def _part_json(part: Part) -> dict[str, Any]:
    measurement, held = part.together.measurement, part.held_out
    return {
        "source": measurement.source,
        "instrument": measurement.instrument.kind(),
        "rows": len(measurement),
        "before": {"rms_um": part.before_um},
        "alone": {"rms_um": part.alone.rms_um, "chi2_reduced": part.alone.chi2_reduced},
        "after": {"rms_um": part.together.rms_um, "chi2_reduced": part.together.chi2_reduced},
        "by_others": {"rms_um": part.by_others.rms_um, "p_value": part.p_value},
        "held_out": None if held is None else held_out_json(held),
        "estimated_noise": None if measurement.noise is None else measurement.noise.json(),
        "outliers": [measurement.where(int(row)) for row in part.together.outliers],
    }


def together_report(found: Together, command: str) -> Report:
    """The result for people; `command`: the command that made it."""
    machine = found.fit.measurement.machine
    lead = f"{machine.name} · {found.model.provenance.made_at:%Y-%m-%d %H:%M} UTC"
    verdict = map(_verdict, found.parts)
    instruments = ", ".join(dict.fromkeys(part.together.measurement.instrument.kind() for part in found.parts))
    head = machine.report.filled(
        machine=machine.name,
        instrument=instrument_text(instruments, found.fit.measurement.simulated),
        calibration=calibration_text(found.model) if found.accepted else "",
        command=command,
    )
    title = f"Calibration of {machine.name}"
    foot = foot_of(title, lead, found.model if found.accepted else None)
    return Report(title, lead, list(_sections(found)), "\n".join(verdict), acceptance(found), head, foot)


def _verdict(part: Part) -> str:
    measurement = part.together.measurement
    unit = measurement.unit
    text = f"{measurement.source} ({measurement.instrument.kind()}): residual "
    text += f"{part.before_um:.2f} -> {part.together.rms_um:.2f} {unit} RMS"
    if part.held_out is not None:
        text += f"; held-out {part.held_out.name} {part.held_out.other_rms_um:.2f} -> {part.held_out.rms_um:.2f} {unit}"
    if part.contradicts:
        text += (
            f". CONTRADICTS the other measurements ({probability(part.p_value)}): the machine has changed between "
            "them, an effect is missing in the model (ncomp diagnose), or an uncertainty is stated too small"
        )
    return f"{text}."


def _sections(found: Together) -> Iterator[Section]:
    identified = found.identifiability
    yield from calibration_figures(found.fit.measurement.machine, found.model)
    sizes = ", ".join(f"{name} {basis.size}" for name, basis in found.bases.items())
    yield facts(
        "Model",
        [
            ("model", f"{identified.parameters} parameters: {sizes}"),
            (
                "rank",
                f"{identified.rank} with the instruments' positions known, {identified.rank_registered} with them "
                f"fitted; directions of the frame fixed by convention: {identified.by_convention}",
            ),
            *(("note", finding.message) for finding in found.findings),
        ],
    )
    text = (
        "Residuals are RMS per scalar, um (rotary axes of an interferometer: urad), each with a registration of its "
        "own. By the others means predicted by the other measurements alone, which may not see the same errors, with "
        "the p-value of the difference from their prediction."
    )
    head = ("measurement", "rows", "nominal", "alone", "together", "held out", "by the others", "p")
    yield Section("Measurements", text, Table(head, [_row(part) for part in found.parts]))
    yield from parameters(found.model)
    text = "Residuals are in standard uncertainties; the curve is the distribution of noise alone."
    yield Section("Unexplained residual", text, figure=partial(_distributions, found))
    yield from hidden_section(identified)


def _row(part: Part) -> list[str]:
    measurement, held = part.together.measurement, part.held_out
    figures = (part.before_um, part.alone.rms_um, part.together.rms_um, held and held.rms_um, part.by_others.rms_um)
    texts = ["" if value is None else f"{value:.2f}" for value in figures]
    return [measurement.source, str(len(measurement)), *texts, f"{part.p_value:.2g}"]


def _distributions(found: Together) -> Figure:
    """Distribution of the residuals of each measurement, in standard uncertainties."""
    panels = []
    for part in found.parts:
        panels.append(Panel(title=part.together.measurement.source))
        against_normal(panels[-1], np.asarray(in_uncertainties(part.together)), 5.0)
    return grid(panels, 3)
