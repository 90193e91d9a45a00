"""CSV: all error motions under their names of ISO 230-1, for spreadsheets and programs."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from kinematics.effects import UM, URAD
from postproc.control_data.format import Settings
from postproc.control_data.readers.read_error_motions_csv import read
from postproc.control_data.tables.content import Content, number
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.table_format import TableFormat

HEADER = "error,axis,position,forward,backward,unit"


class CsvSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Most points of one error motion."""

    points: Annotated[int, Meta(ge=2)] = 401


def write(content: Content) -> dict[str, str]:
    """`errors.csv`."""
    lines = [
        "# errors: actual minus nominal, tool relative to workpiece (ISO 841, ISO 230-1)",
        "# position: mm or degrees; forward, backward: by the direction of travel of the axis",
        HEADER,
    ]
    for table in content.motions:
        size, unit = (URAD, "urad") if table.angular else (UM, "um")
        rows = zip(table.nodes.tolist(), table.forward.tolist(), table.backward.tolist(), strict=True)
        lines += [
            f"{table.name},{table.axis},{number(x, 6)},{number(f / size, 4)},{number(b / size, 4)},{unit}"
            for x, f, b in rows
        ]
    return {"errors.csv": "\n".join(lines) + "\n"}


FORMAT = TableFormat(
    name="csv",
    title="error motions by ISO 230-1 as CSV",
    settings=CsvSettings,
    limits=lambda settings: Limits(points=settings.points, resolution=1e-7, spacing_step=1e-6),
    write=write,
    read=read,
    sign="error",
    meaning="""\
Values are errors, actual minus nominal, tool relative to workpiece also for axes that carry the workpiece, in um
and urad; positions in mm and degrees, machine coordinates. Forward and backward differ for positioning errors
only. Location errors are in them: squareness as slopes, the position of a rotary axis as constants. Reference points
of angular errors: the `point` of each axis in the machine file.""",
    loading="Not for a control: for a spreadsheet, a report, or a converter of your own.",
    certainty="ncomp's own format (docs/conventions.md).",
)
