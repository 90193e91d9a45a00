"""What the corrections of a run have in common, as arguments of the public functions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from kinematics.user_error import UserError
from machines.given import load_calibration, load_machine
from postproc.control.setup import parse_height_map
from postproc.interface.programs import Corrected, check, conditions, correct, set_up

if TYPE_CHECKING:
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from postproc.control.setup import Setup
    from postproc.correct.check import Findings
    from postproc.folders.own_set_up import OwnSetUp
    from postproc.folders.programs import FolderProgram
    from postproc.folders.summary import Summary

CalibrationOfNow = Callable[[str, str | None, Sequence[Path]], str | None]
"""Name of the calibration that counts now: of machine and calibration that are given, and of all files of a request."""


class Request(msgspec.Struct, frozen=True, kw_only=True):
    """Machine, calibration, set-up, conditions and extent of several corrections."""

    job: Path | None = None
    """Job file that they are from; None without one."""
    machine: str
    """Name of the machine, or path of its file."""
    calibration: str | None
    """Path of the calibration; `none`, or None for that of the machine."""
    set_up: Mapping[str, Any]
    """Arguments of `set_up`."""
    conditions: Mapping[str, Any]
    """Arguments of `conditions`."""
    correction: Mapping[str, Any]
    """Arguments of `correct`: dialect, limits and extent of the correction."""

    @property
    def files(self) -> list[Path]:
        """All files that the corrections read except the programs, also those that the machine's name stands for."""
        import machines

        found = load_machine(self.machine)
        own = [machines.default_calibration(found)] if self.calibration is None else []
        named = (self.job, machines.path_of(self.machine), *own, *self.inputs)
        return [Path(each) for each in named if each is not None]

    @property
    def inputs(self) -> tuple[str | Path | None, ...]:
        """Files that are named in addition to the programs; None for one that is not given."""
        calibration = self.calibration if self.calibration != "none" else None
        given = self.set_up.get("height_map")
        map_file = None if given is None else parse_height_map(given)[0]
        log = map(self.conditions.get, ("log", "log_columns"))
        return (calibration, *self.set_up.get("tool_table", ()), map_file, *log)

    def setup(self, machine: Machine) -> Setup:
        """The set-up of the control; UserError for one that cannot be used."""
        return set_up(machine, **self.set_up)

    def for_program(self, program: Path, own: OwnSetUp | None = None) -> tuple[Request, list[str]]:
        """The request with the set-up of one program, and the names of the parts of that set-up; as `of_program`."""
        from postproc.folders.own_set_up import of_program

        given, names = of_program(self.set_up, program, load_machine(self.machine), own)
        return (self, names) if given is self.set_up else (msgspec.structs.replace(self, set_up=given), names)

    @property
    def dialect(self) -> str:
        """The dialect of the programs, or `auto`."""
        return str(self.correction.get("dialect", "auto"))

    def main_programs(self, programs: Iterable[FolderProgram]) -> list[FolderProgram]:
        """The programs that no other one calls: called ones are corrected with these."""
        from postproc.folders.sets import Sets

        setup = self.setup(load_machine(self.machine))
        try:
            return Sets(self.dialect).main_programs(programs, setup)
        except UserError as fault:
            raise UserError(f"job file {self.job}: {fault}") from None

    def of_each(self, programs: Iterable[FolderProgram]) -> list[FolderProgram]:
        """The programs, each with its own set-up if it has one."""
        found, each = load_machine(self.machine), []
        for program in programs:
            request, names = self.for_program(program.path, program.own)
            setup = None if request is self else request.setup(found)
            each.append(replace(program, setup=setup, own_names=tuple(names)))
        return each

    def prepared(self, *, of_several: bool = False) -> tuple[Machine, ErrorModel, Callable[..., Corrected]]:
        """The machine, its calibration, and the correction of a program by them."""
        found = load_machine(self.machine)
        model = load_calibration(found, self.calibration)
        one = partial(
            correct,
            machine=found,
            calibration=model,
            setup=self.setup(found),
            conditions=conditions(**self.conditions),
            one_of_several=of_several,
            **self.correction,
        )
        return found, model, one

    def corrected(
        self,
        programs: Sequence[FolderProgram],
        results: Mapping[str, str | Path | None],
        number: int,
        dask: str | None,
        progress: Callable[[int], None],
        *,
        of_several: bool = True,
    ) -> Summary:
        """Correct programs, each into its own file, as `correct_all`; results: other outputs, by their options.

        of_several: each may leave a part of the set-up unused.
        """
        from postproc.folders.programs import check_targets
        from postproc.folders.summary import correct_all

        programs = self.main_programs(programs)
        check_targets(programs, self.files, results)
        prepared = self.prepared(of_several=of_several)
        return correct_all(self.of_each(programs), *prepared, number, dask, progress)

    def checks(self, programs: Iterable[FolderProgram]) -> Iterator[tuple[FolderProgram, Findings]]:
        """The programs, each with its check."""
        found = load_machine(self.machine)
        given = {name: self.correction[name] for name in ("dialect", "travel_check")}
        for program in self.of_each(self.main_programs(programs)):
            setup = program.setup or self.setup(found)
            yield program, check(program.path, found, setup=setup, one_of_several=True, **given)


def with_calibration(given: Callable[[], Request], of_now: CalibrationOfNow | None) -> Callable[[], Request]:
    """The request of each moment, with the calibration that counts then; None for the one that is given."""
    if of_now is None:
        return given

    def now() -> Request:
        request = given()
        calibration = of_now(request.machine, request.calibration, request.files)
        return msgspec.structs.replace(request, calibration=calibration)

    return now
