"""The conditions of the machine that an error model needs while a program runs."""

from __future__ import annotations

from kinematics.error_model.model import ErrorModel


def needed_conditions(model: ErrorModel) -> list[str]:
    """The options of the command line that give them, with degC and s for the values; empty for a model of none."""
    of_machine = [effect for effect in model.effects if effect.ACTS_ON != "instrument"]
    sensors = dict.fromkeys(sensor for effect in of_machine for sensor in effect.sensors)
    timed = any("time" in effect.needs and not effect.HAS_MEMORY for effect in of_machine)
    return [*(f"--temperature {sensor}=degC" for sensor in sensors), *["--elapsed s"] * timed]
