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


FIVE_AXES = "five axes"
"""The plain form, ISO."""
HEAD = "%\nO0001 (SPEED)\nG21 G17 G90 G40 G49 G80 G94 G54\nT1 M6\nS12000 M3\n"
START = "X60.0000 Y0.0000 Z200.0000 B20.0000 C180.0000"
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
            "three axes, inch, words left out", ".nc",
            f"{HEAD.replace('G21', 'G20')}G0 X2.3622Y0.Z7.874\nG1 F60.\n", _inch,
        ),
        Clothing(
            "three axes, an arc every tenth move", ".nc",
            f"{HEAD}G0 X60.0000 Y-0.1650 Z200.0000\nG1 F1500.\n", _arcs,
        ),
    )
}  # fmt: skip
