"""Ends of moves of ISO blocks: arcs by R or by I J K, polar coordinates (G16), tool vectors (G43.5)."""

from __future__ import annotations

from postproc.control.arcs import read_arc
from postproc.control.channel import AxisWords
from postproc.control.words import whole_of
from postproc.iso.channel import Channel
from postproc.iso.modal_state import PolarCoordinates
from postproc.iso.words import Content
from postproc.motion.circles import point_around
from postproc.motion.moves import Arc, AxisWord, Polar
from postproc.text.block import Block

HINT = '. With an absolute centre it is a circle: for such a control set arc_centres = "absolute" in the machine file'


def arc_of(channel: Channel, content: Content, target: list[float]) -> Arc:
    """The arc of a block to `target`, programmed coordinates; Refusal for words that give no arc."""
    block, turns, absolute = content.block, _turns(content), channel.modal.arc_absolute
    return read_arc(channel, block, content.other, target, radius="R", turns=turns, absolute=absolute, hint=HINT)


def _turns(content: Content) -> int:
    """Whole turns besides the arc: P counts the one that it ends in."""
    if "P" not in content.other:
        return 0
    turns = whole_of(content.block, content.block.words[content.other["P"]])
    if turns < 1:
        raise content.refuse("P of the arc must be 1 or more: it counts the turns")
    return turns - 1


# ---- polar coordinates


def select_polar(channel: Channel, block: Block, on: bool) -> None:
    """G16 and G15."""
    if on and not channel.modal.absolute:
        raise block.refuse("polar coordinates with G91 are not corrected: write G90 before them")
    channel.modal.polar = (channel.modal.polar or PolarCoordinates()) if on else None


def end_words(channel: Channel, content: Content) -> tuple[AxisWords, Polar | None]:
    """The axis words of a move; for polar coordinates those outside the plane, and the polar end."""
    words, modal = channel.axis_words(content.block, content.axes), channel.modal
    if modal.polar is None:
        return words, None
    if not modal.absolute:
        raise content.refuse("polar coordinates with G91 are not corrected: write G90 before them")
    axes = modal.plane_columns[:2]
    others, polar = modal.polar.take(content.block, axes, words)
    if polar is None:
        channel.recorder.note("locked_axes", axes)
    channel.no_insertion = True
    return others, polar


def go_polar(channel: Channel, target: list[float], polar: Polar) -> None:
    """Set the polar end of a move in its target."""
    target[polar.axes[0]], target[polar.axes[1]] = point_around((0.0, 0.0), polar.radius, polar.angle)
    channel.recorder.note("polars", polar)


# ---- tool vectors


def turn_tool(channel: Channel, content: Content, target: list[float], words: AxisWords) -> AxisWords:
    """The positions of rotary axes by tool vectors, which no word names; in a tilted plane they do not move."""
    if any(channel.rotary[word.axis] for word, _ in words):
        raise content.refuse("a rotary axis word with tool vectors or in a tilted plane is not corrected: leave it out")
    programmed = [content.other.get(letter) for letter in "IJK"]
    if programmed == [None, None, None] or channel.modal.tilted:
        return []
    if None in programmed or channel.modal.motion not in (0.0, 1.0):
        raise content.refuse("a tool vector needs I, J and K and a straight line: write all three with G0 or G1")
    vector = [content.block.words[i].value or 0.0 for i in programmed if i is not None]
    channel.notes.add(
        "G43.5: the new positions of the rotary axes are taken nearest to the present ones", content.block.line
    )
    positions = channel.along_tool_axis(content.block, target, vector)
    for axis, value in positions.items():
        target[axis] = value
    channel.no_insertion = True
    return [(AxisWord(axis, -1, True), value) for axis, value in positions.items()]
