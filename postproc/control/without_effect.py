"""Parts of the set-up that were given for this run and have no effect on the program: misspelt, perhaps."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Sequence

import msgspec

from kinematics.user_error import UserError
from postproc.control.setup import Origin
from postproc.control.state import ControlState
from postproc.control.tool_table import shown_tool


class Unused(msgspec.Struct, frozen=True):
    """A part of the set-up that was given and that the program does not use."""

    name: str
    """What it is: `work offset G45`."""
    instead: tuple[str, ...] = ()
    """Names that the program uses in its place; empty where the name is not likely to be a mistake."""

    @property
    def note(self) -> str:
        """A sentence for the user."""
        return f"{self.name} was given and is not used"

    @property
    def mistake(self) -> str:
        """The refusal; empty where the name is not likely to be a mistake."""
        if not self.instead:
            return ""
        name, used = self.name.split()[-1], " and ".join(self.instead)
        alike = [each for each in self.instead if _alike(name, each)] or self.instead
        meant = f" (did you mean {alike[0]!r}?)" if len(alike) == 1 else ""
        were = "were" if len(self.instead) > 1 else "was"
        cure = f"correct the name, or leave {name} out"
        return f"{self.note}: the program uses {used}, which {were} not given{meant}; {cure}"


def unused_set_up(state: ControlState) -> list[Unused]:
    """The parts of the set-up that were given, and that no move of the program used.

    A name that was given one by one is likely to be a mistake where the program uses a value that nobody gave for this
    run, neither one by one nor in a table; or a name with the same digits.
    """
    setup = state.setup
    offsets = {name: state.offset_origin(name) for name in state.used_offsets}
    tools = {name: state.tool_origin(name) for name in state.used_tools}
    return [
        *_unused(
            "work offset", setup.work_offsets, setup.given_offsets, _not_set(offsets), setup.work_offsets, offsets
        ),
        *_unused("the datum of", setup.obtained, frozenset(setup.obtained), offsets, setup.obtained, offsets),
        *_unused("tool length", setup.given_tools, setup.given_tools, _not_set(tools), setup.tools, tools, shown_tool),
    ]


def refuse_without_effect(unused: Iterable[Unused]) -> None:
    """UserError for the first part of the set-up whose name is likely to be a mistake."""
    for each in unused:
        if each.mistake:
            raise UserError(each.mistake)


def unused_by_all(programs: Sequence[Iterable[Unused]]) -> list[str]:
    """Sentences on parts of the set-up that none of several programs uses, where the name is likely to be a mistake."""
    common = set.intersection(*({each.name for each in unused} for unused in programs)) if programs else set()
    mistakes = {each.name: each.mistake for unused in programs for each in unused if each.mistake}
    return [f"NOT USED BY ANY PROGRAM: {text}" for name, text in sorted(mistakes.items()) if name in common]


def _not_set(origins: dict[str, Origin | None]) -> list[str]:
    """The names whose values the program has not set itself."""
    return [name for name, origin in origins.items() if origin is not Origin.PROGRAM]


def _unused(
    kind: str,
    given: Collection[str],
    one_by_one: frozenset[str],
    of_set_up: Iterable[str],
    for_this_run: Collection[str],
    used: Collection[str],
    shown: Callable[[str], str] = str,
) -> list[Unused]:
    """The names of a kind that are given and not used.

    of_set_up: used names whose values come from the set-up; for_this_run: names with a value from options or tables.
    """
    others = [name for name in of_set_up if name not in one_by_one]
    found = []
    for name in sorted(set(given) - set(used), key=lambda name: (len(name), name)):
        instead = [shown(each) for each in others if each not in for_this_run or _alike(name, each)]
        found.append(Unused(f"{kind} {shown(name)}", tuple(instead) if name in one_by_one else ()))
    return found


def _alike(name: str, other: str) -> bool:
    """True for names whose first numbers have the same digits: G45, 54 and G54P1 are like G54, and H1 is like T1."""
    digits = [sorted(number[0]) for number in (re.findall(r"\d+", name), re.findall(r"\d+", other)) if number]
    return len(digits) == 2 and digits[0] == digits[1]
