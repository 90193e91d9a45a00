"""Virtual calibration: the paper's findings, the gantry's bars, optimised plans, and how fast it all is.

    python benchmarks/study.py findings          the three studies of examples/studies
    python benchmarks/study.py bars              620 points: the paper's fit and ours; plans by hand and optimised
    python benchmarks/study.py diagonals         what a fit of space diagonals leaves
    python benchmarks/study.py speed             draws per second against a loop of lstsq
    python benchmarks/study.py scaling           1 and 2 processes, a Dask LocalCluster of 2 workers

Bars: at most 620 points leave 5.6 um in the mean of the draws and 6.7 um in 95 % of them; the paper's fit leaves 9.5.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
import tomllib
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from calibration.study.cases import Case, read_cases
from calibration.study.chunks import Chunk, Prepared
from calibration.study.definition import study_of
from calibration.study.run import Draws, Result, run
from calibration.study.spread import workers
from calibration.study.stopping import estimates
from calibration.study.store import Store
from kinematics.running.workers import Team

STUDIES = Path(__file__).parents[1] / "examples" / "studies"
PAPER = {"basis": "legendre:6", "weighting": "cartesian-diagonal", "prior": "none"}
PLACE = [-1500, 1500, 300]
STATIONS = [PLACE, [1500, -1500, 300], [4000, 1500, 300], [1500, 4500, 300]]
TRACKER = {"u_range_um_per_m": 0.25, "u_angle_um": 10.0, "u_angle_um_per_m": 2.5}
FRESH = 77
"""Seed of the draws of the evaluation; no plan was made with it."""
HAND_MADE = {
    "hexahedron+random": {"strategy": "hexahedron+random", "points": [316, 304]},
    "hexahedron": {"strategy": "hexahedron"},
    "grid": {"strategy": "grid"},
    "space-filling": {"strategy": "space-filling"},
    "face-diagonals": {"strategy": "face-diagonals"},
    "hexahedron+face-diagonals": {"strategy": "hexahedron+face-diagonals", "points": [310, 310]},
    "diagonals": {"strategy": "diagonals"},
    "planes at low ends": {"strategy": "planes", "planes_at": 0.0},
}


def cases_of(content: dict[str, Any]) -> list[Case]:
    """Cases of a study that is no file."""
    return read_cases(study_of({"machine": "gantry", "seed": FRESH, **content}, "benchmark"), STUDIES)


def results(cases: list[Case], draws: int, team: Team | None = None) -> list[Result]:
    """All draws of some cases, kept nowhere."""
    with nullcontext(team) if team else workers(1, None) as its:
        return run(cases, Draws(draws), its, Store(None))


def show(result: Result) -> None:
    """One line."""
    before, after = estimates(result.before[0]), estimates(result.after[0])
    u = after.deviation / result.after.shape[1] ** 0.5
    print(
        f"  {result.case.name:<28}{result.points:>5} points {result.minutes:>4.0f} min  before {before.mean:5.2f}"
        f"  after {after.mean:5.2f} +- {2 * u:.2f} (k=2)  95 % {after.quantile:5.2f} um",
        flush=True,
    )


def findings(draws: int) -> None:
    """The three studies of the paper."""
    for name in ("trajectory", "spacing", "tracker_position"):
        content = tomllib.loads((STUDIES / f"{name}.toml").read_text())
        print(name)
        found = results(cases_of(content), draws)
        for result in found:
            show(result)
        if name == "spacing":
            points = np.array([result.points for result in found], float)
            means = np.array([result.after[0].mean() for result in found])
            share = (points - points[0]) / np.ptp(points)
            below = (means[0] - means) / (means[0] - means[-1]) - share
            gains = -np.diff(means) / np.diff(points) * 100
            print(f"  knee, farthest from the chord of the curve: {points[below.argmax()]:.0f} points")
            pairs = zip(points[1:], gains, strict=True)
            print("  gain of 100 more points, um: " + ", ".join(f"{gain:.2f} to {at:.0f}" for at, gain in pairs))


def bars(draws: int) -> None:
    """620 points from the same tracker position."""
    common = {"tracker": PLACE, "points": 620}
    fits = {
        "paper's: Legendre 6": PAPER,
        "Legendre 6 by full covariance": {**PAPER, "weighting": "full"},
        "cubic:8 with prior 30": {"basis": "cubic:8", "prior": 30.0},
        "by evidence": {},
    }
    print("fits of the hexahedron")
    cases = [{**common, "name": name, "strategy": "hexahedron", "fit": fit} for name, fit in fits.items()]
    for result in results(cases_of({"case": cases}), draws):
        show(result)
    print("plans, fitted by evidence; no optimised one takes longer than a hand-made one")
    by_hand = []
    for name, own in HAND_MADE.items():
        by_hand += results(cases_of({"case": [{**common, **own, "name": name}]}), draws)
        show(by_hand[-1])
    best = min(by_hand, key=lambda result: float(result.after[0].mean()))
    reach = {"elevation": [-59, 79]}
    for name, trackers in (("optimised", PLACE), ("optimised with tracker", [])):
        case = {"name": name, "strategy": "optimised", "minutes": 174.0, "tracker": trackers, **reach}
        (result,) = results(cases_of({"case": [case]}), draws)
        show(result)
        less = best.after[0] - result.after[0]
        u = less.std(ddof=1) / less.size**0.5
        print(f"    tracker at {result.case.trackers[0]}; same machines: {less.mean():.2f} +- {2 * u:.2f} um (k=2)")
        print(f"    less than by {best.case.name}, {np.mean(less > 0):.0%} of them")


def diagonals(draws: int) -> None:
    """What a fit of space diagonals leaves."""
    four = {"tracker": STATIONS}
    good = {"u_range_um_per_m": 0.1, "u_angle_um": 1.0, "u_angle_um_per_m": 0.3}
    for name, case, instrument in (
        ("80 points", {"points": 80}, TRACKER),
        ("200 points", {}, TRACKER),
        ("620 points", {"points": 620}, TRACKER),
        ("80 points four stations", {"points": 80, **four}, TRACKER),
        ("200 points four stations", four, TRACKER),
        ("200 points good tracker", {}, good),
    ):
        entry = {"name": name, "strategy": "space-diagonals", "points": 200, "tracker": PLACE, **case}
        ready = Prepared.of(cases_of({"instrument": instrument, "case": [entry]})[0])
        outcomes = [ready.outcome(chunk) for chunk in Draws(draws).chunks(0)]
        before, after = (np.concatenate([getattr(each, name)[0] for each in outcomes]) for name in ("before", "after"))
        columns = (f"{values.mean():5.2f} ({np.quantile(values, 0.95):5.2f})" for values in (before, after))
        print(f"  {name:<26}" + "  ".join(columns), flush=True)


def speed(repeats: int) -> None:
    """Draws per second of two fits: in chunks, and one by one by numpy's lstsq on the same equations."""
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; medians of {repeats}")
    for name, fit in (
        ("Legendre 6 without prior", PAPER),
        ("cubic:8 with prior 30", {"basis": "cubic:8", "prior": 30.0}),
    ):
        case = {"name": name, "strategy": "hexahedron", "points": 620, "tracker": PLACE, "fit": fit}
        ready = Prepared.of(cases_of({"case": [case]})[0])
        ready.outcome(Chunk(0, 50))
        together = _median(lambda: [ready.outcome(Chunk(k, 50)) for k in range(4)], repeats) / 200  # noqa: B023
        alone = _median(lambda: _one_by_one(ready, 10), max(repeats // 2, 1)) / 10  # noqa: B023
        from_nothing = _median(lambda: Prepared.of(ready.case).outcome(Chunk(0, 50)), repeats)  # noqa: B023
        print(
            f"  {name:<26}chunks {1 / together:6.0f} draws/s   lstsq {1 / alone:5.1f} draws/s"
            f"   ratio {alone / together:4.0f}   first chunk with its design {from_nothing:.2f} s"
        )


def _one_by_one(ready: Prepared, draws: int) -> list[float]:
    """The same draws by a loop of `lstsq`: registration and parameters, priors as rows."""
    drawn = ready.sample(Chunk(0, draws))
    ((parts, scales), _), *_ = ready.choices(drawn).items()
    columns = ready.fits.columns
    model = columns.model(parts)
    design = np.concatenate([columns.registration, columns.observed(model)], axis=1)
    seen_in, r = columns.evaluated(model), columns.registration.shape[1]
    if np.isfinite(scales[0]):
        own = np.diag(1.0 / ready.fits.scale(parts, scales))
        design = np.concatenate([design, np.concatenate([np.zeros((len(own), r)), own], axis=1)])
    errors = []
    for k in range(draws):
        right = np.append(drawn.observed[:, k], np.zeros(len(design) - len(drawn.observed)))
        parameters = np.linalg.lstsq(design, right, rcond=1e-10)[0][r:]
        left = ready.fits.true_volume @ drawn.coefficients[:, k] - seen_in @ parameters
        errors.append(float(np.sqrt(np.sum(left**2) / (len(left) / 3))))
    return errors


def scaling(repeats: int) -> None:
    """Seconds of a study of 400 draws by evidence, in one process, two, and on a cluster of two workers."""
    from distributed import LocalCluster

    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; medians of {repeats}, workers started before")
    case = {
        "name": "scaling",
        "strategy": "hexahedron",
        "points": 400,
        "tracker": PLACE,
        "fit": {"basis": "auto:cubic"},
    }
    cases = cases_of({"case": [case]})
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        for name, number, dask in (
            ("1 process", 1, None),
            ("2 processes", 2, None),
            ("Dask, 2 workers", 2, local.scheduler_address),
        ):
            with workers(number, dask) as team:
                results(cases, 50 * number, team)
                print(f"  {name:15} {_median(lambda: results(cases, 400, team), repeats):6.1f} s", flush=True)


def _median(work: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("findings", "bars", "diagonals", "speed", "scaling"))
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--repeats", type=int, default=3)
    args = parser.parse_args()
    by_draws = {"findings": findings, "bars": bars, "diagonals": diagonals}
    if args.what in by_draws:
        by_draws[args.what](args.draws)
    else:
        {"speed": speed, "scaling": scaling}[args.what](args.repeats)


if __name__ == "__main__":
    main()
