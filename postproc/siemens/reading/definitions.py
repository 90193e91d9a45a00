"""Files of definitions of a Siemens control (GUD): variables that it has and that its programs share.

    DEF CHAN REAL LAYER[3]      DEF NCK INT PART_COUNT = 0

First values are not read: the control may have others by now.
"""

from __future__ import annotations

import re

from kinematics.user_error import UserError
from postproc.siemens.reading.blocks import read_block
from postproc.siemens.reading.declarations import Declare
from postproc.siemens.variables import SiemensVariables
from postproc.text.block import Refusal
from postproc.text.expressions import NotKnown, whole

_DEFINITION = re.compile(r"DEF\s+(?:NCK|CHAN)\s+((?:(?:SYNRW?|SYNW|PHU\s*\d+|AP[RW][PBX]?\s*\d+)\s+)*)", re.IGNORECASE)
"""The beginning of a definition: its range, and attributes of reading, unit and access."""
_OTHER = re.compile(r"(%.*|M17|M30|RET|N\d+)?", re.IGNORECASE)
"""Head and end of a file."""


def define_all(scope: SiemensVariables, name: str, text: str) -> None:
    """Define the variables of a file; UserError with the line that is not understood."""
    for number, line in enumerate(text.splitlines(), start=1):
        statement = line.partition(";")[0].strip()
        match = _DEFINITION.match(statement)
        if match is None and not _OTHER.fullmatch(statement):
            raise _fault(name, number, line, "expected DEF CHAN REAL NAME or DEF NCK INT NAME[3]")
        if match is not None:
            _define(scope, name, number, line, f"DEF {statement[match.end() :]}")


def _define(scope: SiemensVariables, name: str, number: int, line: str, statement: str) -> None:
    try:
        code = read_block(number, statement).code
        steps = () if code is None else code.before
        for step in steps:
            if not isinstance(step, Declare):
                raise _fault(name, number, line, "R parameters need no definition: delete the line")
            scope.define(step.kind, step.name, [whole(size, scope) for size in step.sizes])
    except Refusal as refusal:
        raise _fault(name, number, line, refusal.reason) from None
    except NotKnown as reason:
        raise _fault(name, number, line, str(reason)) from None


def _fault(name: str, number: int, line: str, why: str) -> UserError:
    return UserError(f"definitions {name}:{number}: {line.strip()!r}: {why}")
