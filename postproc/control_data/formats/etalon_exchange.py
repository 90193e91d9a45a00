"""Etalon Exchange Format, the variant "Vendor": error motions by ISO 230-1, mm and rad."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from kinematics.user_error import UserError
from postproc.control_data.format import Settings
from postproc.control_data.readers.read_etalon_exchange import read
from postproc.control_data.tables.content import Content, number
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.table_format import TableFormat


class EtalonSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Most grid points of one error motion; for import the units of the values, and of positions of rotary axes."""

    points: Annotated[int, Meta(ge=2)] = 200
    length: Literal["mm", "um", "m"] = "mm"
    angle: Literal["rad", "urad", "deg"] = "rad"
    rotary: Literal["deg", "rad"] = "deg"


def write(content: Content) -> dict[str, str]:
    """`errors.etalon`."""
    lines = [f"// ISO 230-1 error motions, values: {content.sign}; mm and rad"]
    for table in content.motions:
        name = f"E{table.component}{table.axis}"
        lines += [f"[{name}]", "Gridpoints = {"]
        rows = zip(table.nodes.tolist(), (-content.factor * table.mean).tolist(), strict=True)
        lines += [f"          {number(x, 4)} {number(value, 12)}" for x, value in rows]
        lines.append(f"}}  // end of {name}")
    return {"errors.etalon": "\n".join([*lines, ""])}


def _limits(settings: EtalonSettings) -> Limits:
    if (settings.length, settings.angle, settings.rotary) != ("mm", "rad", "deg"):
        raise UserError("--set length=, angle= and rotary= are for import: tables are written in mm, rad and degrees")
    return Limits(points=settings.points, resolution=1e-7)


FORMAT = TableFormat(
    name="etalon",
    title="Etalon Exchange Format (Vendor)",
    settings=EtalonSettings,
    limits=_limits,
    write=write,
    read=read,
    family="isg",
    meaning="""\
Error motions EXX ... ECC over the position of their own axis, mm and rad, positions in mm and degrees; squareness
and positions of rotary axes are in them as slopes and constants. Counted as tool relative to workpiece, angular
errors about the axis' point (docs/conventions.md).""",
    loading="""\
ISG and Beckhoff: file_format[0] of the volumetric compensation. Other controls: by the converter of their maker.""",
    certainty="""\
Layout: Beckhoff TF5280 documentation of the variant "Vendor". Units by the size of its sample; sign not stated;
experimental. The sign is as given by --sign.""",
)
