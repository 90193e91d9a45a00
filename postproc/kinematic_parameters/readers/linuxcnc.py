"""LinuxCNC: lines `setp` of a HAL file, of the pins of five-axis kinematics."""

from __future__ import annotations

import re
from dataclasses import replace

from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.tables.readers.source import Source, numbers, refusal

_PIN = re.compile(r"(?P<module>xyz(?P<tilt>[ab])c-trt-kins|5axiskins)\.(?P<pin>[a-z-]+)$")
_PINS = ("x-rot-point", "y-rot-point", "z-rot-point", "x-offset", "y-offset", "z-offset")


def read(source: Source, name: str, machine: Machine) -> Machine:
    """The machine with the lines by the pins; lines of a HAL file that do not concern its kinematics are passed."""
    found: dict[str, float] = {}
    modules = set()
    for line, text in enumerate(source.files[name].splitlines(), 1):
        words = text.partition("#")[0].split()
        if not words or words[0] != "setp":
            continue
        pin = _PIN.match(words[1]) if len(words) > 1 else None
        if pin is None:
            if len(words) > 1 and ("-kins." in words[1] or "kins." in words[1]):
                raise refusal(name, line, text, "a pin of kinematics that ncomp does not know")
            continue
        if len(words) != 3:
            raise refusal(name, line, text, "expected setp PIN VALUE")
        key = pin["pin"]
        if key not in (*_PINS, "pivot-length"):
            raise refusal(name, line, text, f"ncomp does not know the pin {key} of these kinematics")
        if key in found:
            raise refusal(name, line, text, "this pin is set twice")
        modules.add(pin["module"])
        found[key] = numbers(words[2:], name, line, text)[0]
    if len(modules) != 1:
        raise UserError(f"{name}: expected lines setp of one five-axis kinematics module, found {len(modules)}")
    return _placed(machine, name, modules.pop(), found)


def _placed(machine: Machine, name: str, module: str, found: dict[str, float]) -> Machine:
    if module == "5axiskins":
        if set(found) != {"pivot-length"}:
            raise UserError(f"{name}: expected the pin pivot-length of 5axiskins and no other")
        height = {"B": (0.0, 0.0, found["pivot-length"])}
        return _with_points(machine, height)
    # a pin that is not set is 0
    x, y, z, dx, dy, dz = (found.get(pin, 0.0) for pin in _PINS)
    tilt = module[3].upper()
    machine.index(tilt), machine.index("C")
    nominal = machine.axes[machine.index(tilt)].point
    line = (nominal[0], y + dy, z + dz) if tilt == "A" else (x + dx, nominal[1], z + dz)
    return _with_points(machine, {"C": (x, y, z), tilt: line})


def _with_points(machine: Machine, points: dict[str, tuple[float, float, float]]) -> Machine:
    for axis in points:
        machine.index(axis)
    return replace(machine, axes=tuple(replace(axis, point=points.get(axis.name, axis.point)) for axis in machine.axes))
