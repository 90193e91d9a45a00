"""Plans of spheres on the five-axis machines, and logs as the controls of machines with errors would write them."""

from functools import cache

import numpy as np

import machines
from calibration.measurement.plan_file import plan_id
from calibration.probing.bodies import Artefact, Probe
from calibration.probing.paths import TOUCH
from calibration.probing.plan import ProbeRequest, probe_plan
from kinematics.forward import tool_point
from kinematics.state import State
from postproc.probing.sequence import ProbingSequence, ProbingSettings
from support.probe_cases import AROUND, MIDDLE, TIP

FIVE_AXES = tuple(MIDDLE)
CONTACT = 15.5
"""Distance of the centres of tip and sphere in contact, mm."""
AXES = "XYZABCUVW"


def spheres_of(name, count):
    return {f"s{k + 1}": tuple((AROUND[k] + MIDDLE[name]).tolist()) for k in range(count)}


@cache
def planned(name, spheres=1, points=5, design="random", seed=0, references=0):
    """A plan on a machine."""
    request = ProbeRequest(
        Probe(TIP), Artefact(spheres_of(name, spheres)), design, points, references=references, seed=seed
    )
    return probe_plan(machines.load(name), request)


def sequence_of(found):
    """The moves of a plan as those of a program."""
    machine, moves = found.plan.machine, found.moves
    rows = [f"{a} {b}" for a, b in zip(found.plan.names, found.plan.state.station, strict=True)]
    return ProbingSequence(
        machine, moves.positions / machine.scale, moves.touch, moves.row + 1, rows, plan_id(found.plan)
    )


def settings_of(control):
    offset = ("G54", {"X": 1.0, "Y": 2.0, "Z": 3.0}) if control == "fanuc" else None
    return ProbingSettings(offset=offset)


def contacts(found, model, *, noise_um=0.0, seed=0, shift=None, cycle_um=0.0):
    """Axis positions `(touches, axes)`, mm and rad, at which the actual tip meets the actual sphere, by bisection.

    shift: displacement of all spheres by row `(rows, 3)`, mm. cycle_um: way in a servo cycle, at whose end the control
    reads the positions.
    """
    machine, moves = found.plan.machine, found.moves
    touches = np.flatnonzero(moves.kind == TOUCH)
    start, end = moves.positions[touches - 1], moves.positions[touches]
    centres = np.array([found.plan.spheres[s] for s in found.plan.state.station])
    centres = centres + (0.3, -0.2, 0.4) + (0.0 if shift is None else shift)
    rng = np.random.default_rng(seed)
    radius = CONTACT + noise_um * 1e-3 * rng.standard_normal(len(touches))
    low, high = np.zeros(len(touches)), np.ones(len(touches))
    for _ in range(40):
        middle = (low + high) / 2.0
        q = start + middle[:, None] * (end - start)
        tip = tool_point(machine, q, TIP, model.errors(machine, State(q)))
        outside = np.linalg.norm(tip - centres[moves.row[touches]], axis=1) > radius
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    share = (low + high) / 2.0
    if cycle_um:
        linear = ~machine.rotary
        cycles = np.linalg.norm((end - start)[:, linear], axis=1) / (cycle_um * 1e-3)
        share = np.ceil(share * cycles) / cycles
    return start + share[:, None] * (end - start)


def log_of(found, control, positions):
    """The log that a control writes for contacts at axis positions `(touches, axes)`, mm and rad."""
    machine, moves = found.plan.machine, found.moves
    touches = np.flatnonzero(moves.kind == TOUCH)
    number = plan_id(found.plan)
    heads = {"fanuc": [f"NCOMP PLAN{number:6d}"], "siemens": [f"NCOMP PLAN {number}"]}
    lines = list(heads.get(control, []))
    for k, q in zip(touches.tolist(), positions / machine.scale, strict=True):
        at = dict(zip(machine.names, q.tolist(), strict=True))
        row, touch = int(moves.row[k]) + 1, int(moves.touch[k])
        if control == "linuxcnc":
            first = {**at, "X": at["X"] + 0.002}
            lines += [" ".join(f"{each.get(name, 0.0):.6f}" for name in AXES) for each in (first, at)]
        elif control == "fanuc":
            cells = " ".join(f"{name}{at[name]:10.4f}" for name in "XYZ")
            lines.append(f"NCOMP P{row:6d} T{touch:3d} {cells}")
        elif control == "siemens":
            lines.append(f"NCOMP P{row} T{touch} " + " ".join(f"{name}{value:.7f}" for name, value in at.items()))
        else:
            cells = " ".join(f"{name}{value:+12.5f}" for name, value in at.items())
            lines.append(f"NCOMP P{row:5d} T{touch:2d} {cells}")
    return "\n".join(["%", *lines, "%", ""] if control == "fanuc" else [*lines, ""])
