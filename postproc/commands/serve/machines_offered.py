"""The machines that the page offers: those that ncomp knows by their names, and those of the history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import machines as shipped
from kinematics.user_error import UserError
from postproc.commands.serve.forms import Offered, Task


class Row(NamedTuple):
    """A machine in the list."""

    name: str
    chain: str
    description: str
    life: str
    """Number and dates of its entries in the history; empty without one."""


@dataclass(frozen=True)
class Machines:
    """The machines of a server."""

    history: str | None
    """Database of their lives; None without one."""

    @property
    def names(self) -> list[str]:
        """Names of the machines that ncomp knows, those of the user first."""
        others = [path.stem for path in shipped.own() if path.stem not in shipped.names()]
        return [*sorted(others), *shipped.names()]

    def offered(self, task: Task) -> Offered:
        """The machines that a form offers."""
        return {"machine": lambda: self.names if task.suffixes else list(self._lives())}

    def words(self, task: Task) -> Mapping[str, Sequence[str]]:
        """The words that name the database of the history."""
        return {} if task.suffixes or self.history is None else {"db": [f"--db={self.history}"]}

    def rows(self) -> list[Row]:
        """All machines, also those that only the history knows."""
        lives = self._lives()
        names = dict.fromkeys((*self.names, *lives))
        return [Row(name, *_chain_of(name), lives.get(name, "")) for name in names]

    def _lives(self) -> dict[str, str]:
        """The machines of the history, with the number and the dates of their entries."""
        if self.history is None:
            return {}
        from history.database import opened
        from history.entries import lives

        with opened(self.history, writes=False) as session:
            found = lives(session)
        return {each.machine: f"{each.entries}, {each.first[:10]} to {each.last[:10]}" for each in found}


def _chain_of(name: str) -> tuple[str, str]:
    """Chain and description of a machine, or why its file cannot be used."""
    try:
        machine = shipped.load(name)
    except UserError as fault:
        return "", str(fault)
    return machine.chain, machine.description
