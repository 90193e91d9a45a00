"""LinuxCNC: lines `setp PIN VALUE`, or `PIN = VALUE`, of a HAL file, of the pins of five-axis kinematics."""

from __future__ import annotations

import re

from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, numbers, refusal, refuse_cut, with_lines
from postproc.control_data.readers.read_linuxcnc_comp import ini_of, units_of

_PIN = re.compile(r"(?P<module>xyz(?P<tilt>[ab])c-trt-kins|5axiskins)\.(?P<pin>[a-z-]+)$")
_POINT = ("x-rot-point", "y-rot-point", "z-rot-point")
_PINS = (*_POINT, "x-offset", "y-offset", "z-offset", "pivot-length")
_TOOL, _CONVENTIONAL = "tool-offset", "conventional-directions"
_ENTRY = re.compile(r"\[(?P<section>[^\]]+)\]\(?(?P<entry>\w+)\)?")
Where = tuple[str, int, str]


def unit_beside(source: Source) -> float | None:
    """The unit of lengths, mm, by an INI file that is given with the HAL file; None without one.

    UserError for angles that are not in degrees.
    """
    if not any(name.lower().endswith(".ini") for name in source.files):
        return None
    ini = ini_of(source)
    length, angle = units_of(source, ini)
    line = ini.line("TRAJ", "ANGULAR_UNITS")
    if angle != 1.0 and line is not None:
        raise line.refusal("the kinematics of LinuxCNC take positions of rotary axes as degrees: only degree is read")
    return length


def read(source: Source, name: str, machine: Machine) -> Machine:
    """The machine with the lines by the pins; lines of a HAL file that do not concern its kinematics are passed."""
    found: dict[str, float] = {}
    modules = set()
    refuse_cut(name, source.files[name], r"kins\.")
    for line, text in enumerate(source.files[name].splitlines(), 1):
        words = text.partition("#")[0].replace("=", " = ").split()
        pins = [word for word in words if "kins." in word]
        where = name, line, text
        if not pins or (words[0] == "net" and all(pin.endswith(f".{_TOOL}") for pin in pins)):
            continue
        pin, value = _setting(words, where, source)
        known = _PIN.match(pin)
        if known is None:
            raise refusal(*where, "a pin of kinematics that ncomp does not know")
        key = known["pin"]
        modules.add(known["module"])
        if key in (_TOOL, _CONVENTIONAL):
            _check(key, value, source, where)
            continue
        if key not in _PINS:
            raise refusal(*where, f"ncomp does not know the pin {key} of these kinematics")
        if key in found:
            raise refusal(*where, "this pin is set twice")
        found[key] = numbers([value], *where)[0]
    if len(modules) != 1:
        raise UserError(f"{name}: expected lines setp of one five-axis kinematics module, found {len(modules)}")
    return _placed(machine, name, modules.pop(), found)


def _setting(words: list[str], where: Where, source: Source) -> tuple[str, str]:
    """Pin and value of a line; UserError for a line with a pin that has no value in it."""
    if words[0] == "net":
        why = "the pin is connected to a signal, and the file has not its value: write setp PIN VALUE (halcmd getp PIN)"
        raise refusal(*where, why)
    own = words[1:] if words[0] == "setp" else words
    if len(own) == 3 and own[1] == "=":
        own = [own[0], own[2]]
    elif words[0] != "setp":
        own = []
    if len(own) != 2:
        raise refusal(*where, "expected setp PIN VALUE")
    entry = _ENTRY.fullmatch(own[1])
    if entry is None:
        return own[0], own[1]
    beside = any(name.lower().endswith(".ini") for name in source.files)
    value = ini_of(source).value(entry["section"], entry["entry"]) if beside else None
    if value is None:
        raise refusal(*where, "the value is an entry of an INI file: give this file as well, or write its number here")
    return own[0], value


def _check(pin: str, value: str, source: Source, where: Where) -> None:
    """UserError for a tool length in the pin, and for directions that differ from those of the setting."""
    if pin == _TOOL:
        if numbers([value], *where)[0]:
            raise refusal(*where, "tool-offset must be 0: the lines are those without a tool")
        return
    own = value.lower() in ("1", "true", "yes")
    if own != source.settings.conventional:
        word = str(own).lower()
        raise refusal(*where, f"the control turns its axes by this pin: give --set conventional={word}")


def _placed(machine: Machine, name: str, module: str, found: dict[str, float]) -> Machine:
    if module == "5axiskins":
        if set(found) != {"pivot-length"}:
            raise UserError(f"{name}: expected the pin pivot-length of 5axiskins and no other")
        machine.index("B")
        return with_lines(machine, {"B": (0.0, 0.0, found["pivot-length"])})
    tilt = module[3].upper()
    across = "y-offset" if tilt == "A" else "x-offset"
    lacking = [pin for pin in (*_POINT, across, "z-offset") if pin not in found]
    if lacking:
        raise UserError(
            f"{name}: the pin {module}.{lacking[0]} is not set: the file may be cut off, or not whole; for a pin that "
            "is 0 in the control add setp PIN 0"
        )
    x, y, z = (found[pin] for pin in _POINT)
    machine.index(tilt), machine.index("C")
    nominal = machine.axes[machine.index(tilt)].point
    height = z + found["z-offset"]
    line = (nominal[0], y + found[across], height) if tilt == "A" else (x + found[across], nominal[1], height)
    return with_lines(machine, {"C": (x, y, z), tilt: line})
