"""Worked examples of control manuals, and values of the air, beside what ncomp says."""

from __future__ import annotations

import re
from pathlib import Path
from tempfile import TemporaryDirectory

from kinematics.effects import AirDrift
from support.command import succeed
from support.evidence.digits import Agreement, digits

FANUC = {"C-90.": ((10.0, 0.0), (0.0, 10.0)), "C90.": ((0.0, 5.0), (5.0, 0.0))}
"""FANUC A-79634E, Workpiece Setting Error Compensation, page 10: an error of y 10 measured at C -90 is one of x 10 at
C 0, and one of x 5 at C 90 is one of y 5 at C 0. By angle: x and y on the table at C 0, and of the machine."""
WRITTEN = 5.5
"""Digits of 10 in words with four decimals."""
PHASE_INDEX = {(20, 800): 21458.0, (20, 1000): 26824.4, (20, 1200): 32191.6, (10, 1000): 27774.7, (30, 1000): 25937.2}
"""Ciddor, Applied Optics 35 (1996) 1566, table 1: (n - 1) 1e8 of dry air at 633 nm, by degC and hPa."""


def table_angles() -> list[Agreement]:
    """The positions of a tool over a turned table, by `--tcp to-axes`."""
    found, expected = list[float](), list[float]()
    for angle, (on_table, of_machine) in FANUC.items():
        with TemporaryDirectory() as name:
            program, axes = Path(name) / "part.nc", Path(name) / "axes.nc"
            x, y = on_table
            program.write_text(f"G90 G21 G94 G54\nT1\nG0 G43.4 H1 X{x} Y{y} Z50. B0 {angle}\nG1 Z40. F500.\nM30\n")
            options = ("--work-offset", "G54=0,0,200", "--tool-length", "T1=100", "--tcp", "to-axes")
            succeed(program, "--machine", "head_table", "--calibration", "none", *options, "-o", axes)
            block = next(line for line in axes.read_text().splitlines() if angle.rstrip(".") in line)
        found += [float(re.search(rf"{letter}(-?[\d.]+)", block)[1]) for letter in "XY"]
        expected += of_machine
    figure = "x and y over a turned table"
    return [
        Agreement("FANUC A-79634E, page 10", "`ncomp --tcp to-axes`", figure, min(digits(found, expected), WRITTEN))
    ]


def air() -> list[Agreement]:
    """What `air-scale-drift` says of temperature and pressure."""
    kelvin, hectopascal = (
        float(re.search(rf"([\d.]+)(?: um/m)? for each {unit}", _said())[1]) for unit in ("K", "hPa")
    )
    by_kelvin = (PHASE_INDEX[10, 1000] - PHASE_INDEX[30, 1000]) / 20 * 1e-2
    by_hectopascal = (PHASE_INDEX[20, 1200] - PHASE_INDEX[20, 800]) / 400 * 1e-2
    through, table = "`docs/effects.md`, `air-scale-drift`", "Ciddor 1996, table 1"
    return [
        Agreement(table, through, "um/m for each K", digits([kelvin], [by_kelvin])),
        Agreement(table, through, "um/m for each hPa", digits([hectopascal], [by_hectopascal])),
    ]


def _said() -> str:
    return " ".join((AirDrift.__doc__ or "").split())


def rows() -> list[Agreement]:
    """All examples."""
    return [*table_angles(), *air()]
