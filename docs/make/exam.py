"""Draws docs/exam_history.svg from docs/exam_history.csv: what fresh seeds have shown, run by run.

python docs/make/exam.py
"""

import csv
from collections.abc import Callable
from pathlib import Path

DOCS = Path(__file__).parents[1]
WIDTH, HEIGHT, LEFT, GAP = 640, 90, 210, 26
Figure = Callable[[dict[str, str]], float]
FIGURES: dict[str, Figure] = {
    "errors of a fit within U, %": lambda row: float(row["within_u_percent"]),
    "hidden causes named, %": lambda row: 100.0 * int(row["named"]) / int(row["causes"]),
    "causes that are not there": lambda row: float(row["false_causes"]),
    "programs that differ": lambda row: float(row["differences"]),
    "tables apart from their sheet, %": lambda row: float(row["sheet_apart_percent"]),
    "lines corrected in a second": lambda row: float(row["lines_per_s"]),
}


def panel(title: str, rows: list[dict[str, str]], of: Figure, top: int) -> str:
    """One figure over the runs."""
    values = [of(row) for row in rows]
    low, high = min([*values, 0.0]), max([*values, 1.0])
    step = (WIDTH - LEFT - 20) / max(len(values) - 1, 1)
    places = [
        (LEFT + i * step, top + HEIGHT - GAP - (HEIGHT - GAP - 20) * (v - low) / (high - low))
        for i, v in enumerate(values)
    ]
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    dots = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="#1f6feb"/>' for x, y in places)
    return (
        f'<text x="10" y="{top + 40}">{title}</text><text x="10" y="{top + 56}" fill="#888">last {values[-1]:g}</text>'
        f'<line x1="{LEFT}" y1="{top + HEIGHT - GAP}" x2="{WIDTH - 10}" y2="{top + HEIGHT - GAP}" stroke="#bbb"/>'
        f'<polyline points="{path}" fill="none" stroke="#1f6feb" stroke-width="1.5"/>{dots}'
    )


def drawn(rows: list[dict[str, str]]) -> str:
    """The chart of all runs, in their order."""
    panels = "".join(panel(title, rows, of, i * HEIGHT) for i, (title, of) in enumerate(FIGURES.items()))
    size = f'width="{WIDTH}" height="{HEIGHT * len(FIGURES)}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="12" fill="#555">{panels}</svg>\n'


if __name__ == "__main__":
    with (DOCS / "exam_history.csv").open(newline="") as file:
        (DOCS / "exam_history.svg").write_text(drawn(list(csv.DictReader(file))))
