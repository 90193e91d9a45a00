"""Words of ISO / Fanuc / LinuxCNC blocks that call subprograms and macros, or end them, as statements."""

from __future__ import annotations

import re

from postproc.control.codes import LARGEST_CODE
from postproc.text.block import Block, Word
from postproc.text.expressions import Constant, Expression, Operation
from postproc.text.statements import Call, Code, EndModal, Modal, Return, Step

CALLS = re.compile(r"(?:M[ \t]*\+?[ \t]*0*(?:9[789]|198)|G[ \t]*\+?[ \t]*0*6[5-7])(?:\.0*)?(?![\d.])", re.IGNORECASE)
"""Words that call a subprogram or end one."""
SUBPROGRAM, RETURN, MACRO, MODAL, MODAL_END = ("M", 98.0), ("M", 99.0), ("G", 65.0), ("G", 66.0), ("G", 67.0)
ELSEWHERE = ("M", 198.0)
"""FANUC: as M98, of a program on another device of the control."""
NUMBERED = ("M", 97.0)
"""HAAS: as M98, of the blocks of this program from one with a number on."""
CALLING = frozenset((SUBPROGRAM, ELSEWHERE, NUMBERED, RETURN, MACRO, MODAL, MODAL_END))
ARGUMENTS = dict(zip("ABCDEFHIJKMQRSTUVWXYZ", (1, 2, 3, 7, 8, 9, 11, 4, 5, 6, 13, *range(17, 27)), strict=True))
"""Local variables that take the words after G65 and G66."""
LAST_ARGUMENT = 33


def names(file: str) -> list[str]:
    """The names by which the program in a file is called: O1000 for `O1000.nc` and `1000`, O<name> for `name.ngc`."""
    stem = file.rpartition(".")[0] or file
    numbered = re.fullmatch(r"[Oo]?0*(\d+)", stem)
    return [f"O<{stem.lower()}>", *([f"O{numbered[1]}"] if numbered else [])]


def with_calls(block: Block) -> Block:
    """The block with M97, M98, M99, G65, G66 and G67 as statements and no longer as words."""
    found = [word for word in block.words if (word.address, word.value) in CALLING]
    if not found:
        return block
    if len(found) > 1 or (block.code and (block.code.before or block.code.after)):
        raise block.refuse(
            "a subprogram call must be the only call, jump or loop of its block: write the others in "
            "blocks of their own"
        )
    word = found[0]
    others = tuple(other for other in block.words if other is not word)
    match word.address, word.value:
        case ("G", 67.0):
            return _with_step(block, others, EndModal())
        case ("M", 99.0):
            return _with_return(block, others)
        case ("M", _):
            return _with_subprogram(block, word, others)
    return _with_macro(block, word, others)


def _with_step(block: Block, words: tuple[Word, ...], step: Step) -> Block:
    return block._replace(kind="words" if words else "control", words=words, code=Code((), (step,)))


def _with_return(block: Block, others: tuple[Word, ...]) -> Block:
    """M99, with P back to a block of the caller that it names."""
    if any(other.address in "LQ" for other in others):
        raise block.refuse("M99 with L or Q is not corrected: write M99 alone or with P")
    taken, kept = _taken(block, others, "P")
    label = _value(taken["P"]) if taken else None
    step = Return("M99 outside of a subprogram repeats the program without end: write M30", label)
    return _with_step(block, kept, step)


def _with_subprogram(block: Block, word: Word, others: tuple[Word, ...]) -> Block:
    """M97, M98 or M198 with P or `<NAME>`, and with a number of repetitions in L or in P."""
    code = f"M{word.value:g}"
    taken, kept = _taken(block, others, "PLO")
    times = _times(taken)
    if any(other.address in "HQ" for other in kept):
        raise block.refuse(f"{code} with the block number H or Q is not corrected: write the program number P only")
    if (word.address, word.value) == NUMBERED:
        numbered = Operation("numbered block", (_program(block, code, taken),))
        return _with_step(block, kept, Call(numbered, None, times, at_label=True))
    if "O" in taken:
        return _with_step(block, kept, Call(_named(block, code, taken), None, times))
    name: Expression = _program(block, code, taken)
    if times is None:
        name, times = Operation("repeated program", (name,)), Operation("repetitions", (name,))
    else:
        name = Operation("program", (name,))
    return _with_step(block, kept, Call(name, None, times))


def _with_macro(block: Block, word: Word, others: tuple[Word, ...]) -> Block:
    """G65 or G66 with arguments."""
    code = f"G{word.value:g}"
    repeated = _repeated(block, others)
    others = tuple(other for other in others if other not in repeated.values())
    taken, kept = _taken(block, others, "PLO" + "".join(ARGUMENTS))
    named = _named(block, code, taken) if "O" in taken else ""
    name = named or Operation("program", (_program(block, code, taken),))
    if any(other.address not in "NG" for other in kept):
        raise block.refuse(
            f"{code} cannot share a block with the other words of this one: write them in a block before it"
        )
    given = {ARGUMENTS[address]: taken[address] for address in taken if address in ARGUMENTS}
    if given.keys() & repeated.keys():
        raise block.refuse("two arguments of the call have one variable: write one of them")
    arguments = tuple((number, _argument(block, argument)) for number, argument in (given | repeated).items())
    call = Call(name, arguments, _times(taken))
    return _with_step(block, kept, call if (word.address, word.value) == MACRO else Modal(call))


def _repeated(block: Block, words: tuple[Word, ...]) -> dict[int, Word]:
    """The second and later I, J and K by their variables, #7 to #9, #10 to #12 and so on (FANUC, HAAS).

    Refusal where they are not in the order I, J, K: FANUC takes `J1. I2.` for the first J and the second I.
    """
    found: dict[int, Word] = {}
    counts, group, last = dict.fromkeys("IJK", 0), 0, ""
    for word in words:
        if word.address in counts:
            group += word.address <= last
            last = word.address
            if group != counts[last]:
                raise block.refuse("the variables of I, J and K depend on their order: write them in the order I, J, K")
            if group:
                found[ARGUMENTS[last] + 3 * group] = word
            counts[last] += 1
    if found and max(found) > LAST_ARGUMENT:
        raise block.refuse("the call has more than ten I, J or K: write fewer")
    return found


def _taken(block: Block, words: tuple[Word, ...], addresses: str) -> tuple[dict[str, Word], tuple[Word, ...]]:
    """The words that a call takes, by address, and the others; Refusal for two of one address."""
    taken = [word for word in words if word.address in addresses]
    by_address = {word.address: word for word in taken}
    if len(taken) > len(by_address):
        raise block.refuse("the call has two words of one address: write one of them")
    return by_address, tuple(word for word in words if word.address not in addresses)


def _named(block: Block, code: str, taken: dict[str, Word]) -> str:
    """The name of the program that a call names instead of its number (FANUC)."""
    text = block.text[taken["O"].at : taken["O"].end]
    if "P" in taken or "<" not in text:
        raise block.refuse(f"{code} needs P, the number of the program, or its name <NAME>: write one of them")
    return program_name(text)


def program_name(text: str) -> str:
    """The label of a program with a name: O<shaft> for `<SHAFT>` and `O<SHAFT>`."""
    return f"O{text[text.index('<') :].lower()}"


def _program(block: Block, code: str, taken: dict[str, Word]) -> Expression:
    """The number of the program that a call names."""
    if "P" not in taken:
        raise block.refuse(f"{code} needs P, the number of the program: write it")
    name = taken["P"]
    if name.value is not None and not (name.value == int(name.value) and 0 <= name.value < LARGEST_CODE):
        raise block.refuse(f"P is not the number of a program: write a whole number from 0 to below {LARGEST_CODE:g}")
    return _value(name)


def _times(taken: dict[str, Word]) -> Expression | None:
    return _value(taken["L"]) if "L" in taken else None


def _value(word: Word) -> Expression:
    return word.formula.expression if word.formula else Constant(word.value or 0.0)


def _argument(block: Block, word: Word) -> Expression:
    """An argument; one without decimal point is a number of increments, for some controls."""
    if word.formula is None and word.value and "." not in block.text[word.start : word.end]:
        return Operation("the unit of an argument without decimal point", (Constant(word.value),))
    return _value(word)
