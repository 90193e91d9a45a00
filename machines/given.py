"""A machine and its calibration as a user gives them: by name, by path, or as an object."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.user_error import UserError

if TYPE_CHECKING:
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine


def load_machine(machine: str | Path | Machine) -> Machine:
    """The machine of a shipped name or of a TOML file."""
    import machines

    return machines.load(str(machine)) if isinstance(machine, (str, Path)) else machine


def machine_of(model: ErrorModel, machine: str | Path | Machine | None, name: str) -> Machine:
    """The machine of a calibration: the one that is given, or the shipped machine of its name.

    name: of the calibration, for the message where there is none.
    """
    import machines

    if machine is None and model.machine.name not in machines.names():
        raise UserError(f"{name}: machine {model.machine.name} is not shipped; give its file with --machine FILE.toml")
    return load_machine(model.machine.name if machine is None else machine)


def load_calibration(machine: str | Path | Machine, calibration: str | Path | ErrorModel | None = None) -> ErrorModel:
    """The calibration in a JSON file; None is the machine's own, `"none"` a machine without errors.

    UserError for a machine without a calibration of its own, and for a calibration of another machine.
    """
    import machines
    from kinematics.error_model.model import no_errors, read_model, refuse_other_machine

    found = load_machine(machine)
    if calibration == "none":
        return no_errors(found)
    if calibration is not None and not isinstance(calibration, (str, Path)):
        refuse_other_machine(calibration, found, calibration.id)
        return calibration
    path = Path(calibration) if calibration else machines.default_calibration(found)
    if path is None:
        raise UserError(
            f"machine {found.name} has no calibration of its own: give one with --calibration CAL.json "
            "('ncomp fit' makes one from measurements), "
            "or --calibration none"
        )
    return read_model(path, found)
