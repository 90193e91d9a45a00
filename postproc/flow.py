"""Programs as they run: which block comes next, and what its words say then.

A program without jumps, loops and calls runs straight on, block after block, and none is kept. The others are held as
a whole and walked through; every block comes as often as it runs, with the values that its words have that time.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar, cast

from postproc.expressions import Expression, NotKnown, Scope, Value, evaluate, may_be_one, number, variables, whole
from postproc.program import Block, Word
from postproc.statements import (
    TURNS,
    Again,
    Assign,
    Begin,
    Call,
    Code,
    Else,
    End,
    Jump,
    Leave,
    Rerun,
    Return,
    Select,
    Simple,
    Step,
    When,
    turns,
)
from postproc.structures import find_structures

Part = TypeVar("Part")

LONGEST = 2_000_000
"""Blocks that a program may run."""
DEEPEST = 100
"""Subprograms in subprograms."""
FREE = frozenset(("F", "S", "FU", "FZ", "FT"))
"""Addresses whose values need not be known: they move the tool nowhere."""


class Variables(Scope, Protocol):
    """A scope whose variables a subprogram may have of its own."""

    def enter(self, arguments: dict[int, Value | NotKnown] | None) -> None:
        """Begin a subprogram, with its own local variables or, for None, those of its caller."""

    def leave(self) -> None:
        """End it."""


def straight(blocks: Iterable[Block], scope: Scope) -> Iterator[Block]:
    """The blocks of a program without jumps, with the values of their words."""
    for block in blocks:
        if block.code is None:
            yield block
            continue
        _assign(block, block.code.before, scope)
        yield with_values(block, scope)
        _assign(block, block.code.after, scope)


def with_values(block: Block, scope: Scope) -> Block:
    """The block with values in the place of formulas; Refusal where a value that moves something is not known."""
    if all(word.formula is None for word in block.words):
        return block
    return block._replace(words=tuple(_with_value(block, word, scope) for word in block.words))


def _with_value(block: Block, word: Word, scope: Scope) -> Word:
    if word.formula is None:
        return word
    try:
        return word._replace(value=number(word.formula.expression, scope))
    except NotKnown as reason:
        if word.address in FREE:
            return word
        raise block.refuse(f"{block.text[word.at : word.end]}: {reason}") from None


def _assign(block: Block, steps: Iterable[Step], scope: Scope) -> None:
    """Run steps that do not turn."""
    for step in steps:
        try:
            if not isinstance(step, When):
                assert not isinstance(step, TURNS)
                step.run(scope)
            elif number(step.condition, scope):
                _assign(block, (step.then,), scope)
        except NotKnown as reason:
            raise block.refuse(str(reason)) from None


def check_order(block: Block) -> Block:
    """The block, refused when it sets a variable and reads it elsewhere: controls differ in what comes first."""
    code = block.code or Code()
    steps = [step for step in code.before + code.after if isinstance(step, Assign)]
    if not steps:
        return block
    read = [(-1, v) for word in block.words if word.formula for v in variables(word.formula.expression)]
    read += [(-1, v) for word in block.words for e in word.arguments or () for v in variables(e)]
    for i, step in enumerate(steps):
        read += [(i, v) for e in (step.value, *step.target.indices) for v in variables(e)]
    for i, step in enumerate(steps):
        if any(j != i and may_be_one(variable, step.target) for j, variable in read):
            raise block.refuse("sets a variable and reads it in one block: controls differ in what comes first")
    return block


@dataclass
class _Frame:
    """A subprogram, or a part of the program that is run again."""

    caller: int
    first: int
    last: int
    """The block behind which a part is done; -1 for a subprogram, which says so itself."""
    left: int
    """Passes still to come behind this one."""
    scoped: bool
    loops: dict[int, int] = field(default_factory=dict)
    """By the block that opens it: passes that a loop has still to run."""


def _given(part: Part | None) -> Part:
    """What a structure of its kind always has."""
    assert part is not None
    return part


def never(_: Block) -> bool:
    """False, whatever the block: where one file holds one program."""
    return False


class Flow:
    """Walks through a program that is held as a whole."""

    def __init__(
        self,
        blocks: Sequence[Block],
        scope: Variables,
        labels: Callable[[Block], Iterable[str]],
        begins: Callable[[Block], bool] = never,
    ) -> None:
        self.blocks, self.scope = blocks, scope
        self.programs = list(itertools.accumulate(map(begins, blocks)))
        """Of every block: which program of the file it belongs to."""
        self.structures = find_structures(blocks)
        self.labels: dict[str, list[int]] = {}
        for i, block in enumerate(blocks):
            for label in labels(block):
                self.labels.setdefault(label, []).append(i)
        self.frames = [_Frame(len(blocks), 0, -1, 0, False)]
        self._turns: dict[type, Callable[[int, Block, Any], int | None]] = {
            Jump: self._jump,
            When: self._when,
            Select: self._select,
            Begin: self._begin,
            Else: self._else,
            End: self._end,
            Leave: self._leave_loop,
            Again: self._next_pass,
            Call: self._call,
            Return: self._return,
            Rerun: self._rerun,
        }
        self.ran: set[int] = set()
        """Blocks that have run."""
        self._jumped = False
        """The block that comes now has been jumped to."""

    def run(self, ended: Callable[[], bool]) -> Iterator[tuple[int, Block]]:
        """Blocks in the order in which they run, with their indices; `ended` says that the last one ended the run."""
        at, ran = 0, 0
        while at < len(self.blocks):
            block = self.blocks[at]
            ran += 1
            if ran > LONGEST:
                raise block.refuse(f"the program does not come to an end within {LONGEST} blocks")
            self.ran.add(at)
            jumped, self._jumped, then = self._jumped, False, None
            if block.code is not None:
                then = self._steps(at, block, block.code.before)
            if then is None:
                alone = jumped or (block.code is not None and any(map(turns, block.code.after)))
                yield at, with_values(block._replace(alone=True) if alone else block, self.scope)
                if block.code is not None and not ended():
                    then = self._steps(at, block, block.code.after)
            if ended():
                return
            at = self._behind(at) if then is None else then

    def _behind(self, at: int) -> int:
        """The block that runs behind one that says nothing of it."""
        frame = self.frames[-1]
        if at != frame.last:
            return at + 1
        if frame.left > 0:
            frame.left -= 1
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
        same = (jump for case, jump in step.cases if evaluate(case, self.scope) == value)
        chosen = next(same, step.default)
        return None if chosen is None else self._jump(at, block, chosen)

    # ---- structures

    def _begin(self, at: int, _: Block, __: Begin) -> int | None:
        step = cast(Begin, self.structures.steps.get(at))
        if isinstance(step, End):  # a WHILE that closes a DO
            return self._end(at, _, step)
        end = self.structures.end[at]
        match step.kind:
            case "IF" if not self._holds(step.test):
                return self._branch(at)
            case "WHILE":
                runs = self._holds(step.test)
            case "REPEAT":
                passes = whole(_given(step.test), self.scope)
                self.frames[-1].loops[at] = passes
                runs = passes > 0
            case "FOR":
                self._count(step, number(_given(step.first), self.scope))
                runs = self._counting(step)
            case kind:
                runs = kind != "SUB"
        return None if runs else end + 1

    def _else(self, at: int, _: Block, __: Else) -> int:
        return self.structures.end[at] + 1

    def _end(self, at: int, _: Block, __: End) -> int | None:
        begin = self.structures.begin[at]
        opened, step = cast(Begin, self.structures.steps[begin]), cast(End, self.structures.steps[at])
        match step.kind:
            case "WHILE" | "LOOP":
                return begin
            case "SUB":
                return self._leave()
            case "DO" if step.until is not None:
                again = not self._holds(step.until)
            case "DO":
                again = self._holds(step.again)
            case "REPEAT":
                self.frames[-1].loops[begin] -= 1
                again = self.frames[-1].loops[begin] > 0
            case "FOR":
                self._count(opened, number(_given(opened.counter), self.scope) + 1.0)
                again = self._counting(opened)
            case _:
                again = False
        return begin + 1 if again else None

    def _leave_loop(self, at: int, _: Block, __: Leave) -> int:
        return self.structures.end[self.structures.begin[at]] + 1

    def _next_pass(self, at: int, _: Block, __: Again) -> int:
        return self.structures.end[self.structures.begin[at]]

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

    # ---- jumps and calls

    def _jump(self, at: int, block: Block, step: Jump) -> int | None:
        name = self._name(step.label)
        places = self._labelled(name, at)
        if len(step.ways) > 1 and len(places) > 1:
            raise block.refuse(f"{name} is the label of {len(places)} blocks")
        later, earlier = [place for place in places if place > at], [place for place in places if place <= at]
        found = {"F": later[:1], "B": earlier[-1:]}
        target = next((place for way in step.ways for place in found[way]), None)
        if target is None:
            if step.optional:
                return None
            raise block.refuse(f"no block with the label {name}")
        frame = self.frames[-1]
        if frame.last >= 0 and not frame.first <= target <= frame.last:
            raise block.refuse("a jump out of a part of the program that is repeated")
        self._jumped = True
        return target

    def _labelled(self, name: str, at: int) -> list[int]:
        """The blocks of a label in the program that a block belongs to."""
        return [place for place in self.labels.get(name, []) if self.programs[place] == self.programs[at]]

    def _name(self, label: str | Expression) -> str:
        value = label if isinstance(label, str) else evaluate(label, self.scope)
        return value if isinstance(value, str) else f"{value:.10g}"

    def _call(self, at: int, block: Block, step: Call) -> int | None:
        name = self._name(step.name)
        places = self.labels.get(name, [])
        if len(places) != 1:
            raise block.refuse(
                f"{len(places)} subprograms {name} in this file" if places else f"no {name} in this file"
            )
        times = 1 if step.times is None else whole(step.times, self.scope)
        if times < 1:
            return None
        if len(self.frames) > DEEPEST:
            raise block.refuse("subprograms that call each other without end")
        arguments: dict[int, Value | NotKnown] | None = None
        if step.arguments is not None:
            arguments = {number_: self._argument(expression) for number_, expression in step.arguments}
        self.scope.enter(arguments)
        self.frames.append(_Frame(at, places[0] + 1, -1, times - 1, True))
        return places[0] + 1

    def _argument(self, expression: Expression) -> Value | NotKnown:
        try:
            return evaluate(expression, self.scope)
        except NotKnown as reason:
            return reason

    def _return(self, _: int, block: Block, step: Return) -> int | None:
        if self.frames[-1].scoped:
            return self._leave()
        if step.outside:
            raise block.refuse(step.outside)
        return None

    def _leave(self) -> int:
        """The end of a subprogram or a part: once more, or behind its call."""
        frame = self.frames[-1]
        if frame.left > 0:
            frame.left -= 1
            return frame.first
        self.frames.pop()
        if frame.scoped:
            self.scope.leave()
        return self._behind(frame.caller)

    def _rerun(self, at: int, block: Block, step: Rerun) -> int | None:
        times = 1 if step.times is None else whole(step.times, self.scope)
        if times < 1:
            return None
        firsts = self._labelled(step.first, at)
        if len(firsts) != 1 or (firsts[0] >= at and not step.last) or "ENDLABEL" in self.labels:
            raise block.refuse(f"no block {step.first} before it, or more than one")
        last = at - 1
        if step.last:
            places = self._labelled(step.last, at)
            if len(places) != 1 or places[0] < firsts[0]:
                raise block.refuse(f"no block {step.last} behind {step.first}, or more than one")
            last = places[0]
        self.frames.append(_Frame(at, firsts[0], last, times - 1, False))
        self._jumped = True
        return firsts[0]
