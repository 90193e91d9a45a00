"""Mitsubishi machine error compensation: increments of the correction in half output units."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from postproc.control_data.format import Settings, of_machine
from postproc.control_data.readers.read_mitsubishi_pitch import read
from postproc.control_data.tables.build import Capabilities
from postproc.control_data.tables.content import Content, number, own_tables
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.table_format import TableFormat

LOWEST, HIGHEST = -128, 127


class MitsubishiSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Output unit, unit of the machine, scale, interval, and points of an axis."""

    unit_um: Annotated[float, Meta(gt=0)] = 1.0
    machine_unit: Literal["", "mm"] = ""
    scale: Annotated[int, Meta(ge=1, le=99)] = 1
    interval: Annotated[float, Meta(gt=0)] | None = None
    points: Annotated[int, Meta(ge=2, le=1024)] = 128


def write(content: Content) -> dict[str, str]:
    """`error_data.csv` and `parameters.csv`, to be entered on the screens."""
    step = _step(content.settings)
    data = ["axis,point,position,value"]
    parameters = ["axis,reference point,interval,scale"]
    for axis, table in own_tables(content):
        interval = float(table.nodes[1] - table.nodes[0])
        reference = round((axis.home - table.nodes[0]) / interval)
        parameters.append(f"{axis.name},{reference},{number(interval, 4)},{content.settings.scale}")
        steps = np.diff(np.round(table.forward / step).astype(int), prepend=0)
        steps[0] = 0
        data += [
            f"{axis.name},{k},{number(x, 4)},{value}"
            for k, (x, value) in enumerate(zip(table.nodes, steps, strict=True))
        ]
    return {"error_data.csv": "\n".join([*data, ""]), "parameters.csv": "\n".join([*parameters, ""])}


def _step(settings: MitsubishiSettings) -> float:
    """mm or degrees of one count: half an output unit times the scale."""
    return 0.5e-3 * settings.unit_um * settings.scale


def _limits(settings: MitsubishiSettings) -> Limits:
    step = _step(settings)
    return Limits(
        points=settings.points,
        resolution=step,
        equidistant=True,
        spacing_step=1e-3,
        interval=settings.interval,
        steepest=min(-LOWEST, HIGHEST) * step,
        zero_at_home=True,
    )


FORMAT = TableFormat(
    name="mitsubishi",
    title="Mitsubishi machine error compensation (incremental)",
    settings=MitsubishiSettings,
    limits=_limits,
    capabilities=lambda _: Capabilities(),
    write=write,
    read=read,
    unit=of_machine,
    sign="correction",
    family="mitsubishi",
    meaning="""\
The value of a point is the increment of the correction over the section that ends there: (interval - actual travel) x
2, in output units times the scale, -128 ... 127; 0 at the reference point. One value for both directions: the
mean of the two. Linear interpolation is assumed.""",
    loading="""\
Enter parameters.csv and error_data.csv on the machine error compensation screens; restart, and return to the
reference position. Numbers of points and the direction they are counted in differ between series: compare with
the manual.""",
    certainty="""\
Formula, half units, range: Mitsubishi M/E/C series manuals. Files: for typing in, no format of the control.""",
)
