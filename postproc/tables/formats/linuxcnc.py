"""LinuxCNC: COMP_FILE, one file a joint, and the lines of the INI file."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from kinematics.user_error import UserError
from postproc.tables.build import Capabilities
from postproc.tables.format import Content, Format, Settings, lettered, number, own_tables
from postproc.tables.limits import Limits

DECIMALS = 7


class LinuxCncSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """COMP_FILE_TYPE, most rows of a file, letters of the joints from 0 (default: X Y Z A B C U V W), and turns.

    `turns`: to either side, that the table of a joint that turns without end covers.
    """

    type: Literal[0, 1] = 1
    points: Annotated[int, Meta(ge=2, le=256)] = 256
    joints: str = ""
    turns: Annotated[int, Meta(ge=1, le=60)] = 2


def write(content: Content) -> dict[str, str]:
    """`comp_x.txt` ..., without any comment, which would end them, and the lines of the INI file."""
    settings: LinuxCncSettings = content.settings
    files: dict[str, str] = {}
    lines = []
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
        files[name] = "".join(" ".join(number(v, DECIMALS) for v in row) + "\n" for row in rows)
        lines.append(f"[JOINT_{joints.index(axis.name)}]\nCOMP_FILE = {name}\nCOMP_FILE_TYPE = {settings.type}\n")
    files["linuxcnc.ini"] = "# lines for the INI file of the machine\n" + "".join(lines)
    return files


def _joints(content: Content) -> list[str]:
    named = [axis.name for axis in lettered(content.machine)]
    given = content.settings.joints
    return list(given) if given else named


def _limits(settings: LinuxCncSettings) -> Limits:
    return Limits(
        points=settings.points, resolution=10.0**-DECIMALS, spacing_step=1e-7, finest=2e-7, turns=settings.turns
    )


FORMAT = Format(
    name="linuxcnc",
    title="LinuxCNC COMP_FILE",
    settings=LinuxCncSettings,
    limits=_limits,
    capabilities=lambda _: Capabilities(bidirectional=True),
    write=write,
    sign="correction",
    parameters="linuxcnc",
    meaning="""\
Three columns: nominal position, then one value for travel in the positive and one for travel in the negative
direction, in machine units (mm, degrees), machine coordinates. Type 1: values are the correction, which LinuxCNC
adds to the command of the joint. Type 0: values are the actual position of the joint at the nominal
command. Linear between rows; the first and last row hold outside. The direction is the sign of the joint's velocity;
nothing is compensated from start-up until the joint has first moved.""",
    loading="""\
Copy the files beside the INI file and add the lines of linuxcnc.ini to its [JOINT_n] sections; restart LinuxCNC.
BACKLASH of a joint with a table is ignored by LinuxCNC: the table holds both directions. The files must hold no
comment and no blank line: LinuxCNC stops reading there without a word. Rotary joints: the table does not repeat. It
covers the travel of the machine file; for a joint without end positions, the number of turns to either side that is
given with --set turns= (2). Beyond them the end value is used, which is wrong there: keep such a joint within these
turns.""",
    certainty="""\
Confirmed: LinuxCNC's source, and its simulator (2.9.0~pre1), which loads these files in ncomp's own tests and
moves its joints accordingly.""",
)
