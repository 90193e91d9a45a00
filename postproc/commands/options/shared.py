"""Common options of the commands, and the checking and writing of their files."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, BinaryIO, ClassVar

import msgspec

from kinematics.files.report_head import ReportHead, read_head
from kinematics.user_error import UserError
from postproc.commands.options.declared import MACHINE, MODEL, OUTPUT, REQUIRED, option
from postproc.commands.options.files import file_of_calibration, machine_file

if TYPE_CHECKING:
    from rendering.report import Report


def machine_names() -> list[str]:
    """Names of the shipped machines."""
    import machines as shipped

    return shipped.names()


MachineName = Annotated[
    str,
    option(
        "Name of a machine, or path of its .toml file.",
        "NAME",
        "-m",
        default=REQUIRED,
        complete=machine_names,
        reads=machine_file,
        panel=MACHINE,
    ),
]
OptionalMachine = Annotated[
    str | None,
    option(
        "Name of a machine, or path of its .toml file.",
        "NAME",
        "-m",
        complete=machine_names,
        reads=machine_file,
        panel=MACHINE,
    ),
]
CalibrationName = Annotated[
    str | None,
    option(
        "Calibration; none for a machine without errors; default: the machine's own.",
        "CAL.json|none",
        "-c",
        reads=file_of_calibration,
        panel=MODEL,
    ),
]
JsonFile = Annotated[str | None, option("File for the results as JSON; `-` is standard output.", "FILE", writes="file")]
ReportFile = Annotated[
    str | None, option("Page with tables and figures; `-` is standard output.", "FILE.html", writes="file")
]
Seed = Annotated[int, option("Seed of all random numbers: the same seed makes the same files.", default=0, min=0)]

DaskAddress = Annotated[
    str | None,
    option("Address of a Dask scheduler, whose cluster does the work; `local`: a cluster of this machine.", "ADDRESS"),
]


def number_of_workers(given: int | None, dask: str | None, name: str) -> int:
    """The number of processes, by the option `name`: one for each core that this process may use, unless given.

    UserError for a number together with the address of a cluster, whose workers are there already.
    """

    if given is not None and dask not in (None, "local"):
        raise UserError(f"{name} and --dask {dask} exclude each other: give one of them")
    return given or len(os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1))


@dataclass(frozen=True, kw_only=True)
class ResultOptions:
    """Results in addition to the main output."""

    PANEL: ClassVar[str] = OUTPUT

    json: JsonFile
    report: ReportFile
    report_head: Path | None = option(
        "TOML file whose table [report] has the entries of the page's head: operator, place, temperature, instrument, "
        "...; they come before those of the machine file.",
        "HEAD.toml",
        reads=True,
    )

    def __post_init__(self) -> None:
        """Read the head before any work is done; UserError for one without a page."""
        if self.report_head is not None and self.report is None:
            raise UserError(
                f"--report-head {self.report_head}: there is no page that it belongs to: add --report FILE.html"
            )
        _ = self.head
        if self.report is not None:
            from postproc.commands.show.terminal import NOTES

            NOTES.clear()

    @cached_property
    def head(self) -> ReportHead:
        """The entries of the head that are given."""
        return ReportHead() if self.report_head is None else read_head(self.report_head)

    @property
    def files(self) -> tuple[str | None, str | None]:
        """Names of the files; `-` is standard output, None a result without an option."""
        return self.json, self.report

    @property
    def by_option(self) -> dict[str, str | Path | None]:
        """Names of the files by option."""
        return {"--json": self.json, "--report": self.report}

    def write(
        self, results: dict[str, Any], report: Report, files: tuple[BinaryIO, ...], inputs: Iterable[str | Path | None]
    ) -> None:
        """Write the results for programs with their provenance, and the page where it is requested."""
        if self.json is not None:
            write_json({**results, "provenance": provenance(report.head, inputs)}, files[0])
        if self.report is not None:
            from postproc.commands.show.terminal import NOTES, console
            from rendering.page import page
            from rendering.report import with_notes

            headed = msgspec.structs.replace(with_notes(report, NOTES), head=made_now(report.head.under(self.head)))
            with console.status("drawing the page") as status:
                files[1].write(page(headed, partial(status.update, "drawing the page")))


def provenance(head: ReportHead, inputs: Iterable[str | Path | None]) -> dict[str, Any]:
    """Program, machine, calibration, and the fingerprints of the input files, as they were read, by their paths."""
    from kinematics.files import fingerprint
    from kinematics.files.inputs import fingerprint_as_read
    from kinematics.version import VERSION

    files = [Path(path) for path in inputs if path not in (None, "-")]
    return {
        "made_by": f"ncomp {VERSION}",
        "machine": head.machine,
        "calibration": head.calibration,
        "inputs": {
            str(path): fingerprint_as_read(path) or fingerprint(path.read_bytes()) for path in files if path.is_file()
        },
    }


def made_now(head: ReportHead) -> ReportHead:
    """The head with the command as it was given, and the present time."""
    import shlex

    command = shlex.join(("ncomp", *sys.argv[1:]))
    return replace(head, command=command, made=f"{datetime.now():%Y-%m-%d %H:%M}")


class _Spool:
    """A result for standard output (`-`), a device or a pipe, or one that is discarded (None)."""

    def __init__(self, target: str | None) -> None:
        import tempfile

        from kinematics.files import named_file, writing

        self._target, self._name = target, "standard output" if target in (None, "-") else str(target)
        with writing(self._name), tempfile.TemporaryFile() as spool:
            self.file = named_file(os.dup(spool.fileno()), f"{self._name} (through {tempfile.gettempdir()})")

    def complete(self) -> None:
        """Write all that is buffered: nothing is sent before all results are complete."""
        self.file.flush()

    def publish(self) -> None:
        """Send the result; BrokenPipeError where the reader of standard output has ended."""
        import shutil

        from kinematics.files import writing

        if self._target is None:
            return
        self.file.seek(0)
        with writing(self._name), self._opened() as stream:
            shutil.copyfileobj(self.file, stream)
            stream.flush()

    def _opened(self) -> AbstractContextManager[BinaryIO]:
        if self._target != "-":
            return Path(str(self._target)).open("wb")
        if sys.stdout is None:
            raise UserError("cannot write standard output: it is closed")
        return nullcontext(sys.stdout.buffer)

    def close(self) -> None:
        """Free the temporary space."""
        with suppress(UserError):
            self.file.close()


@contextmanager
def whole_results(*targets: str | None, beside: Mapping[Path, bytes] | None = None) -> Iterator[tuple[BinaryIO, ...]]:
    """Files for the results of a command: each is written completely or not at all, and all of them or none.

    beside: further files, which the block may name.

    `-` is standard output; None is a result that is discarded. Results that cannot be withdrawn - standard output,
    pipes and devices - are sent when the others are complete on the disk, before these replace existing files.
    """
    from kinematics.files import Draft, completed

    with ExitStack() as stack:
        drafts: list[Draft | _Spool] = []
        for target in targets:
            replaced = target is not None and _can_be_replaced(target)
            drafts.append(stack.enter_context(closing(Draft(Path(str(target))) if replaced else _Spool(target))))
        yield tuple(draft.file for draft in drafts)
        for draft in drafts:
            draft.complete()
        drafts += stack.enter_context(completed(beside or {}))
        for draft in sorted(drafts, key=lambda draft: isinstance(draft, Draft)):
            draft.publish()


@contextmanager
def result(target: str | None) -> Iterator[BinaryIO]:
    """A file for the one result of a command; None for a result that is discarded."""
    with whole_results(target) as (file,):
        yield file


def _can_be_replaced(target: str) -> bool:
    """True for a file or a new name; names in /dev and /proc denote devices or streams, even if these are files."""
    path = Path(target)
    if target == "-" or path.absolute().parts[1:2] in (("dev",), ("proc",)):
        return False
    return path.is_file() or path.is_dir() or not path.exists()


def write_json(results: dict[str, Any], file: BinaryIO) -> None:
    """Write results for programs."""
    import json

    file.write((json.dumps(results, indent=2) + "\n").encode())
