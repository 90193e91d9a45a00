"""Calibrations by `ncomp fit`, and by the error motions of a diagnosis without causes, on the same files.

    python benchmarks/fit_and_terms.py --seeds 3 --first 700    # each design of the third exam with each machine
    python benchmarks/fit_and_terms.py --seeds 1 --effects none,backlash

The data are those of `benchmarks/short_measurements`, with nothing hidden unless effects are named. For each method:
the RMS error at 300 unseen poses that its calibration leaves, as a share of that without a correction; the share of
errors within the intervals of 95 % (all, and the lowest of one file); and processor time, s, of the fit (median).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from short_measurements.answers import predicted, rms, without_rigid
from short_measurements.case import KINDS, UM, Case
from short_measurements.designs import DESIGNS

import ncomp
from calibration.fit.calibrate import calibrate
from calibration.fit.written.calibrated import calibrated
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Data, Structure
from calibration.measurement.measurement import Measurement
from kinematics.error_model.model import ErrorModel, write_model

MACHINES = ("cframe", "gantry")


def by_fit(measurement: Measurement) -> ErrorModel:
    """The calibration of `ncomp fit`, without its held-out test."""
    return calibrate(measurement, hold_out=False, force=True).model


def by_terms(measurement: Measurement) -> ErrorModel:
    """The calibration by the error motions of a fitted structure."""
    return calibrated(Structure.first(Data.of(Observations.of(measurement))).fitted())


METHODS: dict[str, Callable[[Measurement], ErrorModel]] = {"fit": by_fit, "terms": by_terms}


def answered(case: Case) -> dict[str, tuple[float, float, float]]:
    """Of each method: the error that it leaves, as a share; the share within the intervals; and seconds."""
    found = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        case.write(folder)
        measurement = ncomp.read_measurement(folder / "data.csv", ncomp.load_machine(case.machine))
        states = case.unseen()
        nominal = case.nominal(states)
        true = without_rigid(nominal, (case.points(states, unseen=True) - nominal) / UM)
        for method, calibration in METHODS.items():
            own = folder / method
            own.mkdir()
            start = time.process_time()
            model = calibration(measurement)
            seconds = time.process_time() - start
            write_model(model, own / "new.json")
            (own / "unseen.csv").write_bytes((folder / "unseen.csv").read_bytes())
            record = predicted(case, own / "new.json", own, nominal, true)
            found[method] = record["after_um"] / rms(true), record["covered"], seconds
    return found


def main() -> None:
    """Ask all methods and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1, help="draws of each design and machine")
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--effects", default="none", help=", ".join(KINDS))
    given = parser.parse_args()
    found = []
    for effect in given.effects.split(","):
        for seed in range(given.first, given.first + given.seeds):
            for design in DESIGNS:
                for machine in MACHINES:
                    case = Case(machine, design, effect, seed)
                    found.append(answered(case))
                    shown = "  ".join(
                        f"{e}: {100 * s:.1f} % {100 * c:.0f} % {t:.1f} s" for e, (s, c, t) in found[-1].items()
                    )
                    print(f"{case.name:45} {shown}", flush=True)
    print(f"{'method':8} {'left, median':>13} {'covered':>8} {'lowest':>7} {'s, median':>10} {'longest':>8}")
    for method in METHODS:
        left, covered, seconds = np.array([each[method] for each in found]).T
        numbers = f"{100 * np.median(left):11.1f} % {100 * covered.mean():6.1f} % {100 * covered.min():5.0f} %"
        print(f"{method:8} {numbers} {np.median(seconds):10.2f} {seconds.max():8.2f}")


if __name__ == "__main__":
    main()
