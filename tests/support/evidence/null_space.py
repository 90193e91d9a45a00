"""Points whose least-squares element is known: residuals from the null space of its design at the known element.

ISO 10360-6 tests software by such sets (Forbes and Minh, Metrologia 49 (2012): generation by the null space). Points of
a known element are moved by residuals v with J'v = 0, where J are their derivatives by its parameters. Then the
gradient of the sum of squares is zero at the known element, which remains the exact answer although the points scatter.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.linalg import null_space

import machines
import ncomp
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.probing.paths import TOUCH
from calibration.simulation.true_model import model_of
from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.state import State
from kinematics.transforms import Array, rotation_vector_matrix
from support.ballbar_cases import CENTRE, CFRAME, circles_of
from support.evidence.digits import Agreement, digits
from support.probe_cases import TIP
from support.probing_cases import CONTACT, contacts, planned
from support.three_points_cases import SERIES, TARGETS, measured, model, random_effects, station

DMU50 = machines.load("dmu50")
ALIKE = LaserTracker(u_range_um=1.0, u_angle_um=1.0)
"""A tracker whose three coordinates are equally certain, as those of a coordinate measuring machine."""
X_OF_DMU50 = "E_XX ... E_CX"


def residuals(design: Array, rms: float, seed: int) -> Array:
    """Random residuals `(n,)` of this RMS that change no parameter of a least-squares element, design `(n, p)`."""
    free = null_space(design.T)
    found = free @ np.random.default_rng(seed).standard_normal(free.shape[1])
    return np.asarray(found * rms / np.sqrt(np.mean(found**2)))


def spheres() -> list[Agreement]:
    """Two spheres of one radius each: the contacts of a probing program, scattered by 5 um, as its log."""
    found = planned("dmu50", spheres=2)
    machine, plan, moves = found.plan.machine, found.plan, found.moves
    row = moves.row[np.flatnonzero(moves.kind == TOUCH)]
    sphere = np.array(plan.state.station)[row]
    centres = np.add([plan.spheres[name] for name in plan.state.station], (0.3, -0.2, 0.4))
    at = contacts(found, model_of(machine, []))
    out = tool_point(machine, at, TIP) - centres[row]
    normals = out / np.linalg.norm(out, axis=1, keepdims=True)
    by_centre = np.einsum("ij,ik->ijk", row[:, None] == np.arange(len(centres)), normals).reshape(len(row), -1)
    by_radius = (sphere[:, None] == np.unique(sphere)).astype(float)
    off = residuals(np.hstack([by_centre, by_radius]), 0.005, 1)
    touched = centres[row] + (CONTACT + off)[:, None] * normals
    positions = linear_positions(machine, at, touched, TIP) / machine.scale
    names, numbers = machine.names, moves.touch[np.flatnonzero(moves.kind == TOUCH)]
    with TemporaryDirectory() as folder:
        written, log = Path(folder) / "plan.csv", Path(folder) / "log.txt"
        ncomp.save(plan, written)
        head = next(line for line in written.read_text().splitlines() if line.startswith("# plan"))
        lines = [f"NCOMP PLAN {head.split()[-1]}"]
        for k, q in enumerate(positions.tolist()):
            cells = " ".join(f"{name}{value:.12f}" for name, value in zip(names, q, strict=True))
            lines.append(f"NCOMP P{row[k] + 1} T{numbers[k]} {cells}")
        log.write_text("\n".join([*lines, ""]))
        probed = ncomp.touches(log, machine, written)
    freedom = len(off) - 3 * len(centres) - 2
    scatter = float(np.sqrt(np.sum(off**2) / freedom)) * 1e3
    there = tool_point(machine, probed.measurement.state.positions, TIP)
    through = "`ncomp.touches`"
    return [
        Agreement("spheres", through, "radii of contact", digits(probed.radii.values(), [CONTACT] * 2)),
        Agreement("spheres", through, "centres", digits(there.ravel(), centres.ravel())),
        Agreement("spheres", through, "scatter about them", digits([probed.scatter_um], [scatter])),
    ]


def circles() -> list[Agreement]:
    """Circles of a ballbar about a table ball that is off its stated place, scattered by 3 um."""
    blank, _ = circles_of(step=5.0, feeds=(1000.0,), noise=0.0)
    tips = tool_point(CFRAME, blank.state.positions, (0.0, 0.0, -120.0))
    ball, longer = np.add(CENTRE, (0.012, -0.009, 0.0)), 0.0047
    away = tips - ball
    length = np.linalg.norm(away, axis=1)
    off = residuals(np.column_stack([away[:, :2] / length[:, None], np.ones(len(length))]), 0.003, 2)
    instrument = type(blank.instrument)(u_um=0.3, length_u_um=1e6)
    found = ncomp.ballbar(replace(blank, instrument=instrument, observed=(length + longer + off)[:, None]))
    figures = {each.symbol: each.value for each in found.tests[0].figures}
    through = "`ncomp.ballbar`"
    return [
        Agreement("circles", through, "D", digits([figures["D"]], [longer * 1e3])),
        Agreement("circles", through, "G(b)", digits([figures["G(b)"]], [np.ptp(off) * 1e3])),
    ]


def rigid_bodies() -> list[Agreement]:
    """Three targets on the carriage of X at 11 positions: rigid motions that are known, scattered by 5 um."""
    truth, eye = model(DMU50, random_effects(3, axes="X")), station((200.0, -1500.0, -300.0), 0.4)
    exact, blank = (measured(DMU50, each, {"1": eye}, axes="X", instrument=ALIKE) for each in (truth, model(DMU50, [])))
    points, nominal = ((each.observed - eye.translation) @ eye.rotation[0] for each in (exact, blank))
    n, k = len(SERIES["X"]), sum(each.carrier == "tool" for each in TARGETS.values())
    target, at = np.divmod(np.arange(n * k), n)
    by_motion = np.zeros((n * k, 3, n, 6))
    by_motion[np.arange(n * k), :, at] = _rigid(points)
    errors = truth.errors(DMU50, exact.state)[:, DMU50.index("X")]
    by_body = np.einsum("ik,iab->iakb", target[:, None] == np.arange(k), rotation_vector_matrix(errors[:, 3:]))
    parts = (by_motion, by_body, _rigid(nominal))  # the last: ncomp lays the nominal points onto all observed ones
    design = np.concatenate([each.reshape(3 * n * k, -1) for each in parts], axis=1)
    off = residuals(design, 0.005, 3).reshape(-1, 3)
    scattered = replace(exact, observed=exact.observed + off @ eye.rotation[0].T)
    one, two = (ncomp.three_points(each).found.axes["X"].errors for each in (exact, scattered))
    largest = np.abs(one).max()
    return [
        Agreement("rigid bodies", "`ncomp.three_points`", X_OF_DMU50, digits([np.abs(two - one).max() / largest], [0]))
    ]


def registration() -> list[Agreement]:
    """A tracker's points of a gantry without errors, scattered by 5 um: what remains once they are registered."""
    gantry, target = machines.load("gantry"), Target((0.0, 0.0, -100.0))
    positions = np.array([*product((0.0, 2500.0, 5000.0), (0.0, 1500.0, 3000.0), (0.0, 750.0, 1500.0))])
    points = tool_point(gantry, positions, target.position)
    off = residuals(_rigid(points).reshape(-1, 6), 0.005, 4).reshape(-1, 3)
    eye = station((-1500.0, 1500.0, 300.0), 0.4)
    state = State(positions, station=np.full(len(positions), "1"), target=np.full(len(positions), "t"))
    blank = Measurement(gantry, ALIKE, with_moves(state), eye.apply(points + off), {"t": target}, source="points")
    found = ncomp.fit(blank, basis="legendre:1", hold_out=False, force=True)
    return [Agreement("registration", "`ncomp.fit`", "residual before", digits([found.before_rms_um], [5.0]))]


def _rigid(points: Array) -> Array:
    """Derivatives `(n, 3, 6)` of points `(n, 3)` by shifts and rotations."""
    turned = np.cross(np.eye(3), points[:, None]).swapaxes(1, 2)
    return np.concatenate([np.broadcast_to(np.eye(3), turned.shape), turned], axis=2)


def rows() -> list[Agreement]:
    """All elements."""
    return [*spheres(), *circles(), *rigid_bodies(), *registration()]
