"""FANUC 30i/31i/32i, 16i/18i/0i: pitch error compensation as increments of a quantised curve; straightness.

Numbers and increments: parameter manuals 0i-PB, 15i; text of the data: common knowledge (docs/tables.md).
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from kinematics.machine import Axis
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control_data.format import Settings, of_machine
from postproc.control_data.readers.read_fanuc_pitch import read
from postproc.control_data.tables.build import Capabilities
from postproc.control_data.tables.content import Content, Own, lettered, number, own_tables
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.table_format import TableFormat
from postproc.control_data.tables.terms import Curve

TEXT_POINT_OFFSET = 10000
"""Number that is added to a point number in the text."""
STRAIGHTNESS_POINTS = 4
"""Points of a straightness compensation."""


class FanucSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Detection unit, unit of the machine, magnification (3623), interval (3624), largest increment, points of an axis
    and in all.
    """

    unit_um: Annotated[float, Meta(gt=0)] = 1.0
    machine_unit: Literal["", "mm"] = ""
    magnification: Annotated[int, Meta(ge=1, le=100)] = 1
    interval: Annotated[float, Meta(gt=0)] | None = None
    largest: Annotated[int, Meta(ge=1, le=127)] = 7
    points: Annotated[int, Meta(ge=2, le=1024)] = 128
    first: Annotated[int, Meta(ge=0, le=1023)] = 0
    total: Annotated[int, Meta(ge=2, le=6000)] = 1024
    bidirectional: bool = False
    straightness: bool = False


def write(content: Content) -> dict[str, str]:
    """`pitch.csv` for the screen, `pitch.txt` as a data file, `straightness.csv`."""
    settings: FanucSettings = content.settings
    step = _step(settings)
    table, data, pitch = ["axis,parameter,value"], [], ["axis,point,position,travel,value"]
    point = settings.first
    numbers = {axis.name: k for k, axis in enumerate(lettered(content.machine), 1)}
    for axis, own in own_tables(content):
        parameters = _parameters(content, axis, own, point)
        table += [f"{axis.name},{name},{value}" for name, value in parameters.items()]
        data += [f"N{name}A{numbers[axis.name]}P{value}" for name, value in parameters.items()]
        directions = {"positive": own.forward, "negative": own.backward} if own.bidirectional else {"both": own.forward}
        for travel, values in directions.items():
            rows = zip(own.nodes.tolist(), _increments(content, axis, values, step), strict=True)
            for n, (position, value) in enumerate(rows, point):
                pitch.append(f"{axis.name},{n},{number(position, 4)},{travel},{value}")
                data.append(f"N{TEXT_POINT_OFFSET + n}P{value}")
            point += len(own.nodes)
        if point > settings.total:
            raise UserError(f"fanuc: the tables need points up to {point - 1}, and the control has {settings.total}")
    files = {
        "pitch.csv": "\n".join([*pitch, ""]),
        "parameters.csv": "\n".join([*table, ""]),
        "pitch.txt": "\n".join(["%", *data, "%", ""]),
    }
    straight = _straightness(content, step)
    return files | ({"straightness.csv": straight} if straight else {})


def _step(settings: FanucSettings) -> float:
    """mm or degrees of one increment; a detection unit of a rotary axis is as many 1e-3 degrees."""
    return settings.unit_um * 1e-3 * settings.magnification


def _parameters(content: Content, axis: Axis, own: Own, first: int) -> dict[str, str]:
    settings: FanucSettings = content.settings
    count, interval = len(own.nodes), float(own.nodes[1] - own.nodes[0])
    home = first + _reference(axis, own.nodes, interval)
    parameters = {
        "03620": str(home),
        "03621": str(first),
        "03622": str(first + count - 1),
        "03623": str(settings.magnification),
        "03624": number(interval, 4),
    }
    if axis.turns_fully:
        parameters["03625"] = "360.0"
    if own.bidirectional:
        amount = float(np.interp(axis.home, own.nodes, own.backward - own.forward))
        parameters |= {"03626": str(first + count), "03627": str(round(content.factor * amount / _step(settings)))}
    return parameters


def _reference(axis: Axis, nodes: Array, interval: float) -> int:
    """Index of the point at the reference position; UserError without one, or if a turn does not begin there."""
    share = (axis.home - float(nodes[0])) / interval
    if abs(share - round(share)) > 1e-6 or (axis.turns_fully and round(share) != 0):
        raise UserError(
            f"fanuc, axis {axis.name}: the points of an axis that turns without end must begin at its reference "
            f"position {axis.home:g}; these begin at {nodes[0]:g}"
        )
    return round(share)


def _increments(content: Content, axis: Axis, values: Array, step: float) -> list[int]:
    """Increment of each point over the section that ends there; the first closes a turn, or is 0."""
    curve = np.round(content.factor * values / step).astype(int)
    steps = np.diff(curve).tolist()
    largest = content.settings.largest
    if max(map(abs, steps)) > largest:
        raise UserError(
            f"fanuc, axis {axis.name}: an increment of {max(map(abs, steps))} exceeds the largest, {largest}: "
            "give a larger magnification or a shorter interval (--set magnification=, --set interval=)"
        )
    return [steps[-1] if axis.turns_fully else 0, *steps]


def _straightness(content: Content, step: float) -> str:
    lines = ["moving axis,compensated axis,position,amount"]
    for term in content.terms:
        curve = term.factors[0]
        if term.inputs != (term.output,) and isinstance(curve, Curve):
            amounts = np.round(content.factor * curve.values / step).astype(int).tolist()
            rows = zip(curve.nodes.tolist(), amounts, strict=True)
            lines += [f"{curve.axis},{term.output},{number(x, 4)},{amount}" for x, amount in rows]
    return "\n".join([*lines, ""]) if len(lines) > 1 else ""


def _limits(settings: FanucSettings) -> Limits:
    if settings.bidirectional and settings.magnification != 1:
        raise UserError(
            "--set bidirectional=true: no source states whether 3627 is magnified; give --set magnification=1"
        )
    if settings.straightness and settings.interval is None:
        raise UserError(
            "--set straightness=true: its points are those of the pitch tables; give --set interval= as well"
        )
    step = _step(settings)
    straight = Limits(
        points=STRAIGHTNESS_POINTS, resolution=step, interval=settings.interval, on_grid=True, zero_at_home=True
    )
    return Limits(
        points=settings.points,
        resolution=step,
        equidistant=True,
        spacing_step=1e-3,
        interval=settings.interval,
        steepest=settings.largest * step,
        zero_at_home=True,
        cross=straight,
    )


FORMAT = TableFormat(
    name="fanuc",
    title="FANUC pitch error compensation (incremental), straightness",
    settings=FanucSettings,
    limits=_limits,
    capabilities=lambda s: Capabilities(bidirectional=s.bidirectional, cross=s.straightness),
    write=write,
    read=read,
    unit=of_machine,
    family="fanuc",
    meaning="""\
The value of point n is the increment of the correction (or error, by --sign) over the section that ends at point n, in
detection units times the magnification (3623): the running sum from the reference point (3620) is the amount at a
position. The whole curve is rounded, and then differences are taken, so rounding does not add up. One set of points
serves both directions, with the mean of the two; backlash is set in 1851. With --set bidirectional=true (3605#0 BDP
1) points of negative travel follow behind those of positive travel (3626: the first of them, 3627: amount at the
reference position when it is approached against the direction of the return, which is taken as positive).
Between points the amount is taken as linear: with the interpolated option; without it, it steps by an increment.
Beyond the ends nothing changes.
Straightness: amounts of a second axis at four points of the first, straight between them (5711, 5721, 5731, 5761
and following). Rotary axes with ends are written as axes of the linear type (1006#1); the points of one that turns
without end begin at its reference position (3625).""",
    loading="""\
Enter parameters.csv and pitch.csv on the screens; pitch.txt is the same as a data file, from common knowledge of
its layout: compare the values on the control with pitch.csv. Never as a G10 L50 program: it means parameters on one
series and pitch data on another. Switch the control off and on, and return to the reference position, before
anything moves.""",
    certainty="""\
Increments, point numbers, parameters 3620 ... 3627, the closing sum of a rotary axis: FANUC parameter manuals
0i-PB and 15i and A-77810E. A-77810E names 3626 as a point number beside 3620 ... 3622; that both sets are numbered
in one range, as they are here, is not stated in the part that was read: bidirectional tables are experimental.
Sign: correction by common knowledge, but no source that was read states it: it is as given
by --sign. Text of pitch.txt and straightness parameters: common knowledge; experimental.""",
)
