"""One program through the whole job on every road: line by line, in pieces of several sizes, with one or two processes."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.running.child_process import ChildProcess
from kinematics.user_error import UserError
from postproc.control.setup import make_setup
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.source import Source, open_source

PIECES: dict[str, Callable[[bytes], list[bytes]]] = {
    "1 line": lambda data: lines_of(data, 1),
    "7 lines": lambda data: lines_of(data, 7),
    "4 KiB": lambda data: bytes_of(data, 4 << 10),
    "1 MiB": lambda data: bytes_of(data, 1 << 20),
}
Outcome = tuple[str, bytes, str]
"""Why a program is refused, or the empty text; the corrected program; the results as JSON."""


def lines_of(data: bytes, number: int) -> list[bytes]:
    """The text in pieces of so many lines."""
    lines = data.splitlines(keepends=True) if b"\r" not in data.replace(b"\r\n", b"") else [data]
    return [b"".join(lines[i : i + number]) for i in range(0, len(lines), number)]


def bytes_of(data: bytes, number: int) -> list[bytes]:
    """The text in pieces of about so many bytes, each of whole lines."""
    found, rest = [], data
    while rest:
        end = rest.find(b"\n", number) + 1 or len(rest)
        found.append(rest[:end])
        rest = rest[end:]
    return found


def outcome(
    path: Path,
    machine: Machine,
    model: ErrorModel,
    pieces: Callable[[bytes], list[bytes]] | None,
    *,
    processes: int = 1,
    process: type = ChildProcess,
) -> Outcome:
    """A program corrected in these pieces, or line by line without any; `process`: stands for a second process."""
    source = open_source(str(path))
    dialect = find_dialect("auto", source.name, source.text_head)
    if pieces is None:
        dialect = msgspec.structs.replace(dialect, plain=None)

    def divided(source: Source) -> Iterator[bytes]:
        assert pieces is not None
        with source.open() as stream:
            stream.seek(len(source.mark))
            yield from pieces(stream.read())

    job = Job(source, dialect, machine, model, make_setup(machine, zero=True), travel_check=False)
    out = io.BytesIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.correct.pipeline.SECOND_PROCESS_BYTES", 0)
        patch.setattr("postproc.evaluation.evaluation_process.ChildProcess", process)
        patch.setattr("postproc.read_ahead.ChildProcess", process)
        if pieces is not None:
            patch.setattr(Source, "pieces", divided)
        try:
            report = Pipeline(job, processes=processes).run(out, lambda _: None)
        except UserError as refusal:
            return str(refusal), b"", ""
    content = report.json()
    content["calibration"].pop("age_days")
    return "", out.getvalue(), json.dumps(content)


def differing(
    path: Path, machine: Machine, model: ErrorModel, process: type = ChildProcess
) -> tuple[Outcome, list[str]]:
    """The outcome of a program line by line, and the roads on which it differs."""
    single = outcome(path, machine, model, None)
    return single, [
        f"{path}, pieces of {name}, {processes} processes"
        for name, pieces in PIECES.items()
        for processes in (1, 2)
        if outcome(path, machine, model, pieces, processes=processes, process=process) != single
    ]
