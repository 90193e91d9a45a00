"""Ranges alone, from one to four stations, beside one tracker with angles: volumetric error left, and its coverage.

A machine of 1.5 x 1 x 0.8 m, whose error motions are random polynomials of degree 3 (10 um and urad in the first
coefficients, less in the next), is measured at about 60 positions, its corners among them, with three reflectors, by
ranges of 0.2 um + 0.3 um/m (k = 1) from stations whose places and dead lengths are unknown. The tracker has the same
ranges, and angles of 5 um + 2.5 um/m. For each case: rank of the fit of the first machine, the share of true deviations
within 1.96 standard uncertainties (95 % where these hold; more where a prior stands for what is hidden), the aligned
volumetric error before and after, and the stated U (k = 2) of the latter. The fit is that of `ncomp fit --basis
legendre:3`.

The cases with a plan have 240 ranges from four stations: stations, reflectors and positions by `ncomp plan optimised`;
stations by habit at the corners, low, with the positions by hand or optimised; all at random, anew in each draw.
`--rough` takes machines of the virtual calibration paper's Table 1, with waves, and the automatic bases. `--prior`
takes machines whose error motions are as large as the fit expects before any data: each coefficient is drawn with the
typical size of its kind. What the data do not show is then within its U in 95 % of all cases; of smaller machines more
is.

    python benchmarks/ranging.py [--draws 200] [--cases "planned;corners"] [--rough | --prior]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

import machines
from benchmarks.virtual_fits import Judged, judge
from calibration.fit.calibrate import calibrate
from calibration.fit.identifiability import identifiability
from calibration.instruments import Instrument, LaserTracker, Ranging
from calibration.measurement.measurement import Measurement, Target
from calibration.measurement.plan import Choices, Plan
from calibration.observation.full_model import priors
from calibration.observation.mean_lines import centred
from calibration.optimal.candidates import volume_of_targets
from calibration.optimal.optimise import Request, optimised
from calibration.planning.strategies import evaluation_grid, plan
from calibration.registration.measured_centre import arms_of
from calibration.simulation.simulate import at_stations, observe, tracker_pose
from calibration.simulation.true_model import model_of, random_true_model
from kinematics.basis import Legendre
from kinematics.effects import COMPONENTS, ErrorMotion
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine, Vector
from kinematics.state import State

PAGE = Path(__file__).parents[1] / "docs" / "measurements" / "ranging.md"
TARGETS = {"t1": Target((80.0, 0.0, -100.0)), "t2": Target((-60.0, 70.0, -150.0)), "t3": Target((-60.0, -70.0, -250.0))}
STATIONS = ((-400.0, -300.0, 100.0), (1900.0, -300.0, 200.0), (750.0, 1400.0, 150.0), (700.0, 500.0, -450.0))
POSITIONS = (32, 28)
"""Positions on the edges and diagonals of the volume, and random ones."""
DEGREE, SIZE = 3, 10.0
"""Degree of the error motions, and the standard deviation of their first coefficients, um and urad."""
RANGES = Ranging(u_range_um=0.2, u_range_um_per_m=0.3)
TRACKER = LaserTracker(u_range_um=0.2, u_range_um_per_m=0.3, u_angle_um=5.0, u_angle_um_per_m=2.5)


CORNERS = ((-360.0, -370.0, -60.0), (1880.0, -370.0, -60.0), (1880.0, 1370.0, -60.0), (-360.0, 1370.0, -60.0))
"""Stations by habit: 300 mm off the corners of the volume of the reflectors, low."""
FEW, RANGES_OF_A_PLAN = (12, 8), 240
"""Positions for each reflector and station, and their number in a plan."""
OFF_MM = 1500.0
"""Largest distance of random stations from the volume, mm."""


class Case(NamedTuple):
    """One set-up."""

    instrument: Instrument
    stations: Sequence[Vector] | None
    """Places of the instrument, mm; None for random ones, () for optimised ones."""
    positions: tuple[int, ...] | None = POSITIONS
    """Numbers of positions, as of POSITIONS, or of random ones; None for optimised ones."""


CASES = {
    "four stations": Case(RANGES, STATIONS),
    "three stations": Case(RANGES, STATIONS[:3]),
    "two stations": Case(RANGES, STATIONS[:2]),
    "one station": Case(RANGES, STATIONS[:1]),
    "one tracker": Case(TRACKER, STATIONS[:1]),
    "planned": Case(RANGES, (), None),
    "corners, positions planned": Case(RANGES, CORNERS, None),
    "corners": Case(RANGES, CORNERS, FEW),
    "random": Case(RANGES, None, (sum(FEW),)),
}


def centre() -> Machine:
    """The machine of the page."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    first = next(i for i, line in enumerate(lines) if line.strip() == 'name = "centre"')
    block = [line.strip() for line in lines[first : first + 8]]
    return machines.parse("\n".join(block), "centre")


def smooth(machine: Machine, rng: np.random.Generator) -> ErrorModel:
    """A machine with random smooth error motions."""
    sizes = SIZE / np.arange(1, DEGREE + 2)
    motions = [
        ErrorMotion(component, axis.name, Legendre(axis.travel, DEGREE), tuple(rng.normal(0.0, sizes).tolist()))
        for axis in machine.axes
        for component in COMPONENTS
    ]
    return model_of(machine, motions)


def as_expected(machine: Machine, rng: np.random.Generator, case: Case) -> ErrorModel:
    """A machine whose error motions, of the same degree, have the sizes that a fit of this case expects of them.

    A fit expects the translations of an axis at the centre of the measured points: angular errors turn about it.
    """
    measurement = measured(case, machine, smooth(machine, rng), np.random.default_rng(0))
    motions = [
        ErrorMotion(component, axis.name, Legendre(axis.travel, DEGREE), (0.0,) * (DEGREE + 1))
        for axis in machine.axes
        for component in COMPONENTS
    ]
    zero = model_of(machine, list(centred(motions, arms_of(measurement))))
    return zero.with_parameters(rng.normal(0.0, priors(zero)))


def measured(case: Case, machine: Machine, truth: ErrorModel, rng: np.random.Generator) -> Measurement:
    """The noisy readings, of each station at the same positions, the targets one after another, or of a plan."""
    if case.positions is None:
        planned = optimised_plan(case)
        poses = {name: tracker_pose(place, rng) for name, place in planned.stations.items()}
        seen = observe(machine, truth, planned.state, case.instrument, rng, poses, TARGETS)
        return replace(seen, spheres=planned.stations)
    strategy = "hexahedron+random" if len(case.positions) > 1 else "random"
    choices = Choices(seed=int(rng.integers(1 << 30))) if case.stations is None else Choices()
    positions = rng.permutation(plan(machine, strategy, case.positions, choices=choices).positions)
    n = len(positions)
    state = State(np.tile(positions, (3, 1)), target=np.repeat(list(TARGETS), n), time=15.0 * np.arange(3 * n))
    places = anywhere(machine, rng) if case.stations is None else case.stations
    poses = {f"s{k}": tracker_pose(place, rng) for k, place in enumerate(places, start=1)}
    stationed = at_stations(state, list(poses), 1200.0)
    return observe(machine, truth, stationed, case.instrument, rng, poses, TARGETS)


@cache
def optimised_plan(case: Case) -> Plan:
    """The plan of `ncomp plan optimised` for the places of a case, or for any."""
    request = Request(Choices(targets=TARGETS), RANGES_OF_A_PLAN, trackers=case.stations or ())
    found = optimised(centre(), case.instrument, request)
    for name, place in found.plan.stations.items():
        print(f"    {name} at {', '.join(f'{v:g}' for v in place)}; expected {found.expected_um:.2f} um")
    return found.plan


def anywhere(machine: Machine, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """Four random places outside the volume of the reflectors, not farther off than OFF_MM."""
    low, high = volume_of_targets(machine, Choices(targets=TARGETS))
    places: list[tuple[float, float, float]] = []
    while len(places) < len(STATIONS):
        x, y, z = rng.uniform(low - OFF_MM * np.array([1, 1, 0]), high + OFF_MM * np.array([1, 1, 0])).tolist()
        if not (low[0] - 100.0 < x < high[0] + 100.0 and low[1] - 100.0 < y < high[1] + 100.0):
            places.append((x, y, z))
    return places


def one(name: str, draw: int, kind: str = "smooth") -> tuple[Judged, str]:
    """One draw, and what the data determine."""
    machine, rng = centre(), np.random.default_rng([30, draw])
    if kind == "prior":
        truth = as_expected(machine, rng, CASES[name])
    else:
        truth = (random_true_model if kind == "rough" else smooth)(machine, rng)
    basis = "auto" if kind == "rough" else f"legendre:{DEGREE}"
    measurement = measured(CASES[name], machine, truth, rng)
    found = calibrate(measurement, basis=basis, hold_out=False).fit
    shown = identifiability(found)
    rank = f"{shown.rank_registered} + {shown.by_convention} of {shown.parameters}"
    tool = TARGETS["t1"].position
    return judge(machine, truth, found, evaluation_grid(machine, 5), tool), rank


def main() -> None:
    """Print a row for each case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--cases", default=";".join(CASES), help="names, with ; between them")
    kinds = parser.add_mutually_exclusive_group()
    for kind in ("rough", "prior"):
        kinds.add_argument(f"--{kind}", dest="kind", action="store_const", const=kind, default="smooth")
    given = parser.parse_args()
    print(
        "| case | rank + frame of parameters | within U95, % | before, um | U (k=2), um | after, um | 95 % below, um |"
    )
    print("|---|---|---|---|---|---|---|")
    for name in given.cases.split(";"):
        judged, ranks = zip(*(one(name, draw, given.kind) for draw in range(given.draws)), strict=True)
        error, u = (np.stack([getattr(each, field) for each in judged]) for field in ("error", "u"))
        left = np.sqrt(np.mean(np.sum(error**2, axis=2), axis=1))
        before = np.mean([each.before for each in judged])
        inside = 100.0 * np.mean(np.abs(error) < 1.96 * u)
        stated = 2.0 * float(np.sqrt(np.mean(np.sum(u**2, axis=2))))
        after = f"{left.mean():.2f}", f"{np.quantile(left, 0.95):.2f}"
        row = name, ranks[0], f"{inside:.1f}", f"{before:.1f}", f"{stated:.2f}", *after
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
