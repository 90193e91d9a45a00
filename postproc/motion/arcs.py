"""Arcs of a block: the circle from its start, its end, and its programmed radius or centre."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from postproc.motion.circles import (
    RADIUS_TOLERANCE_MM,
    SAME_POINT_MM,
    Point,
    centre_from_radius,
    radius_fault,
    same,
    short_by,
)
from postproc.motion.moves import Arc
from postproc.motion.recorder import Recorder
from postproc.text.block import Block
from postproc.text.notes import Notes

CENTRES = "IJK"
"""Addresses of the centre of an arc, along X, Y and Z."""


class Ends(NamedTuple):
    """Start and end of an arc in its plane, mm, programmed coordinates."""

    plane: tuple[int, int, int]
    """Columns of the first, second and normal axis."""
    sense: int
    """Sense of rotation: +1 counter-clockwise seen from the positive end of the normal axis, otherwise -1."""
    start: Point
    end: Point


def begin_arc(block: Block, recorder: Recorder, plane: str, sense: int, target: list[float]) -> Ends:
    """The ends of an arc from the current position to `target`; Refusal if the start is not known.

    plane: the letters of the first, second and normal axis.
    """
    first, second, normal = (recorder.machine.index(letter) for letter in plane)
    if not (recorder.known[first] and recorder.known[second]):
        raise block.refuse(
            "the arc starts at a position that the program has not given: write its start in a block before it"
        )
    if not recorder.frame.keeps_circles(plane[:2]):
        raise block.refuse(
            "the axes of the plane of this arc are scaled by different factors, so that it is no circle: write "
            "straight lines"
        )
    start = recorder.position[first], recorder.position[second]
    return Ends((first, second, normal), sense, start, (target[first], target[second]))


def centre_letters(plane: str) -> tuple[str, str]:
    """The addresses of a centre in a plane, given by the letters of its axes."""
    first, second = (CENTRES["XYZ".index(axis)] for axis in plane[:2])
    return first, second


def centre_words(
    block: Block, other: Mapping[str, int], plane: str, radius: str, *, in_space: bool = False
) -> tuple[int | None, int | None]:
    """Indices of the words of a centre in a plane; Refusal if there are none, or if one belongs to another plane.

    other: indices of words by address. radius: the address of a radius, for the message. in_space: the control takes a
    centre with three coordinates, of which only those in the plane count.
    """
    letters = centre_letters(plane)
    outside = [a for a in CENTRES if a not in letters and a in other and block.words[other[a]].value]
    if outside and not in_space:
        raise block.refuse(
            f"{outside[0]} gives no centre in the plane of {' and '.join(plane[:2])}, and no manual says that the "
            f"control leaves it out: write {' and '.join(letters)} alone"
        )
    first, second = other.get(letters[0]), other.get(letters[1])
    if first is None and second is None:
        raise block.refuse(f"the arc has no centre and no radius: write {' and '.join(letters)}, or {radius}")
    return first, second


def radius_alone(block: Block, other: Mapping[str, int], radius: str) -> int | None:
    """The index of the radius word, if any; Refusal if the block also has words of a centre."""
    if radius in other and not other.keys().isdisjoint(CENTRES):
        raise block.refuse("the arc has a radius and a centre: write one of them")
    return other.get(radius)


def arc_by_radius(
    block: Block,
    ends: Ends,
    radius: float,
    word: int,
    form: str = "radius",
    *,
    notes: Notes,
    tolerance: float = RADIUS_TOLERANCE_MM,
) -> Arc:
    """The arc with this radius, mm, negative for the longer arc; Refusal if there is none.

    tolerance: length, mm, by which the radius may be too short for half a circle; a note names it.
    """
    short = short_by(ends.start, ends.end, radius)
    centre = centre_from_radius(ends.start, ends.end, radius, ends.sense)
    if centre is None or short > tolerance:
        raise block.refuse("no circle of this radius joins start and end: write a larger radius, or the centre")
    if short > SAME_POINT_MM:
        notes.add("the radius of an arc is too short, by less than the tolerance: taken as half a circle", block.line)
    return Arc(ends.plane, ends.sense, centre, False, form, (word, None))


def arc_by_centre(
    block: Block,
    ends: Ends,
    programmed: Point,
    words: tuple[int | None, int | None],
    *,
    absolute: bool,
    hint: str = "",
) -> Arc:
    """The arc around the programmed centre, mm: a position if `absolute`, otherwise an increment from the start.

    hint: text added to the message where the centre would fit as a position. Refusal if the ends do not lie on a circle
    around the centre.
    """
    x, y = (0.0, 0.0) if absolute else ends.start
    centre = (x + programmed[0], y + programmed[1])
    fault = radius_fault(ends.start, ends.end, centre)
    if fault is not None:
        fits = not absolute and radius_fault(ends.start, ends.end, programmed) is None
        raise block.refuse(fault + (hint if fits else ""))
    form = "absolute" if absolute else "incremental"
    return Arc(ends.plane, ends.sense, centre, same(ends.start, ends.end), form, words)
