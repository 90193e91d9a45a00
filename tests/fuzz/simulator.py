"""Examiner: LinuxCNC's simulator beside its interpreter, which `linuxcnc` and `play` rely on, on random programs.

The simulator stops exactly at each end (G61.1), so its axes have to pass the ends that the interpreter gives, in their
order, and have to stand at the last one.
"""

from __future__ import annotations

import random
import re
import sys
from pathlib import Path

import numpy as np

from tests.fuzz.case import Case, Outcome, Verdict
from tests.fuzz.path import Array
from tests.fuzz.rs274_programs import program

TOOLS = {1: 80.0, 2: 50.0, 3: 100.0}
WAITS = re.compile(r"m0*(0|1|49|60)(?!\d)", re.IGNORECASE)
"""M0, M1, M60, which wait for the operator, and M49, behind which the moves take their real time."""
BLENDS = re.compile(r"g6[14](?![.\d])(\s*[pq][-+\d.]+)*", re.IGNORECASE)
"""G61 and G64, which do not stop where two lines are one, or go round corners."""
SAME_MM = 1e-5
"""Largest distance of the axes from an end."""
PROGRAMS = 5
"""Programs of a run of the tests: each starts a simulator, which takes seconds."""
MOST = 200
"""Programs of `make fuzz`."""
LEAST_COMPARED = 0.2
"""Share of the programs that are compared: the interpreter refuses many."""


def draw(seed: int) -> Case:
    """A program of lines, arcs, cycles, frames and presets."""
    text = program(seed, contours=False, plain=random.Random(seed).random() < 0.5)
    return Case(BLENDS.sub("G61.1", WAITS.sub("M48", text)))


def judge(case: Case) -> Outcome:
    """Run it in both."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from clients import linuxcnc_sim, rs274

    tools = {number: rs274.Tool(length=length) for number, length in TOOLS.items()}
    try:
        found = rs274.run(case.program, tools=tools)
    except ValueError:
        return Outcome(Verdict.REFUSED, "a spline")
    if found.exit_status or not found.moves:
        return Outcome(Verdict.REFUSED, f"rs274: {re.sub(r'[-+]?[0-9.]+', '0', found.message)[:60]}")
    config = linuxcnc_sim.Config("XYZ", tools=TOOLS, velocity=2000.0, acceleration=50_000.0)
    try:
        samples = linuxcnc_sim.run(config, case.program, feed_override=100.0)
    except linuxcnc_sim.SimulatorError as fault:
        return Outcome(Verdict.DIFFERS, f"simulator: {str(fault)[:200]}")
    return _compared(np.array([move.machine[:3] for move in found.moves if move.kind != "tap"]), samples.axis)


def _compared(ends: Array, path: Array) -> Outcome:
    at = 0
    for i, end in enumerate(ends):
        near = np.flatnonzero(np.abs(path[at:] - end).max(axis=1) < SAME_MM)
        if not near.size:
            nearest = float(np.abs(path[at:] - end).max(axis=1).min())
            return Outcome(Verdict.DIFFERS, f"end: the axes miss {end} of move {i + 1} by {nearest:.6f} mm")
        at += int(near[0])
    if np.abs(path[-1] - ends[-1]).max() > SAME_MM:
        return Outcome(Verdict.DIFFERS, f"last: the axes stand at {path[-1]} instead of {ends[-1]}")
    return Outcome(Verdict.COMPARED)
