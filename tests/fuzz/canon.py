"""LinuxCNC's interpreter on many short programs: every canonical call in order, every position at double precision.

The program `rs274` decides whether a program is accepted and prints every call, positions to four decimals; the
module `gcode`, in one server process that forks for each program, gives the same moves at double precision.
"""

from __future__ import annotations

import json
import os
import re
import select
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

SYSTEM_PYTHON = "/usr/bin/python3"  # the Python that Debian's `gcode` module is built for
TOOLS_FOLDER = Path(__file__).parents[1] / "clients"
SECONDS = 20.0
CALL = re.compile(r"\s*\d+\s+N(?:\d+|\.+)\s*([A-Z][A-Z0-9_]*)\((.*)\)\s*")
MM_PER_INCH = 25.4
MOVES = {
    "STRAIGHT_TRAVERSE": "rapid",
    "STRAIGHT_FEED": "line",
    "ARC_FEED": "arc",
    "STRAIGHT_PROBE": "probe",
    "RIGID_TAP": "tap",
}


PRINTED = 1e-4
"""Positions that differ by less are printed alike, in the unit in force."""


class Call(NamedTuple):
    """One canonical call; a move has its source line from 1 and its values at double precision, mm and degrees."""

    name: str
    text: str
    line: int = 0
    values: tuple[float, ...] = ()
    before: tuple[tuple[str, Any], ...] = ()
    """Calls of the module since the last move that set the coordinates: g5x, g92, rotation, tool_length, plane."""


@dataclass(frozen=True)
class Environment:
    """Work offsets by name (x, y, z), and tools as (length, diameter) by number, mm."""

    work_offsets: Mapping[str, Sequence[float]]
    tools: Mapping[int, tuple[float, float]]
    files: Mapping[str, str] = field(default_factory=dict)
    """Other programs, which are called, by file name."""


class RefusedError(Exception):
    """LinuxCNC refuses the program."""


class ClientError(Exception):
    """The two front ends do not agree, or one of them ended with an unknown status."""


OFFSETS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
BY_MACHINE = re.compile(r"(?<![A-Z_])(G0*(28|30|53)(?![\d.])|L0*20(?!\d))", re.IGNORECASE)
"""Codes that go to machine positions, or count from them."""


def calls(text: str, environment: Environment) -> list[Call]:
    """All canonical calls of a program; RefusedError with the message where LinuxCNC refuses it."""
    with tempfile.TemporaryDirectory(prefix="ncomp-fuzz-rs274-") as folder:
        place = Path(folder)
        for name, content in {"program.ngc": text, **environment.files}.items():
            (place / name).write_bytes(content.encode("latin-1"))
        printed = _printed(place, environment)
        _write_tables(place, environment, 1.0)
        exact = _server().moves(place)
    if BY_MACHINE.search(text) and _changes_unit_under_length(printed):
        raise ClientError("both front ends keep the number of a tool length in force when the unit changes")
    return list(_joined(printed, exact))


def _changes_unit_under_length(printed: list[tuple[str, str]]) -> bool:
    """Whether the unit changes while a tool length is in force.

    LinuxCNC's control then converts the length (emccanon.cc, GET_EXTERNAL_TOOL_LENGTH_ZOFFSET); `rs274` and `gcode`
    keep its number, and go elsewhere than the control where machine positions are meant.
    """
    unit, long = "CANON_UNITS_MM", False
    for name, text in printed:
        if name == "USE_TOOL_LENGTH_OFFSET":
            long = any(float(figure) for figure in re.split(r"[,\s]+", text.strip()))
        elif name == "USE_LENGTH_UNITS":
            if long and text != unit:
                return True
            unit = text
    return False


def _write_tables(place: Path, environment: Environment, unit: float) -> None:
    tools = (
        f"T{number} P{number} D{diameter / unit!r} Z{length / unit!r}\n"
        for number, (length, diameter) in sorted(environment.tools.items())
    )
    (place / "tools.tbl").write_text("".join(tools), encoding="ascii")
    values = {5220: 1.0}
    for name, offset in environment.work_offsets.items():
        values |= {5221 + 20 * OFFSETS.index(name) + i: value / unit for i, value in enumerate(offset)}
    text = "".join(f"{key} {value!r}\n" for key, value in sorted(values.items()))
    (place / "offsets.var").write_text(text, encoding="ascii")


def _printed(place: Path, environment: Environment) -> list[tuple[str, str]]:
    """Name and arguments of every call that `rs274` prints."""
    _write_tables(place, environment, MM_PER_INCH)  # this front end takes both tables to be in inches
    command = ["rs274", "-g", "-t", "tools.tbl", "-v", "offsets.var", "program.ngc"]
    surroundings = {"HOME": str(place), "PATH": os.environ.get("PATH", os.defpath), "LC_ALL": "C.UTF-8"}
    done = subprocess.run(
        command,
        cwd=place,
        env=surroundings,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=SECONDS,
        check=False,
    )
    if done.returncode:
        said = [line for line in done.stderr.decode("latin-1").splitlines() if line.strip() and line != "executing"]
        raise RefusedError(said[0] if said else f"status {done.returncode}")
    found = (CALL.fullmatch(line) for line in done.stdout.decode("latin-1").splitlines())
    return [(match[1], match[2]) for match in found if match]


def _joined(printed: list[tuple[str, str]], exact: list[Call]) -> list[Call]:
    """The printed calls, with the values of the exact moves."""
    moves, unit = iter(exact), 1.0
    joined = []
    for name, text in printed:
        if name not in MOVES:
            joined.append(Call(name, text))
            unit = (MM_PER_INCH if "INCHES" in text else 1.0) if name == "USE_LENGTH_UNITS" else unit
            continue
        move = next(moves, None)
        if move is None or move.name != MOVES[name]:
            raise ClientError(f"rs274 moves by {name}({text}), gcode by {move}")
        if not _same_end(name, text, move, unit):
            raise ClientError("its two front ends end a move at different positions")
        joined.append(move)
    left = next(moves, None)
    if left is not None:
        raise ClientError(f"gcode moves on: {left}")
    return joined


def _same_end(name: str, text: str, move: Call, unit: float) -> bool:
    """Whether a printed move ends where the exact one does: behind M6, `gcode` forgets arcs and new coordinates."""
    figures = [float(figure) * unit for figure in text.split(",")[:6]]
    ends = (0, 1, 5) if name == "ARC_FEED" else (0, 1, 2)
    return all(abs(figures[i] - move.values[i]) < PRINTED * unit for i in ends)


# --- the server


class _Server:
    """A process of the system's Python that runs `canon_dump` in a fork for each program."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [SYSTEM_PYTHON, __file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def moves(self, place: Path) -> list[Call]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(place, file=self.process.stdin, flush=True)
        if not select.select([self.process.stdout], [], [], SECONDS)[0]:
            self.process.kill()
            raise ClientError("gcode does not end")
        status = int(self.process.stdout.readline() or -1)
        if status:
            raise RefusedError(f"gcode: status {status}: {(place / 'error').read_text(errors='replace')[-200:]}")
        return list(_exact((place / "moves").read_text(encoding="ascii")))


_SERVERS: dict[int, _Server] = {}


def _server() -> _Server:
    """The server of this process."""
    server = _SERVERS.get(os.getpid())
    if server is None or server.process.poll() is not None:
        server = _SERVERS[os.getpid()] = _Server()
    return server


def _exact(output: str) -> list[Call]:
    found, before = [], []
    for row in output.splitlines():
        line, name, values = json.loads(row)
        if name in MOVES.values():
            found.append(Call(name, "", line, tuple(values), tuple(before)))
            before = []
        else:
            before.append((name, values))
    return found


def _serve() -> None:
    """Run the program in each folder that is named on standard input; its exit status on standard output."""
    sys.path.insert(0, str(TOOLS_FOLDER))
    import canon_dump

    for row in sys.stdin:
        child = os.fork()
        if child == 0:
            os._exit(_dump(canon_dump, Path(row.strip())))
        _, status = os.waitpid(child, 0)
        print(status, flush=True)


def _dump(canon_dump: Any, place: Path) -> int:
    os.environ["HOME"] = str(place)
    os.chdir(place)
    for name, descriptor in (("moves", 1), ("error", 2)):
        os.dup2(os.open(place / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), descriptor)
    sys.stdout = os.fdopen(1, "w", closefd=False)
    sys.stderr = os.fdopen(2, "w", closefd=False)
    status: int = canon_dump.main("program.ngc", "tools.tbl", "offsets.var")
    sys.stdout.flush()
    sys.stderr.flush()
    return status


if __name__ == "__main__":
    _serve()
