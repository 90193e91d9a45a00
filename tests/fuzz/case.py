"""One program with all that is needed to run it again, and the outcome of its examination."""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple, Protocol, cast

from tests.fuzz import EXAMINERS

FOUND = Path(__file__).with_name("found")


@dataclass(frozen=True)
class Case:
    """A run of ncomp: every text is latin-1, one character a byte."""

    program: str
    """The text that is drawn, judged and shrunk."""
    name: str = "part.nc"
    """File name of the program; its ending may decide the dialect."""
    machine: str = "gantry"
    """Name of a shipped machine, or the text of a machine file."""
    calibration: str = "none"
    """`none`, empty for the machine's own, or the text of a calibration file."""
    options: tuple[str, ...] = ()
    """Further options of the command line."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Other files that the options name, by name."""


class Verdict(StrEnum):
    """How an examination ended."""

    COMPARED = "compared"
    REFUSED = "refused"
    DIFFERS = "differs"


class Outcome(NamedTuple):
    """Verdict with its text: the class of a refusal, or `class: detail` of a difference."""

    verdict: Verdict
    text: str = ""

    @property
    def kind(self) -> str:
        """Class of a difference: its text up to the first colon."""
        return self.text.partition(":")[0]


class Examiner(Protocol):
    """A module of this package that examines."""

    @staticmethod
    def draw(seed: int) -> Case:
        """A random case; the same for the same seed."""

    @staticmethod
    def judge(case: Case) -> Outcome:
        """Run ncomp on a case and examine the result."""


def examiner(name: str) -> Examiner:
    """The examiner of that name."""
    if name not in EXAMINERS:
        raise SystemExit(f"no examiner {name}; there are {', '.join(EXAMINERS)}")
    return cast("Examiner", importlib.import_module(f"tests.fuzz.{name}"))


def save(name: str, case: Case, outcome: Outcome) -> Path:
    """Write a found difference; lines of the texts one by one, to be read by people."""
    content = asdict(case) | {"detail": outcome.text}
    for key in ("program", "machine", "calibration"):
        content[key] = _lines(content[key])
    content["files"] = {key: _lines(text) for key, text in case.files.items()}
    digest = hashlib.sha256(case.program.encode("latin-1")).hexdigest()[:8]
    path = FOUND / name / f"{'_'.join(outcome.kind.lower().split())[:40]}_{digest}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="ascii")
    return path


def load(path: Path) -> Case:
    """Read a found difference."""
    content = json.loads(path.read_text(encoding="ascii"))
    del content["detail"]
    for key in ("program", "machine", "calibration"):
        content[key] = _text(content[key])
    files = {key: _text(text) for key, text in content.pop("files").items()}
    return replace(Case(content.pop("program")), **content | {"options": tuple(content["options"])}, files=files)


def _lines(text: str) -> str | list[str]:
    """Text of one line as it is, longer ones as a list of lines with their ends."""
    return text.splitlines(keepends=True) if "\n" in text else text


def _text(lines: str | list[str]) -> str:
    return lines if isinstance(lines, str) else "".join(lines)
