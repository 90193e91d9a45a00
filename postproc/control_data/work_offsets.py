"""A small NC program that sets the work offset of a drifted machine, with new values that may be set again and again.

Work offset and datum: W = D - e(W). An error that has come since the touch-off moves the offset by minus the error at
the work zero, tool relative to workpiece.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import msgspec

from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.touch_off import Datum, touch_off
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.compensation.conditions import Conditions
from postproc.compensation.datum import deviations
from postproc.control.setup import parse_work_offset

Control = Literal["linuxcnc", "fanuc", "siemens", "heidenhain"]
NUMBERS = {f"G{53 + n}": n for n in range(1, 7)}
"""Numbers of the work offsets in these programs."""
OFFSET_DECIMALS = 4


def offset_program(machine: Machine, drift: ErrorModel, offset: str, control: Control, remarks: Sequence[str]) -> str:
    """The program that sets a work offset for the drift of a machine; offset: G54=x,y,z as it was touched off.

    UserError for an offset that such a program cannot set.
    """
    name, values = parse_work_offset(offset, machine)
    axes = [axis.name for axis in machine.axes if axis.name in ("X", "Y", "Z")]
    if len(axes) != 3:
        raise UserError(f"--offsets: machine {machine.name} has no axes X, Y and Z")
    if name not in NUMBERS or (control == "siemens" and NUMBERS[name] > 4):
        known = "G54 to G57" if control == "siemens" else "G54 to G59"
        raise UserError(f"--work-offset {offset}: a program for {control} sets one of {known}")
    shift = dict(zip("XYZ", (-_error(machine, drift, name, values)).tolist(), strict=True))
    moved = {axis: round(values.get(axis, 0.0) + shift[axis], OFFSET_DECIMALS) + 0.0 for axis in "XYZ"}
    changes = ", ".join(f"{axis} {1e3 * change:+.1f}" for axis, change in shift.items())
    lines = [
        *remarks,
        f"{name} MOVES BY {changes} UM - MINUS THE DRIFT OF THE TOOL RELATIVE TO THE WORKPIECE - ISO 841",
    ]
    if control == "heidenhain":
        shown = {axis: round(change, OFFSET_DECIMALS) + 0.0 for axis, change in shift.items()}
        return _klartext(shown, [*lines, "CALL IT BEFORE THE PROGRAM - A CYCLE 7 OF THE PROGRAM REPLACES IT"])
    return (_siemens if control == "siemens" else _iso)(NUMBERS[name], moved, lines, control)


def _error(machine: Machine, drift: ErrorModel, name: str, values: Mapping[str, float]) -> Array:
    """The drift at the work zero `(3,)`, mm; as if a touch-off contained it."""
    effects = [msgspec.structs.replace(each, since_touch_off=msgspec.UNSET) for each in drift.effects]
    whole = msgspec.structs.replace(drift, effects=tuple(effects))
    offset = tuple(values.get(axis.name, 0.0) for axis in machine.axes)
    found: Array = deviations(machine, whole, [touch_off(name, Datum(), offset, machine)], Conditions())[0]
    return found


def _iso(number: int, values: Mapping[str, float], lines: Sequence[str], control: str) -> str:
    words = " ".join(f"{axis}{value:.{OFFSET_DECIMALS}f}" for axis, value in values.items())
    remarks = [f"({line})" for line in (*lines, "IT LEAVES G21 G90 IN FORCE")]
    sets = ["G21 G90", f"G10 L2 P{number} {words}", "M30"]
    tape = control == "fanuc"
    return "\n".join(["%"] * tape + ["O9054"] * tape + [*remarks, *sets] + ["%"] * tape) + "\n"


def _siemens(number: int, values: Mapping[str, float], lines: Sequence[str], _: str) -> str:
    remarks = [f"; {line}" for line in (*lines, "MM - CALL THE WORK OFFSET AGAIN BEHIND IT - FINE PARTS STAY")]
    sets = [f"$P_UIFR[{number},{axis},TR]={value:.{OFFSET_DECIMALS}f}" for axis, value in values.items()]
    return "\n".join([*remarks, *sets, "M30"]) + "\n"


def _klartext(shift: Mapping[str, float], lines: Sequence[str]) -> str:
    steps = [f"CYCL DEF 7.{k} {axis}{value:+.{OFFSET_DECIMALS}f}" for k, (axis, value) in enumerate(shift.items(), 1)]
    blocks = [*(f"; {line}" for line in lines), "CYCL DEF 7.0 DATUM SHIFT", *steps, "END PGM DRIFT MM"]
    return "\n".join(f"{k} {block}" for k, block in enumerate(("BEGIN PGM DRIFT MM", *blocks))) + "\n"
