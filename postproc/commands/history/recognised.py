"""Files as results of a machine, by their content."""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

import ncomp
from history.entries import FoundCause, Quantity, Result
from history.results import fingerprints, instant, of_calibration, of_results
from kinematics.files import read_input
from kinematics.files.certificate import carried
from kinematics.files.mistaken import kind_of_file
from kinematics.machine import Machine
from kinematics.user_error import UserError

CHECK = re.compile(
    r"\s*(?P<name>[^=]*[^=\s])\s*=\s*(?P<value>[-+]?\d*\.?\d+)\s*(?:\+-|±)\s*(?P<U>\d*\.?\d+)\s*(?P<unit>um/m|um|urad)\s*"
)
"""A single check: squareness X-Y=12.4 +- 3 um/m."""
OTHERS = (
    "name a calibration, results of ncomp iso230, ballbar, etve or diagnose, a measurement file or a corrected program"
)


def result_of(machine: Machine, path: Path, kind: str | None, at: datetime.datetime | None) -> Result:
    """The result in a file; UserError for one that is none, or of another machine."""
    content = read_input(path, "file")
    what = kind_of_file(content)
    files = fingerprints([path])
    if kind is not None:
        return Result(kind=kind, at=at or instant(None), title=f"{kind} {path.name}", files=files)
    if "certificate" in what:
        return _certificate(machine, path, content, at)
    if "calibration" in what:
        return _calibration(machine, path, content, at)
    if "JSON" in what:
        return _results(machine, path, content, at)
    if "measurement file" in what:
        return _measurement(machine, path, at)
    return _program(path, at)


def _certificate(machine: Machine, path: Path, content: bytes, at: datetime.datetime | None) -> Result:
    """What a certificate carries, at the last day of its measurement, by its instruments."""
    found = carried(content, str(path))
    enter = _calibration if "calibration" in kind_of_file(found.document) else _results
    made = enter(machine, path, found.document, at or instant(found.ended))
    return replace(made, title=f"{made.kind} by certificate {found.identifier}", method=found.equipment)


def _calibration(machine: Machine, path: Path, content: bytes, at: datetime.datetime | None) -> Result:
    """A calibration, with the files that it was made from where they are beside it."""
    from kinematics.error_model.model import decode_model

    made_from = decode_model(content, str(path)).provenance.inputs
    beside = {str(path.parent / name): known for name, known in made_from.items() if (path.parent / name).is_file()}
    return of_calibration(machine, content, str(path), files=fingerprints([path]) | beside, at=at)


def _results(machine: Machine, path: Path, content: bytes, at: datetime.datetime | None) -> Result:
    """The results of a command for programs."""
    from history.causes import of_diagnosis
    from history.figures import of_axes, of_circles, of_etve

    try:
        found: dict[str, Any] = msgspec.json.decode(content, type=dict[str, Any])
        own = found["provenance"]["machine"] or machine.name  # etve needs no machine
    except (msgspec.DecodeError, KeyError, TypeError):
        raise UserError(f"{path}: these are no results of ncomp (--json): {OTHERS}") from None
    if own != machine.name:
        raise UserError(f"{path} is of machine {own!r}, not of {machine.name}: enter it into the life of {own!r}")
    if at is None:
        raise UserError(f"{path}: results have no date: give that of the measurement with --at 2026-03-01")
    figures: Sequence[Quantity] = ()
    causes: Sequence[FoundCause] = ()
    if "axes" in found:
        kind, figures = "iso230-2", of_axes(found["axes"])
    elif "tests" in found and "causes" in found:
        kind, figures = "iso230-4", of_circles(machine, found)
    elif "etve" in found:
        kind, figures = "etve", of_etve(found)
    elif "effects" in found and "before" in found:
        kind, causes = "diagnosis", of_diagnosis(found["effects"])
    else:
        raise UserError(f"{path}: the history has no place for these results: {OTHERS}")
    title = f"{kind}, {path.name}"
    files = fingerprints([path])
    return of_results(kind, title, found, figures, method=kind, files=files, at=at, causes=causes)


def _measurement(machine: Machine, path: Path, at: datetime.datetime | None) -> Result:
    """A measurement file."""
    measured = ncomp.read_measurement(path, machine)
    kind = measured.instrument.kind()
    title = f"{path.name}: {len(measured)} rows, {kind}"
    moment = at or instant(measured.measured)
    return Result(kind="measurement", at=moment, title=title, method=kind, files=fingerprints([path]))


def _program(path: Path, at: datetime.datetime | None) -> Result:
    """A corrected program, by its mark."""
    from postproc.correct.mark import mark_in
    from postproc.text.source import open_source

    lines = (text for _, text in open_source(str(path)).lines())
    mark = next((text.strip() for text in lines if mark_in(text) is not None), None)
    if mark is None:
        raise UserError(
            f"{path}: this is no result that ncomp knows, nor a program that it has corrected: {OTHERS}; --kind tables "
            "or --kind parameters enters a file of a control"
        )
    return Result(kind="program", at=at or instant(None), title=f"{path.name}: {mark}", files=fingerprints([path]))


def check_result(texts: Sequence[str], at: datetime.datetime | None) -> Result:
    """The result of single checks, `squareness X-Y=12.4 +- 3 um/m`; UserError for another text."""
    figures = []
    for text in texts:
        found = CHECK.fullmatch(text)
        if found is None or float(found["U"]) <= 0.0:
            raise UserError(
                f"--check {text}: expected NAME=VALUE +- U UNIT with the uncertainty U (k = 2) above 0, as in "
                '"squareness X-Y=12.4 +- 3 um/m"; units are um, um/m and urad'
            )
        figures.append(Quantity(found["name"], found["unit"], float(found["value"]), float(found["U"]) / 2.0))
    return Result(kind="check", at=at or instant(None), title="; ".join(texts), method="check", figures=figures)
