"""Data of a control that were made of a calibration: what they hold, what they leave, and their lists for people."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from kinematics.error_model.joined import joined
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.control_data.format import Format, Settings, Sign, in_words
from rendering.shown import Shown

if TYPE_CHECKING:
    from rendering.volume import Field

WORTH_UM = 0.05
"""RMS: smaller errors that the data cannot hold are not named."""


class Unrepresented(NamedTuple):
    """A remaining error."""

    name: str
    rms_um: float
    """RMS at the tool point over the volume, in addition to the part that the data correct; NaN: not known."""
    why: str


class Listing(NamedTuple):
    """A list of contents, for sheet.md and for the report."""

    title: str
    head: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    sheet: str | None
    """Sentence before the list in sheet.md; None: it is not there."""
    report: str | None
    """The same for the report."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """The sentences and lists by which sheet.md and the report differ."""

    tool: str
    """The tool, in words."""
    stages: Mapping[str, str]
    """Kinds of correction whose remaining errors are given, in words."""
    stage: str
    """The one with the data in the control and what belongs to them."""
    remark: str = ""
    """Sentence behind the tool point error of that stage."""
    shift: str
    """The shift of zeros or of work offsets that belongs to the data; empty if there is none."""
    notices: list[str]
    """Paragraphs at the top of sheet.md."""
    meanings: list[str]
    """Paragraphs on the meaning of the numbers."""
    listings: list[Listing]
    """What the files hold."""
    fields: Sequence[Field] = ()
    """Errors that are drawn over the volume."""
    decimals: int
    """Decimals of the errors that the data cannot hold, um, in sheet.md."""
    closing: Sequence[str] = ()
    """Last lines of sheet.md, on other errors than those of the tool point."""


@dataclass(frozen=True, repr=False)
class ExportedData(Shown):
    """Data of one control: its tables, or its kinematic parameters."""

    format: Format
    """The format of the data."""
    machine: Machine
    """The machine."""
    settings: Settings
    """Settings of the control."""
    sign: Sign
    """Meaning of the values: errors, or their correction."""
    tool: Array
    """`(3,)`, mm: the vector from the spindle nose to the tool tip."""
    whole: ErrorModel
    """The calibration."""

    @property
    @abstractmethod
    def files(self) -> dict[str, str]:
        """Texts of the files by their names."""

    @property
    @abstractmethod
    def taken(self) -> ErrorModel:
        """The errors that the data correct."""

    @property
    @abstractmethod
    def left(self) -> list[Unrepresented]:
        """Errors that the data cannot hold, the largest first."""

    @abstractmethod
    def errors_in_the_volume(self) -> dict[str, Any]:
        """Tool point and axis errors over the working volume, by stage."""

    @abstractmethod
    def page(self, volume: Mapping[str, Any]) -> Page:
        """Sentences and lists for people; `volume`: the errors over the working volume."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return f"{self.format.name}: {', '.join(self.files)}"

    @property
    def unit(self) -> str:
        """Unit of the lengths in the files."""
        return self.format.unit(self.settings, self.machine.control)

    @property
    def rest(self) -> ErrorModel:
        """The calibration less the errors that the data correct: what corrected programs must still correct."""
        left = joined(self.whole, self.taken.effects, -1.0)
        less = f"less {self.format.KIND} in the control ({self.format.name})"
        source = f"{self.whole.provenance.source}; {less}".lstrip("; ")
        return msgspec.structs.replace(left, provenance=msgspec.structs.replace(left.provenance, source=source))

    @property
    def loading(self) -> str:
        """How the files are loaded into the control."""
        return in_words(self.format.loading, self.unit)

    @property
    def origin(self) -> str:
        """Where the sign comes from."""
        return "known for this format" if self.format.sign else "as given by --sign; no source confirms it"

    @property
    def unit_notes(self) -> list[str]:
        """The unit of the files, for a control in inches, or for files in inches; nothing where all is in mm."""
        if "inch" not in (self.unit, self.machine.control.unit):
            return []
        files = in_words("**Lengths in the files are in {unit}, angles in degrees.", self.unit)
        return [f"{files} Lengths on this page are in mm, unless another unit is given with them.**"]
