"""Residual errors along a program with each compensation class of ISO/TR 16907."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from kinematics.error_model.classes import CLASSES, ORIENTATION, parse_classes, select
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import COLD, correct_ends, pose_errors
from postproc.compensation.datum import datum_shifts
from postproc.compensation.predicted_error import MachineStates, in_a_program
from postproc.evaluation.predicted_errors import Statistic
from postproc.motion.motions import Motions

CHOICES = (*CLASSES, "L-VOL,R-VOL", "L-VOL+,R-VOL+")


@dataclass(frozen=True)
class ClassResiduals:
    """Residual errors at block ends after the correction of one choice of classes."""

    choice: str
    position: Statistic = field(default_factory=Statistic)
    """Errors of the tool point, um."""
    tilt: Statistic = field(default_factory=Statistic)
    """Errors of the tool axis, urad."""
    rotary_correction: Statistic = field(default_factory=Statistic)
    """Corrections of the rotary axes, urad."""

    def json(self) -> dict[str, Any]:
        """The machine-readable form."""
        return {
            "classes": self.choice,
            "tool_point_um": self.position.json(),
            "tool_axis_urad": self.tilt.json(),
            "rotary_axes_moved_urad": self.rotary_correction.json(),
        }


class ClassTable:
    """Residual errors at the evaluated moves of a program: without correction, and for each of CHOICES.

    Choices that need rotary axes are omitted on a machine that has none. Directions are those of the nominal moves,
    which are added chunk by chunk.
    """

    def __init__(self, machine: Machine, model: ErrorModel, conditions: Conditions = COLD) -> None:
        self._model, self._conditions = model.part(in_a_program), conditions
        self._states = MachineStates(self._model, machine, conditions, 1.0)
        classes = {"none": frozenset[str]()} | {choice: parse_classes(choice) for choice in CHOICES}
        if not machine.rotary.any():
            classes = {choice: names for choice, names in classes.items() if not _needs_rotary(names)}
        self.rows = [ClassResiduals(choice) for choice in classes]
        self._corrected = [
            (select(self._model, names), self._model if ORIENTATION in names else None, replace(conditions))
            for names in classes.values()
        ]
        """Corrected parts of the model, of the tool point and of the orientation, by choice.

        Each has conditions of its own, because conditions keep the tables of few models.
        """

    def add(self, motions: Motions) -> None:
        """Add the next moves of the program."""
        machine, evaluated, model, conditions = motions.machine, motions.evaluated, self._model, self._conditions
        states = self._states.states(motions, evaluated)
        nominal, tool = motions.machine_target[evaluated], motions.tool[evaluated]
        shift = datum_shifts(motions, model, conditions)[evaluated]
        for left, corrected in zip(self.rows, self._corrected, strict=True):
            correction = correct_ends(motions, *corrected, self._states.approach)
            commanded = correction.corrected[evaluated]
            found = pose_errors(machine, model, commanded, nominal, tool, states, shift)
            left.position.add(found.point_um)
            left.tilt.add(found.axis_urad)
            left.rotary_correction.add(np.abs(commanded - nominal)[:, machine.rotary] * 1e6)


def _needs_rotary(classes: frozenset[str]) -> bool:
    return any(name.startswith("R-") or name == ORIENTATION for name in classes)
