"""Commands that use the calibration of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from shlex import quote
from typing import NamedTuple

from kinematics.error_model.model import ErrorModel
from kinematics.error_model.needed_conditions import needed_conditions
from rendering.report import Section, Table


class Files(NamedTuple):
    """Names for the commands of a report: machine or its file, file of the new calibration, and of the present one."""

    machine: str
    new: str
    present: str | None = None


def use_section(files: Files, model: ErrorModel) -> Section:
    """What the new calibration is for, with the commands."""
    text = f"{files.new} holds the machine with the causes of the machine (calibration {model.id})."
    if needed_conditions(model):
        text += " Its errors depend on temperature or time: write the values while the program runs, or give --log."
    commands = Table(("task", "command"), _commands(files, model))
    return Section("Use of the new calibration", text, commands, detail=True)


def _commands(files: Files, model: ErrorModel) -> list[Sequence[str]]:
    """Tasks and their commands, with the options that the effects of the new model need."""
    at = "".join(f" {option}" for option in needed_conditions(model))
    new = f"--machine {quote(files.machine)} --calibration {quote(files.new)}{at}"
    tasks: list[Sequence[str]] = [("correct a program", f"ncomp PART.nc {new} -o PART_NEW.nc")]
    verify = f"ncomp verify PART.nc PART_NEW.nc {new}"
    if files.present is None:
        return [*tasks, ("evaluate the part's error before and after", verify)]
    old = f"--machine {quote(files.machine)} --calibration {quote(files.present)}{at}"
    left = f"ncomp PART.nc {old} -o PART_OLD.nc\nncomp verify PART.nc PART_OLD.nc {new} --accept calibration"
    return [
        *tasks,
        ("evaluate the part's error by this and the present model", f"{verify} --old {quote(files.present)}"),
        ("evaluate the part's error after a correction by the present model", left),
    ]
