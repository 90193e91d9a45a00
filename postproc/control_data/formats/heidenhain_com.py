"""HEIDENHAIN TNC: error tables `.COM`, their assignment `.CMA`, and KinematicsComp rows.

Columns: technical manuals (MANUALplus 620, iTNC 530 HSCI, TNC 407); text layout: one public tool (docs/tables.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from kinematics.effects import COMPONENTS
from kinematics.effects.base import own_component
from kinematics.machine import Axis
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control_data.format import Settings
from postproc.control_data.readers.read_heidenhain_com import read, read_kinematics
from postproc.control_data.tables.build import Capabilities
from postproc.control_data.tables.content import Content, lettered
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.motion_tables import MotionTable
from postproc.control_data.tables.table_format import TableFormat
from postproc.control_data.tables.terms import Curve

COM_DECIMALS, COM_ANGLE_DECIMALS = 4, 7
COMPTAB_ROWS = 100
CMA = "config.cma"
"""Standard name of the assignment table."""


class ComSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Layout (new: NCK software; old: iTNC 530, equidistant by `distance`), rows, column BACKLASH of the new one."""

    layout: Literal["new", "old"] = "new"
    points: Annotated[int, Meta(ge=2, le=256)] = 256
    distance: Annotated[float, Meta(gt=0)] | None = None
    backlash: bool = False


class KinematicsSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Most rows of a table."""

    points: Annotated[int, Meta(ge=2, le=256)] = 256


def write(content: Content) -> dict[str, str]:
    """`AXIS_X.COM` ..., and `config.cma`, which names each, as it is on disk, for the axis it is a function of."""
    if content.settings.layout == "old" and content.settings.backlash:
        raise UserError("--set backlash=true: the old layout has no column BACKLASH")
    new = content.settings.layout == "new"
    names = [axis.name for axis in lettered(content.machine)]
    files: dict[str, str] = {}
    for source in lettered(content.machine):
        columns = _columns(content, source)
        if columns:
            file, (nodes, cells) = _com(content, source), columns
            files[file] = _new(file, nodes, ["BACKLASH", *names], cells) if new else _old(file, nodes, names, cells)
    files[CMA] = _assignment(content, files)
    return files


def _com(content: Content, axis: Axis) -> str:
    return f"AXIS{'_' if content.settings.layout == 'new' else '-'}{axis.name}.COM"


def _columns(content: Content, source: Axis) -> tuple[Array, dict[str, list[str]]] | None:
    """Nodes of an axis and values by column, in the file's sign."""
    cells: dict[str, list[str]] = {}
    nodes = None
    for term in content.terms:
        curve = term.factors[0]
        if term.inputs == (source.name,) and isinstance(curve, Curve):
            nodes = curve.nodes
            values = [_signed(value) for value in (content.factor * curve.values).tolist()]
            cells["BACKLASH" if term.direction < 0 else term.output] = values
    return None if nodes is None else (nodes, cells)


def _new(file: str, nodes: Array, names: Sequence[str], cells: Mapping[str, Sequence[str]]) -> str:
    """A table of the new layout with these columns, some of them empty."""
    lines = [f"BEGIN {file} MM", f"{'NR':<5}" + "".join(f"{name:<14}" for name in ("AXISPOS", *names))]
    for k, position in enumerate(nodes.tolist()):
        row = [_signed(position), *(cells[name][k] if name in cells else "" for name in names)]
        lines.append(f"{k:<5}" + "".join(f"{cell:<14}" for cell in row))
    return "\n".join(line.rstrip() for line in [*lines, "[END]", ""])


def _old(file: str, nodes: Array, names: Sequence[str], cells: Mapping[str, Sequence[str]]) -> str:
    """A table of the old layout, as `_new`."""
    distance = (nodes[-1] - nodes[0]) / (len(nodes) - 1)
    lines = [
        f"BEGIN {file}  DATUM:{_signed(nodes[0])} DISTANCE:{_signed(distance)}",
        f"{'NR':<20}" + "".join(f"{name:<11}" for name in names),
    ]
    for k, position in enumerate(nodes.tolist()):
        row = [cells[name][k] if name in cells else "" for name in names]
        lines.append(f"{k:<8}{_signed(position):<12}" + "".join(f"{cell:<11}" for cell in row))
    return "\n".join(line.rstrip() for line in [*lines, "[END]", ""])


def _assignment(content: Content, files: Mapping[str, str]) -> str:
    axes = [axis for axis in lettered(content.machine) if _com(content, axis) in files]
    new = content.settings.layout == "new"
    head = f"{'NR':<5}" + (f"{'ACTIVE':<8}" if new else "") + "".join(f"{axis.name:<16}" for axis in axes)
    row = f"{'0':<5}" + (f"{'*':<8}" if new else "") + "".join(f"{_com(content, axis):<16}" for axis in axes)
    return "\n".join([f"BEGIN {CMA}", head.rstrip(), row.rstrip(), "[END]", ""])


def _signed(value: float, decimals: int = COM_DECIMALS) -> str:
    return f"{value:+z.{decimals}f}"


def write_kinematics(content: Content) -> dict[str, str]:
    """`AXIS_X.COM` with columns C1 ... C6, and `kinematics.txt`: the rows to put into the kinematics description."""
    files: dict[str, str] = {}
    rows = []
    comptab = 0
    for axis in reversed(content.machine.axes):  # the description begins at the tool
        tables = [table for table in content.motions if table.axis == axis.name]
        own = own_component(axis.name)
        across = [table for table in tables if table.component != own]
        if tables:
            files[f"AXIS_{axis.name}.COM"] = _with_components(content, axis, tables)
        comptab += len(across)
        rows += _rows(axis, across)
    if comptab > COMPTAB_ROWS - len(content.machine.axes):
        raise UserError(
            f"heidenhain-kinematics: {comptab} rows with COMPTAB; {COMPTAB_ROWS} less the number of axes fit"
        )
    head = f"{'NR':<4}{'DOC':<18}{'KEY':<10}{'AXIS':<6}{'COORD':<16}{'COMPTAB':<10}"
    numbered = [f"{k:<4}{row}" for k, row in enumerate(rows)]
    files["kinematics.txt"] = "\n".join(line.rstrip() for line in [head, *numbered, "[END]", ""])
    return files


def errors_before(axis: Axis) -> bool:
    """True if the errors of an axis are nearer to the tool than its motion.

    They belong to the moving component of a linear axis, and to the bed's side of a rotary axis (docs/conventions.md).
    """
    return (axis.side == "tool") != axis.rotary


def _rows(axis: Axis, tables: Sequence[MotionTable]) -> list[str]:
    """The rows of an axis, with its errors before or after its motion."""
    moved = [f"{'':<18}{'MachAxis':<10}{axis.name:<6}"]
    errors = []
    for table in tables:
        column = f"{axis.name}..C{COMPONENTS.index(table.component) + 1}"
        errors.append(f"{table.name.replace('_', ''):<18}{'Trans':<10}{table.component:<6}{'':<16}{column:<10}")
    return [*errors, *moved] if errors_before(axis) else [*moved, *errors]


def _with_components(content: Content, axis: Axis, tables: Sequence[MotionTable]) -> str:
    """A table of error motions in the file's sign, mm and degrees."""
    own = own_component(axis.name)
    cells: dict[str, list[str]] = {}
    for table in tables:
        name = axis.name if table.component == own else f"C{COMPONENTS.index(table.component) + 1}"
        values = -content.factor * (np.degrees(table.mean) if table.angular else table.mean)
        cells[name] = [
            _signed(value, COM_ANGLE_DECIMALS if table.angular else COM_DECIMALS) for value in values.tolist()
        ]
    names = ["BACKLASH", axis.name, *(f"C{k}" for k in range(1, 7))]
    return _new(f"AXIS_{axis.name}.COM", tables[0].nodes, names, cells)


def _limits(settings: ComSettings | KinematicsSettings) -> Limits:
    old = isinstance(settings, ComSettings) and settings.layout == "old"
    distance = settings.distance if isinstance(settings, ComSettings) else None
    return Limits(
        points=settings.points,
        resolution=10.0**-COM_DECIMALS,
        finest=2e-5,
        equidistant=old,
        interval=distance,
        shared=True,
    )


COM = TableFormat(
    name="heidenhain",
    title="HEIDENHAIN error tables (.COM, .CMA)",
    settings=ComSettings,
    limits=_limits,
    capabilities=lambda settings: Capabilities(cross=True, bidirectional=settings.backlash),
    write=write,
    read=read,
    family="heidenhain",
    meaning="""\
A table named in column Y of config.cma holds functions of the position of Y; a value in its column Z is for axis
Z (sag), in its own column Y the pitch. mm or degrees, positions from the machine datum. BACKLASH (new layout, on
request): the value of the own axis for travel in the negative direction; the own column then is that for the
positive one. Linear interpolation and end values outside are assumed; no source states this. Old layout: equidistant
from DATUM by DISTANCE.""",
    loading="""\
Copy the files into the machine's folder for compensation (PLC partition, under the machine builder's key);
activate the line of config.cma; machine parameter: non-linear compensation of each axis (MP730 on old controls).
TNC 407/415/425: the distance must be a power of two in 0.1 um: give --set distance=6.5536 or a similar value. The total
of all rows may be limited (PLC module 9095 reports it).""",
    certainty="""\
Columns and assignment: HEIDENHAIN manuals. Text layout and sign: one public tool, which writes the error; nothing
confirms it: experimental. The sign is as given by --sign.""",
)
KINEMATICS = TableFormat(
    name="heidenhain-kinematics",
    title="HEIDENHAIN KinematicsComp (.COM with C1 ... C6, rows of the kinematics description)",
    settings=KinematicsSettings,
    limits=_limits,
    write=write_kinematics,
    read=read_kinematics,
    family="heidenhain",
    meaning="""\
Columns C1 ... C6 of the table of an axis are its error motions X Y Z A B C by ISO 230-1, mm and degrees; its
positioning error is in the column of the axis itself (axis compensation), not in C. kinematics.txt lists the
axes from the tool on. Trans rows contain the errors, before MachAxis if the errors are nearer to the tool than
the motion (linear axes that carry the tool, rotary axes that carry the workpiece), after it if they are nearer
to the workpiece (linear axes that carry the workpiece, rotary axes that carry the tool). Values are counted from
the nominal machine: no row subtracts their value at the axis' origin. The control corrects the position of the
tool centre point. Directions and reference points as in ncomp, tool relative to workpiece in every row
(docs/conventions.md).""",
    loading="""\
Copy the .COM files, name them in the .CMA table; put the rows of kinematics.txt around the MachAxis rows of the
machine's own kinematics description, whose order begins at the tool; licence KinematicsComp. By the machine
builder.""",
    certainty="""\
Columns, rows and their limits: iTNC 530 HSCI technical manual, whose example has rows before MachAxis. That rows
may follow it, units of the angular columns (degrees), sign and text layout: no source; experimental. The sign
is as given by --sign.""",
)
