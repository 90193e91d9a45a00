"""`ncomp three-points`: three targets on each moving part in, six error motions of each axis and a calibration out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, argument, option
from postproc.commands.options.measurement import DataOptions
from postproc.commands.options.shared import (
    JsonFile,
    MachineName,
    check_files,
    residual_table,
    show_insignificant,
    whole_results,
    write_json,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import Console

    from calibration.single_axis.three_points import AxisResult, ThreePoints
    from calibration.single_axis.three_points_check import Check

EPILOG = (
    "Examples:\n\n"
    "`ncomp three-points tracker.csv --machine dmu50 -o cal.json`\n\n"
    "`ncomp three-points tracker.csv --machine dmu50 --degree XX=4 --degree YY=6 -o cal.json --json three_points.json`"
)


def three_points(
    *,
    data: Path = argument("Measurement file of a tracker on the bed.", "DATA.csv"),
    machine: MachineName,
    output: Path = option("File for the calibration.", "CAL.json", "-o", default=REQUIRED),
    basis: Literal["polynomial", "table"] = option("Basis of the error motions.", default="polynomial"),
    degree: tuple[str, ...] = option("Degree of the polynomial of E_XX; default: chosen by AIC.", "XX=4"),
    form: DataOptions,
    tables: bool = option("Also show the errors at each position of each axis.", default=False),
    json: JsonFile,
) -> None:
    """Identify the six error motions of each axis from three or more targets on the part that the axis moves."""
    from calibration.fit.acceptance import refuse_uncertain
    from calibration.fit.beyond_measured import calibration_file
    from calibration.single_axis.three_points import Choice, identify
    from calibration.single_axis.three_points_check import check
    from postproc.commands.show.terminal import console, say
    from postproc.commands.show.terminal import output as screen

    check_files((data, form.plan), {"--output": output, "--json": json})
    measurement = form.read([data], ncomp.load_machine(machine))
    choice = Choice(basis, _degrees(degree))
    found = identify(measurement, choice)
    for note in found.notes:
        say("note", note)
    refuse_uncertain(found.model, measurement)
    checked = check(measurement, found, choice)
    with whole_results(json, str(output)) as (results, file):
        file.write(calibration_file(found.model, measurement.machine))
        write_json(summary(found, checked), results)
    show(found, checked, console if json == "-" else screen, tables)


def _degrees(texts: Iterable[str]) -> dict[str, int]:
    degrees = {}
    for text in texts:
        name, _, number = text.partition("=")
        if not number.strip().isdigit():
            raise UserError(f"--degree {text}: expected NAME=DEGREE, as in XX=4")
        degrees[name.strip().removeprefix("E_")] = int(number)
    return degrees


def summary(found: ThreePoints, checked: Check) -> dict[str, Any]:
    """The result for programs; um and urad, positions in mm and degrees, u with k = 1."""
    from calibration.single_axis.three_points_figures import locations, ranges, squarenesses

    points, held = found.points, checked.cross_validation
    return {
        "before": {"rms_um": checked.before_rms_um, "max_um": checked.before_max_um},
        "after": {
            "rms_um": checked.fit.rms_um,
            "max_um": checked.fit.max_um,
            "heldout_rms_um": None if held is None else held.rms_um,
        },
        "chi2_reduced": points.chi2 / points.freedom if points.freedom else None,
        "repeatability_um": points.repeatability_um if points.freedom else None,
        "locations": {f.name: {"value": f.value, "u": f.u, "unit": f.unit} for f in locations(found)},
        "squareness": {f.name: {"value_urad": f.value, "u": f.u, "is": f.what} for f in squarenesses(found)},
        "axes": {
            name: {
                "targets": list(axis.targets),
                "standing": dict(axis.standing),
                "positions": axis.positions.tolist(),
                "errors": _columns(axis, axis.errors),
                "u": _columns(axis, axis.u),
                "u_type_a": _columns(axis, axis.u_a),
                "curves": _curves(axis),
                "ranges": {f.name: {"is": f.what, "value": f.value, "u": f.u, "unit": f.unit} for f in ranges(axis)},
                "straightness": _straightness(axis),
            }
            for name, axis in found.axes.items()
        },
        "significant_share": found.significant_share,
        "calibration": found.model.id,
    }


def _columns(axis: AxisResult, values: Any) -> dict[str, list[float]]:
    return {f"E_{letter}{axis.axis.name}": values[:, j].tolist() for j, letter in enumerate("XYZABC")}


def _curves(axis: AxisResult) -> dict[str, Any]:
    return {
        f"E_{letter}{axis.axis.name}": {
            "degree": degree,
            "chi2_reduced": one.chi2 / one.freedom if one.freedom else None,
            "u_widened_by": one.widening,
            "resolved": j not in axis.curves.unresolved,
        }
        for j, (letter, degree, one) in enumerate(zip("XYZABC", axis.curves.degrees, axis.misfits, strict=True))
    }


def _straightness(axis: AxisResult) -> dict[str, Any]:
    from calibration.single_axis.three_points_figures import straightnesses

    return {
        name: {
            one.line.kind: {
                "value_um": one.value, "u_um": one.u_value, "slope_urad": 1e3 * one.slope, "u_slope": 1e3 * one.u_slope
            }
            for one in lines
        }
        for name, lines in straightnesses(axis).items()
    }  # fmt: skip


def show(found: ThreePoints, checked: Check, to: Console, tables: bool = False) -> None:
    """Show the result for people; with `tables` also every position of every axis."""
    from rich.table import Table

    from calibration.single_axis.three_points_figures import locations, squarenesses, straightnesses

    points = found.points
    show_insignificant(found.significant_share, to)
    if points.freedom:
        to.print(
            f"rounds       chi2/dof {points.chi2 / points.freedom:.3g} by the tracker's sheet; the machine's "
            f"repeatability beyond it {points.repeatability_um:.2g} um"
        )
    to.print(residual_table((checked.before_rms_um, checked.before_max_um), checked.fit, checked.cross_validation))
    for axis in found.axes.values():
        to.print(_axis_summary(axis))
        if tables:
            to.print(_axis_table(axis))
        for name, lines in straightnesses(axis).items():
            values = ", ".join(f"{one.value:.2f} ± {one.u_value:.2f} ({one.line.kind})" for one in lines)
            to.print(f"straightness {name}: {values} um")
    table = Table("", "value", "u (k=1)", "", "", caption="tool relative to workpiece, right-handed")
    for figure in (*locations(found), *squarenesses(found)):
        table.add_row(figure.name, f"{figure.value:.2f}", f"{figure.u:.2f}", figure.unit, figure.what)
    to.print(table)


def _axis_summary(axis: AxisResult) -> Any:
    """One row for each error motion: its range over the positions, its curve and the misfit of the curve."""
    from rich.table import Table

    from calibration.single_axis.three_points_figures import ranges

    at = axis.positions
    table = Table(
        axis.axis.name, "range", "u (k=1)", "", "degree", "chi2/dof", "",
        title=f"{axis.axis.name}: {len(at)} positions, {at[0]:g} to {at[-1]:g} {axis.axis.unit} ({_standing(axis)})",
    )  # fmt: skip
    for figure, degree, one in zip(ranges(axis), axis.curves.degrees, axis.misfits, strict=True):
        ratio = f"{one.chi2 / one.freedom:.2f}" if one.freedom else ""
        shape = "table" if degree is None else str(degree)
        table.add_row(figure.name, f"{figure.value:.2f}", f"{figure.u:.2f}", figure.unit, shape, ratio, figure.what)
    return table


def _standing(axis: AxisResult) -> str:
    return ", ".join(f"{name} {at:g}" for name, at in axis.standing.items())


def _axis_table(axis: AxisResult) -> Any:
    from rich.table import Table

    heads = [f"E_{letter}{axis.axis.name}" for letter in "XYZABC"]
    table = Table(
        f"{axis.axis.name}, {axis.axis.unit}",
        *heads,
        title=f"{axis.axis.name} ({_standing(axis)}); um, urad, ± u",
    )
    for at, errors, u in zip(axis.positions, axis.errors, axis.u, strict=True):
        table.add_row(f"{at:g}", *(f"{e:.1f} ± {s:.1f}" for e, s in zip(errors, u, strict=True)))
    return table
