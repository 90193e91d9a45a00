"""Everything that the corrections of a run have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

import ncomp
from postproc.commands.options.declared import option
from postproc.commands.options.program import ConditionsOptions, DatumOptions

if TYPE_CHECKING:
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine


@dataclass(frozen=True, kw_only=True)
class CorrectionOptions:
    """Extent and limits of the correction, by the names of the public interface."""

    classes: str | None = option("ISO/TR 16907 classes of errors to correct; default: all but FOR.", "L-VOL,R-VOL,...")
    tolerance_um: float = option(
        "Largest deviation of a feed move from its path, um; moves that deviate more are split.",
        "um",
        default=1.0,
        min=0.0,
    )
    max_correction_um: float | None = option(
        "Largest correction of a linear axis, um; a program that needs more is refused. Default: twice the "
        "calibration's largest error, at most 500.",
        "um",
        min=0.0,
        max=5000.0,
    )
    accept: str | None = option(
        "Implausible conditions to accept: stale, future, temperature, outside, insignificant, worse (docs/safety.md).",
        "NAME,...",
    )
    unroll: bool = option("Write out loops and calls: each block as many times as it runs.", default=False)
    force: bool = option("Correct a program that ncomp has already corrected.", default=False)


class Request(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that several corrections have in common, by the options of the command line."""

    machine: str
    calibration: str | None
    set_up: DatumOptions
    travel_check: bool
    correction: CorrectionOptions
    at: ConditionsOptions

    @property
    def inputs(self) -> tuple[str | Path | None, ...]:
        """Files that are read beside the programs."""
        return (self.calibration if self.calibration != "none" else None, *self.set_up.tool_table, self.at.log)

    def prepared(self) -> tuple[Machine, ErrorModel, Callable[..., ncomp.Corrected]]:
        """The machine, its calibration, and the correction of a program by them."""
        found = ncomp.load_machine(self.machine)
        model = ncomp.load_calibration(found, self.calibration)
        one = partial(
            ncomp.correct,
            machine=found,
            model=model,
            dialect=self.set_up.dialect,
            setup=self.set_up.setup(found),
            conditions=self.at.conditions(),
            travel_check=self.travel_check,
            **vars(self.correction),
        )
        return found, model, one
