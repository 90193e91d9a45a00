"""Seconds for the deviations of 1,000,000 states of the DMU 50 with its 41 errors: first order against exact.

python benchmarks/deviation.py

The errors are those of the demonstration calibration: 30 error motions and 11 location errors. Exact is the product of
the matrices of all axes. The error motions themselves, which both need, are timed apart.
"""

from __future__ import annotations

import resource
import statistics
import time
from collections.abc import Callable

import numpy as np

import machines
from kinematics.deviation import Deviation, exact_deviation
from kinematics.effects import ErrorMotion
from kinematics.error_model.model import read_model
from kinematics.error_transform import error_transform
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import ROWS_OF_BLOCK, Array, blocks

ROWS = 1_000_000
RUNS = 5
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


def first_order(machine: Machine, q: Array, errors: Array) -> Deviation:
    """J . errors, a block of rows at a time."""
    result = np.empty((6, len(q))).T
    for rows in blocks(len(q)):
        motions = errors[rows, : len(machine.axes)].reshape(rows.stop - rows.start, -1)
        result[rows] = np.einsum("nij,nj->ni", error_transform(machine, q[rows], TOOL), motions)
    return Deviation(result[:, :3], result[:, 3:])


def largest(deviation: Deviation) -> float:
    """Largest position deviation, um."""
    return float(np.linalg.norm(deviation.position, axis=1).max() * 1e3)


def main() -> None:
    """Print the table."""
    machine = machines.load("dmu50")
    path = machines.default_calibration(machine)
    assert path is not None
    model = read_model(path, machine)
    state = State(np.random.default_rng(0).uniform(*machine.travel, (ROWS, len(machine.axes))))
    errors = model.errors(machine, state)
    ways: dict[str, Callable[[], object]] = {
        "error motions of the model": lambda: model.errors(machine, state),
        "exact matrix product": lambda: exact_deviation(machine, state.positions, errors, TOOL),
        "first order": lambda: first_order(machine, state.positions, errors),
    }
    seconds = {name: median_seconds(work) for name, work in ways.items()}
    motions, exact, first = seconds.values()
    seconds["model and exact"], seconds["model and first order"] = motions + exact, motions + first

    count = sum(isinstance(effect, ErrorMotion) for effect in model.effects)
    print(
        f"{machine.name} ({machine.chain}), {ROWS} states, {count} error motions and {len(model.effects) - count} "
        f"location errors, blocks of {ROWS_OF_BLOCK}, median of {RUNS} runs"
    )
    for name, duration in seconds.items():
        print(f"{name:28}{duration:9.3f} s{duration / ROWS * 1e6:9.3f} us/state")
    print(f"exact / first order: {exact / first:.1f}; with the model: {(motions + exact) / (motions + first):.1f}")
    both = exact_deviation(machine, state.positions, errors, TOOL), first_order(machine, state.positions, errors)
    gap = Deviation(both[0].position - both[1].position, both[0].orientation - both[1].orientation)
    print(f"largest deviation {largest(both[0]):.1f} um; first order differs by at most {largest(gap) * 1e3:.1f} nm")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
