"""Seconds for the deviations of 100,000 poses of the DMU 50: first order against the exact matrix product.

python benchmarks/error_transform.py
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

import machines
from kinematics.deviation import exact_deviation
from kinematics.error_transform import error_transform

ROWS = 100_000
RUNS = 7
TOOL = (10.0, -20.0, -120.0)


def median_seconds(work: Callable[[], object]) -> float:
    """Median duration of RUNS runs, after one that warms up."""
    work()
    durations = []
    for _ in range(RUNS):
        start = time.perf_counter()
        work()
        durations.append(time.perf_counter() - start)
    return statistics.median(durations)


def main() -> None:
    """Print the table."""
    machine = machines.load("dmu50")
    rng = np.random.default_rng(0)
    q = rng.uniform(*machine.travel, (ROWS, 5))
    errors = rng.normal(0.0, 1e-5, (ROWS, 5, 6))

    ways: dict[str, Callable[[], object]] = {
        "exact matrix product": lambda: exact_deviation(machine, q, errors, TOOL),
        "J alone": lambda: error_transform(machine, q, TOOL),
        "J . errors": lambda: np.einsum("nij,nj->ni", error_transform(machine, q, TOOL), errors.reshape(ROWS, -1)),
    }
    seconds = {name: median_seconds(work) for name, work in ways.items()}
    exact = seconds["exact matrix product"]
    print(f"{machine.name} ({machine.chain}), {ROWS} rows, median of {RUNS} runs")
    print(f"{'':28}{'seconds':>10}{'exact / this':>14}")
    for name, duration in seconds.items():
        print(f"{name:28}{duration:10.4f}{exact / duration:14.1f}")


if __name__ == "__main__":
    main()
