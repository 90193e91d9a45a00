"""What lengths of a rectangle and a dial gauge say of a machine, in sentences with mm in 300 mm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calibration.evaluation.rectangle import PLANES, RECTANGLE_MM
from kinematics.effects.base import UM
from kinematics.error_model.model import ErrorModel
from kinematics.files.number_text import plus_minus

UNSEEN_MM_IN_300 = 10.0
"""Uncertainty (k = 2), mm in 300 mm, from which the readings do not show an error."""


def sentences(model: ErrorModel, plane: str) -> Iterator[str]:
    """The lean of the second axis, scales and backlash, of a model that was fitted to lengths and readings."""
    for name, value, u in _values(model, plane):
        size, big_u = abs(value) * RECTANGLE_MM, 2.0 * u * RECTANGLE_MM
        sure = "" if size > big_u else ": not more than its uncertainty"
        if big_u > UNSEEN_MM_IN_300:
            yield f"{name[0]}: not known yet."
        else:
            word = name[1] if value > 0.0 else name[2]
            yield f"{name[0]}: {word} by {plus_minus(size, big_u, 2)} mm in 300 mm (U, k=2){sure}."
    covariance = np.array(model.covariance)
    for effect, part in zip(model.effects, model.slices, strict=True):
        if effect.kind == "backlash":
            width, big_u = abs(effect.parameters[0]) * UM, 2.0 * float(covariance[part, part][0, 0]) ** 0.5 * UM
            yield f"backlash of {effect.name.partition(' ')[2]}: {plus_minus(width, big_u, 3)} mm (U, k=2)."


def _values(model: ErrorModel, plane: str) -> Iterator[tuple[tuple[str, str, str], float, float]]:
    """Names with words for plus and minus, values and standard uncertainties, mm/mm."""
    covariance = np.array(model.covariance)
    component, sign = PLANES[plane]
    first, second = plane[0], plane[1]
    for effect, part in zip(model.effects, model.slices, strict=True):
        u = float(np.sqrt(covariance[part, part][0, 0]))
        if effect.name == f"E_{component}0{second}":
            words = f"squareness of {second} to {first}", f"{second} leans to +{first}", f"{second} leans to -{first}"
            yield words, sign * float(effect.parameters[0]) * 1e-6, u * 1e-6
    for motion, part in model.error_motions:
        if motion.name in (f"E_{first}{first}", f"E_{second}{second}"):
            low, high = motion.basis.interval
            ends = motion.basis.columns(np.array([low, high]))
            row = (ends[1] - ends[0]) / (high - low) * 1e-3
            u = float(np.sqrt(row @ covariance[part, part] @ row))
            words = f"scale of {motion.axis}", f"{motion.axis} goes too far", f"{motion.axis} stops short"
            yield words, float(row @ np.array(motion.parameters)), u
