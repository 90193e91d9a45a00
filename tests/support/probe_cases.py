"""Virtual measurements with a touch probe and spheres on the five-axis machines, and their true location errors."""

from dataclasses import replace

import numpy as np

import machines
from calibration.evaluation.volumetric import rigid_columns, volumetric_error_um
from calibration.fit.datum import split_locations, to_datum, transformed
from calibration.instruments import TouchProbe
from calibration.measurement.measurement import Target
from calibration.measurement.plan import Choices
from calibration.planning.strategies import plan
from calibration.simulation.measure_plan import VirtualInstrument, measure_plan, streams
from calibration.simulation.touch_probe import Spheres
from calibration.simulation.true_model import model_of, random_location_errors
from kinematics.deviation import exact_deviation
from kinematics.effects import LocationError
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.state import State

MIDDLE = {
    "dmu50": (0.0, 0.0, 0.0),
    "trunnion_ac": (0.0, 0.0, 0.0),
    "trunnion_bc": (0.0, 0.0, 0.0),
    "head_table": (0.0, 0.0, 200.0),
    "head_head": (2000.0, 1250.0, 300.0),
}
"""Middle of the spheres, mm, by machine."""
AROUND = np.array([[130.0, 20.0, 60.0], [-110.0, 60.0, 50.0], [20.0, -130.0, 90.0]])
TIP = (0.0, 0.0, -150.0)
RANGES = {
    "trunnion_ac": {"C": (0.0, 360.0), "A": (-100.0, 30.0)},
    "trunnion_bc": {"C": (0.0, 360.0), "B": (-90.0, 90.0)},
    "head_table": {"C": (0.0, 360.0), "B": (-60.0, 60.0)},
    "head_head": {"C": (-180.0, 180.0), "B": (-90.0, 90.0)},
}
"""Rotary positions at which the spheres are within reach, degrees, by machine."""


def spheres_of(name, count=3, distances=None):
    """Spheres about the middle of a machine's volume, with standard uncertainties of distances, mm."""
    centres = {f"s{k + 1}": tuple((AROUND[k] + MIDDLE[name]).tolist()) for k in range(count)}
    return Spheres(centres, distances or {})


def poses(machine, count, seed=0, *, tip=TIP, runs=1):
    """A plan of random rotary positions."""
    choices = Choices(
        ranges=RANGES.get(machine.name, {}), rotary="random", targets={"probe": Target(tip)}, runs=runs, seed=seed
    )
    return plan(machine, "random", count, None, choices)


def probed(name, count=34, *, spheres=None, seed=0, effects=None, noise=1.0, u_um=1.0, location=50.0, **plan):
    """A measurement with random location errors, and the true model."""
    machine, draws = machines.load(name), streams(seed, 4)
    effects = random_location_errors(machine, draws[0], location) if effects is None else effects
    model = model_of(machine, effects)
    virtual = VirtualInstrument(TouchProbe(u_um=u_um), spheres=spheres or spheres_of(name), noise_scale=noise)
    return measure_plan(poses(machine, count, seed, **plan), model, virtual, draws[1:]).measurement, model


def unseen_um(model, true):
    """Error of the tip, um RMS, at poses that were not measured, by the true model: alone, and less that of a model."""
    machine = machines.load(true.machine.name)
    middle = np.add(MIDDLE[machine.name], (0.0, 0.0, 60.0))
    points = middle + np.random.default_rng(9).uniform(-100.0, 100.0, (200, 3))
    q = linear_positions(machine, poses(machine, len(points), seed=99).positions, points, TIP)
    real, found = (exact_deviation(machine, q, m.errors(machine, State(q)), TIP).position for m in (true, model))
    return [volumetric_error_um(error, points).rms for error in (real, real - found)]


def in_datum(model, found):
    """Location errors of a true model, um and urad, by name, in the datum of a fit."""
    machine, fitted = found.measurement.machine, found.model
    parameters = np.zeros(len(fitted.parameters))
    for effect, part in fitted.error_motions:
        i, low, high = machine.index(effect.axis), *effect.basis.interval
        positions = np.zeros((50, len(machine.axes)))
        x = np.linspace(low, high, 50)
        positions[:, i] = x * machine.scale[i]
        errors = model.errors(machine, State(positions))[:, i, "XYZABC".index(effect.component)]
        size = 1e-6 if effect.angular else 1e-3
        parameters[part] = np.linalg.lstsq(effect.basis.columns(x), errors / size)[0]
    whole = fitted.with_parameters(parameters, np.eye(len(parameters)))
    inside = transformed(whole, whole.effects, to_datum(machine, whole, found.prior))
    split = transformed(inside, *split_locations(machine, inside))
    return {effect.name: effect.value for effect in split.effects if isinstance(effect, LocationError)}


def shifted_rows(measured, rows, shift):
    """The measurement with the tip farther by a shift, mm, workpiece frame, in some rows."""
    machine = measured.machine
    tips = tool_point(machine, measured.state.positions, measured.tool)
    tips[rows] += shift
    positions = linear_positions(machine, measured.state.positions, tips, measured.tool)
    return replace(measured, state=replace(measured.state, positions=positions))


def deviation_columns(model, machine, q):
    """Derivatives `(3 n, p)`, um, of the tip's deviations by the parameters of a model."""
    transform = error_transform_with_tool(machine, q, np.tile(TIP, (len(q), 1)))[:, :3]
    return 1e3 * model.design(machine, State(q), transform).reshape(3 * len(q), -1)


def covered(model, true, machine, q, unseen=None):
    """Within U (k = 2) `(n, 3)`, the deviations of the tip that a calibration predicts.

    The best rigid motion is left out of errors and uncertainties: the datum of the calibration decides on it. unseen:
    further directions `(3 n, k)` that are left out.
    """
    real, told = (exact_deviation(machine, q, each.errors(machine, State(q)), TIP).position for each in (true, model))
    off, design = 1e3 * (real - told).ravel(), deviation_columns(model, machine, q)
    left_out = rigid_columns(tool_point(machine, q, TIP))
    basis = np.linalg.qr(left_out if unseen is None else np.hstack([left_out, unseen]))[0]
    off, design = off - basis @ (basis.T @ off), design - basis @ (basis.T @ design)
    variance = np.einsum("ij,jk,ik->i", design, np.array(model.covariance), design)
    return (np.abs(off) <= 2.0 * variance**0.5).reshape(-1, 3)
