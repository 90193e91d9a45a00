"""Arcs of blocks with I J K or a radius."""

from __future__ import annotations

from collections.abc import Mapping

from postproc.control.channel import Channel
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


def arc_ends(channel: Channel, block: Block, target: list[float]) -> Ends:
    """Start and end of the arc of a block in the working plane; Refusal for a start that the program has not given."""
    return begin_arc(block, channel.recorder, channel.modal.plane, channel.modal.sense, target)


def read_arc(
    channel: Channel,
    block: Block,
    other: Mapping[str, int],
    target: list[float],
    *,
    radius: str,
    turns: int,
    absolute: bool,
    hint: str = "",
    in_space: bool = False,
) -> Arc:
    """The arc of a block to `target`, programmed coordinates, mm; Refusal for words that give no arc.

    other: indices of words by address. radius: the address of a radius. turns: whole turns besides the arc. absolute:
    a centre is a position. hint: advice where the centre fits only as a position. in_space: as for `centre_words`.
    """
    ends = arc_ends(channel, block, target)
    i = radius_alone(block, other, radius)
    if i is not None:
        if turns:
            raise block.refuse(f"an arc of several turns needs a centre: write I J K instead of {radius}")
        form = "radius-absolute" if absolute else "radius"
        size, tolerance = channel.number(block, i, channel.modal.unit), channel.short_radius_mm
        return arc_by_radius(block, ends, size, i, form, notes=channel.notes, tolerance=tolerance)
    indices = centre_words(block, other, channel.modal.plane, radius, in_space=in_space)
    centre = centre_of(channel, block, indices, absolute=absolute)
    return arc_by_centre(block, ends, centre, indices, absolute=absolute, hint=hint)._replace(turns=turns)


def centre_of(
    channel: Channel, block: Block, indices: tuple[int | None, int | None], *, absolute: bool
) -> tuple[float, float]:
    """The values of the words of a centre, mm; Refusal where one of an absolute centre is missing."""
    if absolute and None in indices:
        raise block.refuse(
            f"an absolute centre needs both words: write {' and '.join(centre_letters(channel.modal.plane))}"
        )
    x, y = (0.0 if i is None else channel.number(block, i, channel.modal.unit) for i in indices)
    return x, y
