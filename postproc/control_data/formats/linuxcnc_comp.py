"""LinuxCNC: COMP_FILE, one file a joint, and the lines of the INI file."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from kinematics.user_error import UserError
from postproc.control.linuxcnc_ini import LETTERS
from postproc.control_data.format import Settings, of_control
from postproc.control_data.readers.read_linuxcnc_comp import read
from postproc.control_data.tables.build import Capabilities
from postproc.control_data.tables.content import Content, lettered, number, own_tables
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.table_format import TableFormat

COMP_DECIMALS = 7


class LinuxCncSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """COMP_FILE_TYPE, most rows of a file, letters of the joints from 0 (default: X Y Z A B C U V W), and turns.

    `joints`: a gantry has the letter of its axis twice, as in XYYZ. `turns`: to either side, that the table of a joint
    that turns without end covers.
    """

    type: Literal[0, 1] = 1
    points: Annotated[int, Meta(ge=2, le=256)] = 256
    joints: str = ""
    turns: Annotated[int, Meta(ge=1, le=60)] = 2


def write(content: Content) -> dict[str, str]:
    """`comp_x.txt` ..., without any comment, which would end them, and the lines of the INI file.

    All joints that move an axis have its table: both ends of a gantry.
    """
    settings: LinuxCncSettings = content.settings
    files: dict[str, str] = {}
    lines: list[tuple[int, str]] = []
    joints = _joints(content)
    for axis, table in own_tables(content):
        if axis.name not in joints:
            raise UserError(
                f"--set joints={settings.joints}: {axis.name} has a table; expected its letter among the joints"
            )
        forward, backward = table.forward, table.backward
        if settings.type == 0:
            forward, backward = table.nodes - forward, table.nodes - backward
        name = f"comp_{axis.name.lower()}.txt"
        rows = zip(table.nodes.tolist(), forward.tolist(), backward.tolist(), strict=True)
        files[name] = "".join(" ".join(number(v, COMP_DECIMALS) for v in row) + "\n" for row in rows)
        lines += [
            (joint, f"[JOINT_{joint}]\nCOMP_FILE = {name}\nCOMP_FILE_TYPE = {settings.type}\n")
            for joint, letter in enumerate(joints)
            if letter == axis.name
        ]
    units = "" if content.unit == "mm" else f"[TRAJ]\nLINEAR_UNITS = {content.unit}\nANGULAR_UNITS = degree\n"
    files["linuxcnc.ini"] = (
        "# lines for the INI file of the machine\n" + units + "".join(text for _, text in sorted(lines))
    )
    return files


def _joints(content: Content) -> list[str]:
    named = [axis.name for axis in lettered(content.machine)]
    given = content.settings.joints.upper()
    if not set(given) <= set(LETTERS):
        raise UserError(f"--set joints={content.settings.joints}: expected the letter of each joint, of {LETTERS}")
    return list(given) if given else named


def _limits(settings: LinuxCncSettings) -> Limits:
    return Limits(
        points=settings.points, resolution=10.0**-COMP_DECIMALS, spacing_step=1e-7, finest=2e-7, turns=settings.turns
    )


FORMAT = TableFormat(
    name="linuxcnc",
    title="LinuxCNC COMP_FILE",
    settings=LinuxCncSettings,
    limits=_limits,
    capabilities=lambda _: Capabilities(bidirectional=True),
    write=write,
    read=read,
    unit=of_control,
    sign="correction",
    family="linuxcnc",
    meaning="""\
Three columns: nominal position, then one value for travel in the positive and one for travel in the negative
direction, in {unit} and degrees, machine coordinates. Type 1: values are the correction, which LinuxCNC
adds to the command of the joint. Type 0: values are the actual position of the joint at the nominal
command. Linear between rows; the first and last row hold outside. The direction is the sign of the joint's velocity;
nothing is compensated from start-up until the joint has first moved.""",
    loading="""\
The INI file must state LINEAR_UNITS in {unit} and ANGULAR_UNITS = degree under [TRAJ]: the tables are in these units.
Copy the files beside the INI file and add the lines of linuxcnc.ini to its [JOINT_n] sections (where linuxcnc.ini has
[TRAJ], it only names the units for ncomp import); restart LinuxCNC.
BACKLASH of a joint with a table is ignored by LinuxCNC: the table holds both directions. The files must hold no
comment and no blank line: LinuxCNC stops reading there without a word. All joints of an axis need its table: a gantry
whose second joint has none is racked by it (--set joints= lists the letter of each joint, as in XYYZ). Rotary joints:
the table does not repeat. It covers the travel of the machine file; for a joint without end positions, the number of
turns to either side that is given with --set turns= (2). Beyond them the end value is used, which is wrong there: keep
such a joint within these turns.""",
    certainty="""\
Confirmed: LinuxCNC's source, and its simulator (2.9.0~pre1), which loads these files in ncomp's own tests and
moves its joints accordingly.""",
)
