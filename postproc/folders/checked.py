"""The check of several programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from kinematics.machine import Machine
from postproc.control.without_effect import unused_by_all
from postproc.correct.check import Findings
from postproc.folders.programs import FolderProgram
from rendering.shown import Shown, html_of


@dataclass(frozen=True, repr=False)
class Checked(Shown):
    """The check of each program, by program."""

    machine: Machine
    """The machine."""
    findings: Mapping[FolderProgram, Findings]
    """Findings in each program."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        refused = sum(bool(found.refused) for found in self.findings.values())
        return f"{self.machine.name}, {len(self.findings) - refused} accepted, {refused} refused"

    @property
    def unused(self) -> list[str]:
        """Sentences on parts of the set-up that no program uses, where one uses others that were not given."""
        return unused_by_all([found.unused for found in self.findings.values() if not found.refused])

    @property
    def status(self) -> int:
        """Exit status: 2 if a program is refused or the set-up is unused, otherwise 0."""
        return 2 if self.unused or any(found.refused for found in self.findings.values()) else 0

    def _repr_html_(self) -> str:
        return "".join(html_of(found.report(program.name)) for program, found in self.findings.items())
