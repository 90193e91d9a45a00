"""A format of a control: its settings, the unit and the sign of its numbers, and the sentences of its page."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import msgspec

from kinematics.machine import Control, Machine
from kinematics.user_error import UserError
from postproc.control.codes import UNIT_NAMES
from postproc.control_data.readers.control_source import Source

if TYPE_CHECKING:
    from kinematics.effects import Effect
    from kinematics.error_model.model import ErrorModel
    from postproc.control_data.exported import ExportedData

Sign = Literal["error", "correction"]
"""Meaning of the values of a file: actual minus commanded, or the correction of the command."""


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the control that a user gives with `--set NAME=VALUE`."""


def metric(_settings: Settings, _control: Control) -> str:
    """The unit of a format whose files are in mm on every control."""
    return "mm"


def of_machine(settings: Any, control: Control) -> str:
    """The unit of a format whose files are in the unit of the machine, a parameter that no program shows.

    settings: with an entry `machine_unit`.
    """
    if control.unit == "inch" and settings.machine_unit != "mm":
        raise UserError(
            "tables of this control are in the unit of the machine, a parameter of its own, and not in the unit of its "
            'programs (unit = "inch" under [control]): give --set machine_unit=mm if the machine is metric. Tables for '
            "a machine in inches are not available: no source states their detection unit"
        )
    return "mm"


def of_control(_settings: Settings, control: Control) -> str:
    """The unit of a format whose files are in the unit of the control."""
    return control.unit or "mm"


class Read(NamedTuple):
    """The content of the files of a control."""

    effects: list[Effect]
    """The errors that they correct."""
    not_read: tuple[str, ...]
    """Names of files that nothing was read of."""
    unit_assumed: bool
    """True where neither the machine file nor the files state the unit of the lengths: they are taken in mm."""


@dataclass(frozen=True, kw_only=True)
class Format(ABC):
    """One format of one control: a `TableFormat`, or a `ParameterFormat`."""

    KIND: ClassVar[str]
    """`tables` or `parameters`, for sentences."""
    LOADED: ClassVar[str]
    """What a user does with the files, for sentences: `loading the tables`."""
    ROTARY: ClassVar[bool] = False
    """True where the sign is shown by a rotary axis."""
    ALONG_PROGRAMS: ClassVar[bool] = False
    """True where the remaining errors are evaluated along programs, too."""

    name: str
    title: str
    settings: type[Settings]
    meaning: str
    """For sheet.md: meaning of a value of the file, units, direction, interpolation, outside the table."""
    loading: str
    """For sheet.md: how the files are loaded into the control."""
    certainty: str
    """For sheet.md: certainty of this description."""
    sign: Sign | None = None
    """Meaning of its values, of parameters the direction of their changes; None if no source states it."""
    unit: Callable[[Any, Control], str] = metric
    """Unit of the lengths in its files, `mm` or `inch`, by settings and control; UserError where it is unknown."""

    @property
    def provenance(self) -> str:
        """Name of its files in the provenance of a model."""
        return self.title

    @abstractmethod
    def export(
        self, machine: Machine, model: ErrorModel, settings: Settings, sign: Sign, tool: tuple[float, ...]
    ) -> ExportedData:
        """The data of a control for a calibration, and for the vector from the spindle nose to the tool tip, mm."""

    @abstractmethod
    def probe(self, machine: Machine, axis: str, settings: Settings) -> dict[str, str]:
        """Files with one harmless value that shows the sign, and instructions, `probe.md`; UserError without one."""

    @abstractmethod
    def errors_in(self, source: Source) -> list[Effect]:
        """The errors that the data in files correct; UserError, located, for a file that cannot be used."""

    def read_files(
        self,
        machine: Machine,
        files: Mapping[str, str],
        sign: Sign,
        settings: Sequence[str] = (),
        searched: frozenset[str] = frozenset(),
    ) -> Read:
        """The errors that the data in files correct, by settings `NAME=VALUE`.

        searched: names of files that were found in a folder; UserError for another one without any data.
        """
        chosen = parse_settings(self.settings, settings)
        length_mm = UNIT_NAMES[self.unit(chosen, machine.control)]
        source = Source(machine, files, sign, chosen, searched, length_mm=length_mm)
        effects = self.errors_in(source)
        assumed = self.unit is of_control and not machine.control.unit and not source.with_unit
        return Read(effects, tuple(source.unused), assumed)


def parse_settings(kind: type[Settings], texts: Iterable[str]) -> Settings:
    """Settings from `NAME=VALUE`; UserError for one that the format has not, or that is out of its bounds."""
    values: dict[str, str] = {}
    names = [field.name for field in msgspec.structs.fields(kind)]
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or name not in names:
            raise UserError(f"--set {text}: expected NAME=VALUE with a name of {', '.join(names) or 'none'}")
        if name in values:
            raise UserError(f"--set {text}: {name} is given twice: give it once")
        values[name] = value
    for field in msgspec.structs.fields(kind):
        if field.required and field.encode_name not in values:
            raise UserError(
                f"--set {field.name}=VALUE is missing, and the format needs it: docs/tables.md has its form"
            )
    try:
        return msgspec.convert(values, kind, strict=False)
    except msgspec.ValidationError as fault:
        raise UserError(f"--set: {fault}") from None


def sign_of(format: Format, given: str | None, probe: str = "ncomp export --probe AXIS") -> Sign:
    """Meaning of the values of its files; UserError if it is not known, or contradicts the option.

    probe: the command that writes the table which shows the sign.
    """
    if given not in (None, "error", "correction"):
        raise UserError(f"--sign {given}: expected error or correction")
    if format.sign is None and given is None:
        raise UserError(
            f"no source states whether values of {format.name} are errors or corrections: find out with the table that "
            f"'{probe}' writes, and give --sign error or --sign correction"
        )
    if format.sign is not None and given not in (None, format.sign):
        raise UserError(f"--sign {given}: values of {format.name} are known to mean the {format.sign}")
    return format.sign or ("error" if given == "error" else "correction")


def in_words(text: str, unit: str) -> str:
    """A text for sheet.md with the name of the unit of lengths in the place of `{unit}`."""
    return text.replace("{unit}", "inches" if unit == "inch" else unit)
