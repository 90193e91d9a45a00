"""The job file: a machine, its set-up and its programs in one TOML file."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, TypeVar

import msgspec

from kinematics.error_model.classes import parse_classes
from kinematics.files import read_input
from kinematics.files.inputs import FileSet, true_path
from kinematics.files.mistaken import missing, none_of
from kinematics.files.report_head import ReportHead
from kinematics.files.toml_entries import at_line, entry, read_table, utf8_text
from kinematics.user_error import UserError
from machines.given import load_machine
from postproc.correct.plausibility import parse_accepted
from postproc.dialects import NAMES
from postproc.folders.own_set_up import Offsets, OwnSetUp, map_in, offsets_in, tools_in
from postproc.folders.programs import FolderProgram, programs_of
from postproc.interface.request import Request

T = TypeVar("T")
PATTERN = re.compile(r"[*?\[]")
"""Wildcards of a pattern of names."""
NotNegative = Annotated[float, msgspec.Meta(ge=0)]


class _Content(msgspec.Struct, forbid_unknown_fields=True):
    machine: str
    programs: dict[str, Any]
    calibration: str | None = None
    dialect: str = "auto"
    tool_tables: tuple[str, ...] = ()
    table_unit: Literal["mm", "inch"] | None = None
    set_up_zero: bool = False
    block_skip: Literal["on", "off"] | None = None
    start: str | None = None
    probing: Literal["beside"] | None = None
    pass_through: tuple[str, ...] = ()
    subprograms: tuple[str, ...] = ()
    definitions: tuple[str, ...] = ()
    work_offsets: Offsets = {}
    tools: dict[str, Any] = {}
    height_map: str | None = None
    conditions: dict[str, Any] = {}
    correction: dict[str, Any] = {}
    results: dict[str, Any] = {}
    report: dict[str, Any] = {}


class _Conditions(msgspec.Struct, forbid_unknown_fields=True):
    temperature: dict[str, float] = {}
    elapsed_s: NotNegative | None = None
    log: str | None = None
    log_columns: str | None = None


class _Correction(msgspec.Struct, forbid_unknown_fields=True):
    classes: str | None = None
    tolerance_um: NotNegative = 1.0
    max_correction_um: Annotated[float, msgspec.Meta(ge=0, le=5000)] | None = None
    accept: tuple[str, ...] = ()
    rotary_feed: Literal["leave", "inverse-time", "scaled"] | None = None
    tcp: Literal["to-axes", "to-tcp"] | None = None
    tcp_feed: Literal["inverse-time", "scaled"] | None = None
    outside: Literal["refuse", "leave"] = "refuse"
    unroll: bool = False
    force: bool = False
    travel_check: bool = True


class _Program(msgspec.Struct, forbid_unknown_fields=True):
    output: str
    work_offsets: Offsets = {}
    tools: dict[str, Any] = {}
    height_map: str | None = None


class _Results(msgspec.Struct, forbid_unknown_fields=True):
    json: str | None = None
    report: str | None = None


@dataclass(frozen=True)
class JobResults:
    """The files of the results of a job; `-` is standard output."""

    json: str | None
    report: str | None
    report_head: Path | None
    """The job file, if it has the head of the page."""

    @property
    def by_entry(self) -> dict[str, str | None]:
        """The files by their entries."""
        return {"results.json": self.json, "results.report": self.report}


@dataclass(frozen=True)
class Job:
    """The content of a job file, as arguments of the public functions; paths are relative to the present folder."""

    request: Request
    results: JobResults
    programs: list[FolderProgram]


def read_job(path: Path, *, there: bool = True) -> Job:
    """The job in a file; UserError with the line of an entry that cannot be used.

    there: its calibration, tables and programs must exist.
    """
    where = f"job file {path}"
    text = utf8_text(read_input(path, "job file"), where)
    table = read_table(text, where)
    if {"chain", "axes"} & table.keys():
        raise UserError(f"{where}: this is a machine file (--machine)")
    try:
        return _Reader(path, table, there).job()
    except UserError as fault:
        raise at_line(text, where, fault) from None


def is_job_file(path: Path) -> bool:
    """True for the name of a job file, which may be given in the place of a folder."""
    return path.suffix.lower() == ".toml" and not path.is_dir()


def own_in_job(job: Path, program: Path) -> OwnSetUp | None:
    """The set-up that a job file has for the program of this name alone, whatever its folder and its suffix."""
    listed = read_job(job, there=False).programs
    named = [each.own for each in listed if each.path.name == program.name]
    return next(iter(named or [each.own for each in listed if each.path.stem == program.stem]), None)


class _Reader:
    """The entries of a job file as options."""

    def __init__(self, path: Path, table: dict[str, Any], there: bool) -> None:
        self._path, self._there = path, there
        self._content = entry(table, _Content)
        for name, number in _numbers(table, ""):
            if not math.isfinite(number):
                raise UserError(f"{name}: {number} is not finite")

    def job(self) -> Job:
        """The whole job."""
        content = self._content
        correction = entry(content.correction, _Correction, "correction")
        conditions = entry(content.conditions, _Conditions, "conditions")
        results = entry(content.results, _Results, "results")
        ReportHead.of_table(content.report)
        if correction.accept:
            _within("correction.accept", parse_accepted, ",".join(correction.accept))
        if correction.classes:
            _within("correction.classes", parse_classes, correction.classes)
        if content.dialect not in NAMES:
            raise UserError(f"dialect: {none_of(content.dialect, NAMES)}")
        request = Request(
            job=self._path,
            machine=self._machine,
            calibration=self._calibration(),
            set_up=self._set_up(),
            conditions={
                "temperature": tuple(f"{name}={value}" for name, value in conditions.temperature.items()),
                "elapsed": conditions.elapsed_s,
                **{
                    name: None if path is None else self._file(path, f"conditions.{name}")
                    for name, path in (("log", conditions.log), ("log_columns", conditions.log_columns))
                },
            },
            correction={
                **msgspec.structs.asdict(correction),
                "accept": ",".join(correction.accept) or None,
                "dialect": content.dialect,
            },
        )
        written = JobResults(
            json=self._output(results.json, "results.json"),
            report=self._output(results.report, "results.report"),
            report_head=self._path if content.report and results.report is not None else None,
        )
        programs = list(self._programs())
        self._check_results(request, written, programs)
        return Job(request, written, programs)

    def _here(self, name: str) -> Path:
        """A path of the file: relative to its folder."""
        return self._path.parent / name

    def _file(self, name: str, where: str) -> Path:
        path = self._here(name)
        if self._there and not path.is_file():
            reason = "this is a folder: give a file" if path.is_dir() else f"No such file{missing(path)}"
            raise UserError(f"{where}: {path}: {reason}")
        return path

    def _output(self, name: str | None, where: str) -> str | None:
        if name in (None, "-"):
            return name
        self._refuse_itself(path := self._here(str(name)), where)
        return str(path)

    def _check_results(self, request: Request, results: JobResults, programs: list[FolderProgram]) -> None:
        """UserError for a result that would replace a file that the job reads, or another output of it."""
        taken = FileSet()
        for path in (*(each.path for each in programs), *request.files):
            taken.add(path, "is read by this job")
        written = [(f'programs."{each.name}"', each.target) for each in programs]
        written += [(where, Path(each)) for where, each in results.by_entry.items() if each]
        for where, output in written:
            if str(output) == "-":
                continue
            if (reason := taken.find(output)) is not None:
                raise UserError(f"{where}: {output} {reason}: name another file")
            taken.add(output, f"is the output of {where} too")

    def _refuse_itself(self, output: Path, where: str) -> None:
        """UserError for an output that would replace the job file."""
        itself = FileSet()
        itself.add(self._path)
        if output in itself:
            raise UserError(f"{where}: the output is the job file itself: name another file")

    @cached_property
    def _machine(self) -> str:
        """Name of the machine, or path of its file."""
        name = self._content.machine
        path = self._here(name)
        given = str(path) if path.is_file() or path.suffix.lower() == ".toml" else name
        _within("machine", load_machine, given)
        return given

    def _calibration(self) -> str | None:
        name = self._content.calibration
        return name if name in (None, "none") else str(self._file(str(name), "calibration"))

    def _set_up(self) -> dict[str, Any]:
        """The arguments of `set_up`."""
        content, machine = self._content, load_machine(self._machine)
        offsets, datums = offsets_in(content.work_offsets, machine)
        return {
            "work_offset": offsets,
            "datum": datums,
            "tool_length": tools_in(content.tools),
            "height_map": next(iter(map_in(content.height_map, self._path.parent)), None),
            "tool_table": tuple(self._file(name, "tool_tables") for name in content.tool_tables),
            "table_unit": content.table_unit,
            "zero": content.set_up_zero,
            "block_skip": content.block_skip,
            "start": content.start,
            "probing": content.probing,
            "pass_through": content.pass_through,
            "subprograms": tuple(self._here(name) for name in content.subprograms),
            "definitions": tuple(self._file(name, "definitions") for name in content.definitions),
        }

    def _programs(self) -> Iterator[FolderProgram]:
        """The programs with their outputs, those of folders too."""
        targets: dict[Path, str] = {}
        if not self._content.programs:
            raise UserError('programs: expected "part.nc" = "part_c.nc" for each program')
        for name, given in self._content.programs.items():
            where, path = f'programs."{name}"', self._here(name)
            own, target = self._own(given, where)
            if not name or entry(target, str, where) in ("", "-"):
                raise UserError(f'{where}: expected "part.nc" = "part_c.nc", the names of two files or folders')
            output = self._here(target)
            if path.is_dir():
                found = _within(where, programs_of, path, output, ())
            elif path.is_file():
                output = output / path.name if output.is_dir() else output
                found = [FolderProgram(name, path, output, path.stat().st_size, stated=True)]
            elif PATTERN.search(name):
                found = self._matching(name, output)
                if not found and self._there:
                    raise UserError(f"{where}: no file has a name of this pattern outside the output folder")
            elif not self._there:
                found = [FolderProgram(name, path, output, 0)]
            else:
                raise UserError(f"{where}: {path}: No such file or folder{missing(path)}")
            for each in found:
                self._refuse_itself(each.target, where)
                if true_path(each.target) == true_path(each.path):
                    raise UserError(f"{where}: the output is the program itself: name another file")
                if other := targets.get(true_path(each.target)):
                    raise UserError(f"{where}: {other} has the same output {each.target}: name another file")
                targets[true_path(each.target)] = each.name
                yield replace(each, own=own)

    def _own(self, target: Any, where: str) -> tuple[OwnSetUp, Any]:
        """The set-up of a program's own in its entry, and its output."""
        if not isinstance(target, dict) or "output" not in target:
            return OwnSetUp(), target
        given = entry(target, _Program, where)
        machine = load_machine(self._machine)
        offsets, datums = offsets_in(given.work_offsets, machine, f"{where}.")
        tools, maps = tools_in(given.tools, f"{where}."), map_in(given.height_map, self._path.parent)
        return OwnSetUp(offsets, datums, tools, maps, str(self._path)), given.output

    def _matching(self, pattern: str, output: Path) -> list[FolderProgram]:
        """The files of a pattern; outputs have the subfolders below the part of the pattern that has no wildcard."""
        parts = PurePosixPath(pattern).parts
        fixed = next(i for i, part in enumerate(parts) if PATTERN.search(part))
        above = self._here("/".join(parts[:fixed]))
        found = [path for path in sorted(above.glob("/".join(parts[fixed:]))) if path.is_file()]
        names = [path.relative_to(above) for path in found]
        return [
            FolderProgram(path.relative_to(self._path.parent).as_posix(), path, output / name, path.stat().st_size)
            for path, name in zip(found, names, strict=True)
            if not any(part.startswith(".") for part in name.parts) and true_path(output) not in true_path(path).parents
        ]


def _within(where: str, function: Callable[..., T], *arguments: Any) -> T:
    """The result of a function; its refusal begins with the entry that it is about."""
    try:
        return function(*arguments)
    except UserError as fault:
        raise UserError(f"{where}: {fault}") from None


def _numbers(value: object, name: str) -> Iterator[tuple[str, float]]:
    """All numbers of a table, by their paths."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _numbers(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, float):
        yield name, value
