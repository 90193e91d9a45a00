"""Machine, calibration, set-up, conditions and extent of corrections: by options, or by a job file."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

from kinematics.user_error import UserError
from postproc.commands.options.declared import MACHINE, option, refuse_given
from postproc.commands.options.program import ConditionsOptions, CorrectionOptions, DatumOptions

if TYPE_CHECKING:
    from postproc.folders.own_set_up import OwnSetUp
    from postproc.interface.request import Request

JobOption = Annotated[
    Path | None,
    option(
        "Job file (docs/job.md), whose machine, calibration, set-up, conditions and correction are used.",
        "JOB.toml",
        reads=True,
        panel=MACHINE,
    ),
]


class GivenForAll(NamedTuple):
    """The options that a job file has as well."""

    machine: str | None
    calibration: str | None
    set_up: DatumOptions
    no_travel_check: bool
    correction: CorrectionOptions
    at: ConditionsOptions

    def refuse(self, reason: str) -> None:
        """UserError for the first of the options that is given."""
        for name, value in (("--machine", self.machine), ("--calibration", self.calibration)):
            if value is not None:
                raise UserError(f"{name} {reason}")
        if self.no_travel_check:
            raise UserError(f"--no-travel-check {reason}")
        for group in (self.set_up, self.correction, self.at):
            refuse_given(reason, group, *(each.name for each in fields(group)))

    def request(self, command: str, job: Path | None) -> Request:
        """The request of these options, or that of the job file; UserError without a machine."""
        from postproc.interface.request import Request

        if job is not None:
            from postproc.interface.job_file import read_job

            self.refuse(f"is an entry of the job file {job}")
            return read_job(job, there=False).request
        if self.machine is None:
            raise UserError(
                f"{command}: --machine NAME is missing: name of a machine, or path of its .toml file; "
                f"'ncomp {command} --help' lists its options"
            )
        return Request(
            machine=self.machine,
            calibration=self.calibration,
            set_up=self.set_up.arguments,
            conditions=vars(self.at),
            correction={
                **vars(self.correction),
                "dialect": self.set_up.dialect,
                "travel_check": not self.no_travel_check,
            },
        )


def own_in(job: Path, program: Path) -> OwnSetUp | None:
    """The set-up that a job file has for the program of this name alone."""
    from postproc.interface.job_file import own_in_job

    return own_in_job(job, program)
