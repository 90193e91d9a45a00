"""Functions that every control has: tool change, M functions, end of radius compensation, and the notes on them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from postproc.motion.recorder import Recorder
from postproc.text.block import Block
from postproc.text.notes import Notes


def note_unknown_m(code: float, block: Block, recorder: Recorder, notes: Notes) -> None:
    """An M function that ncomp does not know: it may have moved any axis."""
    notes.add(f"M{code:g} is not known to ncomp and taken to move nothing", block.line)
    recorder.mark_uncertain()


def note_after_end(block: Block, notes: Notes) -> None:
    """A block behind the end of the program."""
    notes.add("blocks after the end of the program do not run and stay as programmed", block.line)


def note_tcp(name: str, block: Block, notes: Notes) -> None:
    """A function that switches TCP on."""
    notes.add(f"{name}: X Y Z taken as the tool point in the workpiece frame that turns with a table", block.line)


def mark_named_unknown(recorder: Recorder, names: Sequence[str]) -> list[str]:
    """Those of the axes that the machine has; the program does not give their positions any more."""
    present = [name for name in names if name in recorder.machine.names]
    recorder.mark_unknown([recorder.machine.index(name) for name in present])
    return present


def move_for_tool_change(block: Block, recorder: Recorder, notes: Notes) -> None:
    """A tool change takes the axes of the machine file to positions that the program does not give."""
    names = mark_named_unknown(recorder, recorder.machine.control.tool_change_moves)
    text = f"a tool change taken to move {' '.join(names) or 'no axis'} (machine file: tool_change_moves)"
    notes.add(text, block.line)


def end_compensation(recorder: Recorder, plane: str) -> None:
    """Radius compensation ends: the tool is beside the contour until both axes of the plane are programmed again."""
    recorder.mark_uncertain(recorder.machine.index(axis) for axis in plane[:2])


def refuse_two_of_a_group(block: Block, codes: Iterable[float], groups: Iterable[Collection[float]]) -> None:
    """Refusal for two G codes of one modal group."""
    present = set(codes)
    for group in groups:
        both = sorted(present.intersection(group))
        if len(both) > 1:
            raise block.refuse(f"G{both[0]:g} and G{both[1]:g} in one block")
