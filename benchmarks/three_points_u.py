"""Do errors after `three-points` have the standard uncertainty that it states? `python benchmarks/three_points_u.py`.

Random five-axis machines (C on a trunnion; C on the table and B in the head; both in the head) with the errors of the
virtual calibration paper, Table 1, and ncomp's own of rotary axes, measured in one round from each of four stations,
several times with other noise. Errors at 150 positions of all axes within the measured ranges, 100 mm below the spindle
nose, less the shift and turn of the workpiece and the shift of the tool, which the data do not show; uncertainties
likewise. error/u: RMS over positions, directions and measurements; noise/u: of the scatter of the measurements about
their mean alone. Without noise: RMS of the error in um, which is the share of waves that the positions do not resolve.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import machines
from benchmarks.rotary_turns import SEED, STATIONS, TABLE, TARGETS, TOOL, random_machine
from calibration.evaluation.volumetric import deviation_on, rigid_columns
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement, Target
from calibration.simulation.simulate import observe, tracker_pose
from calibration.simulation.true_model import random_true_model
from calibration.single_axis.three_points import identify
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import forward
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

KINDS = ("C on a trunnion", "C on the table, B in the head", "B and C in the head")
TRACKERS = {
    "sharp": LaserTracker(u_range_um=0.25, u_range_um_per_m=0.25, u_angle_um=5.0, u_angle_um_per_m=1.0),
    "blunt": LaserTracker(u_range_um=0.5, u_range_um_per_m=0.5, u_angle_um=15.0, u_angle_um_per_m=6.0),
}
POSITIONS = 150


@dataclass(frozen=True)
class Session:
    """A machine with its errors, and how it is measured."""

    machine: Machine
    truth: ErrorModel
    blank: State
    tracker: LaserTracker
    seed: int

    def seen(self, number: int, noise: float = 1.0) -> Measurement:
        """The measurement of this number, from the same tracker position."""
        placed = np.random.default_rng(self.seed)
        poses = {str(k): tracker_pose(np.array(point_of(at)), placed) for k, at in enumerate(STATIONS)}
        targets = {name: Target(point_of(at)) for name, at in TARGETS.items()}
        targets |= {name: Target(point_of(at), "table") for name, at in TABLE.items()}
        rng = np.random.default_rng([self.seed, number])
        return observe(
            self.machine, self.truth, self.blank, self.tracker, rng, poses, targets,
            stands_on="bed", run=self.blank.station, noise_scale=noise,
        )  # fmt: skip


def point_of(text: str) -> tuple[float, float, float]:
    """A point written as `x,y,z`."""
    x, y, z = map(float, text.split(","))
    return x, y, z


def drawn(kind: str, draw: int, folder: Path) -> Machine:
    """A random machine of a kind."""
    text = random_machine(np.random.default_rng([SEED, draw]), head=kind != KINDS[0])
    if kind == KINDS[2]:
        text = re.sub(r'chain = "w C (.*) B t"', r'chain = "w \1 C B t"', text)
    file = folder / "drawn.toml"
    file.write_text(text)
    return machines.load(str(file))


def session(machine: Machine, tracker: LaserTracker, linear: int, seed: int) -> Session:
    """Every axis alone, its targets one after the other, from every station."""
    rng = np.random.default_rng([SEED, seed, 1])
    truth = random_true_model(machine, rng)
    ends = machine.travel.copy()
    turning = np.flatnonzero(machine.rotary & (ends[1] - ends[0] >= 2.0 * np.pi))
    ends[1, turning] = ends[0, turning] + np.deg2rad(345.0)
    standing = np.where(machine.rotary, 0.0, rng.uniform(0.3, 0.7, len(ends[0])) * (ends[1] - ends[0]) + ends[0])
    q, names = [], []
    for i, axis in enumerate(machine.axes):
        for name in TARGETS if axis.side == "tool" else TABLE:
            part = np.tile(standing, (24 if axis.rotary else linear, 1))
            part[:, i] = np.linspace(*ends[:, i], len(part))
            q.append(part)
            names += [name] * len(part)
    k = len(STATIONS)
    stations = np.repeat([str(n) for n in range(k)], len(names))
    return Session(
        machine,
        truth,
        State(np.tile(np.concatenate(q), (k, 1)), station=stations, target=np.tile(names, k)),
        tracker,
        seed,
    )


def judged(of: Session, model: ErrorModel) -> tuple[Array, Array]:
    """Errors and their standard uncertainties `(3 n,)`, um."""
    low, high = of.blank.positions.min(axis=0), of.blank.positions.max(axis=0)
    q = np.random.default_rng(1).uniform(low, high, (POSITIONS, len(low)))
    (true, points), (found, _) = (deviation_on(of.machine, one, q, TOOL) for one in (of.truth, model))
    mounted = np.broadcast_to(forward(of.machine, q).rotation, (POSITIONS, 3, 3)).reshape(-1, 3)
    columns, sizes, _ = np.linalg.svd(np.hstack([rigid_columns(points), mounted]), full_matrices=False)
    columns = columns[:, sizes > 1e-9 * sizes[0]]
    design = model.design(
        of.machine, State(q), error_transform_with_tool(of.machine, q, np.tile(TOOL, (POSITIONS, 1)))[:, :3]
    )
    both = np.hstack([(found - true).reshape(-1, 1), design.reshape(3 * POSITIONS, -1)])
    both = 1e3 * (both - columns @ (columns.T @ both))
    return both[:, 0], model.propagated(both[:, 1:].reshape(POSITIONS, 3, -1)).reshape(-1)


def figures(of: Session, repeats: int) -> tuple[float, float, float]:
    """Squares of error/u and of noise/u, and of the error without noise, um, in the mean."""
    errors, u = np.array([judged(of, identify(of.seen(k)).model) for k in range(repeats)]).swapaxes(0, 1)
    scatter = (errors - errors.mean(axis=0)) * np.sqrt(repeats / (repeats - 1))
    quiet, _ = judged(of, identify(of.seen(0, 0.0)).model)
    return float(np.mean((errors / u) ** 2)), float(np.mean((scatter / u) ** 2)), float(np.mean(quiet**2))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=7, help="machines of each kind")
    parser.add_argument("--repeats", type=int, default=3, help="measurements of each")
    parser.add_argument("--positions", type=int, nargs="*", default=[11, 21], help="of each linear axis")
    parser.add_argument("--trackers", nargs="*", default=list(TRACKERS), choices=list(TRACKERS))
    asked = parser.parse_args()
    print(f"{'':44}error/u   noise/u   without noise, um")
    for tracker in asked.trackers:
        for linear in asked.positions:
            for kind in KINDS:
                found = []
                for draw in range(asked.draws):
                    with tempfile.TemporaryDirectory() as folder:
                        machine = drawn(kind, draw, Path(folder))
                    found.append(figures(session(machine, TRACKERS[tracker], linear, draw), asked.repeats))
                error, noise, quiet = np.sqrt(np.mean(found, axis=0))
                print(f"{tracker}, {linear}, {kind:32}{error:10.2f}{noise:10.2f}{quiet:10.2f}", flush=True)


if __name__ == "__main__":
    main()
