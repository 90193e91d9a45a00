"""Lengths by a ruler: do the stated uncertainties of squareness and scale hold, with three, eight and twenty readings?

Machines with random squareness and scales are measured by a ruler whose scale is off within its uncertainty. The marks
are calculated here, without ncomp. For each number of readings: the share of draws in which the true value lies within
1.96 standard uncertainties (95 % where these hold; over 200 draws it varies by 1.5 %), and the RMS of the error in
standard uncertainties (1).

    python benchmarks/lengths.py [DRAWS]
"""

from __future__ import annotations

import sys
import tempfile
from itertools import combinations
from pathlib import Path

import numpy as np

import ncomp

MACHINE = """name = "router"
chain = "w b X Y Z t"
[axes.X]
travel = [0, 800]
[axes.Y]
travel = [0, 800]
[axes.Z]
travel = [-100, 0]
"""
RULER_UM, SCALE_UM_PER_M = 250.0, 300.0
"""Standard uncertainties of a reading, um, and of the scale of the ruler, um/m."""
SQUARENESS, SCALES = 3e-3, 2e-3
"""Standard deviations of the errors of the machines, rad and mm/mm."""
CORNERS = {"A": (50.0, 50.0), "B": (50.0, 650.0), "C": (750.0, 650.0), "D": (750.0, 50.0)}
MORE = {"E": (400.0, 50.0), "F": (750.0, 350.0), "G": (400.0, 650.0), "H": (50.0, 350.0)}
"""Positions: the corners of a rectangle, and the middles of its sides."""
READINGS = {
    3: ("AC", "BD", "AD"),
    8: ("AB", "BC", "CD", "AD", "AC", "BD", "EG", "FH"),
    20: tuple("".join(pair) for pair in combinations((CORNERS | MORE), 2))[:20],
}
"""Lengths, by their number."""


def measured(pairs: tuple[str, ...], rng: np.random.Generator) -> tuple[str, dict[str, float]]:
    """The file of a machine, and its squareness, urad, and scales, um/m."""
    skew, along_x, along_y = rng.normal(0.0, (SQUARENESS, SCALES, SCALES))
    ruler = rng.normal(0.0, SCALE_UM_PER_M * 1e-6)
    places = CORNERS | MORE
    lines = [
        "# machine: router",
        "# instrument: lengths",
        f"# u_um: {RULER_UM}",
        f"# u_scale_um_per_m: {SCALE_UM_PER_M}",
    ]
    lines.append("name,X1,Y1,X2,Y2,length_mm")
    for pair in pairs:
        (x1, y1), (x2, y2) = (places[letter] for letter in pair)
        marks = np.array([(x * (1.0 + along_x) + skew * y, y * (1.0 + along_y)) for x, y in ((x1, y1), (x2, y2))])
        length = np.linalg.norm(marks[1] - marks[0]) * (1.0 + ruler) + rng.normal(0.0, RULER_UM * 1e-3)
        lines.append(f"{pair},{x1},{y1},{x2},{y2},{length:.6f}")
    truth = {"squareness": -skew * 1e6, "scale of X": along_x * 1e6, "scale of Y": along_y * 1e6}
    return "\n".join(lines) + "\n", truth


def found_of(path: Path, machine: object) -> dict[str, tuple[float, float]]:
    """Squareness, urad, and scales, um/m, with their standard uncertainties, of a fit."""
    model = ncomp.fit(ncomp.read_measurement(path, machine), hold_out=False).model
    effects = {effect.name: effect for effect in model.effects}
    square = effects["E_C0Y"]
    found = {"squareness": (square.value, square.u[0])}
    for axis in "XY":
        motion = effects[f"E_{axis}{axis}"]
        low, high = motion.basis.interval
        found[f"scale of {axis}"] = tuple(2e3 * each[1] / (high - low) for each in (motion.parameters, motion.u))
    return found


def errors(count: int, draws: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Errors `(draws,)` in standard uncertainties, of fits of so many readings."""
    off: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        toml, path = Path(folder) / "router.toml", Path(folder) / "lengths.csv"
        toml.write_text(MACHINE)
        machine = ncomp.load_machine(toml)
        for rng in (np.random.default_rng((seed, count, k)) for k in range(draws)):
            text, truth = measured(READINGS[count], rng)
            path.write_text(text)
            for name, (value, u) in found_of(path, machine).items():
                off.setdefault(name, []).append((value - truth[name]) / u)
    return {name: np.array(values) for name, values in off.items()}


def main() -> None:
    """Print the shares."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    print(f"{'readings':8}  {'error':12}  {'within U95, %':>13}  {'RMS':>5}")
    for count in READINGS:
        for name, off in errors(count, draws).items():
            within = 100.0 * np.mean(np.abs(off) < 1.96)
            print(f"{count:8}  {name:12}  {within:13.1f}  {np.sqrt(np.mean(off**2)):5.2f}")


if __name__ == "__main__":
    main()
