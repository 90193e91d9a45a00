"""Loops and branches as they run: the block that follows where one opens, divides or closes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar, cast

from postproc.text.block import Block
from postproc.text.control_flow import find_structures
from postproc.text.expressions import Expression, NotKnown, Scope, evaluate, number, whole
from postproc.text.statements import Again, Begin, Else, End, Leave

Part = TypeVar("Part")


def _given(part: Part | None) -> Part:
    """The entry of a structure of this kind, which always exists."""
    assert part is not None
    return part


class StructureSteps:
    """The next block after a step of a structure; None for the following one."""

    def __init__(
        self, blocks: Sequence[Block], scope: Scope, remaining: Callable[[], dict[int, int]], leave: Callable[[], int]
    ) -> None:
        """`remaining` gives, by the block that opens a loop, the number of its remaining iterations in the present
        subprogram; `leave` ends the subprogram."""
        self.blocks, self.structures = blocks, find_structures(blocks)
        self.scope, self.remaining, self.leave = scope, remaining, leave
        self.after_break = False
        """A WHILE with a break in it has ended, and no DO since."""
        self.after_continue = False
        """A DO has started its next iteration by a continue."""
        self.turns: dict[type, Callable[[int, Block, Any], int | None]] = {
            Begin: self._begin,
            Else: self._else,
            End: self._end,
            Leave: self._leave_loop,
            Again: self._next_iteration,
        }

    def extend(self, first: int) -> None:
        """Take the blocks of a further file, from `first` on."""
        find_structures(self.blocks, first, self.structures)

    def _begin(self, at: int, block: Block, __: Begin) -> int | None:
        step = cast(Begin, self.structures.steps.get(at))
        if isinstance(step, End):  # a WHILE that closes a DO
            return self._end(at, block, step)
        end = self.structures.end[at]
        match step.kind:
            case "IF" if not self._holds(step.test):
                return self._branch(at)
            case "WHILE":
                runs = self._holds(step.test)
            case "REPEAT":
                iterations = whole(_given(step.test), self.scope)
                self.remaining()[at] = iterations
                runs = iterations > 0
            case "FOR":
                self._count(step, number(_given(step.first), self.scope))
                runs = self._counting(step)
            case kind:
                runs = kind != "SUB"
        if not runs and step.kind == "WHILE" and at in self.structures.with_leave:
            self.after_break = True
        return None if runs else end + 1

    def _else(self, at: int, _: Block, __: Else) -> int:
        return self.structures.end[at] + 1

    def _end(self, at: int, block: Block, __: End) -> int | None:
        begin = self.structures.begin[at]
        opened, step = cast(Begin, self.structures.steps[begin]), cast(End, self.structures.steps[at])
        match step.kind:
            case "WHILE" | "LOOP":
                return begin
            case "SUB":
                return self.leave()
            case "DO" if step.until is not None:
                again = not self._holds(step.until)
            case "DO":
                again = self._again(step.again)
            case "REPEAT":
                if self.after_continue:
                    raise block.refuse(
                        "LinuxCNC 2.9 runs a repeat loop too often after the continue of a do loop: write the do loop "
                        "without a continue"
                    )
                self.remaining()[begin] -= 1
                again = self.remaining()[begin] > 0
            case "FOR":
                self._count(opened, number(_given(opened.counter), self.scope) + 1.0)
                again = self._counting(opened)
            case _:
                again = False
        return begin + 1 if again else None

    def _again(self, condition: Expression | None) -> bool:
        """Whether a DO of O-words runs once more; NotKnown where LinuxCNC 2.9 ends it for the break of a WHILE."""
        again = self._holds(condition)
        if again and self.after_break:
            raise NotKnown(
                "after a while loop with a break LinuxCNC 2.9 leaves the next do loop after its first iteration; "
                "the behaviour of other versions is not known: write the loop without a break"
            )
        self.after_break = False
        return again

    def _leave_loop(self, at: int, _: Block, __: Leave) -> int:
        begin = self.structures.begin[at]
        self.after_break = cast(Begin, self.structures.steps[begin]).kind == "WHILE"
        return self.structures.end[begin] + 1

    def _next_iteration(self, at: int, _: Block, __: Again) -> int:
        begin = self.structures.begin[at]
        self.after_continue |= cast(Begin, self.structures.steps[begin]).kind == "DO"
        return self.structures.end[begin]

    def _branch(self, at: int) -> int:
        """The first block of the branch of an IF that runs when the first one does not."""
        while True:
            at = self.structures.following[at]
            step = self.structures.steps[at]
            if not isinstance(step, Else) or step.test is None or self._holds(step.test):
                return at + 1

    def _holds(self, condition: Expression | None) -> bool:
        return number(_given(condition), self.scope) != 0.0

    def _count(self, step: Begin, value: float) -> None:
        counter = _given(step.counter)
        self.scope.set(counter.name, tuple(evaluate(index, self.scope) for index in counter.indices), value)

    def _counting(self, step: Begin) -> bool:
        return number(_given(step.counter), self.scope) <= number(_given(step.test), self.scope)
