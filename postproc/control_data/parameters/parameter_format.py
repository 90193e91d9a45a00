"""A format of kinematic parameters: the lines that a control can move, its numbers, their writer and their reader."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from kinematics.user_error import UserError
from postproc.control.codes import UNIT_NAMES
from postproc.control_data.format import Format, Settings, Sign
from postproc.control_data.parameters.far_lines import refuse_far_lines
from postproc.control_data.parameters.line_errors import errors_of_lines
from postproc.control_data.parameters.parameter_numbers import Number, with_lengths
from postproc.control_data.parameters.rotary_lines import Freedom, reflected

if TYPE_CHECKING:
    from kinematics.effects import Effect
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from postproc.control_data.parameters.export_parameters import ExportedParameters
    from postproc.control_data.readers.control_source import Source
    from postproc.control_data.tables.table_format import TableFormat


@dataclass(frozen=True, kw_only=True)
class ParameterFormat(Format):
    """The kinematic parameters of one control."""

    KIND: ClassVar[str] = "parameters"
    LOADED: ClassVar[str] = "setting any parameter"
    ROTARY: ClassVar[bool] = True

    freedoms: Callable[[Machine, Any], list[Freedom]]
    """Changes of lines that the control can hold, by the user's settings; UserError for a machine that it cannot."""
    numbers: Callable[[Machine, Any], list[Number]]
    """All numbers for a machine with these lines, in the unit of its lengths."""
    write: Callable[[Sequence[Number], Machine, Any, str], str]
    """Text of a file with these numbers, under a heading."""
    file: str
    """Name of the file; that of the present values has `_before` in front of its suffix."""
    steps: Callable[[Any], tuple[float, float]]
    """By the user's settings: steps of the values that the control stores, in the unit of its lengths, and rad."""
    read: Callable[[Source, str, Machine], Machine]
    """The machine with the lines of a file, by its name, in the unit of its lengths; shares no code with the writer."""
    tables: TableFormat
    """Format of the same control's tables, for the remaining error with both."""
    unit_beside: Callable[[Source], float | None] = lambda _: None
    """The unit of lengths, mm, by another file of the control; None where there is none."""
    remark: Callable[[Machine], str] = lambda _: ""
    """For sheet.md, behind `meaning`: what holds for this machine."""

    @property
    def provenance(self) -> str:
        """See `Format.provenance`."""
        return self.name

    @property
    def file_before(self) -> str:
        """Name of the file with the values by the machine file."""
        stem, dot, suffix = self.file.rpartition(".")
        return f"{stem}_before{dot}{suffix}"

    def numbers_of(self, machine: Machine, settings: Any) -> list[Number]:
        """All numbers for a machine, in the unit of the control."""
        unit = self.unit(settings, machine.control)
        found = self.numbers(with_lengths(machine, 1.0 / UNIT_NAMES[unit]), settings)
        return [each._replace(unit=unit) if each.unit == "mm" else each for each in found]

    def steps_of(self, machine: Machine, settings: Any) -> tuple[float, float]:
        """Steps, mm and rad, of the values that the control stores."""
        length, angle = self.steps(settings)
        return length * UNIT_NAMES[self.unit(settings, machine.control)], angle

    def files(
        self, machine: Machine, settings: Settings, numbers: Sequence[Sequence[Number]], headings: Sequence[str]
    ) -> dict[str, str]:
        """Texts by name: the numbers that are set and those of the machine file, each under its heading."""
        rows = zip((self.file, self.file_before), numbers, headings, strict=True)
        return {file: self.write(found, machine, settings, heading) for file, found, heading in rows}

    def export(
        self, machine: Machine, model: ErrorModel, settings: Settings, sign: Sign, tool: tuple[float, ...]
    ) -> ExportedParameters:
        """See `Format.export`."""
        from postproc.control_data.parameters.export_parameters import export_parameters

        return export_parameters(machine, model, self, settings, sign, tool)

    def probe(self, machine: Machine, axis: str, settings: Settings) -> dict[str, str]:
        """See `Format.probe`."""
        from postproc.control_data.parameters.parameter_probe import probe

        return probe(machine, axis, self, settings)

    def errors_in(self, source: Source) -> list[Effect]:
        """See `Format.errors_in`; the errors are differences from the lines of the machine file."""
        machine, (moved, name) = source.machine, self.lines_in(source)
        refuse_far_lines(machine, moved, name)
        return errors_of_lines(machine, moved if source.value_is == "correction" else reflected(machine, moved))

    def lines_in(self, source: Source) -> tuple[Machine, str]:
        """The machine with the lines of the files, mm, and the name of the file of parameters."""
        self.freedoms(source.machine, source.settings)
        own, machine = source.in_units(self.unit_beside(source) or source.length_mm, 1.0), source.machine
        named = [name for name in source.unused if not name.endswith(self.file_before)]
        if len(named) != 1:
            raise UserError(f"{self.name}: expected one file of parameters, found {', '.join(named) or 'none'}")
        lines = self.read(own, named[0], with_lengths(machine, 1.0 / own.length_mm))
        source.used.update(source.files)
        source.with_unit.update(source.files)  # lines in another unit would be far from those of the machine file
        return with_lengths(lines, own.length_mm), named[0]
