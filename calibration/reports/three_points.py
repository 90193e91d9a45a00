"""Results of a three-point identification: error motions of each axis, location errors, squareness, straightness."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

from calibration.reports.fit import RIGHT_HANDED, insignificant, residual_sentence, residuals
from calibration.single_axis.stations import Points
from calibration.single_axis.three_points import AxisResult, ThreePoints
from calibration.single_axis.three_points_check import Check
from calibration.single_axis.three_points_figures import LINES, locations, ranges, squarenesses, straightnesses
from kinematics.effects import COMPONENTS
from kinematics.files.number_text import plus_minus, uncertainty
from kinematics.files.report_head import ReportHead
from kinematics.transforms import Array
from rendering.figures import COLOURS, Figure, Panel, bars_of_error, grid, level
from rendering.report import Report, Section, Table
from rendering.volume import Field, uncertainty_of, volume_section


def three_points_json(found: ThreePoints, checked: Check) -> dict[str, Any]:
    """The result for programs; um and urad, positions in mm and degrees, u with k = 1."""
    points, held = found.points, checked.cross_validation
    return {
        "before": {
            "rms_um": checked.before_rms_um,
            "max_um": checked.before_max_um,
            "heldout_rms_um": None if held is None else held.other_rms_um,
        },
        "after": {
            "rms_um": checked.fit.rms_um,
            "max_um": checked.fit.max_um,
            "heldout_rms_um": None if held is None else held.rms_um,
        },
        "chi2_reduced": points.chi2 / points.degrees_of_freedom if points.degrees_of_freedom else None,
        "repeatability_um": points.repeatability_um if points.degrees_of_freedom else None,
        "locations": {f.name: {"value": f.value, "u": f.u, "unit": f.unit} for f in locations(found)},
        "squareness": {f.name: {"value_urad": f.value, "u": f.u, "is": f.description} for f in squarenesses(found)},
        "axes": {
            name: {
                "targets": list(axis.targets),
                "standing": dict(axis.standing),
                "positions": axis.positions.tolist(),
                "errors": _columns(axis, axis.errors),
                "u": _columns(axis, axis.u),
                "u_type_a": _columns(axis, axis.u_a),
                "curves": _curves(axis),
                "ranges": {
                    f.name: {"is": f.description, "value": f.value, "u": f.u, "unit": f.unit} for f in ranges(axis)
                },
                "straightness": _straightness(axis),
            }
            for name, axis in found.axes.items()
        },
        "significant_share": found.significant_share,
        "calibration": found.model.id,
    }


def _names(axis: AxisResult) -> list[str]:
    return [f"E_{letter}{axis.axis.name}" for letter in COMPONENTS]


def _columns(axis: AxisResult, values: Array) -> dict[str, list[float]]:
    return {name: values[:, j].tolist() for j, name in enumerate(_names(axis))}


def _curves(axis: AxisResult) -> dict[str, Any]:
    return {
        name: {
            "degree": degree,
            "chi2_reduced": one.chi2 / one.degrees_of_freedom if one.degrees_of_freedom else None,
            "u_widened_by": one.widening,
            "resolved": j not in axis.curves.unresolved,
        }
        for j, (name, degree, one) in enumerate(zip(_names(axis), axis.curves.degrees, axis.misfits, strict=True))
    }


def _straightness(axis: AxisResult) -> dict[str, Any]:
    return {
        name: {
            one.line.kind: {
                "value_um": one.value, "u_um": one.u_value, "slope_urad": 1e3 * one.slope, "u_slope": 1e3 * one.u_slope
            }
            for one in lines
        }
        for name, lines in straightnesses(axis).items()
    }  # fmt: skip


def three_points_report(found: ThreePoints, checked: Check, lead: str, head: ReportHead, *, tables: bool) -> Report:
    """The result for people; `lead`: the data; with `tables` also every position of every axis."""
    residual = residual_sentence(checked.before_rms_um, checked.fit, checked.cross_validation)
    verdict = "\n".join([*insignificant(found.significant_share), residual, *_noise(found.points)])
    return Report("Three-point identification", lead, list(_sections(found, checked, tables)), verdict, head=head)


def _sections(found: ThreePoints, checked: Check, tables: bool) -> Iterator[Section]:
    maps = [Field("without a correction", found.model), uncertainty_of(found.model)]
    yield from volume_section(checked.fit.measurement.machine, maps)
    yield residuals((checked.before_rms_um, checked.before_max_um), checked.fit, checked.cross_validation)
    for axis in found.axes.values():
        yield _axis_summary(axis)
        text = "The points are the errors at the positions, um and urad, with bars of U (k=2)."
        yield Section(f"Error motions of {axis.axis.name}", text, figure=partial(_motions, axis))
        if tables:
            rows = [
                (f"{at:g}", *(plus_minus(e, s, 1) for e, s in zip(errors, u, strict=True)))
                for at, errors, u in zip(axis.positions, axis.errors, axis.u, strict=True)
            ]
            table = Table((f"{axis.axis.name}, {axis.axis.unit}", *_names(axis)), rows)
            text = "Errors are in um and urad, each with its standard uncertainty u (k=1)."
            yield Section(f"Positions of axis {axis.axis.name}", text, table)
    straight = [
        (name, *(plus_minus(one.value, one.u_value, 2) for one in lines))
        for axis in found.axes.values()
        for name, lines in straightnesses(axis).items()
    ]
    if straight:
        text = "Values are in um, each with its standard uncertainty u (k=1), by reference line."
        yield Section("Straightness", text, Table(("error motion", *LINES), straight))
    rows = [
        (figure.name, f"{figure.value:.2f}", uncertainty(figure.u, 2), figure.unit, figure.description)
        for figure in (*locations(found), *squarenesses(found))
    ]
    yield Section(
        "Location errors and squareness", RIGHT_HANDED, Table(("error", "value", "u (k=1)", "unit", "meaning"), rows)
    )


def _noise(points: Points) -> Iterator[str]:
    """The size of the residuals beside the instrument specification, and the repeatability that it shows."""
    if not points.degrees_of_freedom:
        return
    text = (
        f"The residuals have chi2/dof {points.chi2 / points.degrees_of_freedom:.3g} by the instrument specification: "
    )
    if points.repeatability_um:
        yield f"{text}the machine repeats to {points.repeatability_um:.2g} um (standard deviation) beside its noise."
    else:
        yield f"{text}they are no larger than its noise."


def _motions(axis: AxisResult) -> Figure:
    """The six error motions of an axis at its positions."""
    panels = []
    for j, name in enumerate(_names(axis)):
        panel = Panel(f"{axis.axis.name}, {axis.axis.unit}", f"{name}, {'urad' if j >= 3 else 'um'}", name)
        bars_of_error(panel, axis.positions, axis.errors[:, j], 2.0 * axis.u[:, j], COLOURS[0], size=5)
        level(panel, 0.0)
        panels.append(panel)
    return grid(panels, 3)


def _axis_summary(axis: AxisResult) -> Section:
    """One row for each error motion: its range over the positions, its curve, the misfit of given degrees."""
    at, others = axis.positions, ", ".join(f"{name} {at:g}" for name, at in axis.standing.items())
    misfit = any(one.degrees_of_freedom for one in axis.misfits)
    rows = [
        (
            figure.name,
            f"{figure.value:.2f}",
            uncertainty(figure.u, 2),
            figure.unit,
            "table" if degree is None else str(degree),
            *[f"{one.chi2 / one.degrees_of_freedom:.2f}" if one.degrees_of_freedom else ""] * misfit,
            figure.description,
        )
        for figure, degree, one in zip(ranges(axis), axis.curves.degrees, axis.misfits, strict=True)
    ]
    text = (
        f"The axis was measured at {len(at)} positions from {at[0]:g} to {at[-1]:g} {axis.axis.unit}, with the other "
        f"axes at {others}."
    )
    head = ("error motion", "range", "u (k=1)", "unit", "degree", *["chi2/dof"] * misfit, "kind")
    return Section(f"Axis {axis.axis.name}", text, Table(head, rows))
