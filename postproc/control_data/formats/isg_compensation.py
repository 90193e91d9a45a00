"""ISG kernel and Beckhoff TwinCAT CNC: axis compensation lists, and the volumetric compensation's data file.

Formats: TF5200 and TF5280 documentation (docs/tables.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from kinematics.machine import Axis
from kinematics.user_error import UserError
from postproc.control_data.format import Settings
from postproc.control_data.readers.read_isg_compensation import read_cross, read_ssfk, read_volumetric
from postproc.control_data.tables.build import Capabilities
from postproc.control_data.tables.content import Content, lettered, number, own_tables, repeats
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.table_format import TableFormat
from postproc.control_data.tables.terms import Curve, Surface

UNIT = 1e-4
"""mm or degrees: 0.1 um, 0.0001 degrees."""
PLANE_POINTS = 10201


class SsfkSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Most points (kw.ssfk.max_points)."""

    points: Annotated[int, Meta(ge=2, le=50_000)] = 1500


class CrossSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Plane compensation, or cross compensation of one slave a master; points of a cross table."""

    planes: bool = True
    points: Annotated[int, Meta(ge=2, le=50_000)] = 1001


class VolumetricSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Unit of angular errors, and records of an axis."""

    angle: Literal["rad", "deg"] = "rad"
    points: Annotated[int, Meta(ge=2)] = 200


def _units(value: float) -> int:
    """Unit of a length or angle in a list, a whole number."""
    return round(value / UNIT)


def _head(content: Content, axis: Axis) -> list[str]:
    number_of = [a.name for a in lettered(content.machine)].index(axis.name) + 1
    return [_line("kopf.achs_nr", number_of), f"{'kopf.log_achs_name':<40} {axis.name}"]


def _line(name: str, value: int) -> str:
    return f"{name:<40} {value}"


def write_ssfk(content: Content) -> dict[str, str]:
    """`achskw_x.lis` ...: leadscrew error compensation, free nodes, both directions."""
    files = {}
    for axis, table in own_tables(content):
        lines = ["# leadscrew error compensation; values: error, actual minus setpoint", *_head(content, axis)]
        lines += [
            _line("kw.ssfk.interval", 0),
            _line("kw.ssfk.kw_startpos", _units(table.nodes[0])),
            _line("kw.ssfk.kw_nr_max", len(table.nodes)),
            _line("kw.ssfk.unit", 1),
            _line("kw.ssfk.bilateral", 1),
            _line("kw.ssfk.modulo", int(repeats(axis))),
        ]
        for k, (x, up, down) in enumerate(zip(table.nodes, table.forward, table.backward, strict=True)):
            lines.append(_line(f"kw.ssfk.table[{k}].setpoint", _units(x)))
            lines.append(_line(f"kw.ssfk.table[{k}].pos", _units(content.factor * up)))
            lines.append(_line(f"kw.ssfk.table[{k}].neg", _units(content.factor * down)))
        files[f"achskw_{axis.name.lower()}.lis"] = "\n".join([*lines, ""])
    return files


def write_cross(content: Content) -> dict[str, str]:
    """`achskw_x.lis` ...: cross compensation in the list of the master, plane compensation in that of the slave."""
    files = {}
    for axis in lettered(content.machine):
        lines = list(_cross_lines(content, axis))
        if lines:
            head = [f"# compensation of other axes; values: {content.sign}", *_head(content, axis)]
            files[f"achskw_{axis.name.lower()}.lis"] = "\n".join([*head, *lines, ""])
    return files


def _cross_lines(content: Content, axis: Axis) -> Iterator[str]:
    numbers = {a.name: k for k, a in enumerate(lettered(content.machine), 1)}
    for term in content.terms:
        factor = term.factors[0]
        if isinstance(factor, Curve) and factor.axis == axis.name:
            yield _line("kw.crosscomp.unit", 1)
            yield _line("kw.crosscomp.slave_ax_nr", numbers[term.output])
            yield _line("kw.crosscomp.last_index", len(factor.nodes) - 1)
            for k, (x, value) in enumerate(zip(factor.nodes, factor.values, strict=True)):
                yield _line(f"kw.crosscomp.table[{k}].setpoint", _units(x))
                yield _line(f"kw.crosscomp.table[{k}].correction", _units(content.factor * value))
        elif isinstance(factor, Surface) and term.output == axis.name:
            yield from _plane(content, factor, numbers)


def _plane(content: Content, surface: Surface, numbers: dict[str, int]) -> Iterator[str]:
    first, second = surface.nodes
    yield _line("kw.crosscomp2.unit", 1)
    yield _line("kw.crosscomp2.interval", _units(first[1] - first[0]))
    for k, (axis, nodes) in enumerate(zip(surface.axes, surface.nodes, strict=True), 1):
        yield _line(f"kw.crosscomp2.master{k}_ax_nr", numbers[axis])
        yield _line(f"kw.crosscomp2.start_position_master{k}", _units(nodes[0]))
        yield _line(f"kw.crosscomp2.last_index_master{k}", len(nodes) - 1)
    for j in range(len(second)):
        for i in range(len(first)):
            yield _line(f"kw.crosscomp2.table[{j}][{i}].correction", _units(content.factor * surface.values[i, j]))


def write_volumetric(content: Content) -> dict[str, str]:
    """`volcomp.csv`, a block for each axis, and `volcomp.lis`, which loads it."""
    turn = 1.0 if content.settings.angle == "rad" else float(np.degrees(1.0))
    blocks = []
    for axis in lettered(content.machine):
        tables = [table for table in content.motions if table.axis == axis.name]
        if not tables:
            continue
        lines = [
            "".join(f"{name:<20}" for name in (axis.name, *(f"E{t.component}{axis.name}" for t in tables))).rstrip()
        ]
        for k, x in enumerate(tables[0].nodes.tolist()):
            values = [-content.factor * t.mean[k] * (turn if t.angular else 1.0) for t in tables]
            lines.append("".join(f"{cell:<20}" for cell in (number(x, 4), *(number(v, 12) for v in values))).rstrip())
        blocks.append("\n".join(lines))
    head = f"// ISO 230-1 parameters, values: {content.sign}; mm, {content.settings.angle}\n"
    return {"volcomp.csv": head + "\n#\n".join(blocks) + "\n", "volcomp.lis": _config(content)}


def _config(content: Content) -> str:
    ours = [axis for axis in content.machine.axes if axis.name in {table.axis for table in content.motions}]
    lines = [("workpiece_axes", str(sum(axis.side == "workpiece" for axis in ours)))]
    lines += [(axis.name, str(k)) for k, axis in enumerate(content.machine.axes, 1)]
    lines += [("interpolation", "GRID"), ("enable_splicing", "FALSE"), ("filter_steps", "20")]
    lines += [("manual_activation", "TRUE"), ("alternative_model", "FALSE")]
    lines += [("file[0]", "volcomp.csv"), ("file_format[0]", "ISG_CSV")]
    return "".join(f"{name:<25}{value}\n" for name, value in lines)


def _volumetric_limits(settings: VolumetricSettings) -> Limits:
    return Limits(points=settings.points, resolution=1e-7, shared=True)


def _cross_limits(settings: CrossSettings) -> Limits:
    if settings.planes:
        return Limits(
            points=PLANE_POINTS, resolution=UNIT, spacing_step=UNIT, grid=41, square=True, surfaces_per_output=1
        )
    return Limits(points=settings.points, resolution=UNIT, cross_per_source=1)


def check_axes(content: Content) -> dict[str, str]:
    """The volumetric files; UserError for a machine that the control's model does not take."""
    linear = [axis for axis in content.machine.axes if not axis.rotary]
    if len(linear) != 3 or len(content.machine.axes) > 6:
        raise UserError("isg-volumetric: expected a machine with exactly three linear and at most three rotary axes")
    return write_volumetric(content)


SSFK = TableFormat(
    name="isg",
    title="ISG / Beckhoff TwinCAT CNC leadscrew error compensation (kw.ssfk)",
    settings=SsfkSettings,
    limits=lambda settings: Limits(points=settings.points, resolution=UNIT, finest=2e-5),
    capabilities=lambda _: Capabilities(bidirectional=True),
    write=write_ssfk,
    read=read_ssfk,
    sign="error",
    family="isg",
    meaning="""\
kw.ssfk.table[i].pos and .neg are the error, actual minus setpoint, for travel in the positive and the negative
direction, in 0.1 um or 0.0001 degrees (unit 1), at setpoint, in the same units, machine coordinates. The control
takes it off. Linear between; the end values hold outside. Both directions are in it (bilateral 1): no further
backlash compensation.""",
    loading="""\
Name the lists in the start-up list (zahl_kw, achs_kw_log_ax_nr[i], achs_kw[i]); lr_param.ssfk 1 in the axis list;
kw.ssfk.max_points where there are more than 1500. Check the axis numbers in kopf.achs_nr.""",
    certainty="""\
Format, units and the formula actual minus setpoint: Beckhoff TF5200 documentation. Its printed example follows
the formula only if the signs of its positions are left out: check one node with --probe.""",
)
CROSS = TableFormat(
    name="isg-cross",
    title="ISG / Beckhoff TwinCAT CNC cross and plane compensation (kw.crosscomp, kw.crosscomp2)",
    settings=CrossSettings,
    limits=_cross_limits,
    capabilities=lambda s: Capabilities(own=False, cross=not s.planes, surfaces="XYZUVW" if s.planes else ""),
    write=write_cross,
    read=read_cross,
    family="isg",
    meaning="""\
kw.crosscomp2 (plane): the correction (or, by --sign, the error) of the slave, whose list it is in, by the
positions of two masters, table[j][i] with j of the second, bilinear between squares of one interval.
kw.crosscomp: the same of one slave by the position of the master, whose list it is in. 0.1 um or 0.0001 degrees;
the values at the edge hold outside. A plane may hold the slave's own pitch as well: make it from the errors that
remain after the tables of format isg (--rest).""",
    loading="""\
As the lists of format isg; lr_param.crosscomp 1 or lr_param.crosscomp2 1 in the list of the slave. One list an
axis: join its lines with those of kw.ssfk. Check the axis numbers.""",
    certainty="""\
Format, units, interpolation: Beckhoff TF5200 documentation. Sign: not stated; it is as given by --sign.""",
)
VOLUMETRIC = TableFormat(
    name="isg-volumetric",
    title="ISG / Beckhoff TwinCAT CNC volumetric compensation (ISG_CSV)",
    settings=VolumetricSettings,
    limits=_volumetric_limits,
    write=check_axes,
    read=read_volumetric,
    family="isg",
    meaning="""\
EXX ... ECC by ISO 230-1 of each axis over its own position; squareness and positions of rotary axes are in them as
slopes and constants. mm, and rad or degrees as set. Counted as tool relative to workpiece, angular errors about
the axis' point (docs/conventions.md). Grid, linear between. The control compensates the position, not the
orientation.""",
    loading="""\
Set the paths in volcomp.lis, its axis numbers and workpiece_axes; name it in the start-up list
(vol_comp[i].file_name, max_records); switch it on with #VOLCOMP ON [ID0]. `negate XYZ` turns the sign per axis.""",
    certainty="""\
Names and layout: Beckhoff TF5280 documentation. Sign and unit of angles: not stated (samples of the Etalon format
suggest rad); experimental. The sign is as given by --sign.""",
)
