"""Approaches and departures of Klartext: APPR and DEP.

The control calculates the path to the contour, or from it, from the elements after or before it and the radius of the
tool. The path leads to the point of the block, and that point is corrected; so are the first and last elements of
the contour, so the path stays as tangential as it was.
"""

from __future__ import annotations

from postproc.heidenhain.modal_state import Content, Control
from postproc.motion.moves import Kind
from postproc.text.block import Block

WITH_END = frozenset(("LCT",))
"""Departures whose end is in the block; the others end at a length, or on an arc, beyond the contour."""


def approach(control: Control, index: int, block: Block, content: Content) -> None:
    """APPR LT, LN, CT, LCT to the first point of a contour; DEP from the last one."""
    form = block.detail.upper().split()[-1]
    if form.startswith("P"):
        raise block.refuse(f"{block.detail}: an approach in polar coordinates is not corrected")
    if control.tcp:
        raise block.refuse(f"{block.detail} while M128 is on")
    words = control.axis_words(block, content.axes)
    if block.kind == "approach" and not any(control.machine.names[word.axis] in "XY" for word, _ in words):
        raise block.refuse(f"{block.detail} without the point of the contour that it goes to")
    if words:
        target = control.target(block, words)
        control.recorder.move(index, Kind.RAPID, target, control.unit, tuple(word for word, _ in words))
    if block.kind == "departure" and form not in WITH_END:
        control.mark_unknown("XY")
    text = "approaches and departures end at corrected points; the control calculates the path between them"
    control.notes.add(text, block.line)
