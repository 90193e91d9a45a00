"""An ordinary six-axis robot, by its own products of 4 x 4 matrices (Denavit and Hartenberg), and its tables.

Joint angles in degrees, lengths in mm. The nominal robot is also written as a machine: axis lines at zero pose in the
frame with the directions of the base and its origin at the flange.
"""

from dataclasses import dataclass

import numpy as np

import machines
from kinematics.machine import Machine

LIMITS = [(-170, 170), (-90, 100), (-100, 60), (-180, 180), (-110, 110), (-340, 340)]
ALPHA = np.radians([-90.0, 0.0, -90.0, 90.0, -90.0, 0.0])
A = np.array([150.0, 600.0, 120.0, 0.0, 0.0, 0.0])
D = np.array([450.0, 0.0, 0.0, 640.0, 0.0, 100.0])
OFFSET = np.radians([0.0, -90.0, 0.0, 0.0, 0.0, 0.0])
REFLECTOR = np.array([60.0, 40.0, 150.0])
"""Position of the reflector in the flange's frame, mm."""


@dataclass(frozen=True)
class Arm:
    """Parameters of six links: mm and rad, shape (6,)."""

    a: np.ndarray
    d: np.ndarray
    alpha: np.ndarray
    offset: np.ndarray
    parallel: float = 0.0
    """Tilt of the third axis about y, rad, which these parameters do not have for parallel axes (Hayati)."""

    def frames(self, joints):
        """Poses (7, 4, 4) before each joint, and of the flange, for joint angles (6,), rad."""
        found = [np.eye(4)]
        for i, q in enumerate(joints):
            link = about_z(q + self.offset[i]) @ shift(self.a[i], 0, self.d[i]) @ about_x(self.alpha[i])
            tilt = about_y(self.parallel) if i == 1 else np.eye(4)
            found.append(found[-1] @ link @ tilt)
        return np.array(found)

    def reflector(self, joints):
        """Positions (n, 3), mm, of the reflector in the base frame for joint angles (n, 6), degrees."""
        tip = np.append(REFLECTOR, 1.0)
        return np.array([(self.frames(q)[-1] @ tip)[:3] for q in np.radians(joints)])

    def yielding(self, joints, urad_per_m):
        """Joint angles (n, 6), degrees, at which joints yield to a weight at the flange.

        urad_per_m: compliance of joints, by their number from 0, times the horizontal lever of the flange.
        """
        found = np.radians(joints)
        for row in found:
            frames = self.frames(row)
            levers = [np.cross(pose[:3, 2], frames[-1][:3, 3] - pose[:3, 3]) @ (0.0, 0.0, -1e-3) for pose in frames[:6]]
            row += [urad_per_m.get(i, 0.0) * 1e-6 * lever for i, lever in enumerate(levers)]
        return np.degrees(found)


NOMINAL = Arm(A, D, ALPHA, OFFSET)


def real_arm(seed=1, mm=0.3, mrad=0.5):
    """A robot whose links differ from the nominal ones by tenths of mm and of mrad."""
    rng = np.random.default_rng(seed)
    lengths, angles = rng.normal(0, mm, (2, 6)), rng.normal(0, mrad * 1e-3, (2, 6))
    return Arm(A + lengths[0], D + lengths[1], ALPHA + angles[0], OFFSET + angles[1], rng.normal(0, mrad * 1e-3))


def toml() -> str:
    """The nominal robot as a machine file, with axes A1 ... A6."""
    frames = NOMINAL.frames(np.zeros(6))
    flange = frames[-1][:3, 3]
    lines = ['name = "robot"', 'chain = "w b A1 A2 A3 A4 A5 A6 t"']
    for i, (low, high) in enumerate(LIMITS):
        direction = np.round(frames[i][:3, 2], 9) + 0.0
        point = np.round(frames[i][:3, 3] - flange, 6) + 0.0
        lines += [f"[axes.A{i + 1}]", f"travel = [{low}, {high}]", f"direction = {direction.tolist()}"]
        lines += [f"point = {point.tolist()}", "home = 0"]
    return "\n".join(lines) + "\n"


def machine() -> Machine:
    """The nominal robot as a machine."""
    return machines.parse(toml(), "robot.toml")


def target() -> np.ndarray:
    """Position (3,) of the reflector from the flange, mm, in the directions of the base at zero pose."""
    return NOMINAL.frames(np.zeros(6))[-1][:3, :3] @ REFLECTOR


def random_joints(n, seed=2, share=0.6):
    """Joint angles (n, 6), degrees, to 0.001, in the middle share of the limits."""
    low, high = np.array(LIMITS).T
    middle, half = (low + high) / 2, share * (high - low) / 2
    return np.round(np.random.default_rng(seed).uniform(middle - half, middle + half, (n, 6)), 3)


def measured(joints, arm=None, seed=3, noise_mm=0.01):
    """Points (n, 3), mm, of a tracker at 3 m from the base, with white noise."""
    rng = np.random.default_rng(seed)
    turn = about_z(0.7) @ about_x(0.02)
    points = (arm or real_arm()).reflector(joints) - [3000.0, 500.0, 200.0]
    return np.round(points @ turn[:3, :3].T + rng.normal(0, noise_mm, points.shape), 4)


def table(columns, decimals=4, delimiter=",") -> str:
    """Text with a line of names and a line for each row, from columns by name."""
    rows = np.column_stack(list(columns.values())).tolist()
    cells = [[f"{cell:.{decimals}f}" if isinstance(cell, float) else str(cell) for cell in row] for row in rows]
    return "\n".join(delimiter.join(line) for line in [list(columns), *cells]) + "\n"


def about_z(q):
    c, s = np.cos(q), np.sin(q)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def about_x(q):
    c, s = np.cos(q), np.sin(q)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def about_y(q):
    c, s = np.cos(q), np.sin(q)
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])


def shift(*vector):
    pose = np.eye(4)
    pose[:3, 3] = vector
    return pose
