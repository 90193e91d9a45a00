"""What earlier logs of touches teach about a morning of four readings.

    python benchmarks/drift_mornings.py --machines 60 --lag-min 0

The Z of a virtual C-frame mill follows its spindle by -3 to 3 um/K (uniform) behind a lag, and walks by 0.5
um per square root of an hour, as X and Y do. On each of three days one sphere is touched every 30 minutes for 12 hours
(u 1 um) while the spindle warms up by 8 K, cools down, and warms up again. On the fourth day it is touched four times
in two hours. The drift three hours later, when the spindle is 6 K warmer, is predicted by this log alone, and with the
earlier ones.
"""

from __future__ import annotations

import argparse
import datetime
import tempfile
from pathlib import Path

import numpy as np

import ncomp
from calibration.measurement.measurement import Measurement
from kinematics.effects.combined.when import lagged
from kinematics.transforms import Array

STEP_S, READ_UM = 1800.0, 1.0
"""Time from touch to touch, and standard uncertainty of a touch."""
STEP_UM = 0.5
"""Walk in the square root of an hour."""
SPHERE, TIP = (120.0, 90.0, 60.0), (0.0, 0.0, -150.0)
MORNING, LATER = 4, 9
"""Readings of the fourth day, and the step at which the drift is predicted."""


def course(warm: float, time: Array) -> Array:
    """Temperatures of the spindle, K."""
    hours = time / 3600.0
    on = (hours > 0.6) & (hours < 5.0) | (hours > 8.0)
    return lagged(warm * on, time, 3600.0)[0]


def log(folder: Path, day: int, read: Array, kelvin: Array) -> Measurement:
    """A log of touches of a day."""
    start = datetime.datetime(2026, 3, 2 + day, 6)
    positions = np.array(SPHERE) - np.array(TIP) - 1e-3 * read
    cells = [",".join(f"{value:.5f}" for value in row) for row in positions.tolist()]
    rows = [
        f"{start + datetime.timedelta(seconds=STEP_S * k)},{row},s1,{20 + warm:.2f}"
        for k, (row, warm) in enumerate(zip(cells, kelvin.tolist(), strict=True))
    ]
    head = ["# machine: cframe", "# instrument: touch-probe", "# zone: UTC", f"# u_um: {READ_UM:g}"]
    placed = [f"# probe: {' '.join(map(str, TIP))}", f"# sphere.s1: {' '.join(map(str, SPHERE))}"]
    path = folder / f"day{day}.csv"
    path.write_text("\n".join([*head, *placed, "time,X,Y,Z,sphere,temp_spindle", *rows]) + "\n")
    return ncomp.read_measurement(path, "cframe")


def morning(seed: int, lag_s: float) -> list[tuple[float, bool, float]]:
    """Error of Z, um, whether it is within U, and U: by the log alone, and with the earlier ones."""
    rng = np.random.default_rng(seed)
    per_kelvin, days = rng.uniform(-3.0, 3.0), []
    with tempfile.TemporaryDirectory() as name:
        for day in range(4):
            time = STEP_S * np.arange(24)
            kelvin = course(8.0, time)
            drift = np.cumsum(STEP_UM * np.sqrt(STEP_S / 3600.0) * rng.standard_normal((24, 3)), axis=0)
            drift[:, 2] += per_kelvin * (lagged(kelvin, time, lag_s)[0] if lag_s else kelvin)
            read = drift + READ_UM * rng.standard_normal((24, 3))
            shown = slice(None, MORNING if day == 3 else None)
            warm = kelvin + 0.1 * rng.standard_normal(24)
            days.append(log(Path(name), day, read[shown], warm[shown]))
    found = []
    for earlier in ([], days[:3]):
        then = {"at": f"{STEP_S * LATER:.0f}", "temperature": {"spindle": f"{20 + kelvin[LATER]:.2f}"}}
        estimate = ncomp.drift(days[3], "none", earlier=earlier, **then).estimate
        place = estimate.places[0]
        off = place.drift[2] - (drift[LATER, 2] - drift[0, 2])
        found.append((float(off), bool(abs(off) < 2.0 * place.u[2]), 2.0 * float(place.u[2])))
    return found


def main() -> None:
    """The table of docs/drift.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machines", type=int, default=60)
    parser.add_argument("--lag-min", type=float, default=0.0, help="lag of the machine behind its spindle, min")
    given = parser.parse_args()
    each = [morning(seed, 60.0 * given.lag_min) for seed in range(given.machines)]
    print("| learned from | error, RMS, um | U (k=2), median, um | within U |\n|---|---|---|---|")
    for name, own in zip(("the morning alone", "three earlier days too"), zip(*each, strict=True), strict=True):
        errors, within, big_u = (np.array(column) for column in zip(*own, strict=True))
        print(f"| {name} | {np.sqrt(np.mean(errors**2)):.1f} | {np.median(big_u):.1f} | {np.mean(within):.0%} |")


if __name__ == "__main__":
    main()
