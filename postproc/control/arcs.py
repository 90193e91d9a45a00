"""Arcs of blocks with I J K or a radius."""

from __future__ import annotations

from collections.abc import Mapping

from postproc.control.interpreter import Interpreter
from postproc.motion.arcs import (
    Ends,
    arc_by_centre,
    arc_by_radius,
    begin_arc,
    centre_letters,
    centre_words,
    radius_alone,
)
from postproc.motion.moves import Arc
from postproc.text.block import Block


def arc_ends(control: Interpreter, block: Block, target: list[float]) -> Ends:
    """Start and end of the arc of a block in the working plane; Refusal for a start that the program has not given."""
    return begin_arc(block, control.recorder, control.plane, control.sense, target)


def read_arc(
    control: Interpreter,
    block: Block,
    other: Mapping[str, int],
    target: list[float],
    *,
    radius: str,
    turns: int,
    absolute: bool,
    hint: str = "",
) -> Arc:
    """The arc of a block to `target`, programmed coordinates, mm; Refusal for words that give no arc.

    other: indices of words by address. radius: the address of a radius. turns: whole turns besides the arc. absolute:
    a centre is a position. hint: advice where the centre fits only as a position.
    """
    ends = arc_ends(control, block, target)
    i = radius_alone(block, other, radius)
    if i is not None:
        if turns:
            raise block.refuse(f"an arc of several turns needs a centre: write I J K instead of {radius}")
        form = "radius-absolute" if absolute else "radius"
        return arc_by_radius(block, ends, control.number(block, i, control.unit), i, form)
    indices = centre_words(block, other, control.plane, radius)
    centre = centre_of(control, block, indices, absolute=absolute)
    return arc_by_centre(block, ends, centre, indices, absolute=absolute, hint=hint)._replace(turns=turns)


def centre_of(
    control: Interpreter, block: Block, indices: tuple[int | None, int | None], *, absolute: bool
) -> tuple[float, float]:
    """The values of the words of a centre, mm; Refusal where one of an absolute centre is missing."""
    if absolute and None in indices:
        raise block.refuse(f"an absolute centre needs both words: write {' and '.join(centre_letters(control.plane))}")
    x, y = (0.0 if i is None else control.number(block, i, control.unit) for i in indices)
    return x, y
