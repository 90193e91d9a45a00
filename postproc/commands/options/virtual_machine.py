"""The options of virtual machines, which all simulations share: their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import MODEL, option
from postproc.commands.options.files import file_if_there
from postproc.text.number_style import given_number, given_once

if TYPE_CHECKING:
    from kinematics.effects import Effect
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine


SIMULATED = ", simulated"
"""Origin of simulated data, for the header of their file."""


@dataclass(frozen=True, kw_only=True)
class VirtualMachineOptions:
    """Errors and temperatures of a virtual machine."""

    PANEL: ClassVar[str] = "Errors of the machine"

    truth: str | None = option(
        "File for the errors as a calibration, for comparison; `-` is standard output.", "TRUTH.json", writes="file"
    )
    errors: str | None = option(
        "Random error motions: within the half-widths of the virtual calibration paper (table-1), or of a file with "
        "E_XX = [a0, a1, n, b, c, ...]. Default: table-1, or none with --calibration.",
        "table-1|none|WIDTHS.toml",
        reads=file_if_there,
    )
    calibration: Path | None = option(
        "Calibration with additional errors of the machine.", "CAL.json", "-c", reads=True, panel=MODEL
    )
    effect: tuple[str, ...] = option(
        "Effect of docs/effects.md, backlash:axis=X,width=12, or a JSON file of effects.",
        "kind:field=value,...",
        reads=file_if_there,
    )
    temperature: tuple[str, ...] = option(
        "Temperature of a sensor at the start and at the end, degC: spindle=20:28.5.", "name=start:end"
    )

    def model(self, machine: Machine, seed: int, others: Sequence[Effect] = (), location: float = 0.0) -> ErrorModel:
        """The errors of the virtual machine; location: largest random location error, um and urad."""
        import msgspec

        errors = self.errors or ("table-1" if self.calibration is None else "none")
        made = ncomp.virtual_machine(
            machine,
            errors=errors,
            calibration="none" if self.calibration is None else self.calibration,
            effects=self.effect,
            location_um=location,
            seed=seed,
        )
        return msgspec.structs.replace(made, effects=(*made.effects, *others))

    def temperatures(self) -> dict[str, tuple[float, float]]:
        """Start and end of temperatures by name, K from 20 degC."""
        from kinematics.state import REFERENCE_DEGC

        return {name: (start - REFERENCE_DEGC, end - REFERENCE_DEGC) for name, (start, end) in self.courses().items()}

    def courses(self) -> dict[str, tuple[float, float]]:
        """Start and end of temperatures by name, degC."""
        from calibration.measurement.states import PLAIN_NAME
        from kinematics.files.text_cells import checked_degrees

        found = []
        for text in self.temperature:
            where = f"--temperature {text}"
            name, _, course = text.partition("=")
            ends = course.split(":")
            if not PLAIN_NAME.fullmatch(name) or len(ends) != 2:
                raise UserError(f"{where}: expected NAME=start:end, e.g. spindle=20:28.5")
            start, end = (checked_degrees(given_number(each, where), where) for each in ends)
            found.append((name, (start, end)))
        return given_once(found, "--temperature ")
