"""Siemens SINUMERIK: EEC (`$AA_ENC_COMP`) and CEC (`$AN_CEC`), equidistant tables in archive text.

Formats and effects: Extended Functions manual, K3; 802D sl and 808D manuals; docs/tables.md lists their certainty.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

from msgspec import Meta

from kinematics.machine import Axis, Control
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control_data.format import Settings, of_control
from postproc.control_data.readers.read_siemens_eec_cec import read_cec, read_eec
from postproc.control_data.tables.build import Capabilities
from postproc.control_data.tables.content import Content, number, own_tables, repeats
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.table_format import TableFormat
from postproc.control_data.tables.terms import Curve, Term

CEC_DECIMALS = 6
SPACING_STEP = 1e-4
"""mm, inches or degrees: spacings are whole multiples, so that MIN, MAX and STEP are exact in the file."""
PLACES = {"mm": 4, "inch": 6}
"""Decimals of MIN and MAX: in inches a reference position is no whole multiple of STEP."""
Interval = Annotated[float, Meta(gt=0)] | None


class EecSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Points by MD38000, spacing, measuring system (0, 1), and machine axis names: `names=X:X1,Y:Y1`."""

    points: Annotated[int, Meta(ge=2, le=5000)] = 200
    interval: Interval = None
    system: Literal[0, 1] = 0
    names: str = ""


class CecSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Control, points by MD18342, spacing, first table; whether tables of the own axis and products are made; MD32711.

    `scaling`: unit of the tables by MD32711, which is independent of the unit of programs: 1 metric, 0 inch.
    """

    control: Literal["840d", "828d", "802d"] = "840d"
    points: Annotated[int, Meta(ge=2, le=5000)] = 200
    interval: Interval = None
    first: Annotated[int, Meta(ge=0, le=61)] = 0
    own: bool = True
    products: bool = True
    names: str = ""
    scaling: Literal["", "metric", "inch"] = ""


TABLES = {"840d": 62, "828d": 8, "802d": 2}
POINTS = {"840d": 5000, "828d": 200, "802d": 350}


def machine_axis_names(content: Content) -> dict[str, str]:
    """By axis, its name in the control: as given, or the letter with 1 behind it."""
    names = {axis.name: axis.name if axis.name[-1].isdigit() else f"{axis.name}1" for axis in content.machine.axes}
    for pair in filter(None, content.settings.names.split(",")):
        axis, colon, name = pair.partition(":")
        if not colon or axis not in names or not name.isalnum():
            raise UserError(f"--set names={content.settings.names}: expected AXIS:NAME,... with axes of the machine")
        names[axis] = name
    return names


class _Grid(NamedTuple):
    """Equidistant nodes as in a file."""

    last: int
    step: str
    low: str
    high: str
    modulo: int


def _grid(nodes: Array, axis: Axis, unit: str) -> _Grid:
    step = (nodes[-1] - nodes[0]) / (len(nodes) - 1)
    low, high = (number(nodes[end], PLACES[unit]) for end in (0, -1))
    return _Grid(len(nodes) - 1, number(step, 4), low, high, int(repeats(axis)))


def write_eec(content: Content) -> dict[str, str]:
    """`ax_eec.ini`: the tables of all axes."""
    names = machine_axis_names(content)
    e = content.settings.system
    lines = [
        "%_N_AX_EEC_INI",
        "CHANDATA(1)",
        f"; value = error: measured minus programmed position, {content.unit} or degrees",
    ]
    for axis, table in own_tables(content):
        grid, name = _grid(table.nodes, axis, content.unit), names[axis.name]
        lines += [
            f"$AA_ENC_COMP[{e},{k},{name}]={number(content.factor * value, CEC_DECIMALS)}"
            for k, value in enumerate(table.forward.tolist())
        ]
        lines += [
            f"$AA_ENC_COMP_STEP[{e},{name}]={grid.step}",
            f"$AA_ENC_COMP_MIN[{e},{name}]={grid.low}",
            f"$AA_ENC_COMP_MAX[{e},{name}]={grid.high}",
            f"$AA_ENC_COMP_IS_MODULO[{e},{name}]={grid.modulo}",
        ]
    return {"ax_eec.ini": "\n".join([*lines, "M17", ""])}


def write_cec(content: Content) -> dict[str, str]:
    """`nc_cec.ini`: a table for each direction, cross error and factor of a product."""
    names = machine_axis_names(content)
    index = content.settings.first
    lines = ["%_N_NC_CEC_INI", "CHANDATA(1)", f"; value = {content.sign}, {content.unit} or degrees"]
    for term in content.terms:
        first, *others = term.factors
        assert isinstance(first, Curve)
        lines += _cec(content, index, first, term, names, content.factor, index + 2 if others else 0)
        index += 1
        for factor in others:
            assert isinstance(factor, Curve)
            lines.append(f"; table {index} is a factor of table {index - 1} only")
            lines += _cec(content, index, factor, term, names, 1.0, 0)
            index += 1
    control = content.settings.control
    if index > TABLES[control]:
        raise UserError(
            f"siemens-cec: the tables need numbers up to {index - 1}; {control} has {TABLES[control]} tables"
        )
    return {"nc_cec.ini": "\n".join([*lines, "M17", ""])}


def _cec(
    content: Content, t: int, curve: Curve, term: Term, names: dict[str, str], factor: float, multiplied_by: int
) -> Iterator[str]:
    """One table; `multiplied_by`: number (index + 1) of the table it is multiplied by, 0 for none."""
    axis = content.machine.axes[content.machine.index(curve.axis)]
    grid = _grid(curve.nodes, axis, content.unit)
    for k, value in enumerate(curve.values.tolist()):
        yield f"$AN_CEC[{t},{k}]={number(factor * value, CEC_DECIMALS)}"
    yield f"$AN_CEC_INPUT_AXIS[{t}]=({names[curve.axis]})"
    yield f"$AN_CEC_OUTPUT_AXIS[{t}]=({names[term.output]})"
    yield f"$AN_CEC_STEP[{t}]={grid.step}"
    yield f"$AN_CEC_MIN[{t}]={grid.low}"
    yield f"$AN_CEC_MAX[{t}]={grid.high}"
    yield f"$AN_CEC_DIRECTION[{t}]={term.direction if curve is term.factors[0] else 0}"
    yield f"$AN_CEC_MULT_BY_TABLE[{t}]={multiplied_by}"
    yield f"$AN_CEC_IS_MODULO[{t}]={grid.modulo}"


def by_scaling(settings: CecSettings, control: Control) -> str:
    """The unit by MD32711; UserError for a control in inches whose MD32711 is not given."""
    if control.unit == "inch" and not settings.scaling:
        raise UserError(
            "siemens-cec: MD32711 CEC_SCALING_SYSTEM_METRIC states the unit of these tables: give --set scaling=metric "
            "where it is 1, or --set scaling=inch where it is 0"
        )
    return "inch" if settings.scaling == "inch" else "mm"


def _limits(settings: EecSettings | CecSettings) -> Limits:
    tables, points = None, settings.points
    if isinstance(settings, CecSettings):
        tables, most = TABLES[settings.control] - settings.first, POINTS[settings.control]
        if points > most:
            raise UserError(f"--set points={points}: {settings.control} holds at most {most} points in a table")
    return Limits(
        points=points,
        resolution=10.0**-CEC_DECIMALS,
        equidistant=True,
        spacing_step=SPACING_STEP,
        interval=settings.interval,
        tables=tables,
        zero_at_home=True,
    )


EEC = TableFormat(
    name="siemens-eec",
    title="Siemens SINUMERIK encoder error compensation (EEC, $AA_ENC_COMP)",
    settings=EecSettings,
    limits=_limits,
    capabilities=lambda _: Capabilities(),
    write=write_eec,
    read=read_eec,
    unit=of_control,
    sign="error",
    family="siemens",
    meaning="""\
$AA_ENC_COMP holds the error of the axis: position measured minus programmed position, {unit} or degrees, at point N =
(position - MIN) / STEP. The control adds it to the encoder's actual value, so that a positive value drives the
axis in its negative direction. One value for both directions: the mean of the two; backlash is set in MD32450.
Linear between points; point 0 holds below MIN, the last above MAX; modulo tables begin again. Machine
coordinates.""",
    loading="""\
Full data backup first: a change of MD38000 (points, at least those of the table) reformats the static user
memory. MD32700 ENC_COMP_ENABLE of the axis to 0; load ax_eec.ini; MD32700 to 1; reference the axes. Values are
read in the basic system of units of the control: this file is in {unit}.""",
    certainty="""\
Layout and effect ("a positive compensation value causes the axis to move in the negative direction"): Siemens
manuals K3 and 808D. That the file value is the error itself follows from these; two independent public tools
write it so. Not tried on a control by ncomp: check one node with --probe.""",
)
CEC = TableFormat(
    name="siemens-cec",
    title="Siemens SINUMERIK sag, cross error and direction-dependent compensation (CEC, $AN_CEC)",
    settings=CecSettings,
    limits=_limits,
    capabilities=lambda s: Capabilities(own=s.own, cross=True, bidirectional=s.own, products=s.products),
    write=write_cec,
    read=read_cec,
    unit=by_scaling,
    family="siemens",
    meaning="""\
Table t adds to the OUTPUT axis by the programmed position of the INPUT axis, {unit} or degrees; all tables of an axis
sum. DIRECTION 1 or -1: only while the input axis travels in this direction. MULT_BY_TABLE = number (index + 1) of a
second table whose output multiplies this one's; the second is a dimensionless factor, and both are zero at the
reference position. Linear between points; the end values hold outside; modulo tables begin again. Machine
coordinates.""",
    loading="""\
MD18342 MM_CEC_MAX_POINTS of each table to at least its points (a change reformats the static user memory: back up
first); MD32710 CEC_ENABLE of the output axes to 0; load nc_cec.ini; MD32710 to 1, and SD41300 CEC_TABLE_ENABLE to
1 for all tables but those that are only a factor of another (marked in the file); reference the axes. MD32711
CEC_SCALING_SYSTEM_METRIC must be that of the file, which is in {unit}: 1 for mm, 0 for inches.""",
    certainty="""\
Layout, summing, DIRECTION, product: Siemens manuals K3 and 802D sl. Sign: stated on no page that was read; it is as
given by --sign. No page states that a factor table adds nothing by itself while its own SD41300 is 0: check a
product on the machine before use, or export with --set products=false.""",
)
