"""The residual of a diagnosis: functions without a name, before and after, noise, rows that are left out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

from calibration.diagnosis.conclusion.fitted_rows import by_direction
from calibration.diagnosis.conclusion.functions import obstacle
from calibration.diagnosis.conclusion.result import Diagnosis
from calibration.fit.prediction import LEVER_ARM_MM, measures_angles
from calibration.reports.diagnosis.figures import against_noise, before_and_after, by_approach, function_figure
from calibration.reports.diagnosis.verdict import function_name
from kinematics.files.number_text import amount, rounded
from rendering.report import Section, Table, facts, shortened

LISTED_RESIDUALS = 8
"""Most rows that are listed; the JSON has all."""
OBSERVED = "Residuals are observed minus expected"
OF_POINTS = ", in x, y, z of the part that carries the instrument"


def unexplained_sections(answer: Diagnosis) -> Iterator[Section]:
    """A section for each function that no cause explains."""
    unit = answer.measurement.unit
    for number, each in enumerate(answer.unexplained, start=1):
        name = function_name(each)
        text = (
            f"{name[0].upper()}{name[1:]}: {amount(answer.rms_of([each]), unit)} RMS of the observations. No cause of "
            "the library explains it."
        )
        if answer.add_unexplained:
            why = obstacle(each, answer.held_out)
            text += f" It is not in the new calibration: {why}." if why else " The new calibration corrects it."
        elif not each.periods:
            text += " The new calibration does not correct it: it is in its uncertainty."
        yield Section(f"Unexplained {number}", text, figure=partial(function_figure, answer, each))


def residual_sections(answer: Diagnosis) -> Iterator[Section]:
    """Residuals before and after, by direction, and against the noise."""
    unit = answer.measurement.unit
    rows = [
        (name, f"{f.rms_um:.2f}", f"{f.max_um:.1f}", f"{f.chi2_reduced:.2f}", f"{f.heldout_rms_um:.2f}")
        for name, f in zip(("before", "after"), answer.figures, strict=True)
    ]
    other = "no correction" if answer.given is None else "the present calibration as it is"
    rows.append((f"the same rows, {other}", "", "", "", f"{answer.held_out.nothing:.2f}"))
    rows.append(("expected of noise alone", f"{answer.noise_um:.2f}", "", "", ""))
    table = Table((f"residual, {unit}", "RMS", "max", "chi2/dof", "held out, RMS"), rows)
    of_points = OF_POINTS if len(answer.measurement.instrument.PARTS) > 1 else ""
    text = (
        f"{OBSERVED}{of_points}. Max is the largest length; chi2/dof is by the instrument specification. Before is the "
        "model without the causes, after with them. Held-out residuals are those of blocks of rows, each predicted "
        "from all others."
    )
    yield Section("Residual before and after", text, table, partial(before_and_after, answer))
    before, after = by_direction(answer.bare), by_direction(answer.structure)
    directions = [(name, f"{value:.2f}", f"{after[name]:.2f}") for name, value in before.items()]
    table = Table((f"residual RMS, {unit}", "before", "after"), directions)
    drawn = None if answer.measurement.state.approach is None else partial(by_approach, answer)
    yield Section("By direction, and in the volume", "\n".join(_volume(answer)), table, drawn)
    yield Section("Residual against noise", figure=partial(against_noise, answer))


def _volume(answer: Diagnosis) -> Iterator[str]:
    volume = answer.volume
    lever = f"; tool point {LEVER_ARM_MM:g} mm off in x, y, z" if measures_angles(answer.measurement) else ""
    yield (
        f"Error of the machine over the measured positions, by the new model: {volume.machine_rms:.2f} um RMS, "
        f"{volume.machine_max:.1f} um at most (after the best common shift and rotation{lever})."
    )
    if answer.given is not None:
        yield (
            f"Error after a correction by the present model, by the new one: {volume.left_rms:.2f} um RMS, "
            f"{volume.left_max:.1f} um at most."
        )


def data_section(answer: Diagnosis) -> Section:
    """The data, the noise that they show, and anomalies."""
    return facts("Data, model, noise", list(_facts(answer)))


def _facts(answer: Diagnosis) -> Iterator[tuple[str, str]]:
    structure, measurement = answer.structure, answer.measurement
    runs = 0 if measurement.run is None else len(set(measurement.run.tolist()))
    counted = f", {runs} run{'s' if runs > 1 else ''}" if runs else ""
    rows, count = int(structure.data.observations.averaged.sum()), structure.whitener.observed
    yield "data", f"{measurement.source}: {rows} rows, {count} observations{counted}"
    base = "error motions of all axes" if answer.given is None else "the present calibration, updated"
    yield "model", f"{base}; {len(answer.model.parameters)} parameters, {answer.rank} determined by these data"
    for finding in answer.findings:
        yield "note", finding.message
    yield (
        "noise",
        f"{rounded(math.sqrt(structure.noise.factor), 3)} times the instrument specification, found from the data",
    )
    repeats = ", ".join(f"{axis} {rounded(size, 2)}" for axis, size in answer.not_repeating.items())
    if repeats:
        yield "repeatability", f"standard deviation from stop to stop, um or urad: {repeats}"


def left_out_section(answer: Diagnosis) -> Iterator[Section]:
    """The rows that are left out."""
    rows = [f"{answer.measurement.where(row)}: outlier" for row in answer.outliers]
    if rows:
        yield Section("Left out", "\n".join(shortened(rows, LISTED_RESIDUALS, "outliers")))
