"""Programs in the order of execution: the next block, with the present values of its words.

A program without jumps, loops and calls is read block after block, and none is kept. Other programs are stored as
a whole and followed in the order of execution; every block comes as often as it runs, with its present values.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol, cast

import msgspec

from postproc.text.block import Block
from postproc.text.block_values import with_values
from postproc.text.blocks import PlainRun
from postproc.text.branches import StructureSteps
from postproc.text.calls.listing import Files, Listing, OneFile, Passed
from postproc.text.calls.repetition import Repetition
from postproc.text.expressions import Expression, NotKnown, Scope, Value, evaluate, number, same_when_corrected, whole
from postproc.text.statements import (
    Call,
    EndModal,
    Jump,
    Modal,
    Rerun,
    Return,
    Select,
    Simple,
    Step,
    When,
    turns,
)

MOST_RUN_BLOCKS = 2_000_000
"""Blocks that a program may run."""
MAIN = sys.maxsize - 1
"""The place of the call of the main program, behind all blocks."""
DEEPEST = 100
"""Subprograms in subprograms."""


class Variables(Scope, Protocol):
    """A scope whose variables a subprogram may have of its own."""

    def enter(self, arguments: dict[int, Value | NotKnown] | None) -> None:
        """Begin a subprogram, with its own local variables or, for None, those of its caller."""

    @property
    def state(self) -> object:
        """The values of all variables, to be copied and compared."""

    def forget(self, reason: str) -> None:
        """Mark all variables as unknown that a construct which ncomp does not follow may set."""

    def leave(self) -> dict[int, Value | NotKnown]:
        """End the subprogram; returns the values of its numbered local variables."""


class Reader(Protocol):
    """The reader of the blocks in the order of execution."""

    @property
    def ended(self) -> bool:
        """The last block ended the program."""

    @property
    def moved(self) -> bool:
        """The last block moved the tool; Refusal where whether a modal call follows it depends on the control."""


class _Called(msgspec.Struct, eq=False):
    """A subprogram with the arguments of its call."""

    first: int
    """The block that it begins with."""
    times: int
    arguments: dict[int, Value | NotKnown] | None
    local: bool
    """True for a subprogram that is always in the file of its call."""
    depth: int = 0
    """Number of frames around the G66 of a modal call."""

    def after(self, at_end: dict[int, Value | NotKnown]) -> None:
        """Mark the variables that an iteration has changed as unknown: their values in the next one depend on the
        control.
        """
        if self.arguments is None:
            return
        unsure = NotKnown(
            "a repeated macro begins with the values of its call on some controls and with its last values on others"
        )
        given = self.arguments
        self.arguments = {
            n: given[n] if n in given and at_end.get(n) == given[n] else unsure for n in given.keys() | at_end.keys()
        }


class _Frame(msgspec.Struct):
    """A subprogram, or a part of the program that is run again."""

    caller: int
    first: int
    last: int
    """The last block of a part; -1 for a subprogram, which has its own end."""
    remaining: int
    """Iterations after the present one."""
    called: _Called | None
    """The subprogram; None for a part, and for the main program."""
    modals: int | None
    """How many of the modal calls hold for its moves; None for all."""
    loops: dict[int, int] = msgspec.field(default_factory=dict)
    """Remaining iterations of a loop, by the block that opens it."""


def never(_: Block) -> bool:
    """False for every block, if one file holds one program."""
    return False


class Flow:
    """Walks through a program whose blocks are all in memory."""

    def __init__(
        self,
        blocks: Sequence[Block],
        scope: Variables,
        labels: Callable[[Block], Iterable[str]],
        begins: Callable[[Block], bool] = never,
        files: Files | None = None,
    ) -> None:
        """`begins`: true for the first block of a program; files: those of called programs, which add their blocks."""
        self.blocks, self.scope = blocks, scope
        structures = StructureSteps(blocks, scope, lambda: self.frames[-1].loops, self._leave)
        self.listing = Listing(blocks, labels, begins, files or OneFile(), structures.extend)
        self.frames = [_Frame(MAIN, 0, -1, 0, None, None)]
        self.modals: list[_Called] = []
        """Calls that run behind moves, in the order of their G66."""
        self._words = ("G66", "G67", "G65")
        """As of the last Modal."""
        self._turns: dict[type, Callable[[int, Block, Any], int | None]] = {
            Jump: self._jump,
            When: self._when,
            Select: self._select,
            **structures.turns,
            Call: self._call,
            Return: self._return,
            Modal: self._modal,
            EndModal: self._end_modal,
            Rerun: self._rerun,
        }
        self.repetition = Repetition()
        self.ran: set[int] = set()
        """Blocks that have run."""
        self._jumped = False
        """The next block is the target of the last jump."""

    def run(self, reader: Reader) -> Iterator[tuple[int, Block | PlainRun]]:
        """Blocks, or runs of plain lines, as they run, with the index of the first; each is read before the next."""
        at, ran = 0, 0
        blocks, ends = self.blocks, self.listing.ends
        while (at < len(blocks) and at not in ends) or not self.listing.at_end(at):
            block = blocks[at]
            ran += 1
            if ran > MOST_RUN_BLOCKS:
                raise block.refuse(
                    f"the program does not end within {MOST_RUN_BLOCKS} blocks: check its loops and jumps"
                )
            jumped, self._jumped, then = self._jumped, False, None
            plain = None if jumped or self._modal_call() else self.listing.plain(at, self.frames[-1].last)
            self.ran.add(at)
            if block.code is not None:
                then = self._steps(at, block, block.code.before)
            if plain is not None:
                yield at, plain
                self.ran.update(range(at, at + len(plain)))
                at, ran = at + len(plain) - 1, ran + len(plain) - 1
            elif then is None:
                modal = self._modal_call()
                turning = block.code is not None and any(map(turns, block.code.after))
                no_insertion = jumped or turning or modal is not None
                yield at, with_values(block._replace(no_insertion=True) if no_insertion else block, self.scope)
                if modal is not None and reader.moved:
                    then = self._after_move(at, block, modal, ended=reader.ended)
                elif block.code is not None and not reader.ended:
                    then = self._steps(at, block, block.code.after)
            if reader.ended:
                return
            then = self._behind(at) if then is None else then
            if then <= at and self.repetition.found(then, (self.scope.state, self.frames)):
                raise block.refuse(
                    "the program does not end: from here on it runs the same blocks with the same values for ever; "
                    "check the condition of its loop or jump"
                )
            at = then

    def _after_move(self, at: int, block: Block, modal: _Called, *, ended: bool) -> int | None:
        """Begin the modal macro behind a move; Refusal where a call or an end is in its block."""
        if ended or (block.code is not None and block.code.after):
            raise block.refuse(
                "a move in one block with a jump, a call or an end is not corrected while "
                f"{self._words[0]} is active: write it in a block of its own"
            )
        return self._enter(at, block, modal)

    def _behind(self, at: int) -> int:
        """The block that runs after one without a jump."""
        frame = self.frames[-1]
        if at != frame.last:
            return at + 1
        if frame.remaining > 0:
            frame.remaining -= 1
            return frame.first
        return self._leave()

    def _steps(self, at: int, block: Block, steps: Iterable[Step]) -> int | None:
        """Run steps; the block to go on with, None for the next one."""
        for step in steps:
            try:
                then = self._step(at, block, step)
            except NotKnown as reason:
                raise block.refuse(str(reason)) from None
            if then is not None:
                return then
        return None

    def _step(self, at: int, block: Block, step: Step) -> int | None:
        turn = self._turns.get(type(step))
        if turn is not None:
            return turn(at, block, step)
        cast(Simple, step).run(self.scope)
        return None

    def _when(self, at: int, block: Block, step: When) -> int | None:
        chosen = step.then if number(step.condition, self.scope) else step.otherwise
        return None if chosen is None else self._step(at, block, chosen)

    def _select(self, at: int, block: Block, step: Select) -> int | None:
        value = evaluate(step.value, self.scope)
        if isinstance(value, float):
            value = same_when_corrected(value)
        same = (jump for case, jump in step.cases if evaluate(case, self.scope) == value)
        chosen = next(same, step.default)
        return None if chosen is None else self._jump(at, block, chosen)

    # ---- jumps and calls

    def _jump(self, at: int, block: Block, step: Jump) -> int | None:
        name = self._name(step.label)
        blocks = self.listing.labelled(name, at)
        if len(step.directions) > 1 and len(blocks) > 1:
            raise block.refuse(f"{len(blocks)} blocks have the label {name}: write it once")
        later, earlier = [i for i in blocks if i > at], [i for i in blocks if i <= at]
        found = {"F": later[:1], "B": earlier[-1:]}
        target = next((i for direction in step.directions for i in found[direction]), None)
        if target is None:
            if step.optional:
                return None
            raise block.refuse(f"the program has no block with the label {name}: write it or correct the jump")
        frame = self.frames[-1]
        if frame.last >= 0 and not frame.first <= target <= frame.last:
            raise block.refuse("a jump out of a repeated part of the program is not corrected: end the part before it")
        self._jumped = True
        return target

    def _name(self, label: str | Expression) -> str:
        value = label if isinstance(label, str) else evaluate(label, self.scope)
        return value if isinstance(value, str) else f"{value:.10g}"

    def _call(self, at: int, block: Block, step: Call) -> int | None:
        if step.arguments is not None and self._modal_call() is not None:
            raise block.refuse(
                "not all controls run the modal macro after the moves of this macro: end the modal call before it"
            )
        try:
            called = self._called(at, step)
        except Passed:
            return None
        return self._enter(at, block, called)

    def _called(self, at: int, step: Call) -> _Called:
        name = self._name(step.name)
        if step.at_label:
            first = self.listing.only(name, at)
        else:
            first = self.listing.first_block(name, at, local=step.local, begun=step.begun)
        arguments: dict[int, Value | NotKnown] | None = None
        if step.arguments is not None:
            arguments = {number_: self._argument(expression) for number_, expression in step.arguments}
        times = 1 if step.times is None else whole(step.times, self.scope)
        return _Called(first, times, arguments, step.local, len(self.frames))

    def _enter(self, at: int, block: Block, called: _Called) -> int | None:
        """Begin the subprogram; one that runs behind a move has the modal calls before its own."""
        if called.times < 1:
            return None
        if self.listing.several and any(each.called and each.called.first == called.first for each in self.frames):
            raise block.refuse("the subprogram calls itself, perhaps through another one: end the recursion")
        if len(self.frames) > DEEPEST:
            raise block.refuse(f"the subprograms call each other more than {DEEPEST} deep: end the recursion")
        modals = self.modals.index(called) if called in self.modals else self.frames[-1].modals
        self.scope.enter(called.arguments)
        self.frames.append(_Frame(at, called.first, -1, called.times - 1, called, modals))
        return called.first

    def _argument(self, expression: Expression) -> Value | NotKnown:
        try:
            return evaluate(expression, self.scope)
        except NotKnown as reason:
            return reason

    def _return(self, at: int, block: Block, step: Return) -> int | None:
        frame = self.frames[-1]
        if frame.called is None:
            if step.label is None and step.outside:
                raise block.refuse(step.outside)
            return None if step.label is None else self._jump(at, block, Jump(step.label))
        if step.local != frame.called.local:
            if step.local:
                return None
            raise block.refuse("a subprogram of this program has no end before it: write it")
        if step.label is None:
            return self._leave()
        if frame.remaining > 0 or frame.called in self.modals:
            raise block.refuse(
                "M99 with P is not corrected in a repeated subprogram or in a modal macro: write M99 without P"
            )
        back = Jump(self._name(step.label))
        self._end_frame(frame)
        return self._jump(frame.caller, block, back)

    def _leave(self) -> int:
        """The end of a subprogram or a part: once more, or behind its call."""
        frame = self.frames[-1]
        if frame.remaining > 0:
            frame.remaining -= 1
            if frame.called is not None:
                frame.called.after(self.scope.leave())
                self.scope.enter(frame.called.arguments)
            return frame.first
        self._end_frame(frame)
        return self._behind(frame.caller)

    def _end_frame(self, frame: _Frame) -> None:
        if self.modals and self.modals[-1].depth == len(self.frames):
            raise self.blocks[frame.caller].refuse(
                f"the subprogram ends while its {self._words[0]} is active: write {self._words[1]} before its end"
            )
        self.frames.pop()
        if frame.called is not None:
            frame.called.after(self.scope.leave())

    # ---- modal calls

    def _modal_call(self) -> _Called | None:
        """The modal calls after a move of the present frame."""
        modals = self.frames[-1].modals
        held = len(self.modals) if modals is None else modals
        return self.modals[held - 1] if held else None

    def _modal(self, at: int, block: Block, step: Modal) -> None:
        if self.frames[-1].modals is not None:
            raise block.refuse(
                f"{step.words[0]} in a modal macro is not corrected: call the second macro by {step.words[2]}"
            )
        if step.single and self.modals:
            raise block.refuse(f"another {step.words[0]} is active: write {step.words[1]} before this one")
        self._words = step.words
        self.modals.append(self._called(at, step.call))

    def _end_modal(self, _: int, block: Block, __: EndModal) -> None:
        if not self.modals:
            return
        if self.frames[-1].modals is not None or self.modals[-1].depth != len(self.frames):
            raise block.refuse(
                f"{self._words[1]} and its {self._words[0]} are in different programs: write {self._words[1]} in the "
                f"program of {self._words[0]}"
            )
        self.modals.pop()

    def _rerun(self, at: int, _: Block, step: Rerun) -> int | None:
        times = 1 if step.times is None else whole(step.times, self.scope)
        if times < 1:
            return None
        first, last = self.listing.part(step, at)
        self.frames.append(_Frame(at, first, last, times - 1, None, self.frames[-1].modals))
        self._jumped = True
        return first
