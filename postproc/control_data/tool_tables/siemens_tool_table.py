"""Siemens' archives of tools and work offsets: `$TC_DP3[1,1]=120.5`, `$P_UIFR[1]=CTRANS(X,10)`, `$P_UIFR[1,X,TR]=10`.

Lines that set anything else are passed over. Lengths are in the basic system of the control: mm or inches.
"""

from __future__ import annotations

import re
from pathlib import Path

from kinematics.user_error import UserError
from postproc.control.tool_table import ToolTable
from postproc.control_data.tool_tables.form import Form
from postproc.siemens.reading.blocks import read_block
from postproc.siemens.variables import SiemensVariables
from postproc.text.block import Block, Refusal
from postproc.text.expressions import NotKnown, whole
from postproc.text.statements import Assign

_DATA = re.compile(r"^[^;\n]*\$(?:TC_|P_UIFR)", re.I | re.M)
_CHANNEL = re.compile(r"^\s*CHANDATA", re.I)


def read(path: Path, text: str) -> ToolTable:
    """Lengths, radii and work offsets; UserError with the line that is not understood, or cannot be followed."""
    scope = SiemensVariables()
    for i, line in enumerate(text.splitlines(), start=1):
        if not _DATA.match(line) and not _CHANNEL.match(line):
            continue
        try:
            _take(read_block(i, line), scope)
        except Refusal as refusal:
            raise UserError(f"tool table {path}:{i}: {line.strip()!r}: {refusal.reason}") from None
        except NotKnown as reason:
            raise UserError(f"tool table {path}:{i}: {line.strip()!r}: {reason}") from None
    data = scope.data
    offsets = {name: data.offset(name) for name in sorted(data.offsets)}
    return ToolTable(data.tools(), offsets, radii=data.radii())


def _take(block: Block, scope: SiemensVariables) -> None:
    for word in block.words:
        if word.address == "CHANDATA" and (not word.arguments or whole(word.arguments[0], scope) != 1):
            raise NotKnown("data of another channel than the first are not read")
    for step in block.code.before if block.code is not None else ():
        if isinstance(step, Assign):
            step.run(scope)


FORM = Form(lambda _, text: _DATA.search(text) is not None, read)
"""Lengths in the basic system of the control."""
