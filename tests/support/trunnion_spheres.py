"""Files of a touch probe on `trunnion_ac`, by kinematics of their own: nothing of them comes from ncomp.

C turns a table on a trunnion A, whose line runs 100 mm above the zero of Z. Both turn the workpiece against the tool, so
that a positive angle turns the table by the negative one about +z and +x.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

TRUNNION = np.array([0.0, 0.0, 100.0])
SPHERES = {"s1": (130.0, 20.0, 60.0), "s2": (-110.0, 60.0, 50.0), "s3": (20.0, -130.0, 90.0)}
"""Centres, mm, workpiece frame."""
PROBE = 150.0
UM, URAD = 1e-3, 1e-6


def turned(vector, degrees):
    """Rotation matrix of an angle about an axis."""
    x, y, z = np.asarray(vector, float)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


@dataclass(frozen=True)
class Mill:
    """The real machine: lines of both rotary axes (shift, mm, and direction) and squareness of the linear axes."""

    a_shift: tuple[float, float, float] = (0.0, 31 * UM, -22 * UM)
    a_line: tuple[float, float, float] = (1.0, 24 * URAD, -33 * URAD)
    c_shift: tuple[float, float, float] = (-18 * UM, 27 * UM, 0.0)
    c_line: tuple[float, float, float] = (-29 * URAD, 16 * URAD, 1.0)
    square: tuple[float, float, float] = (12 * URAD, -19 * URAD, 14 * URAD)
    """Squareness of y to x, of z to x, and of z to y."""
    waves_um: float = 1.5
    """Radial and axial error motions of both rotary axes, one and two waves per turn."""

    def carried(self, point, a, c):
        """Position in the machine of a point of the table at angles, degrees."""
        c_line, a_line = (np.array(line) / np.linalg.norm(line) for line in (self.c_line, self.a_line))
        point = turned(c_line, -c) @ (point - np.array(self.c_shift)) + self.c_shift + self._wave(c, 0.4)
        on_a = TRUNNION + self.a_shift
        return turned(a_line, -a) @ (point - on_a) + on_a + self._wave(a, 1.9)

    def commanded(self, tip):
        """X, Y, Z, mm, at which the spindle nose is where the axes, which are not square, have to go."""
        xy, xz, yz = self.square
        return np.linalg.solve(np.array([[1.0, -xy, xz], [0.0, 1.0, -yz], [0.0, 0.0, 1.0]]), tip)

    def _wave(self, degrees, phase):
        angle = np.radians(degrees) + phase
        size = self.waves_um * UM
        return size * np.array([np.cos(angle), np.sin(2.0 * angle), 0.6 * np.sin(angle)])


@dataclass(frozen=True)
class Touches:
    """A file: its header, and rows of commanded X Y Z A C, sphere, reading (or none)."""

    rows: np.ndarray
    """Commanded X Y Z, mm, and A C, degrees `(n, 5)`."""
    names: tuple[str, ...]
    readings: np.ndarray | None = None
    """Readings of an R-test `(n, 3)`, mm: the sphere's centre from the tip, in the directions of the tool."""
    u_um: float = 1.0
    probe: float = PROBE
    spheres: dict[str, tuple[float, float, float]] = field(default_factory=lambda: dict(SPHERES))
    columns: str = "X,Y,Z,A,C"

    @property
    def text(self) -> str:
        """The measurement file."""
        head = [f"# machine: trunnion_ac\n# instrument: touch-probe\n# u_um: {self.u_um}\n# probe: 0 0 {-self.probe}\n"]
        head += [f"# sphere.{name}: {x} {y} {z}\n" for name, (x, y, z) in self.spheres.items()]
        head.append(f"{self.columns},sphere{'' if self.readings is None else ',dx,dy,dz'}\n")
        parts = [self.rows, *([] if self.readings is None else [self.readings])]
        lines = []
        for k, name in enumerate(self.names):
            numbers = [",".join(f"{value:.5f}" for value in part[k]) for part in parts]
            lines.append(",".join([numbers[0], name, *numbers[1:]]) + "\n")
        return "".join([*head, *lines])

    def line(self, row: int) -> int:
        """Number of the line of a row."""
        return 1 + self.text.splitlines().index(next(t for t in self.text.splitlines() if t.startswith("X,"))) + row + 1

    def but(self, **changed) -> Touches:
        """The file with other fields."""
        return replace(self, **changed)


def touched(
    seed=0, *, poses=30, spheres=SPHERES, mill=Mill(), zeros=(0.0, 0.0), moved=None, r_test=False, noise_um=1.0
):
    """A file of the spheres at random angles, the first centre again at the end.

    zeros: true angles of A and C at their stated zeros, degrees. moved: rows `(n,)` to shifts, mm, of the workpiece.
    """
    rng = np.random.default_rng(seed)
    angles = np.column_stack([rng.uniform(-90.0, 25.0, poses), rng.uniform(0.0, 360.0, poses)])
    order = [(name, a, c) for a, c in angles for name in spheres]
    order.append(order[0])
    placed = {name: np.array(at) + rng.uniform(-0.5, 0.5, 3) for name, at in spheres.items()}
    rows, readings = [], []
    for number, (name, a, c) in enumerate(order):
        point = placed[name] + (0.0 if moved is None else moved(number, name))
        centre = mill.carried(point, a + zeros[0], c + zeros[1])
        found = mill.commanded(centre + np.array([0.0, 0.0, PROBE])) + rng.normal(0.0, noise_um * UM, 3)
        start = np.round(found + rng.uniform(-0.1, 0.1, 3), 3) if r_test else found
        rows.append([*start, a, c])
        readings.append(found - start)
    return Touches(np.array(rows), tuple(name for name, *_ in order), np.array(readings) if r_test else None)
