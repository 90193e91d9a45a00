"""Blocks with the values that their formulas have when they run, one after the other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from postproc.text.block import Block, Word
from postproc.text.blocks import PlainRun
from postproc.text.expressions import (
    Constant,
    Expression,
    NotKnown,
    Position,
    Scope,
    coordinate,
    evaluate,
    may_be_one,
    number,
    variables,
)
from postproc.text.statements import TURNS, Code, Setting, Step, When

FREE = frozenset(("F", "S", "FU", "FZ", "FT"))
"""Addresses whose values need not be known: they move the tool nowhere."""


def straight(blocks: Iterable[Block | PlainRun], scope: Scope) -> Iterator[Block | PlainRun]:
    """The blocks of a program without jumps, with the values of their words."""
    for block in blocks:
        if isinstance(block, PlainRun) or block.code is None:
            yield block
            continue
        _assign(block, block.code.before, scope)
        yield with_values(block, scope)
        _assign(block, block.code.after, scope)


def with_values(block: Block, scope: Scope) -> Block:
    """The block with values instead of formulas; Refusal if the value of a moving word is not known."""
    if all(word.formula is None and not word.arguments for word in block.words):
        return block
    return block._replace(words=tuple(_with_value(block, word, scope) for word in block.words))


def _with_value(block: Block, word: Word, scope: Scope) -> Word:
    if word.arguments:
        return word._replace(arguments=tuple(_argument(argument, scope) for argument in word.arguments))
    if word.formula is None:
        return word
    try:
        value = coordinate(word.formula.expression, scope)
    except NotKnown as reason:
        if word.address in FREE:
            return word
        raise block.refuse(f"{block.text[word.at : word.end + word.tail]}: {reason}") from None
    if isinstance(value, Position) and word.address not in FREE:
        return word._replace(value=float(value), formula=word.formula._replace(reads=True))
    return word._replace(value=float(value))


def _argument(expression: Expression, scope: Scope) -> Expression:
    """An argument of a call at this block: its value where it reads variables that are known."""
    if not any(True for _ in variables(expression)):
        return expression
    try:
        value = evaluate(expression, scope)
    except NotKnown:
        return expression
    return expression if isinstance(value, Position) else Constant(value)


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
    """The block, refused if it sets a variable and reads it elsewhere: controls evaluate it in different orders."""
    code = block.code or Code()
    steps = [step for step in code.before + code.after if isinstance(step, Setting)]
    if not steps:
        return block
    read = [(-1, v) for word in block.words if word.formula for v in variables(word.formula.expression)]
    read += [(-1, v) for word in block.words for e in word.arguments or () for v in variables(e)]
    for i, step in enumerate(steps):
        read += [(i, v) for e in (step.value, *step.target.indices) for v in variables(e)]
    for i, step in enumerate(steps):
        if any(j != i and may_be_one(variable, step.written) for j, variable in read):
            raise block.refuse(
                "variable assigned and used in the same block: the order of evaluation depends on the control"
            )
    return block
