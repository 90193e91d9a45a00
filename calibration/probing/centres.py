"""Centres of spheres from contacts: one centre for each row, one radius of contact for each sphere."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.instruments import TouchProbe
from calibration.instruments.touch_probe import TIP
from calibration.measurement.measurement import Measurement, with_moves
from calibration.measurement.plan import Plan
from calibration.probing.log import Contacts
from calibration.probing.touches import TOUCHES
from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.transforms import Array
from kinematics.user_error import UserError
from rendering.shown import Shown

CENTRE_STEPS = 6
"""Gauss-Newton steps: the start is near."""
FAR_FROM_PLAN_MM = 10.0
"""Largest distance of a centre from its planned position, mm."""
OFF_SPHERE_SCATTERS, OFF_SPHERE_MM = 8.0, 0.01
"""A contact is off its sphere beyond so many times the scatter of all, and beyond a distance, mm."""
SCATTER = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""
FEWEST_CONTACTS = 4
"""Fewest rows from which the scatter of contacts is estimated."""
TYPICAL_U_UM = 1.0
CENTRE_DECIMALS = 5


@dataclass(frozen=True)
class Repeat:
    """The first centre measured again."""

    row: int
    """Number of the row, from 0."""
    shift_um: Array
    """Difference `(3,)` from the first row, um, workpiece frame."""
    U_um: float
    """Expanded uncertainty (k = 2) of each component of the difference."""

    @property
    def significant(self) -> bool:
        """True for a difference beyond its uncertainty in a component (Bonferroni: three components)."""
        return bool(np.abs(self.shift_um).max() > 1.25 * self.U_um)


@dataclass(frozen=True, repr=False)
class Probed(Shown):
    """Centres from contacts, with their scatter."""

    measurement: Measurement
    """The centres as a measurement, for a fit."""
    radii: dict[str, float]
    """Distance of the centres of tip and sphere in contact by sphere, mm, with the pre-travel of the probe."""
    scatter_um: float | None
    """Standard deviation of the contacts from their spheres, um; None for too few rows."""
    u_um: float
    """Standard uncertainty of each coordinate of a centre, from the scatter, um."""
    repeats: tuple[Repeat, ...]
    """Shifts of the first centre, when it was measured again."""
    notes: tuple[str, ...]
    """Notes for the user."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return f"{len(self.measurement)} centres, u {self.u_um:.2g} um"


def centres_of(contacts: Contacts, plan: Plan, source: str) -> Probed:
    """The centres of the contacts of a plan; rows with a contact off their sphere are left out, with a note.

    UserError for centres far from the planned ones, and where most rows have contacts off their sphere.
    """
    machine, tip = plan.machine, plan.targets[TIP].position
    assert plan.state.station is not None
    sphere = plan.state.station[contacts.row]
    m = len(contacts.row)
    points = tool_point(machine, contacts.positions.reshape(m * TOUCHES, -1), tip).reshape(m, TOUCHES, 3)
    kept, notes = np.ones(m, bool), list(contacts.notes)
    centres, radii, left = _fitted(points, sphere)
    _refuse_far(centres, sphere, plan, contacts, source)
    while True:
        size = SCATTER * float(np.median(np.abs(left[kept]))) * np.sqrt(TOUCHES / 2.0)
        off = np.flatnonzero(kept & (np.abs(left).max(axis=1) > max(OFF_SPHERE_SCATTERS * size, OFF_SPHERE_MM)))
        if not len(off):
            break
        # one bad contact spoils the whole row, and a little all others of its sphere
        worst = int(off[np.argmax(np.abs(left[off]).max(axis=1))])
        kept[worst] = False
        notes.append(
            f"{source}, line {contacts.lines[worst]}: a contact is {np.abs(left[worst]).max() * 1e3:.0f} um off the "
            f"sphere {sphere[worst]}: row {contacts.row[worst] + 1} is left out"
        )
        if kept.sum() < max(m / 2.0, 1.0):
            raise UserError(f"{source}: most centres have contacts off their sphere: is the probe or a sphere loose?")
        centres[kept], radii, left[kept] = _fitted(points[kept], sphere[kept])
    rows = np.flatnonzero(kept)
    scatter, u_um = _scatter(left[rows], len(radii), points[rows] - centres[rows, None])
    if scatter is None:
        notes.append(f"{m} centres are too few to estimate their uncertainty: u_um {TYPICAL_U_UM:g} is assumed")
    measurement = _measurement(contacts, plan, centres, rows, u_um, source)
    repeats = tuple(_repeats(measurement, centres[rows], contacts.row[rows], u_um))
    return Probed(measurement, radii, scatter, u_um, repeats, tuple(notes))


def _fitted(points: Array, sphere: np.ndarray) -> tuple[Array, dict[str, float], Array]:
    """Centres `(m, 3)`, radius of each sphere, mm, and distances `(m, TOUCHES)` of the contacts from their spheres."""
    m, names = len(points), np.unique(sphere)
    number = np.searchsorted(names, sphere)
    centres = np.array([_alone(each) for each in points])
    radii = np.array(
        [np.linalg.norm((points - centres[:, None])[number == k], axis=2).mean() for k in range(len(names))]
    )
    rows = np.arange(m)
    left = np.zeros((m, TOUCHES))
    for _ in range(CENTRE_STEPS):
        out = points - centres[:, None]
        far = np.linalg.norm(out, axis=2)
        left = far - radii[number, None]
        design = np.zeros((m, TOUCHES, 3 * m + len(names)))
        for k in range(3):
            design[rows, :, 3 * rows + k] = out[:, :, k] / far
        design[rows, :, 3 * m + number] = 1.0
        step, *_ = np.linalg.lstsq(design.reshape(m * TOUCHES, -1), left.ravel(), rcond=None)
        centres, radii = centres + step[: 3 * m].reshape(m, 3), radii + step[3 * m :]
    left = np.linalg.norm(points - centres[:, None], axis=2) - radii[number, None]
    return centres, dict(zip(names.tolist(), radii.tolist(), strict=True)), left


def _alone(points: Array) -> Array:
    """The centre `(3,)` of the sphere through points `(k, 3)`, by least squares of squared distances."""
    middle = points.mean(axis=0)
    own = points - middle
    columns = np.concatenate([2.0 * own, np.ones((len(own), 1))], axis=1)
    solved, *_ = np.linalg.lstsq(columns, np.sum(own**2, axis=1), rcond=None)
    return np.asarray(middle + solved[:3])


def _scatter(left: Array, radii: int, out: Array) -> tuple[float | None, float]:
    """Standard deviation of the contacts and standard uncertainty of a centre's coordinate, um."""
    m = len(left)
    if m < FEWEST_CONTACTS:
        return None, TYPICAL_U_UM
    freedom = left.size - 3 * m - radii
    scatter = float(np.sqrt(np.sum(left**2) / freedom)) * 1e3
    normals = out / np.linalg.norm(out, axis=2, keepdims=True)
    information = np.swapaxes(normals, 1, 2) @ normals
    variance = np.trace(np.linalg.inv(information), axis1=1, axis2=2).mean() / 3.0
    return scatter, max(round(scatter * float(np.sqrt(variance)), 3), 0.001)


def _refuse_far(centres: Array, sphere: np.ndarray, plan: Plan, contacts: Contacts, source: str) -> None:
    stated = np.array([plan.spheres[name] for name in sphere.tolist()])
    far = np.linalg.norm(centres - stated, axis=1)
    beyond = np.flatnonzero(far > FAR_FROM_PLAN_MM)
    if len(beyond):
        k = int(beyond[0])
        raise UserError(
            f"{source}, line {contacts.lines[k]}: the centre is {far[k]:.3g} mm from sphere {sphere[k]} of the plan: "
            "is it the log of another plan, or are the columns in inch or exchanged?"
        )


def _measurement(
    contacts: Contacts, plan: Plan, centres: Array, rows: np.ndarray, u_um: float, source: str
) -> Measurement:
    """The measurement of these centres: the positions of the linear axes at which the tip is in them."""
    planned = plan.state.rows(contacts.row[rows])
    found = linear_positions(plan.machine, planned.positions, centres[rows], plan.targets[TIP].position)
    positions = np.where(plan.machine.rotary, planned.positions, np.round(found, CENTRE_DECIMALS))
    n = len(rows)
    return Measurement(
        plan.machine, TouchProbe(u_um=u_um), with_moves(replace(planned, positions=positions)), np.zeros((n, 3)),
        plan.targets, run=plan.run[contacts.row[rows]], spheres=dict(plan.spheres), source=source,
        lines=contacts.lines[rows],
    )  # fmt: skip


def _repeats(measurement: Measurement, centres: Array, row: np.ndarray, u_um: float) -> list[Repeat]:
    """The first centre measured again, at the same rotary positions."""
    positions, names = measurement.state.positions, measurement.state.station
    assert names is not None
    rotary = positions[:, measurement.machine.rotary]
    same = (names == names[0]) & np.all(np.abs(rotary - rotary[0]) < 1e-9, axis=1)
    return [
        Repeat(int(row[k]), (centres[k] - centres[0]) * 1e3, 2.0 * float(np.sqrt(2.0)) * u_um)
        for k in np.flatnonzero(same).tolist()
        if k
    ]
