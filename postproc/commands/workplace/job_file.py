"""The job file: a machine, its set-up and its programs in one TOML file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec

import ncomp
from kinematics.error_model.classes import parse_classes
from kinematics.files import read_input, true_path
from kinematics.files.mistaken import missing, none_of
from kinematics.files.report_head import ReportHead
from kinematics.files.toml_entries import at_line, entry, read_table, utf8_text
from kinematics.touch_off import read_datum
from kinematics.user_error import UserError
from postproc.commands.options.program import ConditionsOptions, DatumOptions
from postproc.commands.options.shared import ResultOptions
from postproc.commands.programs.folder import FolderProgram, programs_of
from postproc.commands.programs.request import CorrectionOptions, Request
from postproc.control.setup import parse_tool_length
from postproc.correct.plausibility import parse_accepted
from postproc.dialects import NAMES

T = TypeVar("T")
NotNegative = Annotated[float, msgspec.Meta(ge=0)]


class _Content(msgspec.Struct, forbid_unknown_fields=True):
    machine: str
    programs: dict[str, Any]
    calibration: str | None = None
    dialect: str = "auto"
    tool_tables: tuple[str, ...] = ()
    table_unit: Literal["mm", "inch"] | None = None
    set_up_zero: bool = False
    pass_through: tuple[str, ...] = ()
    work_offsets: dict[str, dict[str, float | str]] = {}
    tools: dict[str, Any] = {}
    conditions: dict[str, Any] = {}
    correction: dict[str, Any] = {}
    results: dict[str, Any] = {}
    report: dict[str, Any] = {}


class _Conditions(msgspec.Struct, forbid_unknown_fields=True):
    temperature: dict[str, float] = {}
    elapsed_s: NotNegative | None = None
    log: str | None = None


class _Correction(msgspec.Struct, forbid_unknown_fields=True):
    classes: str | None = None
    tolerance_um: NotNegative = 1.0
    max_correction_um: Annotated[float, msgspec.Meta(ge=0, le=5000)] | None = None
    accept: tuple[str, ...] = ()
    unroll: bool = False
    force: bool = False
    travel_check: bool = True


class _Results(msgspec.Struct, forbid_unknown_fields=True):
    json: str | None = None
    report: str | None = None


@dataclass(frozen=True)
class Job:
    """The content of a job file, by the options of the command line; paths are relative to the present folder."""

    request: Request
    others: ResultOptions
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
        options = {name: getattr(correction, name) for name in ("classes", "tolerance_um", "max_correction_um")}
        request = Request(
            machine=self._machine,
            calibration=self._calibration(),
            set_up=self._set_up(),
            travel_check=correction.travel_check,
            correction=CorrectionOptions(
                **options, accept=",".join(correction.accept) or None, unroll=correction.unroll, force=correction.force
            ),
            at=ConditionsOptions(
                temperature=tuple(f"{name}={value}" for name, value in conditions.temperature.items()),
                elapsed=conditions.elapsed_s,
                log=None if conditions.log is None else self._file(conditions.log, "conditions.log"),
            ),
        )
        others = ResultOptions(
            json=self._output(results.json, "results.json"),
            report=self._output(results.report, "results.report"),
            report_head=self._path if content.report and results.report is not None else None,
        )
        programs = list(self._programs())
        self._check_results(request, others, programs)
        return Job(request, others, programs)

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

    def _check_results(self, request: Request, others: ResultOptions, programs: list[FolderProgram]) -> None:
        """UserError for a result that would replace a file that the job reads, or another output of it."""
        read = [each.path for each in programs] + [Path(each) for each in request.set_up.tool_table]
        read += [Path(each) for each in (request.machine, request.calibration, request.at.log) if each is not None]
        taken = {true_path(path): "is read by this job" for path in read}
        written = [(f'programs."{each.name}"', each.target) for each in programs]
        written += [(f"results.{name[2:]}", Path(each)) for name, each in others.by_option.items() if each]
        for where, output in written:
            if (reason := taken.get(true_path(output))) and str(output) != "-":
                raise UserError(f"{where}: {output} {reason}: name another file")
            taken[true_path(output)] = f"is the output of {where} too"

    def _refuse_itself(self, output: Path, where: str) -> None:
        """UserError for an output that would replace the job file."""
        if true_path(output) == true_path(self._path):
            raise UserError(f"{where}: the output is the job file itself: name another file")

    @cached_property
    def _machine(self) -> str:
        """Name of the machine, or path of its file."""
        name = self._content.machine
        path = self._here(name)
        given = str(path) if path.is_file() or path.suffix.lower() == ".toml" else name
        _within("machine", ncomp.load_machine, given)
        return given

    def _calibration(self) -> str | None:
        name = self._content.calibration
        return name if name in (None, "none") else str(self._file(str(name), "calibration"))

    def _set_up(self) -> DatumOptions:
        content, machine = self._content, ncomp.load_machine(self._machine)
        offsets, datums = list[str](), list[str]()
        for name, values in content.work_offsets.items():
            where, given = f"work_offsets.{name}", dict(values)
            if (datum := given.pop("datum", None)) is not None:
                read_datum(str(datum), machine.names, f"{where}.datum")
                datums.append(f"{name}={datum}")
            for axis, value in given.items():
                if axis not in machine.names:
                    raise UserError(f"{where}.{axis}: machine {machine.name} ({machine.chain}) has no axis {axis}")
                if isinstance(value, str):
                    raise UserError(f"{where}.{axis}: expected a number, not {value!r}")
            if not given:
                raise UserError(f"{where}: expected the offset of each axis, {{ X = -30, Y = -20, Z = 150 }}")
            offsets.append(f"{name}={','.join(f'{axis}={value!r}' for axis, value in given.items())}")
        tools, found = list[str](), dict[str, str]()
        for name, length in content.tools.items():
            number = entry(length, float, f"tools.{name}")
            tools.append(f"T{name}={number!r}" if name.isdigit() else f"{name}={number!r}")
            tool, _ = _within(f"tools.{name}", parse_tool_length, tools[-1])
            if other := found.get(tool):
                raise UserError(f"tools.{name}: this is tool {other} again: give its length once")
            found[tool] = name
        return DatumOptions(
            dialect=content.dialect,
            pass_through=",".join(content.pass_through),
            work_offset=tuple(offsets),
            datum=tuple(datums),
            tool_length=tuple(tools),
            tool_table=tuple(self._file(name, "tool_tables") for name in content.tool_tables),
            table_unit=content.table_unit,
            set_up_zero=content.set_up_zero,
        )

    def _programs(self) -> Iterator[FolderProgram]:
        """The programs with their outputs, those of folders too."""
        targets: dict[Path, str] = {}
        if not self._content.programs:
            raise UserError('programs: expected "part.nc" = "part_c.nc" for each program')
        for name, target in self._content.programs.items():
            where, path = f'programs."{name}"', self._here(name)
            if not name or entry(target, str, where) in ("", "-"):
                raise UserError(f'{where}: expected "part.nc" = "part_c.nc", the names of two files or folders')
            output = self._here(target)
            if path.is_dir():
                found = _within(where, programs_of, path, output, ())
            elif path.is_file():
                output = output / path.name if output.is_dir() else output
                found = [FolderProgram(name, path, output, path.stat().st_size)]
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
                yield each


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
