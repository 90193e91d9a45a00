"""Who calls: the command line, or Python. A message names an option in the words of its caller.

Messages are written in the words of the command line: `--calibration CAL.json`, `--no-travel-check`. A public function
that Python calls raises them in the words of Python: `calibration="CAL.json"`, `travel_check=False`.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, ParamSpec, TypeVar

from kinematics.user_error import UserError

P = ParamSpec("P")
Result = TypeVar("Result")

BY_COMMAND_LINE: ContextVar[bool] = ContextVar("BY_COMMAND_LINE", default=False)
"""True while the command line runs."""
SWITCHES = (
    *(
        "accept-jumps",
        "both",
        "check",
        "force",
        "history",
        "hold-out",
        "in-place",
        "install",
        "optimise",
        "planar",
        "rapid",
    ),
    *("set-up-zero", "tables", "unroll"),
)
"""Options without a value."""
RENAMED = {"set-up-zero": "zero", "effect": "effects", "range": "ranges", "set": "settings", "location": "location_um"}
"""Options with another name in Python, where a name that is right for one of several is wrong for the whole."""
VALUES = {
    "accept": "stale future temperature outside insignificant worse calibration set-up datum",
    "approach": "any positive negative",
    "basis": "auto polynomial table",
    "block-skip": "on off",
    "probing": "beside",
    "calibration": "none",
    "columns": "leica polyworks spatialanalyzer",
    "dask": "local",
    "dialect": "auto iso siemens heidenhain linuxcnc fanuc",
    "direction": "auto forward backward mean",
    "engine": "rules terms",
    "error-motions": "all",
    "errors": "none table-1",
    "family": "any fanuc linuxcnc grbl mach3",
    "format": "auto ncomp rtl target-readings iso230-table ecmc-report cmm epics twincat-scope ballbar-angles robot "
    "delimited csv linuxcnc siemens-eec siemens-cec heidenhain heidenhain-kinematics fanuc isg isg-cross "
    "isg-volumetric etalon mitsubishi klipper reprap marlin grbl linuxcnc-matrix linuxcnc-calibxyz linuxcnc-kinematics "
    "siemens-trafo5 siemens-tcarr heidenhain-transformations fanuc-kinematics",
    "instrument": "laser-tracker interferometer part touch-probe ballbar level lengths ranging",
    "kind": "tables parameters",
    "machine": "bzt_pfu cframe dmu50 gantry head_head head_table trunnion_ac trunnion_bc",
    "noise": "sheet estimate",
    "old": "none",
    "order": "given shuffled retraced",
    "outside": "refuse leave",
    "reversal": "none constant curves",
    "rotary": "fixed random simultaneous swept",
    "rotary-feed": "leave inverse-time scaled",
    "sign": "error correction",
    "stands-on": "workpiece bed",
    "straightness": "end-point least-squares",
    "strategy": "planes hexahedron diagonals face-diagonals space-diagonals grid random space-filling axes rectangles "
    "on-the-fly optimised bk samba",
    "table-unit": "mm inch",
    "target-order": "in-turn alternating",
    "unexplained": "report add",
    "tcp": "to-axes to-tcp",
    "tcp-feed": "inverse-time scaled",
}
"""Values that are plain words, by their options: such a word does not show by itself that it is a value."""
UNITS = ("s", "ms", "us", "min", "h", "days", "mm", "um", "m", "deg", "degC", "share")
"""Words that stand for a number, by its unit."""
FUNCTIONS = {"import": "import_tables"}
"""Functions of commands whose name is a word of Python."""
PLAIN = "|".join(rf"(?<=--{option} )(?:{'|'.join(words.split())})(?![\w-])" for option, words in VALUES.items())
WORD = "|".join(
    (
        r"'[^']*'",
        PLAIN,
        rf"(?:{'|'.join(UNITS)})(?![\w-])",
        r"(?=[^\s;:,()]*[A-Z0-9=.:<])[^\s;()]+?(?=[.:,]*(?:[\s;)]|$))",
        r"[a-z]+(?:,[a-z]+)+",
    )
)
"""A value behind an option: quoted, a plain word, recognised by capitals, digits or `=`, or divided by commas."""
OPTION = rf"(?<![\w-])--(?P<name>[a-z][a-z0-9-]*)(?: (?P<value>{WORD}))?"
FIRST = r"^--(?P<name>[a-z][a-z0-9-]*) (?P<value>\S+|[^-].*?(?=: expected))(?=: )"
"""An option with the value that is refused, whatever that is."""
FILE = r"[A-Z]+(?:\.\w+)?"
COMMAND = rf"ncomp (?P<name>[a-z][a-z0-9-]*)(?P<files>(?: {FILE})*)(?P<options>(?: --[a-z][a-z0-9-]*(?: (?:{WORD}))?)+)"
"""A command with options, as a call."""


@contextmanager
def command_line_calls() -> Iterator[None]:
    """While it runs, the caller is the command line."""
    before = BY_COMMAND_LINE.set(True)
    try:
        yield
    finally:
        BY_COMMAND_LINE.reset(before)


def in_words_of_caller(function: Callable[..., Result]) -> tuple[Callable[..., Any], ...]:
    """What to call in another process instead of a function, so that its messages are in the words of this caller."""
    return (_for_command_line, function) if BY_COMMAND_LINE.get() else (function,)


def _for_command_line(function: Callable[..., Result], *arguments: object) -> Result:
    with command_line_calls():
        return function(*arguments)


def public(function: Callable[P, Result]) -> Callable[P, Result]:
    """A function that checks its arguments, and whose messages are in the words of its caller."""

    @functools.wraps(function)
    def call(*positional: P.args, **named: P.kwargs) -> Result:
        """The result; from Python the arguments are checked, and a UserError is in the words of Python."""
        if BY_COMMAND_LINE.get():
            return function(*positional, **named)
        from kinematics.running.arguments import checked

        try:
            given = checked(function, positional, named)
            return function(*given.args, **given.kwargs)
        except UserError as fault:
            fault.args = tuple(in_python(str(each)) for each in fault.args)
            raise

    return call


def in_python(message: str) -> str:
    """A message of the command line in the words of Python.

    >>> in_python("--classes A-VOL: unknown; give one with --calibration CAL.json, or --no-travel-check")
    'classes="A-VOL": unknown; give one with calibration="CAL.json", or travel_check=False'
    >>> in_python("'ncomp fit --noise estimate' takes it; --accept worse continues; --force corrects it again")
    '\\'ncomp.fit(noise="estimate")\\' takes it; accept="worse" continues; force=True corrects it again'
    """
    message = re.sub(FIRST, _argument, message)
    message = re.sub(COMMAND, _call, message)
    return re.sub(OPTION, _argument, message)


def _call(found: re.Match[str]) -> str:
    files = [f'"{name}"' for name in found["files"].split()]
    arguments = [*files, *(_argument(each) for each in re.finditer(OPTION, found["options"]))]
    name = found["name"].replace("-", "_")
    return f"ncomp.{FUNCTIONS.get(name, name)}({', '.join(arguments)})"


def _argument(found: re.Match[str]) -> str:
    """An option as an argument of Python; a switch has no value of its own."""
    option, value = found["name"], found["value"]
    if option in SWITCHES:
        return f"{_name(option)}=True" + ("" if value is None else f" {value}")
    if option.startswith("no-"):
        return f"{_name(option.removeprefix('no-'))}=False" + ("" if value is None else f" {value}")
    return f"{_name(option)}={'' if value is None else _literal(option, value)}"


def _name(option: str) -> str:
    return RENAMED.get(option, option.replace("-", "_"))


def _literal(option: str, value: str) -> str:
    """A value in quotes, unless it is a number or stands for one."""
    if value in UNITS and value not in VALUES.get(option, "").split():
        return value
    try:
        float(value)
    except ValueError:
        return '"' + value.strip("'") + '"'
    return value
