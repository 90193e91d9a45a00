"""LinuxCNC's RS274/NGC interpreter as a second reader of NC programs (Debian package linuxcnc-uspace).

`run` says whether LinuxCNC takes a program, and which moves it makes of it. Two front ends of the one interpreter
serve: the program `rs274`, which is the stricter one and decides, and the Python module `gcode`, which gives the
moves at double precision where `rs274` prints four decimals. Each run has its own HOME, for both keep the tool table
in a file there, and an end in time.

Arcs, canned cycles, subroutines and variables come out resolved. A program starts at machine zero, in mm (G21, G90).
"""

import json
import math
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

SYSTEM_PYTHON = "/usr/bin/python3"  # the Python that Debian's `gcode` module is built for
MODULES = Path("/usr/lib/python3/dist-packages")
MM_PER_INCH = 25.4
WORK_OFFSETS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
NON_ASCII_TO_QUESTION_MARK = bytes(range(128)) + b"?" * 128

# Coordinates of an arc in the order the interpreter gives them: first, second, normal to the plane.
PLANE_ORDER = {"xy": (0, 1, 2), "yz": (1, 2, 0), "xz": (2, 0, 1)}

Event = tuple[int | None, int | None, str, str | Sequence[float]]  # N word, source line, command, values


class Tool(NamedTuple):
    """A tool of the table, in mm."""

    length: float = 0.0
    diameter: float = 0.0


@dataclass(frozen=True, slots=True)
class Move:
    """One move. Positions are x y z in mm and a b c in degrees.

    `kind` is rapid, line, arc, probe or tap (a tap ends at the bottom of its hole). `end` is in the coordinates of the
    program; `machine` adds its work offset, rotation, G92 and tool length: what the axes are told. `feed` is in mm/min;
    the rate of the block is converted in inverse time mode (G93) and left in mm/rev in G95.

    An arc has a `plane` (xy, yz, xz) and a `centre` x y z in program coordinates, level with its end, and `turns`:
    positive is counterclockwise seen from the plane's positive normal (+y for xz), 1 less than a full turn, 2 up to
    two turns.
    """

    kind: str
    end: tuple[float, ...]
    machine: tuple[float, ...]
    feed: float
    number: int | None = None  # the block's N word; only `rs274_moves` knows it
    line: int | None = None  # line of the source from 1; only `gcode_moves` and `run` know it
    plane: str = ""
    centre: tuple[float, ...] | None = None
    turns: int = 0


@dataclass(frozen=True)
class Result:
    """What became of a program: 0, or not 0 with the interpreter's message, its block, and the moves before it."""

    exit_status: int
    message: str
    moves: list[Move]
    line: int | None = None  # where it was refused, counted from 1
    block: str = ""


class RefusedError(Exception):
    """LinuxCNC refuses the program."""


def available() -> bool:
    """Whether both front ends are on this computer."""
    return shutil.which("rs274") is not None and any(MODULES.glob("gcode.*.so")) and Path(SYSTEM_PYTHON).exists()


def run(
    program: Path | str,
    *,
    tools: Mapping[int, Tool] | None = None,
    work_offsets: Mapping[str, Sequence[float]] | None = None,
    timeout: float = 60.0,
) -> Result:
    """Interpret a program: a file, or its text as a string.

    Without `tools`, every tool the program names exists and has no length. `work_offsets` is {"G54": (x, y, z), ...}.
    """
    text = _by_rs274(program, tools, work_offsets, timeout)
    double = _by_gcode(program, tools, work_offsets, timeout)
    if text.exit_status == 0:
        return double
    line = double.line if double.exit_status else _line_of(text.block, program)
    return Result(text.exit_status, text.message, double.moves, line, text.block)


def rs274_moves(
    program: Path | str,
    *,
    tools: Mapping[int, Tool] | None = None,
    work_offsets: Mapping[str, Sequence[float]] | None = None,
    timeout: float = 60.0,
) -> list[Move]:
    """Moves with their N words, to four decimals of the program's unit (0.1 um, or 2.5 um in G20)."""
    return _accepted(_by_rs274(program, tools, work_offsets, timeout))


def gcode_moves(
    program: Path | str,
    *,
    tools: Mapping[int, Tool] | None = None,
    work_offsets: Mapping[str, Sequence[float]] | None = None,
    timeout: float = 60.0,
) -> list[Move]:
    """Moves with their source lines, at double precision. This front end lets some mistakes pass: see `run`."""
    return _accepted(_by_gcode(program, tools, work_offsets, timeout))


def _accepted(result: Result) -> list[Move]:
    if result.exit_status:
        raise RefusedError(f"{result.message}: {result.block}" if result.block else result.message)
    return result.moves


# --- the two front ends


def _by_rs274(
    program: Path | str,
    tools: Mapping[int, Tool] | None,
    work_offsets: Mapping[str, Sequence[float]] | None,
    timeout: float,
) -> Result:
    # This front end takes the tool table and the offsets to be in inches.
    with _workplace(program, tools, work_offsets, unit=MM_PER_INCH) as (path, table, offsets):
        done = _call(["rs274", "-g", "-t", table, "-v", offsets, path], table.parent, timeout)
    moves = list(_moves(_canon_lines(done.stdout)))
    said = [line for line in done.stderr.splitlines() if line.strip() and line != "executing"]
    if done.returncode == 0:
        return Result(0, "", moves)
    message = said[0] if said else f"rs274 ended with status {done.returncode}"
    return Result(done.returncode, message, moves, block=said[1].strip() if len(said) > 1 else "")


def _by_gcode(
    program: Path | str,
    tools: Mapping[int, Tool] | None,
    work_offsets: Mapping[str, Sequence[float]] | None,
    timeout: float,
) -> Result:
    dump = Path(__file__).with_name("canon_dump.py")
    with _workplace(program, tools, work_offsets, unit=1.0) as (path, table, offsets):
        ascii_only = table.with_name("ascii.ngc")  # the module fails on other bytes, even in comments
        ascii_only.write_bytes(path.read_bytes().translate(NON_ASCII_TO_QUESTION_MARK))
        done = _call([SYSTEM_PYTHON, dump, ascii_only, table, offsets], table.parent, timeout)
    if done.returncode not in {0, 1}:
        return Result(done.returncode, f"canon_dump ended with status {done.returncode}: {done.stderr.strip()}", [])
    moves = list(_moves(_json_lines(done.stdout)))
    if done.returncode == 0:
        return Result(0, "", moves)
    why = json.loads(done.stderr.splitlines()[-1])
    return Result(1, why["message"], moves, why["line"])


def _call(command: Sequence[str | Path], home: Path, timeout: float) -> subprocess.CompletedProcess[str]:
    environment = {"HOME": str(home), "PATH": os.environ.get("PATH", os.defpath), "LC_ALL": "C.UTF-8"}
    return subprocess.run(
        [str(word) for word in command],
        cwd=home,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        timeout=timeout,
        check=False,
    )


@contextmanager
def _workplace(
    program: Path | str,
    tools: Mapping[int, Tool] | None,
    work_offsets: Mapping[str, Sequence[float]] | None,
    unit: float,
) -> Iterator[tuple[Path, Path, Path]]:
    """A folder of its own with the program, its tool table and its work offsets, lengths in `unit` mm."""
    with tempfile.TemporaryDirectory(prefix="ncomp-rs274-") as name:
        folder = Path(name)
        if isinstance(program, str):
            path = folder / "program.ngc"
            path.write_text(program, encoding="utf-8", newline="")
        else:
            path = program.resolve(strict=True)
        if tools is None:
            tools = dict.fromkeys(_tool_numbers(path.read_text(encoding="latin-1")), Tool())
        table = folder / "tools.tbl"
        rows = (
            f"T{number} P{pocket} D{tool.diameter / unit!r} Z{tool.length / unit!r}\n"
            for pocket, (number, tool) in enumerate(sorted(tools.items()), 1)
        )
        table.write_text("".join(rows), encoding="ascii")
        offsets = folder / "offsets.var"
        offsets.write_text(_offset_parameters(work_offsets or {}, unit), encoding="ascii")
        yield path, table, offsets


def _tool_numbers(text: str) -> list[int]:
    """The numbers of all tools named with T, H or D outside comments."""
    code = re.sub(r"\([^)\n]*\)|;[^\n]*", "", text)
    return sorted({int(number) for number in re.findall(r"[THD]\s*(\d{1,6})", code, re.IGNORECASE)} - {0})


def _offset_parameters(work_offsets: Mapping[str, Sequence[float]], unit: float) -> str:
    """LinuxCNC's parameters of G54 ... G59.3, in ascending order, as it insists."""
    values = {5220: 1.0}  # G54 is active at the start
    for name, offset in work_offsets.items():
        base = 5221 + 20 * WORK_OFFSETS.index(name)
        values |= {base + i: value / (unit if i < 3 else 1.0) for i, value in enumerate(offset)}
    return "".join(f"{key} {value!r}\n" for key, value in sorted(values.items()))


def _line_of(block: str, program: Path | str) -> int | None:
    """The first line that reads like `block`."""
    text = program if isinstance(program, str) else program.read_text(encoding="latin-1")
    lines = [line.strip() for line in text.splitlines()]
    return lines.index(block) + 1 if block in lines else None


# --- from their outputs to moves

# A running count, the block's N word or dots, the command. From N100000 on no blank parts the number and the command.
CANON_LINE = re.compile(r"\s*\d+\s+N(\d+|\.+)\s*([A-Z][A-Z0-9_]*)\((.*)\)\s*")
POSE_COMMANDS = {
    "STRAIGHT_TRAVERSE": "rapid",
    "STRAIGHT_FEED": "line",
    "STRAIGHT_PROBE": "probe",
    "SET_G92_OFFSET": "g92",
    "USE_TOOL_LENGTH_OFFSET": "tool_length",
    "RIGID_TAP": "tap",
}


def _canon_lines(output: str) -> Iterator[Event]:
    """The commands printed by `rs274`, lengths in mm."""
    unit = 1.0
    for line in output.splitlines():
        match = CANON_LINE.fullmatch(line)
        if match is None:
            if re.match(r"\s*\d+\s+N[\d.]", line):
                raise ValueError(f"rs274 printed a line of unknown form: {line!r}")
            continue  # printed by the program itself
        number = int(match[1]) if match[1].isdigit() else None
        command, rest = match[2], match[3]
        if command == "USE_LENGTH_UNITS":
            unit = {"CANON_UNITS_MM": 1.0, "CANON_UNITS_INCHES": MM_PER_INCH}[rest]
        elif command == "SELECT_PLANE":
            yield number, None, "plane", rest.rpartition("_")[2].lower()
        elif command in POSE_COMMANDS:
            yield number, None, POSE_COMMANDS[command], _pose(_numbers(rest), unit)
        elif command == "SET_G5X_OFFSET":
            yield number, None, "g5x", _pose(_numbers(rest)[1:], unit)
        elif command == "SET_XY_ROTATION":
            yield number, None, "rotation", _numbers(rest)
        elif command == "SET_FEED_RATE":
            yield number, None, "feed", [unit * _numbers(rest)[0]]
        elif command == "ARC_FEED":
            *lengths, turns, normal, a, b, c = _numbers(rest)
            yield number, None, "arc", [*(unit * v for v in lengths), turns, unit * normal, a, b, c]
        elif command.startswith("NURBS"):
            raise ValueError("rs274 prints splines without their numbers: use gcode_moves")


def _numbers(text: str) -> list[float]:
    return [float(word) for word in re.split(r"[,\s]+", text.strip())]


def _pose(values: Sequence[float], unit: float) -> list[float]:
    return [unit * v for v in values[:3]] + list(values[3:6])


def _json_lines(output: str) -> Iterator[Event]:
    """The commands printed by `canon_dump.py`."""
    for line in output.splitlines():
        number, command, values = json.loads(line)
        yield None, number, command, values


def _moves(events: Iterable[Event]) -> Iterator[Move]:
    """Moves, with the plane, feed and offsets that hold for each."""
    plane, feed, rotation = "xy", 0.0, 0.0
    position: Sequence[float] = (0.0,) * 6
    offset: dict[str, Sequence[float]] = dict.fromkeys(("g5x", "g92", "tool_length"), position)

    def machine(end: Sequence[float]) -> tuple[float, ...]:
        # G92 acts in the rotated work frame, the tool length along the machine's own axes.
        x, y, *rest = (p + q for p, q in zip(end, offset["g92"], strict=True))
        cos, sin = math.cos(math.radians(rotation)), math.sin(math.radians(rotation))
        turned = (cos * x - sin * y, sin * x + cos * y, *rest)
        return tuple(p + q + r for p, q, r in zip(turned, offset["g5x"], offset["tool_length"], strict=True))

    for number, line, command, values in events:
        if command == "plane":
            plane = str(values)
            continue
        v = [float(value) for value in values]
        if command == "feed":
            feed = v[0]
        elif command == "rotation":
            rotation = v[0]
        elif command in offset:
            offset[command] = v
        elif command == "arc":
            first, second, normal = PLANE_ORDER[plane]
            end = [0.0, 0.0, 0.0, *v[6:]]
            end[first], end[second], end[normal] = v[0], v[1], v[5]
            centre = [0.0, 0.0, 0.0]
            centre[first], centre[second], centre[normal] = v[2], v[3], v[5]
            position = end
            yield Move("arc", tuple(end), machine(end), feed, number, line, plane, tuple(centre), int(v[4]))
        else:
            end = [*v, *position[len(v) :]]
            if command != "tap":  # which comes back to where it started
                position = end
            yield Move(command, tuple(end), machine(end), feed, number, line)
