"""`ncomp fit`: measured points in, a calibration out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import ncomp
from postproc.commands.options.declared import REQUIRED, argument, option
from postproc.commands.options.measurement import DataOptions, Noise
from postproc.commands.options.path import OnTheFlyOptions, moving_summary, read_path, show_moving
from postproc.commands.options.program import DialectName, SetUpOptions
from postproc.commands.options.shared import (
    MachineName,
    ResultOptions,
    check_files,
    residual_table,
    show_insignificant,
    whole_results,
    write_json,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import Console

    from calibration.fit.calibrate import Calibration
    from calibration.fit.fit import Fit
    from calibration.fit.identifiability import Identifiability
    from calibration.measurement.measurement import Measurement
    from calibration.on_the_fly.along_path import OnTheFly
    from kinematics.effects import Effect


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """The fitted model, its prior and its validity, by the names of the public interface."""

    basis: str = option(
        "Basis of the error motions: b-spline:NODES (a table), cubic:NODES, legendre:DEGREE, polynomial:DEGREE, "
        "fourier:HARMONICS; auto or auto:KIND: selected by the evidence of the data.",
        "auto|KIND:SIZE|X=KIND:SIZE,...",
        default="auto",
    )
    effects: tuple[str, ...] = option(
        "Another effect of docs/effects.md to fit, with its initial values: backlash:axis=X,width=0.",
        "KIND:FIELD=VALUE,...",
        "--effect",
    )
    noise: Noise
    prior_scale: float | None = option(
        "Expected size of the errors, as a multiple of 30 um and urad; default: selected by the evidence of the data.",
        min=1e-3,
    )
    hold_out: bool = option("Predict each run, or cell of space, from all others as a check.", default=True)
    valid_days: float | None = option("Validity of the calibration, days; default: 365.", "N", min=1.0, max=36500.0)


MANY = 0.05
"""Share of outliers above which they are evidence of an effect missing from the model."""
EPILOG = (
    "Examples:\n\n"
    "`ncomp fit tracker.csv --machine gantry -o gantry.json --report gantry.html`\n\n"
    "`ncomp fit tracker.csv --machine dmu50 --basis legendre:5 -o cal.json --json fit.json`\n\n"
    "`ncomp fit tracker.csv --machine cframe --effect backlash:axis=X,width=0 -o cal.json`\n\n"
    "`ncomp fit log.csv --machine gantry --plan plan.csv -o gantry.json`  finds the standstills in a "
    "tracker's stream\n\n"
    "`ncomp fit points.csv --machine cframe --path path.nc --reversal constant -o cal.json`  fits "
    "data taken on the fly\n\n"
    "`ncomp fit plate.txt --machine cframe --header u_um=2.3 --noise estimate -o cal.json`  reads a CMM's table\n\n"
    "`ncomp fit tracker.csv --machine gantry --valid-days 90 -o gantry.json`  makes a calibration that "
    "is refused after 90 days\n\n"
    "then `ncomp part.nc --machine gantry --calibration gantry.json -o part_c.nc`"
)


def fit(
    *,
    data: Path = argument("Measurement file.", "DATA.csv"),
    machine: MachineName,
    output: Path = option("File for the calibration.", "CAL.json", "-o", default=REQUIRED),
    model: FitOptions,
    form: DataOptions,
    moving: OnTheFlyOptions,
    set_up: SetUpOptions,
    dialect: DialectName,
    others: ResultOptions,
) -> None:
    """Fit the machine's errors to measured points, with uncertainties, and list the errors that the points can't show.

    Error motions of all axes that move, the instrument's position and outliers are found jointly. Errors that the data
    do not determine are listed by name and keep their prior uncertainty.
    """
    from postproc.commands.show.terminal import console
    from postproc.commands.show.terminal import output as screen

    check_files((data, form.plan, moving.path), {"--output": output, **others.by_option})
    moving.check(form, set_up)
    found_machine = ncomp.load_machine(machine)
    measured: Measurement | OnTheFly
    if moving.path is None:
        measured = form.read([data], found_machine)
    else:
        nominal = read_path(moving.path, found_machine, set_up.setup(found_machine), dialect)
        measured = moving.read(data, nominal, form)
    with console.status("reading") as status:
        found = ncomp.fit(measured, reversal=moving.reversal, progress=status.update, **vars(model))
    taken = None if moving.path is None else cast("OnTheFly", measured)
    command = f"ncomp fit {data} --machine {machine} --basis {model.basis} --noise {model.noise}"
    _write(found, taken, str(output), others, command)
    to = console if "-" in others.files else screen
    if taken is not None:
        show_moving(found, taken, to)
    show(found, to)


def _write(found: Calibration, taken: OnTheFly | None, output: str, others: ResultOptions, command: str) -> None:
    """Write the calibration, the results for programs and the report, all or none."""
    from calibration.fit.beyond_measured import calibration_file

    with whole_results(*others.files, output) as (results, shown, file):
        file.write(calibration_file(found.model, found.fit.measurement.machine))
        write_json(summary(found) | moving_summary(found, taken), results)
        if others.report is not None:
            from calibration.pages.fit import fit_page

            shown.write(fit_page(found, command))


def summary(found: Calibration) -> dict[str, Any]:
    """The result for programs."""
    from kinematics.effects import LocationError

    fitted, seen, held = found.fit, found.identifiability, found.cross_validation
    measurement = fitted.measurement
    return {
        "before": {"rms_um": found.before_rms_um, "max_um": found.before_max_um},
        "after": {
            "rms_um": fitted.rms_um,
            "max_um": fitted.max_um,
            "chi2_reduced": fitted.chi2_reduced,
            "p_value": fitted.p_value,
            "heldout_rms_um": None if held is None else held.rms_um,
        },
        "noise_factor": fitted.variance_factor**0.5,
        "n_observations": fitted.observations,
        "n_parameters": seen.parameters,
        "effective_parameters": fitted.effective_parameters,
        "rank": seen.rank,
        "rank_registered": seen.rank_registered,
        "by_convention": seen.by_convention,
        "not_visible": seen.not_visible,
        "blind": [
            {"effects": list(b.effects), "directions": b.directions, "reason": b.reason, "remedy": b.remedy}
            for b in seen.unidentifiable
        ],
        "basis": {axis: str(choice) for axis, choice in found.choice.bases.items()},
        "prior_scale": found.choice.prior_scale,
        "log_evidence": fitted.log_evidence,
        "depends_on": [{"what": s.what, "p_value": s.p_value, "hint": s.hint} for s in found.suspects],
        "outliers": [measurement.where(int(row)) for row in fitted.outliers],
        "copies": [measurement.where(int(row)) for row in fitted.copies.nonzero()[0]],
        "failed_stations": list(fitted.failed),
        "significant_share": found.significant_share,
        "u_um": found.seen.json(),
        "sanity": [{"what": finding.what, "says": finding.says} for finding in found.findings],
        "locations": {
            e.name: {"value_urad" if e.angular else "value_um": e.value, "u": e.uncertainties[0]}
            for e in found.model.effects
            if isinstance(e, LocationError)
        },
        "effects": [
            {"name": e.name, "parameters": e.by_key(e.parameters), "u": e.by_key(e.uncertainties)}
            for e in besides(found.model.effects)
        ],
        "calibration": found.model.id,
    }


def show(found: Calibration, to: Console) -> None:
    """Show the result for people."""
    from rich.table import Table

    from kinematics.effects import LocationError

    fitted, seen = found.fit, found.identifiability
    measurement = fitted.measurement
    bases = ", ".join(f"{axis} {basis}" for axis, basis in found.choice.bases.items())
    show_insignificant(found.significant_share, to)
    for finding in found.findings:
        to.print(f"DATA         {finding.says}")
    to.print(f"data         {measurement.source}: {len(measurement)} rows, {fitted.observations} observations fitted")
    to.print(f"model        {seen.parameters} parameters: {bases}; size of errors x {found.choice.prior_scale:g}")
    to.print(
        f"rank         {seen.rank} with the instrument's position known, {seen.rank_registered} as it is; "
        f"{seen.by_convention} directions are the frame's and fixed by convention"
    )
    to.print(residual_table((found.before_rms_um, found.before_max_um), fitted, found.cross_validation))
    to.print(f"noise        {_noise(fitted)}")
    to.print(f"uncertainty  {found.seen}")
    locations = [effect for effect in found.model.effects if isinstance(effect, LocationError)]
    if locations:
        lines = Table("location error", "value", "u (k=1)", "", caption="tool relative to workpiece, right-handed")
        for effect in locations:
            unit = "urad" if effect.angular else "um"
            lines.add_row(effect.name, f"{effect.value:.2f}", f"{effect.uncertainties[0]:.2f}", unit)
        to.print(lines)
    _show_besides(found.model.effects, to)
    for (reason, remedy), names in _alike(seen).items():
        to.print(f"NOT VISIBLE  {', '.join(names)}: {reason}; {remedy}")
    for suspect in found.suspects:
        to.print(f"DEPENDS ON   the residuals depend on {suspect.what} (p = {suspect.p_value:.1g}): try {suspect.hint}")
    if len(fitted.outliers) > MANY * len(measurement):
        to.print("DOUBTFUL     so many rows disagree that they are no outliers: the model lacks something")
    _show_left_out(fitted, to)


def besides(effects: Iterable[Effect]) -> list[Effect]:
    """Effects other than error motions and location errors."""
    from kinematics.effects import ErrorMotion, LocationError

    return [effect for effect in effects if not isinstance(effect, (ErrorMotion, LocationError))]


def _show_besides(effects: Iterable[Effect], to: Console) -> None:
    from rich.table import Table

    table = Table("other effect", "parameter", "value", "u (k=1)")
    for effect in besides(effects):
        for i, (parameter, u) in enumerate(zip(effect.parameter_table, effect.uncertainties, strict=True)):
            value = effect.parameters[i]
            table.add_row("" if i else effect.name, f"{parameter.name}, {parameter.unit}", f"{value:.3f}", f"{u:.3f}")
    if table.row_count:
        to.print(table)


def _alike(seen: Identifiability) -> dict[tuple[str, str], list[str]]:
    """Names of unidentifiable effects by reason and remedy."""
    found: dict[tuple[str, str], list[str]] = {}
    for unidentifiable in seen.unidentifiable:
        found.setdefault((unidentifiable.reason, unidentifiable.remedy), []).append(" + ".join(unidentifiable.effects))
    return found


def _noise(fitted: Fit) -> str:
    if fitted.variance_factor != 1.0:
        return f"estimated from the data: {fitted.variance_factor**0.5:.3g} times the instrument's sheet"
    text = f"chi2/dof {fitted.chi2_reduced:.3g} by the instrument's sheet"
    if fitted.doubtful:
        return (
            f"{text} (p = {fitted.p_value:.1g}): the model lacks something, or the sheet promises too much; "
            f"uncertainties are widened by {fitted.chi2_reduced**0.5:.3g}"
        )
    return text


def _show_left_out(fitted: Fit, to: Console) -> None:
    measurement, most = fitted.measurement, 12
    for what, rows in (("outlier", fitted.outliers), ("copy of an earlier row", fitted.copies.nonzero()[0])):
        for row in rows[:most]:
            size = fitted.residual_um[row]
            to.print(f"left out     {measurement.where(int(row))}: {what}, {size:.1f} um from the rest")
        if len(rows) > most:
            to.print(f"left out     ... and {len(rows) - most} more ({what})")
    for name in fitted.failed:
        to.print(f"left out     station {name}: most of its rows disagree with all others")
