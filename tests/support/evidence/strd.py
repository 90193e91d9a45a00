"""The NIST StRD sets of tests/data/strd as measurements that ncomp fits.

A polynomial is the positioning error of an axis; the intercept is the zero of the run. Further predictors are
temperatures of sensors, exponentials a warming up, waves cyclic errors. Only the units are changed, by powers of ten,
so that no check of units takes the numbers for a mistake.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import comb
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import msgspec
import numpy as np

import ncomp
from calibration.fit.fit import Fit, fit
from calibration.measurement.measurement import Measurement
from kinematics.basis import Legendre
from kinematics.effects import Cyclic, DriftWithSensor, Effect, ErrorMotion, ThermalDrift
from kinematics.error_model.model import no_errors
from kinematics.transforms import Array
from support.evidence.digits import Agreement, digits

DATA = Path(__file__).parents[2] / "data" / "strd"
POLYNOMIALS = {
    "Norris": ("0.01", "1"), "Pontius": ("1e-6", "1e3"), "Filip": ("1", "1e3"), "Wampler1": ("0.1", "1e-3"),
    "Wampler2": ("0.1", "10"), "Wampler3": ("0.1", "1e-3"), "Wampler4": ("0.1", "1e-3"), "Wampler5": ("0.1", "1e-4"),
}  # fmt: skip
"""Factors on x for mm, and on y for um."""
EXACT_UM = 0.001
"""Standard uncertainty that is stated for sets without scatter."""
HELD, WIDE = 1e-12, 1e7
"""Priors of what is held, and of what is fitted in units of its data or uncertainty: a fit of ncomp has priors, and
the smaller they are, the more they move the result."""
CALM = 4.0
"""Stated uncertainty of the nonlinear sets in units of their scatter: no row is an outlier, nor weighted down."""
MACHINE = """name = "line"
chain = "w b X Y Z t"
[axes.X]
travel = [{low!r}, {high!r}]
[axes.Y]
travel = [0, 1]
[axes.Z]
travel = [0, 1]
"""


class Reference(NamedTuple):
    """A set: its columns, y last, and its certified values."""

    rows: list[list[Fraction]]
    values: list[float]
    deviations: list[float]
    """Standard deviations of the values."""
    residual: float
    """Residual standard deviation."""


def reference(name: str) -> Reference:
    """A set by its name."""
    lines = (DATA / f"{name}.csv").read_text().splitlines()
    certified = [line.split()[3:] for line in lines if line.startswith("# certified")]
    (residual,) = (float(line.split()[-1]) for line in lines if line.startswith("# residual"))
    rows = [[Fraction(cell) for cell in line.split(",")] for line in lines if line[0].isdigit() or line[0] == "-"]
    return Reference(rows, [float(value) for value, _ in certified], [float(sd) for _, sd in certified], residual)


def measurement_of(
    columns: dict[str, list[float]], u_um: float, u_per_m: float = 0.0, runs: Sequence[tuple[str, str]] = ()
) -> Measurement:
    """Readings `deviation_um` of an interferometer along X, as a file that ncomp reads; runs: run and direction."""
    count = len(columns["deviation_um"])
    columns = {"target_mm": [0.0] * count} | columns
    rows = zip(runs or [("1", "+")] * count, zip(*columns.values(), strict=True), strict=True)
    text = "\n".join(",".join(["X", *run, *map(repr, cells)]) for run, cells in rows)
    low, high = min(columns["target_mm"]), max(columns["target_mm"])
    with TemporaryDirectory() as folder:
        data, machine = Path(folder) / "data.csv", Path(folder) / "line.toml"
        machine.write_text(MACHINE.format(low=low, high=high if high > low else low + 1.0))
        head = f"# machine: line\n# instrument: interferometer\n# u_um: {u_um!r}\n# u_um_per_m: {u_per_m!r}\n# target.t: 0 0 0\n"
        data.write_text(f"{head}axis,run,direction,{','.join(columns)}\n{text}\n")
        return ncomp.read_measurement(data, machine)


def thermometer_readings() -> tuple[list[float], list[float]]:
    """The GUM's example H.3: temperatures, degC, and corrections, mdegC, as positions and deviations."""
    temperature, correction = np.loadtxt(DATA.parent / "gum_h3.csv", delimiter=",", skiprows=2).T.tolist()
    return temperature, correction


def polynomial(name: str) -> list[Agreement]:
    """A polynomial as a sum of Legendre polynomials over the measured range, whose constant is the zero of the run."""
    data, (by_x, by_y) = reference(name), map(Fraction, POLYNOMIALS[name])
    x, y = [float(row[0] * by_x) for row in data.rows], [float(row[1] * by_y) for row in data.rows]
    degree, low, high = len(data.values) - 1, min(x), max(x)
    motion = ErrorMotion("X", "X", Legendre((low, high), degree), (0.0,) * (degree + 1))
    u = data.residual * float(by_y) or EXACT_UM
    wide = np.append(HELD, np.full(degree, WIDE * max(u, np.abs(y).max())))
    found = _fitted({"target_mm": x, "deviation_um": y}, u, [motion], wide)
    (zero,) = found.registration.zeros.values()
    own = [Fraction(zero) * 1000, *map(Fraction, found.model.parameters[1:])]
    powers = [
        [each * by_x**k / by_y for k, each in enumerate(row)] for row in _powers(degree, Fraction(low), Fraction(high))
    ]
    values = [float(sum(a * row[k] for a, row in zip(own, powers, strict=True))) for k in range(degree + 1)]
    into = np.array(powers, float).T[1:]
    uncertainties = np.sqrt(np.diag(into @ np.array(found.model.covariance) @ into.T))
    spread = float(np.sqrt(np.sum(found.residual**2) / (len(x) - degree - 1))) * 1e3 / float(by_y)
    result = _agreements(name, f"`legendre:{degree}`", data, values, uncertainties)
    return [
        *result,
        Agreement(name, result[0].through, "residual standard deviation", digits([spread], [data.residual])),
    ]


def _powers(degree: int, low: Fraction, high: Fraction) -> list[list[Fraction]]:
    """Legendre polynomials over an interval by powers of x, lowest first, exactly."""
    slope, start = 2 / (high - low), -(high + low) / (high - low)
    rows = []
    for n in range(degree + 1):
        row = [Fraction(0)] * (degree + 1)
        for half in range(n // 2 + 1):
            power = n - 2 * half
            factor = Fraction((-1) ** half * comb(n, half) * comb(2 * n - 2 * half, n), 2**n)
            for k in range(power + 1):
                row[k] += factor * comb(power, k) * slope**k * start ** (power - k)
        rows.append(row)
    return rows


def longley() -> list[Agreement]:
    """Six predictors as temperatures of sensors that the tool point follows; by the fit itself, with wide priors."""
    data = reference("Longley")
    names = [f"temp_x{k}" for k in range(1, 7)]
    columns = {name: [float(row[k]) for row in data.rows] for k, name in enumerate(names)}
    effects = [DriftWithSensor(component="X", sensor=name.removeprefix("temp_"), coefficient=0.0) for name in names]
    wide = WIDE * np.array(data.deviations[1:])
    found = _fitted(columns | {"deviation_um": [float(row[6]) for row in data.rows]}, data.residual, effects, wide)
    values = found.model.parameters
    (zero,) = found.registration.zeros.values()
    intercept = zero * 1e3 - 20.0 * sum(values)  # temperatures are differences from 20 degC
    uncertainties = np.sqrt(np.diag(found.model.covariance))
    return _agreements("Longley", "`thermal-drift-sensor`", data, np.append(intercept, values), uncertainties)


def mgh17() -> list[Agreement]:
    """Two exponentials as a warming up with two time constants, from NIST's second start."""
    data = reference("MGH17")
    columns = {"time_s": [float(x) for x, _ in data.rows], "deviation_um": [float(y) for _, y in data.rows]}
    start = ThermalDrift("X", amplitudes=(-1.5, 1.0), time_constants_s=(100.0, 50.0))
    found = _fitted(columns, CALM * data.residual, [start], np.full(4, WIDE))
    one, two, early, late = found.model.parameters
    (zero,) = found.registration.zeros.values()
    u = np.sqrt(np.diag(found.model.covariance)) / CALM / [1.0, 1.0, early**2, late**2]
    values = np.array([zero * 1e3 + one + two, -one, -two, 1.0 / early, 1.0 / late])
    return _agreements("MGH17", "`thermal-drift`", data, values, u)


def enso() -> list[Agreement]:
    """A wave of known period and two of unknown ones as cyclic errors, from NIST's second start."""
    data = reference("ENSO")
    columns = {"target_mm": [float(x) for x, _ in data.rows], "deviation_um": [float(y) for _, y in data.rows]}
    periods, sines, cosines = (12.0, 44.0, 26.0), (0.5, 0.5, 1.5), (3.0, -1.5, -0.1)
    effects = [Cyclic("X", "X", p, (s,), (c,)) for p, s, c in zip(periods, sines, cosines, strict=True)]
    wide = np.full(9, WIDE)
    wide[0] = HELD  # the first period is known
    found = _fitted(columns, CALM * data.residual, effects, wide)
    order = [2, 1, 3, 5, 4, 6, 8, 7]
    u = np.sqrt(np.diag(found.model.covariance))[order] / CALM
    (zero,) = found.registration.zeros.values()
    return _agreements("ENSO", "`cyclic`", data, np.append(zero * 1e3, found.model.parameters[order]), u)


def _fitted(columns: dict[str, list[float]], u_um: float, effects: list[Effect], prior: Array) -> Fit:
    """The fit of effects alone, by which all commands fit."""
    measured = measurement_of(columns, u_um)
    found = fit(measured, msgspec.structs.replace(no_errors(measured.machine), effects=tuple(effects)), prior=prior)
    assert found.kept.all()
    return found


def _agreements(name: str, effect: str, data: Reference, values: Array, uncertainties: Array) -> list[Agreement]:
    """Digits of values and of all uncertainties but that of the intercept, which no figure of ncomp is."""
    through = f"`calibration.fit.fit`, {effect}"
    found = [Agreement(name, through, "parameters", digits(values, data.values))]
    if data.residual:
        found.append(
            Agreement(name, through, "their standard uncertainties", digits(uncertainties, data.deviations[1:]))
        )
    return found


def rows() -> list[Agreement]:
    """All sets."""
    return [row for name in POLYNOMIALS for row in polynomial(name)] + longley() + mgh17() + enso()
