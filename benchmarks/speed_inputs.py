"""Programs of any length for `benchmarks/speed.py`, as CAM systems post them: one smooth path in several clothings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

AT_ONCE = 100_000
LARGEST_NUMBER = 1_000_000
"""Line numbers begin again after so many lines: readers limit their digits."""
EVERY = 10
"""One move in so many is an arc."""
RADIUS = 3.0
"""Radius of the arcs, mm."""
INCH = 25.4
IN_SUBPROGRAM = 40
"""Moves of a subprogram."""
PLANE = 300
"""So many arcs follow one another in one plane."""
PLANES = ((17, (0, 1, 2), "IJ"), (18, (2, 0, 1), "KI"), (19, (1, 2, 0), "JK"))
"""Code of each plane; its first, second and normal axis; addresses of centres."""


def path(i: np.ndarray) -> np.ndarray:
    """Positions `(n, 5)` of X, Y, Z, mm, and B, C, degrees, of the moves `i`."""
    t = i / 400.0
    x, y, z = 60 * np.cos(t), 60 * np.sin(1.1 * t), 200 + 20 * np.sin(0.7 * t)
    return np.stack([x, y, z, 20 + 10 * np.sin(0.3 * t), 180 + 90 * np.sin(0.2 * t)], axis=1)


def feed(i: np.ndarray) -> np.ndarray:
    """Feeds `(n,)`, mm/min."""
    return 1500 + 500 * np.sin(0.05 * i / 400.0)


def _numbers(i: np.ndarray) -> list[int]:
    return (10 * (i % (LARGEST_NUMBER - 1) + 1)).tolist()


def _five_axes(i: np.ndarray) -> Iterator[str]:
    for n, (x, y, z, b, c), f in zip(_numbers(i), path(i).tolist(), feed(i).tolist(), strict=True):
        yield f"N{n} G1 X{x:.4f} Y{y:.4f} Z{z:.4f} B{b:.4f} C{c:.4f} F{f:.1f}\n"


def _without_numbers(i: np.ndarray) -> Iterator[str]:
    for line in _five_axes(i):
        yield line.partition(" ")[2]


def _increments(i: np.ndarray) -> Iterator[str]:
    """Increments between the positions of four decimals."""
    steps = np.round(path(i), 4) - np.round(path(i - 1), 4)
    for n, (x, y, z, b, c), f in zip(_numbers(i), steps.tolist(), feed(i).tolist(), strict=True):
        yield f"N{n} G1 X{x:.4f} Y{y:.4f} Z{z:.4f} B{b:.4f} C{c:.4f} F{f:.1f}\n"


def _tool(i: np.ndarray) -> np.ndarray:
    """Directions `(n, 3)` of the tool against the workpiece: near the vertical, on a slow cone."""
    t = i / 400.0
    tilt, turn = np.radians(20 + 10 * np.sin(0.3 * t)), np.radians(90 * np.sin(0.2 * t))
    return np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=1)


def _tool_vectors(i: np.ndarray) -> Iterator[str]:
    rows = zip(_numbers(i), path(i)[:, :3].tolist(), _tool(i).tolist(), feed(i).tolist(), strict=True)
    for n, (x, y, z), (a, b, c), f in rows:
        yield f"N{n} G1 X{x:.4f} Y{y:.4f} Z{z:.4f} A3={a:.6f} B3={b:.6f} C3={c:.6f} F{f:.1f}\n"


def _surface_normals(i: np.ndarray) -> Iterator[str]:
    rows = zip(_numbers(i), path(i)[:, :3].tolist(), _tool(i).tolist(), feed(i).tolist(), strict=True)
    for n, (x, y, z), (a, b, c), f in rows:
        normal, tool = (f"{letter}X{a:+.6f} {letter}Y{b:+.6f} {letter}Z{c:+.6f}" for letter in "NT")
        yield f"{n} LN X{x:+.4f} Y{y:+.4f} Z{z:+.4f} {normal} {tool} F{f:.0f}\n"


def _klartext(i: np.ndarray) -> Iterator[str]:
    for n, (x, y, z, b, c), f in zip(_numbers(i), path(i).tolist(), feed(i).tolist(), strict=True):
        yield f"{n} L X{x:+.4f} Y{y:+.4f} Z{z:+.4f} B{b:+.4f} C{c:+.4f} F{f:.0f}\n"


def _inch(i: np.ndarray) -> Iterator[str]:
    """Three axes, most lines without some of them, and all without G1 and a feed."""
    named = i * 2654435761 % 7 + 1
    named[i % 50 == 0] = 7
    for row, mask in zip((path(i)[:, :3] / INCH).tolist(), named.tolist(), strict=True):
        words = [f"{axis}{row[k]:.4f}" for k, axis in enumerate("XYZ") if mask >> k & 1]
        yield f"{''.join(words)}\n"


def _arcs(i: np.ndarray) -> Iterator[str]:
    """Three axes; the arcs lie in X and Y, at the height of the move before."""
    rows, before = (np.round(path(each)[:, :2], 4) for each in (i, i - 1))
    chord, middle = rows - before, (rows + before) / 2
    length = np.maximum(
        np.linalg.norm(chord, axis=1, keepdims=True), 1e-9
    )  # zero where the path turns back: no arc is there
    across = np.stack([-chord[:, 1:], chord[:, :1]])[..., 0].T / length
    centres = middle + across * np.sqrt(RADIUS**2 - length**2 / 4) - before
    heights = path(i)[:, 2]
    for k, n in enumerate(_numbers(i)):
        (x, y), (a, b) = rows[k].tolist(), centres[k].tolist()
        if n // 10 % EVERY:
            yield f"N{n} G1 X{x:.4f} Y{y:.4f} Z{heights[k]:.4f}\n"
        else:
            yield f"N{n} G3 X{x:.4f} Y{y:.4f} I{a:.4f} J{b:.4f}\n"


def _arcs_only(i: np.ndarray) -> Iterator[str]:
    """By a radius, by a centre, and helices, in turn; another plane after every 300 arcs."""

    def position(k: np.ndarray) -> np.ndarray:
        """The normal axis moves in helices, which are every third arc."""
        rows, plane = path(k)[:, :3], k // PLANE % 3
        normal = np.array([2, 1, 0])[plane]
        rows[np.arange(len(k)), normal] = path(k // 3 * 3)[np.arange(len(k)), normal]
        return np.round(rows, 4)

    ends, starts = position(i), position(i - 1)
    for k, n, start, end in zip(i.tolist(), _numbers(i), starts, ends, strict=True):
        code, axes, letters = PLANES[k // PLANE % 3]
        first, second, normal = axes
        chord = (end - start)[[first, second]]
        length = max(float(np.hypot(*chord)), 1e-9)
        a, b = chord / 2 + np.array([-chord[1], chord[0]]) / length * np.sqrt(RADIUS**2 - length**2 / 4)
        words = "".join(f" {'XYZ'[axis]}{end[axis]:.4f}" for axis in sorted((first, second)))
        if k % 3 == 0:
            words += f" {'XYZ'[normal]}{end[normal]:.4f}"
        centre = f"R{RADIUS:.4f}" if k % 3 == 1 else f"{letters[0]}{a:.4f} {letters[1]}{b:.4f}"
        yield f"N{n} {f'G{code} ' if k % PLANE == 0 else ''}G3{words} {centre}\n"


def _holes(i: np.ndarray) -> Iterator[str]:
    for (x, y), depth in zip(path(i)[:, :2].tolist(), (i % 40).tolist(), strict=True):
        yield f"X{x:.4f} Y{y:.4f}{' Z185.' if not depth else ''}\n"


def _calls(i: np.ndarray) -> Iterator[str]:
    """Calls of a subprogram, one for as many moves as it has."""
    for first in (i % IN_SUBPROGRAM == 0).tolist():
        yield "M98 P0100\n" if first else ""


FIVE_AXES = "five axes"
"""The plain form, ISO."""
HEAD = "%\nO0001 (SPEED)\nG21 G17 G90 G40 G49 G80 G94 G54\nT1 M6\nS12000 M3\n"
START = "X60.0000 Y0.0000 Z200.0000 B20.0000 C180.0000"
BETWEEN = ("--accept", "worse")
"""No block can be added beside a tool vector, so that the error between the ends of the moves stays."""
BEFORE = " ".join(f"{axis}{value:.4f}" for axis, value in zip("XYZBC", path(np.array([-1]))[0].tolist(), strict=True))
"""The position before the first increment."""
FOOT = "M5\nM30\n%\n"


@dataclass(frozen=True)
class Clothing:
    """A form of the program."""

    name: str
    suffix: str
    head: str
    lines: Callable[[np.ndarray], Iterator[str]]
    foot: str = FOOT
    own_head: str | None = None
    """Head for LinuxCNC, where it has no word for something."""
    twin: str = ""
    """Name of the form that LinuxCNC reads in its place; empty if it reads this one."""
    options: tuple[str, ...] = ()
    """Further words of the command of ncomp."""
    most: int = 100_000_000
    """Moves, at most: a form that takes milliseconds a move is measured with fewer."""

    def write(self, file: Path, number: int, head: str | None = None) -> None:
        """A program of so many moves."""
        with file.open("w", newline="\n") as out:
            out.write(head or self.head)
            for first in range(0, number, AT_ONCE):
                out.writelines(self.lines(np.arange(first, min(first + AT_ONCE, number))))
            out.write(self.foot)


CLOTHINGS = {
    each.name: each
    for each in (
        Clothing(FIVE_AXES, ".nc", f"{HEAD}G0 {START}\n", _five_axes),
        Clothing("five axes, without N", ".nc", f"{HEAD}G0 {START}\n", _without_numbers),
        Clothing(
            "five axes, G91", ".nc",
            f"{HEAD}G0 {START}\nG1 {BEFORE} F1500.\nG91\n", _increments,
        ),
        Clothing(
            "five axes, Siemens", ".mpf",
            f"%_N_SPEED_MPF\nG71 G17 G90 G40 G94 G54\nT1 D1\nM6\nS12000 M3\nG0 {START}\n", _five_axes, "M5\nM30\n",
            twin=FIVE_AXES,
        ),
        Clothing(
            "five axes, Klartext", ".h",
            "0 BEGIN PGM SPEED MM\n1 TOOL CALL 1 Z S12000\n2 L X+60 Y+0 Z+200 B+20 C+180 FMAX M3\n", _klartext,
            "M30\nEND PGM SPEED MM\n", twin=FIVE_AXES,
        ),
        Clothing(
            "five axes, TCP", ".nc", f"{HEAD}G43.4 H1\nG0 {START}\n", _five_axes,
            own_head=f"{HEAD}G43 H1\nG0 {START}\n",
        ),
        Clothing(
            "tool vectors, Siemens", ".mpf",
            "%_N_SPEED_MPF\nG71 G17 G90 G40 G94 G54\nT1 D1\nM6\nTRAORI\nS12000 M3\n"
            "G0 X60 Y0 Z200 A3=0.34202 B3=0 C3=0.93969\n",
            _tool_vectors, "M5\nM30\n", twin=FIVE_AXES, options=BETWEEN, most=20_000,
        ),
        Clothing(
            "tool vectors, Klartext", ".h",
            "0 BEGIN PGM SPEED MM\n1 TOOL CALL 1 Z S12000\n2 L X+60 Y+0 Z+200 B+20 C+180 FMAX M3\n"
            "3 M128\n", _surface_normals,
            "M30\nEND PGM SPEED MM\n", twin=FIVE_AXES, options=BETWEEN, most=20_000,
        ),
        Clothing(
            "three axes, inch, words left out", ".nc",
            f"{HEAD.replace('G21', 'G20')}G0 X2.3622Y0.Z7.874\nG1 F60.\n", _inch,
        ),
        Clothing(
            "three axes, an arc every tenth move", ".nc",
            f"{HEAD}G0 X60.0000 Y-0.1650 Z200.0000\nG1 F1500.\n", _arcs,
        ),
        Clothing(
            "three axes, every move an arc", ".nc",
            f"{HEAD}G0 X60.0000 Y-0.1650 Z199.8950\nG1 F1500.\n", _arcs_only,
        ),
        Clothing(
            "five axes, a subprogram called again", ".nc",
            f"{HEAD}G0 {START}\n", _calls,
            f"M5\nM30\nO0100\n{''.join(_without_numbers(np.arange(IN_SUBPROGRAM)))}M99\n%\n",
        ),
        Clothing(
            "holes of a drilling cycle", ".nc",
            f"{HEAD}G0 X60. Y0. Z240.\nG98 G81 X60. Y0. Z180. R230. F300.\n", _holes, f"G80\n{FOOT}",
        ),
    )
}  # fmt: skip
