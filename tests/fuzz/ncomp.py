"""ncomp's command line in this process, on the files of a case."""

from __future__ import annotations

import json
import re
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from kinematics.user_error import UserError
from tests.fuzz.case import Case
from tests.support.command import run_raising

ENCODING = "latin-1"


class Run(NamedTuple):
    """The result of a run: exit status, text written (None: no file), text shown, and its machine-readable report."""

    status: int
    text: str | None
    shown: str
    report: dict[str, Any]

    @property
    def refusal(self) -> str:
        """The class of a refusal: its message without place, numbers and quoted text."""
        message = self.shown.strip().splitlines()[-1] if self.shown.strip() else ""
        return reason_of(message)


def reason_of(message: str) -> str:
    """A message without place, text of the block, numbers and names: what many refusals have in common."""
    message = re.sub(r"^.*?part\.\w+( \(unrolled\))?:\d+: ", "", message)
    message = re.sub(r" \(read as .*$", "", message)
    message = re.sub(r'"[^"]*"|\'[^\']*\'|`[^`]*`', "...", message)
    return re.sub(r"[-+]?\d+(\.\d+)?", "0", message)[:100]


def correct(case: Case, *more: str) -> Run:
    """`ncomp correct` on a case; a fault inside ncomp is raised."""
    return command("correct", case, "-o", "out.nc", "--json", "report.json", *more)


def command(name: str, case: Case, *options: str) -> Run:
    """A subcommand on the program of a case in a folder of its own; it may write `out.nc` and `report.json`."""
    with tempfile.TemporaryDirectory(prefix="ncomp-fuzz-") as folder:
        place = Path(folder)
        arguments = arguments_of(case, place)
        output, report = place / "out.nc", place / "report.json"
        given = [str(place / option) if option in {"out.nc", "report.json"} else option for option in options]
        try:
            done = run_raising(name, *arguments, *given)
            status, shown = done.status, done.shown
        except UserError as refusal:
            status, shown = 2, str(refusal)
        text = output.read_bytes().decode(ENCODING) if output.exists() else None
        content = json.loads(report.read_text(encoding="utf-8")) if report.exists() else {}
        return Run(status, text, shown.replace(folder + "/", ""), content)


def corrected_set(case: Case) -> tuple[Run, dict[str, str]]:
    """`ncomp correct` on a case whose files the program calls: the run, and the texts of all files that it writes."""
    with tempfile.TemporaryDirectory(prefix="ncomp-fuzz-") as folder:
        place, out = Path(folder), Path(folder) / "corrected"
        out.mkdir()
        arguments = arguments_of(case, place)
        try:
            done = run_raising("correct", *arguments, "-o", str(out / case.name))
            status, shown = done.status, done.shown
        except UserError as refusal:
            status, shown = 2, str(refusal)
        written = {path.name: path.read_bytes().decode(ENCODING) for path in sorted(out.iterdir())}
        return Run(status, written.get(case.name), shown.replace(folder + "/", ""), {}), written


def arguments_of(case: Case, place: Path) -> list[str]:
    """Write the files of a case to a folder; the arguments that name them."""
    for name, text in (case.files | {case.name: case.program}).items():
        (place / name).write_bytes(text.encode(ENCODING))
    machine, calibration = case.machine, case.calibration
    if "\n" in machine:
        (place / "machine.toml").write_text(machine, encoding="utf-8")
        machine = str(place / "machine.toml")
    if "{" in calibration:
        (place / "calibration.json").write_text(calibration, encoding="utf-8")
        calibration = str(place / "calibration.json")
    options = [str(place / option) if option in case.files else option for option in case.options]
    chosen = ["--calibration", calibration] if calibration else []
    return [str(place / case.name), "--machine", machine, *chosen, *options]
