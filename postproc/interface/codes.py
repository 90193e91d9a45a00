"""The public function on the codes of controls."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from kinematics.running.caller import public

if TYPE_CHECKING:
    from kinematics.machine import Machine
    from postproc.code_tables.search import Codes


@public
def codes(
    text: str = "",
    machine: str | Path | Machine | None = None,
    *,
    family: Literal["any", "fanuc", "linuxcnc", "grbl", "mach3"] | None = None,
    dialect: Literal["iso", "siemens", "heidenhain"] | None = None,
) -> Codes:
    """What codes mean to ncomp: followed, passed unchanged, or refused and why.

    text: a name (`G43.4`, `CYCLE81`, `FN 18`, `cycle 200`), or words of the meaning; all codes without it. family: of
    the ISO control that is meant, by default that of a machine, whose `pass_through` counts too; a code that needs
    another family is refused. dialect: one only.

    >>> [(each.entry.code, each.entry.verdict) for each in codes("G05.1", dialect="iso").found["iso"]]
    [('G5.1', 'passes')]
    """
    from machines.given import load_machine
    from postproc.code_tables import search

    return search.codes(text, None if machine is None else load_machine(machine), family, dialect)
