"""Straight lines with surface normals and tool axes as vectors: LN of Klartext."""

from __future__ import annotations

from postproc.control.tool_vectors import turn_along
from postproc.heidenhain.modal_state import Content, Control, value_of
from postproc.motion.moves import Kind
from postproc.text.block import Block

NORMAL, TOOL_AXIS = "N", "T"


def normal_line(control: Control, index: int, block: Block, content: Content, frame_unchanged: bool) -> None:
    """LN X Y Z with NX NY NZ, along which the control shifts the tool by its oversizes, and with TX TY TZ under M128.

    X Y Z are those of the tool point and are corrected; both vectors stay. Where TX TY TZ take the rotary axes is
    worked out, and no word of ours names them.
    """
    normal, tool_axis = (_vector(block, kind) for kind in (NORMAL, TOOL_AXIS))
    if normal is None and tool_axis is None:
        raise block.refuse("LN needs NX NY NZ or TX TY TZ")
    words = control.axis_words(block, content.axes)
    target = control.target(block, words)
    recorder, machine = control.recorder, control.machine
    if tool_axis is not None:
        if not control.tcp or control.tilt is not None or recorder.frame.turn is not None:
            raise block.refuse("TX TY TZ without M128, or in turned coordinates")
        if not machine.rotary.any() or any(machine.rotary[word.axis] for word, _ in words):
            raise block.refuse(f"TX TY TZ beside a rotary axis, or on machine {machine.name} without one")
        turn_along(block, recorder, target, tool_axis)
        control.notes.add("TX TY TZ: the control is taken to turn the rotary axes to the nearest solution", block.line)
    if normal is not None:
        control.notes.add("surface normals: the offset of the tool along them is not corrected", block.line)
    kind = Kind.RAPID if "FMAX" in content.other else Kind.LINE
    recorder.move(index, kind, target, control.unit, tuple(word for word, _ in words), frame_unchanged=frame_unchanged)


def _vector(block: Block, kind: str) -> list[float] | None:
    words = {word.address: word for word in block.words if word.address in (f"{kind}X", f"{kind}Y", f"{kind}Z")}
    if not words:
        return None
    if len(words) < 3 or sum(word.address in words for word in block.words) > 3:
        raise block.refuse(f"{kind}X {kind}Y {kind}Z must all be in the block, each once")
    return [value_of(block, words[kind + axis]) for axis in "XYZ"]
