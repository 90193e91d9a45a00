"""Arcs of ISO blocks: by R, or by I J K."""

from __future__ import annotations

from postproc.arcs import Ends, arc_by_centre, arc_by_radius, begin_arc
from postproc.circles import radius_fault
from postproc.iso_codes import CENTRES
from postproc.iso_content import Content
from postproc.iso_modes import Modes
from postproc.iso_values import Values
from postproc.motions import Arc, Recorder

CENTRE_WORD = {"X": "I", "Y": "J", "Z": "K"}


def read_arc(
    content: Content, sense: int, target: list[float], recorder: Recorder, values: Values, modes: Modes
) -> Arc:
    """The arc of a block to `target`, programmed coordinates; Refusal for what is none."""
    block, other = content.block, content.other
    ends = begin_arc(block, recorder, modes.plane, sense, target)
    turns = _turns(content, values)
    if "R" in other:
        if not other.keys().isdisjoint(CENTRES):
            raise block.refuse("an arc by its radius and its centre at once")
        if turns:
            raise block.refuse("an arc of several turns by its radius")
        i = other["R"]
        form = "radius-absolute" if modes.arc_absolute else "radius"
        return arc_by_radius(block, ends, values.number(block, i, modes.unit), i, form)
    letters = [CENTRE_WORD[letter] for letter in modes.plane[:2]]
    indices = other.get(letters[0]), other.get(letters[1])
    _check_centre_words(content, modes, letters, indices)
    x, y = (0.0 if i is None else values.number(block, i, modes.unit) for i in indices)
    hint = _hint(ends, (x, y), modes.arc_absolute)
    return arc_by_centre(block, ends, (x, y), indices, absolute=modes.arc_absolute, hint=hint)._replace(turns=turns)


def _turns(content: Content, values: Values) -> int:
    """Whole turns besides the arc: P counts the one that it ends in."""
    if "P" not in content.other:
        return 0
    turns = values.whole(content.block, content.other["P"])
    if turns < 1:
        raise content.refuse("an arc of no turn")
    return turns - 1


def _check_centre_words(
    content: Content, modes: Modes, letters: list[str], indices: tuple[int | None, int | None]
) -> None:
    block, other = content.block, content.other
    stray = [a for a in CENTRES if a not in letters and a in other and block.words[other[a]].value]
    if stray:
        raise block.refuse(f"{stray[0]} gives no centre in the plane of {' and '.join(modes.plane[:2])}")
    if indices == (None, None):
        raise block.refuse(f"an arc without {' or '.join(letters)} or R")
    if modes.arc_absolute and None in indices:
        raise block.refuse(f"an absolute centre (G90.1) takes both {' and '.join(letters)}")


def _hint(ends: Ends, said: tuple[float, float], absolute: bool) -> str:
    """What helps where the centre fits as a place only."""
    if absolute or radius_fault(ends.start, ends.end, said) is not None:
        return ""
    return '; its centre would fit as absolute: for such a control set arc_centres = "absolute" in the machine file'
