"""Marlin: skew factors (M852), and the mesh of its bed levelling (M421)."""

from __future__ import annotations

from typing import Literal

from kinematics.user_error import UserError
from postproc.control_data.format import Settings
from postproc.control_data.formats.firmware.skew_and_mesh import (
    SKEW_LIMITS,
    SKEWS,
    capabilities,
    departure_um,
    mesh_of,
    tangents,
)
from postproc.control_data.readers.firmware.read_marlin import nodes_of, read
from postproc.control_data.readers.firmware.skew import skew_of
from postproc.control_data.tables.build import Capabilities
from postproc.control_data.tables.content import Content, number
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.mesh_moves import Cells
from postproc.control_data.tables.table_format import TableFormat

SKEW_FACTOR_MAX = 1.0
"""SKEW_FACTOR_MAX: Marlin ignores a factor beyond it."""
MESH_DECIMALS = 5
"""As M503 prints the heights of a mesh."""


class MarlinSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Build of the firmware.

    `skew`: xy without SKEW_CORRECTION_FOR_Z. `x`, `y`: first and last position and number of the points of the mesh,
    as `10:190:5`; without them no mesh is written.
    """

    skew: Literal["xy", "xyz"] = "xyz"
    x: str = ""
    y: str = ""


def write(content: Content) -> dict[str, str]:
    """`marlin.gcode`: M852, and a row M421 for each point of the mesh."""
    factors = dict(zip("IJK", skew_of(tangents(content)), strict=True))
    for letter, value in factors.items():
        if abs(value) > SKEW_FACTOR_MAX:
            raise UserError(f"Marlin ignores a skew factor beyond {SKEW_FACTOR_MAX:g}, and {letter} would be {value:g}")
    letters = "IJK" if content.settings.skew == "xyz" else "I"
    rows = ["G21", " ".join(["M852", *(f"{letter}{number(factors[letter], 10)}" for letter in letters)])]
    mesh = mesh_of(content)
    if mesh is not None:
        rows += [
            f"M421 I{i} J{j} Z{number(height, MESH_DECIMALS)}"
            for j, heights in enumerate(mesh.rows.tolist())
            for i, height in enumerate(heights)
        ]
        rows.append("M420 S1 Z0")
    return {"marlin.gcode": "\n".join([*rows, ""])}


def _along_moves(content: Content) -> str:
    um = departure_um(content, Cells())
    if um is None:
        return (
            "" if content.settings.x else "No mesh was written: it needs --set x= and --set y=, the points of Marlin's."
        )
    return f"""\
**Between the ends of a move** Marlin is on the mesh where the move crosses its lines (UBL and BILINEAR without
SEGMENT_LEVELED_MOVES). By this rule the straight moves over the bed that were tried are up to {um:.1f} um from this
mesh. The remaining errors below are those at the ends of moves; along a move this comes on top."""


def _limits(settings: MarlinSettings) -> Limits:
    mesh = nodes_of(settings.x, settings.y)
    return Limits(
        points=max([2, *map(len, mesh.values())]),
        resolution=10.0**-MESH_DECIMALS,
        mesh=mesh,
        surfaces_per_output=1,
        cross=SKEW_LIMITS,
    )


def _capabilities(settings: MarlinSettings) -> Capabilities:
    pairs = SKEWS if settings.skew == "xyz" else SKEWS[:1]
    surfaces = "XY" if nodes_of(settings.x, settings.y) else ""
    return capabilities(pairs, surfaces)


FORMAT = TableFormat(
    name="marlin",
    title="Marlin M852 skew and M421 mesh",
    settings=MarlinSettings,
    limits=_limits,
    capabilities=_capabilities,
    write=write,
    read=read,
    remark=_along_moves,
    sign="correction",
    family="firmware",
    meaning="""\
M852: tangents I (XY), J (XZ), K (YZ), at most 1; the firmware takes y I + z (J - I K) off x, and z K off y. M421:
height in mm of point I of the mesh along X and J along Y, counted from 0, that is added to z; bilinear between points,
held outside (BILINEAR; UBL goes on with the slope of the edge). The mesh describes the machine's own error over the
bed; a probed mesh contains it already: use one of them. Marlin does not correct skew within 1 mm of the least position
of X and Y, nor where the corrected position would be outside of the bed.""",
    loading="""\
The firmware needs SKEW_CORRECTION_GCODE, for J and K SKEW_CORRECTION_FOR_Z (without it: --set skew=xy), and for M421
UBL or BILINEAR with a valid mesh of the same points. Send the file after G28. Ask for M852 and M420 V: a factor that
the answer does not show is not in use. Store them with M500. M420 S1 Z0 makes the mesh act at every height. G21 stands
first because Marlin takes these numbers in the unit of the program: in inches (G20) the factors would be 25.4 times as
large. MESH_BED_LEVELING reads the positions of Y from the list of X in some versions: do not use it with other points
in Y than in X.""",
    certainty="""\
Marlin's source (2.1): M852.cpp, planner.h (skew), M421.cpp, bbl.cpp, ubl.h, mesh_bed_leveling.h. Its formulas, in
single precision, move the machine of ncomp's tests; the firmware itself was not run.""",
)
