"""Renew the page of the router: the output that it shows, and its pictures.

python docs/make/router.py
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tutorial

import ncomp
from kinematics.transforms import Array

PAGE = tutorial.ROOT / "docs" / "router.md"
PICTURES = PAGE.parent / "pictures"
END = "## 6. "
"""The part of the page before it shows outputs."""
FILES = {"my_router.toml": "chain =", "marks.nc": "G1 Z-0.3 F200", "sign.nc": "M3 S10000"}
"""Files of the page, each with words of its block."""
LARGER = 20.0
"""Factor by which errors are drawn larger."""
ZERO = (-700.0, -700.0, -60.0)
"""Work offset of the page, mm."""
STYLE = "font-family:sans-serif;font-size:15px;fill:#222"
MARKS = {"A": (0.0, 0.0), "B": (0.0, 600.0), "C": (600.0, 600.0), "D": (600.0, 0.0)}
"""Marks of the page, mm."""


def block(page: str, words: str) -> str:
    """The first block of code of a page that contains some words."""
    blocks = re.findall(r"(?:^    .*\n|^\n)+", page, re.MULTILINE)
    found = next(each for each in blocks if words in each)
    return re.sub(r"^    ", "", found.lstrip("\n"), flags=re.MULTILINE)


def renewed(page: str, folder: Path) -> str:
    """The page with the outputs of its commands, which run in the folder, beside the files of the page."""
    for name, words in FILES.items():
        (folder / name).write_text(block(page, words))
    head, _, rest = page.partition(END)
    return str(tutorial.renewed(head, folder)) + END + rest


def pictures(folder: Path) -> dict[str, str]:
    """The pictures, by their names, as SVG, of the calibration that the commands of the page have left in the folder."""
    return {"router_marks.svg": _marks(folder), "router_before_after.svg": _before_after(folder)}


def _cut(folder: Path, corners: Sequence[tuple[float, float]]) -> Array:
    """Where the router of the page cuts corners `(n, 2)`, mm, relative to the work offset; errors are drawn larger."""
    machine = folder / "my_router.toml"
    positions = np.array([(x, y, 0.0) for x, y in [(0.0, 0.0), *corners]]) + np.array(ZERO)
    deviation = ncomp.predict(positions, machine, folder / "my_router.json").deviation_um[:, :2] * 1e-3
    return np.asarray(np.array(corners) + LARGER * (deviation[1:] - deviation[0]))


def _marks(folder: Path) -> str:
    """The four marks with the distances to measure."""
    at = {name: 90.0 + 0.5 * x for name, x in zip(MARKS, _cut(folder, list(MARKS.values()))[:, 0], strict=True)}
    down = {name: 360.0 - 0.5 * y for name, (_, y) in MARKS.items()}
    lines = [
        f'<line x1="{at[a]:.1f}" y1="{down[a]:.1f}" x2="{at[b]:.1f}" y2="{down[b]:.1f}" stroke="{colour}" '
        f'stroke-width="2"{dashes}/>'
        for a, b, colour, dashes in (
            *((a, b, "#888", "") for a, b in ("AB", "BC", "CD", "DA")),
            *((a, b, "#c33", ' stroke-dasharray="6 4"') for a, b in ("AC", "BD")),
        )
    ]
    lines += [f'<circle cx="{at[name]:.1f}" cy="{down[name]:.1f}" r="4" fill="#222"/>' for name in MARKS]
    shift = {"A": (-22, 18), "B": (-22, -8), "C": (12, -8), "D": (12, 18)}
    words = [(name, at[name] + shift[name][0], down[name] + shift[name][1]) for name in MARKS]
    words += [("side AD, along X", 180.0, 385.0), ("side AB, along Y", at["B"] - 130.0, 210.0)]
    words += [("diagonal AC", at["C"] - 84.0, 150.0), ("diagonal BD", at["D"] - 158.0, 305.0)]
    lines.append('<path d="M20 400 h50 m-8 -4 l8 4 l-8 4 M20 400 v-50 m-4 8 l4 -8 l4 8" fill="none" stroke="#222"/>')
    words += [("X", 76.0, 405.0), ("Y", 14.0, 340.0)]
    return _svg(520, 415, lines, words)


def _before_after(folder: Path) -> str:
    """The square of the program as it is cut before and after the correction."""
    square = [(0.0, 0.0), (300.0, 0.0), (300.0, 300.0), (0.0, 300.0)]
    commands = re.findall(
        r"^(?:G1 )?(?=[XY])(?:X(\S+))?\s*(?:Y(\S+))?", (folder / "sign_c.nc").read_text(), re.MULTILINE
    )
    place, corrected = [0.0, 0.0], [(0.0, 0.0)]
    for x, y in commands[:3]:
        place = [float(x) if x else place[0], float(y) if y else place[1]]
        corrected.append((place[0], place[1]))
    lines, words = [], []
    for title, corners, left, colour in (
        ("before", square, 60.0, "#c33"),
        ("after", corrected, 440.0, "#283"),
    ):
        wanted = [(x + left, 340.0 - y) for x, y in square]
        cut = _cut(folder, corners) + (LARGER - 1.0) * (np.array(corners) - np.array(square))
        lines.append(_polygon(wanted, 'stroke="#888" stroke-dasharray="5 4"'))
        lines.append(_polygon([(x + left, 340.0 - y) for x, y in cut], f'stroke="{colour}" stroke-width="2"'))
        words.append((f"{title}: grey is the drawing", left + 40.0, 370.0))
    words.append((f"errors drawn {LARGER:g} times larger", 300.0, 20.0))
    return _svg(800, 385, lines, words)


def _polygon(corners: Sequence[tuple[float, float]], look: str) -> str:
    return f'<polygon points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in corners)}" fill="none" {look}/>'


def _svg(width: int, height: int, lines: Sequence[str], words: Sequence[tuple[str, float, float]]) -> str:
    """A drawing with lines, and words at places."""
    texts = [f'<text x="{x:.1f}" y="{y:.1f}">{word}</text>' for word, x, y in words]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" style="{STYLE};background:#fff">'
    return "\n".join([head, *lines, *texts, "</svg>", ""])


def main() -> None:
    """Renew page and pictures."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        PAGE.write_text(renewed(PAGE.read_text(), folder))
        for name, drawing in pictures(folder).items():
            (PICTURES / name).write_text(drawing)


if __name__ == "__main__":
    main()
