"""LinuxCNC's INI file, read by LinuxCNC's own rules.

The names of sections and entries are exact: capitals and small letters differ. A line may be indented, and it may go on
behind a backslash. The first section of a name and the first entry of a name count, and only `=` separates an entry
from its value. LinuxCNC passes over every other line without a message. Where such a line looks like an entry that is
asked for, it is refused. Rules: LinuxCNC 2.9, its program `inivar`, and its start script for `#INCLUDE`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from kinematics.user_error import UserError
from postproc.control.codes import INCH

LENGTHS_MM = {"mm": 1.0, "metric": 1.0, "in": INCH, "inch": INCH, "imperial": INCH}
"""Units of LINEAR_UNITS, in capitals or not."""
ANGLES_DEG = {"deg": 1.0, "degree": 1.0, "rad": math.degrees(1.0), "radian": math.degrees(1.0)}
"""Units of ANGULAR_UNITS. Not `grad` and `gon`: LinuxCNC 2.9 moves an axis by 81 of them for 90 degrees."""
LETTERS = "XYZABCUVW"
JOINTS_OF = {"trivkins": LETTERS, "xyzac-trt-kins": "XYZAC", "xyzbc-trt-kins": "XYZBC", "5axiskins": "XYZBCW"}
"""Letters of the joints of each kinematics module whose joints are axes, where `coordinates=` is not given."""
_INCLUDE = re.compile(r"#INCLUDE(?:\s+(\S.*?))?\s*$")


@dataclass(frozen=True)
class Line:
    """A line of the INI file, or of a file that it includes."""

    file: str
    number: int
    text: str

    def refusal(self, why: str) -> UserError:
        """A refusal of this line."""
        return UserError(f"{self.file}:{self.number}: {self.text.strip()!r}: {why}")


@dataclass(frozen=True)
class Section:
    """A section as it is written, with its heading and the lines below it."""

    name: str
    heading: Line
    lines: list[Line]

    def like(self, entry: str) -> list[Line]:
        """The lines that look like this entry, whatever their capitals and their separator."""
        pattern = re.compile(rf"\s*{re.escape(entry)}(\s*[=:]|\s.*=)", re.I)
        return [line for line in self.lines if pattern.match(line.text)]


@dataclass(frozen=True)
class IniFile:
    """The INI file `name` of LinuxCNC, with the texts of the files that it may include."""

    name: str
    texts: Mapping[str, str]

    def value(self, section: str, entry: str) -> str | None:
        """The value that LinuxCNC takes; None where it finds none. UserError for a line that it would pass over."""
        found = self.line(section, entry)
        return None if found is None else found.text.partition("=")[2].strip()

    def line(self, section: str, entry: str) -> Line | None:
        """The line whose value LinuxCNC takes; None where it finds none, or none with a value."""
        first: Line | None = None
        for k, each in enumerate(self._alike(section)):
            for line in each.like(entry):
                if k or each.name != section:
                    why = f"LinuxCNC reads only the first section [{section}], and names are exact"
                    raise line.refusal(f"{why}: this line is in [{each.name}], line {each.heading.number}")
                if not re.match(rf"\s*{re.escape(entry)}\s*=", line.text):
                    raise line.refusal(f"LinuxCNC does not read it as {entry} = VALUE: write it so")
                if first is not None:
                    raise line.refusal(f"{entry} is given twice, and LinuxCNC reads line {first.number}: delete one")
                first = line
        return first if first is not None and first.text.partition("=")[2].strip() else None

    @cached_property
    def sections(self) -> list[Section]:
        """All sections, in the order of the file."""
        found: list[Section] = []
        for line in self._lines:
            if line.text.lstrip().startswith("["):
                found.append(Section(line.text.lstrip()[1:].partition("]")[0], line, []))
            elif found:
                found[-1].lines.append(line)
        return found

    @cached_property
    def included(self) -> list[str]:
        """Names of the files that the INI file includes."""
        return list(dict.fromkeys(line.file for line in self._lines if line.file != self.name))

    def _alike(self, section: str) -> list[Section]:
        """The sections of this name; then those whose names differ from it by capitals or spaces only."""
        alike = [each for each in self.sections if each.name.strip().upper() == section.upper()]
        return sorted(alike, key=lambda each: each.name != section)

    @cached_property
    def _lines(self) -> list[Line]:
        """All lines but comments and empty ones, those of included files in the place of `#INCLUDE`."""
        own = self._joined(self.name)
        if not any(_INCLUDE.match(line.text) for line in own):
            return [line for line in own if not _is_comment(line.text)]
        found: list[Line] = []
        for line in own:
            include = _INCLUDE.match(line.text.strip())
            if include is None:
                found.append(line)
                continue
            for other in self._joined(self._included(line, include[1])):
                if _INCLUDE.match(other.text):
                    raise other.refusal("LinuxCNC reads no #INCLUDE in a file that is included itself")
                found.append(other)
        return [line for line in found if not _is_comment(line.text)]

    def _included(self, line: Line, path: str | None) -> str:
        name = (path or "").rsplit("/", 1)[-1]
        if name not in self.texts or name == self.name:
            raise line.refusal(f"the file {name or 'to include'} is not among the files: give it as well")
        return name

    def _joined(self, name: str) -> list[Line]:
        """The lines of a file, each with those that a backslash at its end joins to it."""
        found: list[Line] = []
        goes_on = False
        for number, row in enumerate(self.texts[name].splitlines(), 1):
            text = row.rstrip("\r")
            if goes_on:
                found[-1] = Line(name, found[-1].number, found[-1].text + text.removesuffix("\\"))
            else:
                found.append(Line(name, number, text.removesuffix("\\")))
            goes_on = text.endswith("\\")
        return found


def _is_comment(text: str) -> bool:
    return not text.strip() or text.strip()[0] in "#;"


def length_unit_mm(ini: IniFile) -> float | None:
    """The unit of lengths, mm, by LINEAR_UNITS; None where the file does not state it, as a part of an INI file."""
    return _unit(ini, "LINEAR_UNITS", LENGTHS_MM, "mm or inch")


def angle_unit_deg(ini: IniFile) -> float | None:
    """The unit of angles, degrees, by ANGULAR_UNITS; None where the file does not state it."""
    return _unit(ini, "ANGULAR_UNITS", ANGLES_DEG, "degree or radian")


def _unit(ini: IniFile, entry: str, units: Mapping[str, float], expected: str) -> float | None:
    line = ini.line("TRAJ", entry)
    if line is None:
        return None
    text = line.text.partition("=")[2].strip()
    if text.lower() in units:
        return units[text.lower()]
    try:
        per_unit = float(text)  # the number of units in a mm or degree
    except ValueError:
        per_unit = math.nan
    if not 0.0 < per_unit < math.inf:
        raise line.refusal(f"{entry} {text} is not read: expected {expected}")
    return 1.0 / per_unit


def joint_letters(ini: IniFile) -> str | None:
    """The letter of the axis that each joint moves, from joint 0; None where the file names no kinematics module.

    UserError for a module whose joints are no axes.
    """
    line = ini.line("KINS", "KINEMATICS")
    if line is None:
        return None
    module, *options = line.text.partition("=")[2].split()
    given = [option.partition("=")[2] for option in options if option.startswith("coordinates=")]
    if module not in JOINTS_OF:
        raise line.refusal(
            f"ncomp does not know which axes the joints of {module} move: give --set joints= with the letter of each "
            "joint, if each of them moves one axis"
        )
    letters = given[-1].upper() if given else JOINTS_OF[module]
    if not set(letters) <= set(LETTERS):
        raise line.refusal(f"coordinates={given[-1]}: expected letters of {LETTERS}")
    return letters


def agreed(letters: str | None, stated: str, ini: IniFile, fallback: Sequence[str]) -> list[str]:
    """The letters of the joints: those of the INI file, those that the user states, or `fallback`."""
    if letters and stated and letters != stated.upper():
        kins = ini.line("KINS", "KINEMATICS")
        assert kins is not None
        raise kins.refusal(f"its joints are {letters}, and --set joints={stated} contradicts it: leave it out")
    return list(letters or stated.upper() or fallback)
