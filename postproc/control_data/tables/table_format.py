"""A format of compensation tables: what a control's tables can hold, their writer and their reader."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

from kinematics.user_error import UserError
from postproc.control.codes import UNIT_NAMES
from postproc.control_data.format import Format, Settings, Sign

if TYPE_CHECKING:
    from kinematics.effects import Effect
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from postproc.control_data.readers.control_source import Source
    from postproc.control_data.tables.build import Capabilities
    from postproc.control_data.tables.content import Content
    from postproc.control_data.tables.export_tables import Exported
    from postproc.control_data.tables.limits import Limits


@dataclass(frozen=True, kw_only=True)
class TableFormat(Format):
    """The compensation tables of one control."""

    KIND: ClassVar[str] = "tables"
    LOADED: ClassVar[str] = "loading the tables"
    ALONG_PROGRAMS: ClassVar[bool] = True

    limits: Callable[[Any], Limits]
    """By the user's settings."""
    write: Callable[[Content], dict[str, str]]
    """Files by name; UserError if the format cannot hold them."""
    read: Callable[[Source], list[Effect]]
    """The errors that the tables in files correct, by a reader that shares no code with the writer."""
    capabilities: Callable[[Any], Capabilities] | None = None
    """None of a format that holds error motions by ISO 230-1, which the control makes corrections of."""
    family: str = ""
    """The family of controls for the names of parameters in sheet.md."""
    remark: Callable[[Content], str] = lambda _: ""
    """For sheet.md, behind `loading`: what holds for these tables."""

    def limits_mm(self, settings: Settings, machine: Machine) -> Limits:
        """The limits with the unit of their lengths, mm."""
        return replace(self.limits(settings), length_mm=UNIT_NAMES[self.unit(settings, machine.control)])

    def export(
        self, machine: Machine, model: ErrorModel, settings: Settings, sign: Sign, tool: tuple[float, ...]
    ) -> Exported:
        """See `Format.export`."""
        from postproc.control_data.tables.export_tables import export

        return export(machine, model, self, settings, sign, tool)

    def probe(self, machine: Machine, axis: str, settings: Settings) -> dict[str, str]:
        """See `Format.probe`."""
        from postproc.control_data.tables.table_probe import probe

        return probe(machine, axis, self, settings)

    def errors_in(self, source: Source) -> list[Effect]:
        """See `Format.errors_in`; a file that was found in a folder may be without a table."""
        found = self.read(source)
        if not found:
            raise UserError(f"no table of format {self.name} in {', '.join(source.files) or 'no file'}")
        idle = [name for name in source.unused if name not in source.searched]
        if idle:
            raise UserError(
                f"{idle[0]}: nothing of it belongs to the tables of format {self.name}, which are in "
                f"{', '.join(sorted(source.used))}: leave it out, or name it where the control names its tables"
            )
        return found
