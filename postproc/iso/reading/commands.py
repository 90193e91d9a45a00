"""System commands of grbl, which are no blocks: `$H`, `$X`, `$100=250`."""

from __future__ import annotations

import re

from postproc.iso.channel import Channel
from postproc.iso.families import GRBL
from postproc.text.block import Block

REPORTS = frozenset(("$$", "$#", "$G", "$I", "$N"))
"""They show something."""
HARMLESS_SETTINGS = frozenset((0, 1, 10, 11, 12, 13, 20, 21, *range(30, 36), *range(110, 126)))
"""Numbers of settings of pulses, reports, limits, spindle, laser, speeds and accelerations (grbl 1.1)."""
REFUSED = {
    "J": "moves by a jog command, which is not corrected: write G1",
    "C": "switches to a check of the program without moves: take it out",
    "RST": "restores settings of the control: take it out",
    "SLP": "sends the control to sleep: write M2",
    "N": "stores a block that runs after the next reset: take it out",
}
"""By the letters of the command."""
_HOMING = re.compile(r"\$H([XYZABCUVW]*)")
_SETTING = re.compile(r"\$(\d+)=(.*)")


def run_command(channel: Channel, block: Block) -> None:
    """Take over a command; Refusal for one that changes scales or directions, moves, or belongs to another control."""
    name = "".join(block.detail.split("(")[0].split(";")[0].split()).upper()
    if channel.family != GRBL:
        raise block.refuse(f'{name} is a command of grbl: write family = "grbl" in the machine file')
    if block.words or block.skippable or block.code is not None:
        raise block.refuse(f"{name} shares its line with a block: write it in a line of its own")
    homing, setting = _HOMING.fullmatch(name), _SETTING.fullmatch(name)
    if homing is not None or name == "$X":
        axes = channel.machine.names if homing is None or not homing[1] else tuple(homing[1])
        channel.mark_unknown(axes)
        channel.notes.add(f"{name}: the positions of the axes after it are taken as unknown", block.line)
    elif setting is not None:
        if int(setting[1]) not in HARMLESS_SETTINGS:
            raise block.refuse(
                f"${setting[1]} may change scale, direction or reference of the axes between the moves: set it on the "
                "control before the program"
            )
        channel.notes.add("settings of grbl in the program pass unchanged: none changes where the axes go", block.line)
    elif name not in REPORTS and not name.startswith("$I="):
        letters = re.match(r"\$([A-Z]*)", name)
        reason = REFUSED.get(letters[1] if letters else "", "is no command of grbl 1.1 that ncomp knows: take it out")
        raise block.refuse(f"{name} {reason}")
