"""Residual errors along a program with each compensation class of ISO/TR 16907."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kinematics.error_model.classes import CLASSES, ORIENTATION, parse_classes, select
from kinematics.error_model.model import ErrorModel
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import COLD, correct, pose_errors
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


def class_table(motions: Motions, model: ErrorModel, conditions: Conditions = COLD) -> list[ClassResiduals]:
    """Residual errors at the evaluated moves of a program: without correction, and for each of CHOICES.

    Choices that need rotary axes are omitted on a machine that has none. Directions are those of the nominal moves.
    """
    machine, evaluated, model = motions.machine, motions.evaluated, model.part(in_a_program)
    machine_states = MachineStates(model, machine, conditions, 1.0)
    states = machine_states.states(motions, evaluated)
    nominal, tool = motions.machine_target[evaluated], motions.tool[evaluated]
    shift = datum_shifts(motions, model, conditions)[evaluated]
    rows = []
    for choice in ("none", *CHOICES):
        classes = frozenset() if choice == "none" else parse_classes(choice)
        needs_rotary = any(name.startswith("R-") or name == ORIENTATION for name in classes)
        if needs_rotary and not machine.rotary.any():
            continue
        orientation = model if ORIENTATION in classes else None
        correction = correct(motions, select(model, classes), orientation, conditions, machine_states.approach)
        commanded = correction.corrected[evaluated]
        left = ClassResiduals(choice)
        found = pose_errors(machine, model, commanded, nominal, tool, states, shift)
        left.position.add(found.point_um)
        left.tilt.add(found.axis_urad)
        left.rotary_correction.add(np.abs(commanded - nominal)[:, machine.rotary] * 1e6)
        rows.append(left)
    return rows
