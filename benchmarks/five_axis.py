"""Location errors of B and C of a DMU 50 from one measurement with all five axes moving.

    python benchmarks/five_axis.py [--draws 50]

A tracker on the table sees three reflectors at the spindle, 600 positions. Error motions of all axes are random (Table
1 and harmonics, a third of their size), location errors normal with 30 um and urad. True errors and fit are in the same
frame; z is (fit - true) / u, whose standard deviation is 1 for honest uncertainties.
"""

from __future__ import annotations

import argparse

import msgspec
import numpy as np

import machines
from calibration.fit.calibrate import Calibration, calibrate
from calibration.fit.datum import split_locations, to_datum, transformed
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Target
from calibration.measurement.plan import Choices
from calibration.planning.strategies import plan
from calibration.simulation.simulate import observe, tracker_pose
from calibration.simulation.true_model import random_true_model
from kinematics.effects import COMPONENTS, UM, URAD, LocationError
from kinematics.error_model.model import ErrorModel
from kinematics.state import State

TARGETS = {"1": Target((0.0, 0.0, -120.0)), "2": Target((90.0, 40.0, -180.0)), "3": Target((-60.0, 80.0, -100.0))}
TRACKER = LaserTracker(u_range_um_per_m=0.5, u_angle_um=3.0, u_angle_um_per_m=2.0)
LOCATIONS = ("X0C", "Y0C", "A0C", "B0C", "X0B", "Z0B", "A0B", "C0B")
BASIS = "cubic:12"


def locations(model: ErrorModel) -> dict[str, tuple[float, float]]:
    """Values and standard uncertainties of location errors, by name."""
    return {e.name: (e.value, e.uncertainties[0]) for e in model.effects if isinstance(e, LocationError)}


def in_the_frame_of(found: Calibration, truth: ErrorModel) -> ErrorModel:
    """The true errors in the bases of a fit, and in its datum, with its location errors apart."""
    machine, model = found.fit.measurement.machine, found.fit.model
    effects = []
    for effect, _ in model.error_motions:
        i, k = machine.index(effect.axis), COMPONENTS.index(effect.component)
        x = np.linspace(*effect.basis.interval, 400)
        q = np.zeros((len(x), len(machine.axes)))
        q[:, i] = x * machine.scale[i]
        values = truth.errors(machine, State(q))[:, i, k] / (UM if k < 3 else URAD)
        parameters = np.linalg.lstsq(effect.basis.columns(x), values, rcond=None)[0]
        effects.append(effect.with_parameters(parameters.tolist(), effect.u))
    written = msgspec.structs.replace(model, effects=tuple(effects))
    inside = transformed(written, written.effects, to_datum(machine, written, found.fit.prior))
    return transformed(inside, *split_locations(machine, inside))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=50)
    machine = machines.load("dmu50")
    rows: dict[str, list[tuple[float, float, float]]] = {}
    for draw in range(parser.parse_args().draws):
        rng = np.random.default_rng([5, draw])
        shapes = random_true_model(machine, rng)
        small = tuple(e.with_parameters([p / 3 for p in e.parameters]) for e in shapes.effects if "0" not in e.name)
        lines = tuple(LocationError(n[0], n[2], rng.normal(0.0, 30.0)) for n in LOCATIONS)  # type: ignore[arg-type]
        truth = msgspec.structs.replace(shapes, effects=(*small, *lines))
        positions = plan(machine, "random", 600, choices=Choices(rotary="random", seed=draw)).positions
        state = State(positions, target=rng.choice(list(TARGETS), len(positions)))
        pose = {"1": tracker_pose((-900.0, -700.0, 400.0), rng)}
        noisy = observe(machine, truth, state, TRACKER, rng, pose, TARGETS)
        found = calibrate(noisy, basis=BASIS, hold_out=False)
        wanted = locations(in_the_frame_of(found, truth))
        got = locations(found.model)
        for name, (value, u) in got.items():
            rows.setdefault(name, []).append((wanted[name][0], value, u))
    print(f"{'':8}{'RMS of truth':>14}{'RMS error':>12}{'u stated':>11}{'sd of z':>10}   um and urad")
    for name, values in rows.items():
        true, found, u = np.array(values).T
        z = (found - true) / u
        size, error = np.sqrt(np.mean(true**2)), np.sqrt(np.mean((found - true) ** 2))
        print(f"{name:8}{size:14.2f}{error:12.2f}{np.sqrt(np.mean(u**2)):11.2f}{np.sqrt(np.mean(z**2)):10.2f}")


if __name__ == "__main__":
    main()
