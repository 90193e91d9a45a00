"""Ends of moves of ISO blocks: arcs by R or by I J K, polar coordinates (G16), tool vectors (G43.5), broken corners
(,C ,R), lines by their angle (,A)."""

from __future__ import annotations

import math

from postproc.control.arcs import read_arc
from postproc.control.channel import AxisWords
from postproc.control.codes import PLANES
from postproc.control.words import given_as, value_of, whole_of, with_word
from postproc.iso.channel import Channel
from postproc.iso.codes import ANGLE, CORNERS
from postproc.iso.families import ANY, FANUC
from postproc.iso.modal_state import PolarCoordinates
from postproc.iso.words import Content
from postproc.motion.along import other_coordinate
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


# ---- broken corners, and lines by their angle

CORNER_MOTIONS = (1.0, 2.0, 3.0)
"""The moves between which FANUC breaks a corner."""
BY_ANGLE = (
    "the angle of a line (,A) is followed in G1 and G90 beside one coordinate of the plane: write both coordinates "
    "instead of it"
)


def check_corner(channel: Channel, content: Content, claimed: float | None) -> None:
    """Take over a chamfer or rounding behind this block; Refusal where it, or one before the block, is no corner.

    The corner is between two moves in the plane of G17 to G19. Their ends are corrected in the plane, and not across
    it, where FANUC allows no coordinate.
    """
    modal, block = channel.modal, content.block
    names = content.names.keys() & (CORNERS | {ANGLE})
    if names and channel.family not in (ANY, FANUC):
        raise content.refuse(f"{min(names)} is no word of {channel.family}: write the moves of the corner or line")
    here, before = sorted(names & CORNERS), modal.cornered
    modal.cornered = bool(here)
    moves = claimed is None and content.axes and modal.motion in CORNER_MOTIONS and modal.cycle is None
    if ANGLE in names and not moves:
        raise content.refuse(BY_ANGLE)
    if not (here or before):
        return
    if len(here) > 1:
        raise content.refuse("the corner has a chamfer and a rounding: write ,C or ,R")
    plane = {modal.plane[0], modal.plane[1]}
    strange = [block.words[i].address for i in content.axes if block.words[i].address not in plane]
    if not moves or strange or modal.polar is not None or modal.tilted or modal.tcp:
        raise content.refuse(
            f"a chamfer or rounding {'before' if before else 'behind'} this block needs two moves in the plane of "
            f"{' and '.join(sorted(plane))} next to each other, by G1, G2 or G3 and without polar coordinates, TCP or "
            "a tilted plane: write the corner as moves"
        )
    if before and not PLANES.keys().isdisjoint(content.g):
        raise content.refuse("the plane changes at a chamfer or rounding: write G17, G18 or G19 before both moves")
    channel.no_insertion = True
    channel.recorder.note("locked_axes", modal.plane_columns[2:])
    channel.notes.add("chamfers and roundings: the corner points are corrected in their plane", block.line)


def end_by_angle(channel: Channel, content: Content) -> None:
    """Give a line with ,A the coordinate that it omits, programmed coordinates."""
    modal, block = channel.modal, content.block
    if ANGLE not in content.names:
        return
    index, (first, second, _) = content.names[ANGLE], modal.plane_columns
    programmed = {channel.columns.get(block.words[i].address): i for i in content.axes}
    given = programmed.keys() & {first, second}
    known = channel.recorder.known
    if len(given) != 1 or modal.motion != 1.0 or not modal.absolute or modal.polar is not None:
        raise content.refuse(BY_ANGLE)
    if not (known[first] and known[second]):
        raise content.refuse("the angle of a line (,A) needs a known start: write X and Y in a move before it")
    axis = first if first in given else second
    unit = modal.unit
    value = channel.number(block, programmed[axis], unit)
    degrees = value_of(block, block.words[index])
    start = (channel.recorder.position[first], channel.recorder.position[second])
    other = other_coordinate(start, value, math.radians(degrees), second_given=axis == second)
    if other is None:
        raise content.refuse(f"a line at {degrees:g} degrees does not lead to this coordinate: correct one of them")
    name = modal.plane[1] if axis == first else modal.plane[0]
    content.block = with_word(block, index, given_as(block.words[index], name, other / unit))
    content.axes.append(index)
