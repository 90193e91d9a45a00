"""Compensation classes of ISO/TR 16907: which part of an error model is corrected.

Every effect belongs to one elementary class, by its axis and the direction of its error:

| class | contents | axes |
|---|---|---|
| L-POS, R-POS | positioning along or about the axis itself (also backlash, pitch, growth) | linear, rotary |
| L-STR, R-RAX | straightness; radial and axial error motions | linear, rotary |
| L-SQU, R-POR | squareness; position and orientation of the axis line | linear, rotary |
| L-ANG, R-ANG | angular error motions; tilt error motions | linear, rotary |
| SPEC | errors outside the report's classes: displacement of the tool or of the workpiece | - |

L-VOL and R-VOL hold all four, L-VOL+ and R-VOL+ the functional orientation (FOR) as well, which the rotary axes must
correct. Lines "along which" L-POS, L-STR and L-SQU hold are those through the reference points of the axes. The slope
of a straightness that is not written as a location error counts as straightness. A compensation table in the control
contains errors of all classes at once: it can only be selected with all of them. The surface of a workpiece is no error
of the machine: it is always corrected. Source: thesis, section 2.9.1.
"""

from __future__ import annotations

from collections.abc import Iterable

from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.files.mistaken import none_of
from kinematics.user_error import UserError

ELEMENTARY = ("L-POS", "L-STR", "L-SQU", "L-ANG", "R-POS", "R-RAX", "R-POR", "R-ANG", "SPEC")
ORIENTATION = "FOR"
_NAMES = {
    "own": ("L-POS", "R-POS"),
    "across": ("L-STR", "R-RAX"),
    "line": ("L-SQU", "R-POR"),
    "turn": ("L-ANG", "R-ANG"),
}
_LINEAR, _ROTARY = frozenset(ELEMENTARY[:4]), frozenset(ELEMENTARY[4:8])
CLASSES: dict[str, frozenset[str]] = {
    **{name: frozenset((name,)) for name in (*ELEMENTARY, ORIENTATION)},
    "L-VOL": _LINEAR,
    "L-VOL+": _LINEAR | {ORIENTATION},
    "R-VOL": _ROTARY,
    "R-VOL+": _ROTARY | {ORIENTATION},
    "THESIS": frozenset(("L-POS", "L-STR", "L-SQU", "R-ANG")),
}
"""Elementary classes, and FOR, of each name that a user may give; THESIS is the set of Ellingsdalen 2021."""


def class_of(effect: Effect) -> str:
    """The elementary class of an effect of the machine."""
    if effect.ACTS_ON != "axis":
        return "SPEC"
    return _NAMES[effect.part][effect.axes[0][0] in "ABC"]


def parse_classes(text: str) -> frozenset[str]:
    """Elementary classes, and FOR, of a list such as `L-VOL,R-POS,FOR`; UserError names one that is none."""
    chosen: set[str] = set()
    for name in text.split(","):
        key = name.strip().upper()
        if key not in CLASSES:
            raise UserError(f"--classes {text}: {none_of(name.strip(), CLASSES)}")
        chosen |= CLASSES[key]
    return frozenset(chosen)


def select(model: ErrorModel, classes: Iterable[str]) -> ErrorModel:
    """The model with the effects of these elementary classes only, and their part of the covariance.

    UserError for a part of a model that holds tables in the control.
    """
    chosen = set(classes)
    tables = [effect for effect in model.effects if effect.OF_SEVERAL_CLASSES]
    if tables:
        whole = [effect for effect in model.effects if effect.ACTS_ON != "instrument" and not effect.area]
        rotary = any(axis[0] in "ABC" for effect in whole for axis in effect.axes)
        needed = _LINEAR.union(_ROTARY if rotary else (), map(class_of, whole))
        if needed - chosen:
            raise UserError(
                f"--classes: the calibration holds tables in the control ({tables[0].name}, ...), which hold errors "
                f"of several classes: leave it out, or choose {', '.join(sorted(needed - chosen))} as well"
            )
        return model
    return model.part(lambda effect: bool(effect.area) or class_of(effect) in chosen)
