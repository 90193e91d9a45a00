"""The demonstration calibration of the DMU 50: `python -m machines.calibrations.dmu50_demonstration` writes it.

The three translational error motions of X are the published ones of Ellingsdalen (NTNU 2021), Fig. 3.11, which lists
the compensated commands for X = 0 ... 500 mm: error = nominal - compensated command. Travel there starts at one end;
here it is centred, X = -250 ... 250 mm. Everything else is simulated: the sizes are those the thesis quotes
(E_YY up to 41 um, E_ZZ about 16 um), the shapes are drawn at random. It describes no machine that you have.
"""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np

import machines
from kinematics.basis import Basis, BSpline, Fourier, Legendre, Polynomial
from kinematics.effects import Component, Effect, ErrorMotion, LocationError
from kinematics.error_model.model import ErrorModel, encode_model
from kinematics.error_model.provenance import Provenance, reference
from kinematics.files import write_whole
from kinematics.machine import Machine
from kinematics.transforms import Array

# Thesis Fig. 3.11, right-hand array: compensated X, Y, Z for nominal X = 0, 50, ... 500 and Y = Z = 0, mm.
FIGURE_3_11 = (
    (0.0, 0.0, 0.0),
    (49.9956, -0.000949353, -0.00156385),
    (99.9937, -0.000753776, 0.000895042),
    (149.993, -0.000362045, -0.00238055),
    (199.992, -0.000215857, -0.00110904),
    (249.99, -0.000387325, 0.00149589),
    (299.987, -0.000716486, 0.000389921),
    (349.984, -0.000948794, -0.000920075),
    (399.981, -0.000872622, 0.00182009),
    (449.979, -0.000456766, 0.000298728),
    (499.981, 1.20629e-05, -0.00292907),
)
NOMINAL = np.arange(0.0, 501.0, 50.0)
CENTRE = 250.0

# The thesis prints no uncertainty of these values. AT960: 15 um MPE across the beam, taken as k = 2, four rounds.
U_MEASURED = 15.0 / 2 / 4**0.5

DIRECTIONS: tuple[Component, ...] = ("X", "Y", "Z", "A", "B", "C")

LOCATION_ERRORS: tuple[tuple[Component, str, float], ...] = (
    ("C", "Y", 12.0), ("B", "Z", 15.0), ("A", "Z", -10.0),
    ("X", "C", 6.0), ("Y", "C", -8.0), ("A", "C", 10.0), ("B", "C", -7.0),
    ("X", "B", 5.0), ("Z", "B", -6.0), ("A", "B", 9.0), ("C", "B", -12.0),
)  # fmt: skip

REAL = "published: Ellingsdalen 2021, Fig. 3.11; u from the tracker's specification"
SIMULATED = "simulated"
SEED = 20210611


def published_x() -> list[Effect]:
    """E_XX, E_YX, E_ZX of Fig. 3.11 as interpolated tables, um."""
    nominal = np.stack([NOMINAL, np.zeros(11), np.zeros(11)], axis=1)
    errors = np.round((nominal - np.array(FIGURE_3_11)) * 1e3, 6)
    basis = BSpline(tuple((NOMINAL - CENTRE).tolist()), 1)
    u = (0.0, *[U_MEASURED] * 10)  # the first point is the origin of the measurement
    return [
        ErrorMotion(component, "X", basis, tuple(map(float, column)), u=u, note=REAL)
        for component, column in zip(DIRECTIONS, errors.T, strict=False)
    ]


def simulated(machine: Machine) -> list[Effect]:
    """All other error motions and the location errors, at the thesis' magnitudes, drawn at random."""
    rng = np.random.default_rng(SEED)
    x, y, z, b, c = ((*machine.axes[machine.index(name)].travel,) for name in "XYZBC")
    bases: dict[str, Basis] = {
        "X": Legendre(x, 5),
        "Y": Legendre(y, 6),
        "Z": Polynomial(z, 4),
        "B": BSpline(tuple(np.linspace(*b, 10).tolist()), 3),
        "C": Fourier(c, (2.0, 4.0)),
    }
    peaks: dict[str, tuple[float, ...]] = {
        "X": (0, 0, 0, 8, 12, 10),
        "Y": (5, 40.8, 8, 10, 8, 12),
        "Z": (7, 8, 16.5, 15, 8, 5),
        "B": (4, 5, 6, 6, 8, 6),
        "C": (5, 5, 9, 20, 12, 15),
    }
    effects: list[Effect] = []
    for axis, basis in bases.items():
        low, high = machine.axes[machine.index(axis)].travel
        columns = basis.columns(np.linspace(low, high, 721))
        for component, peak in zip(DIRECTIONS, peaks[axis], strict=True):
            if peak:
                draw = rng.normal(size=basis.size)
                draw *= peak / np.abs(columns @ draw).max()
                u = max(1.0, 0.1 * peak)
                effects.append(_motion(component, axis, basis, draw, u))
    effects += [LocationError(*error, u=(2.0,), note=SIMULATED) for error in LOCATION_ERRORS]
    return effects


def demonstration() -> ErrorModel:
    """The calibration, the same at every call."""
    machine = machines.load("dmu50")
    made = Provenance(
        "machines.calibrations.dmu50_demonstration",
        datetime.datetime(2026, 11, 21, tzinfo=datetime.UTC),
        "translational error motions of X: Ellingsdalen (NTNU 2021), Fig. 3.11; all others simulated",
    )
    effects = (*published_x(), *simulated(machine))
    return ErrorModel(machine=reference(machine), provenance=made, demonstration=True, effects=effects)


def _motion(component: Component, axis: str, basis: Basis, draw: Array, u: float) -> ErrorMotion:
    parameters = tuple(float(p) for p in np.round(draw, 4))
    return ErrorMotion(component, axis, basis, parameters, u=(u,) * basis.size, note=SIMULATED)


if __name__ == "__main__":
    write_whole(Path(__file__).with_name("dmu50.json"), encode_model(demonstration()))
