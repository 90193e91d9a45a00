"""CYCLE832, the tolerance of the path: an older form switches the five-axis transformation."""

from __future__ import annotations

from postproc.siemens.variables import EMPTY, SiemensVariables
from postproc.text.block import Block, Word
from postproc.text.expressions import NotKnown, whole

OLDER_MODE = range(100, 1_000_000)
"""Second arguments of CYCLE832 whose second last digit switches TRAORI; in others it is for the orientation."""


def check_tolerance_cycle(block: Block, word: Word, scope: SiemensVariables, *, tcp: bool) -> None:
    """Refusal of CYCLE832 in the older form, whose tens digit switches TRAORI; tcp: TRAORI is on."""
    given = word.arguments or ()
    try:
        mode = whole(given[1], scope) if len(given) > 1 and given[1] != EMPTY else 0
    except NotKnown as reason:
        raise block.refuse(f"second argument of CYCLE832: {reason}") from None
    if mode in OLDER_MODE and mode // 10 % 10 != int(tcp):
        raise block.refuse(f"CYCLE832 with {mode} switches TRAORI by its tens digit: write TRAORI or TRAFOOF before it")
