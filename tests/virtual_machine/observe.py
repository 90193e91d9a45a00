"""What instruments see: a tracker on a stand, with noise along and across its beam; a laser along one axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from virtual_machine.cause import UM, Cause
from virtual_machine.chain import Array, nominal_points, rotations, tool_points
from virtual_machine.session import Session
from virtual_machine.truth import Curves

C = TypeVar("C", bound=Cause)


@dataclass(frozen=True)
class Tracker:
    """Standard uncertainties (k = 1), um and um per m of range; base and share of one quantity are added."""

    u_range_um: float
    u_range_um_per_m: float
    u_angle_um: float
    u_angle_um_per_m: float

    def along(self, length: Array) -> Array:
        """Standard uncertainty of the range, mm."""
        return np.asarray(UM * (self.u_range_um + self.u_range_um_per_m * length * 1e-3))

    def across(self, length: Array) -> Array:
        """Standard uncertainty in either direction across the beam, mm."""
        return np.asarray(UM * (self.u_angle_um + self.u_angle_um_per_m * length * 1e-3))


class Stand(NamedTuple):
    """Where a tracker stands, mm, and how it is turned, rad, in the workpiece frame."""

    origin: Array
    turn: Array


@dataclass(frozen=True)
class Setup:
    """A machine with its errors, a session, and the tracker's stands by the names of the session's stations."""

    session: Session
    curves: Curves
    tracker: Tracker
    stands: Mapping[str, Stand]
    causes: tuple[Cause, ...] = ()

    def having(self, *causes: Cause) -> Setup:
        """The same with more that is wrong."""
        return replace(self, causes=(*self.causes, *causes))


def exact_points(setup: Setup) -> Array:
    """Points `(n, 3)`, mm, in the workpiece frame, where the targets really are."""
    session = setup.session
    chain, causes = session.chain, setup.causes
    errors = setup.curves.errors(chain, session.positions) + sum(
        (cause.errors(session) for cause in causes), start=np.zeros((*session.positions.shape, 6))
    )
    tool = sum((cause.tool(session) for cause in causes), start=np.zeros((len(session), 6)))
    points = tool_points(chain, chain.to_radians(session.positions), errors, tool, session.reflectors())
    return np.where(session.on_tool[:, None], points, session.points())


def without_noise(setup: Setup) -> Array:
    """What the tracker would read `(n, 3)`, mm, in the frame of each row's station."""
    session, points = setup.session, exact_points(setup)
    for name, stand in setup.stands.items():
        rows = session.stations == name
        points[rows] = (points[rows] - stand.origin) @ rotations(stand.turn[None])[0]
    for cause in setup.causes:
        points = cause.seen(session, points)
    return points


def observed(setup: Setup, rng: np.random.Generator) -> Array:
    """What the tracker reads `(n, 3)`, mm; the same noise on whatever is wrong, from the same generator."""
    points = without_noise(setup)
    drawn = rng.normal(size=points.shape)
    length = np.linalg.norm(points, axis=1)
    beam = points / length[:, None]
    along = np.sum(drawn * beam, axis=1, keepdims=True) * beam
    return np.asarray(
        points + along * setup.tracker.along(length)[:, None] + (drawn - along) * setup.tracker.across(length)[:, None]
    )


def displacement(setup: Setup, cause: Cause) -> Array:
    """What a cause brings to the observed points `(n, 3)`, mm."""
    return without_noise(setup.having(cause)) - without_noise(setup)


def noise_of_mean(setup: Setup) -> float:
    """RMS over rows that see the tool, and components, of the standard uncertainty of a position's mean, mm."""
    length = np.linalg.norm(without_noise(setup), axis=1)
    variance = (setup.tracker.along(length) ** 2 + 2 * setup.tracker.across(length) ** 2) / 3
    return float(np.sqrt(np.mean((variance / setup.session.visits())[setup.session.on_tool])))


def scale_to(setup: Setup, cause: C, times: float) -> C:
    """The cause in the size that displaces the observed points by so many times the noise of the mean, RMS."""
    moved = displacement(setup, cause)[setup.session.on_tool]
    return cause.scaled(times * noise_of_mean(setup) / float(np.sqrt(np.mean(np.sum(moved**2, axis=1)))))


def aligned(moved: Array, points: Array, groups: np.ndarray) -> Array:
    """What is left `(n, 3)` of displacements at points, both mm, when each group is shifted and turned to fit best."""
    left = moved.copy()
    for group in np.unique(groups):
        rows = groups == group
        centred = points[rows] - points[rows].mean(axis=0)
        size = np.abs(centred).max()
        turns = np.cross(np.eye(3)[None], centred[:, None] / size)
        columns = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=1)
        design = columns.transpose(0, 2, 1).reshape(-1, 6)
        wanted = moved[rows].reshape(-1)
        left[rows] = (wanted - design @ np.linalg.lstsq(design, wanted, rcond=None)[0]).reshape(-1, 3)
    return left


def share_left(setup: Setup, cause: Cause) -> float:
    """Share of a cause's displacement, RMS, that the registration of the stations leaves to be seen."""
    moved, rows = displacement(setup, cause), setup.session.on_tool
    left = aligned(moved[rows], without_noise(setup)[rows], setup.session.stations[rows])
    return float(np.sqrt(np.mean(left**2) / np.mean(moved[rows] ** 2)))


@dataclass(frozen=True)
class Laser:
    """An interferometer: standard uncertainties (k = 1), um and um per m from the start of a run."""

    u_um: float
    u_um_per_m: float


def exact_readings(setup: Setup, axis: str) -> Array:
    """Readings `(n,)`, mm, of a laser along a linear axis, actual less nominal; without noise."""
    session = setup.session
    q = session.chain.to_radians(session.positions)
    ahead = q.copy()
    ahead[:, session.chain.index(axis)] += 1.0
    start, end = (nominal_points(session.chain, at, session.reflectors()) for at in (q, ahead))
    return np.asarray(np.sum((exact_points(setup) - start) * (end - start), axis=1))


def along_axis(setup: Setup, axis: str, laser: Laser, rng: np.random.Generator) -> Array:
    """The same with noise, each run from a zero of its own."""
    readings, u = exact_readings(setup, axis), noise_along(setup, axis, laser)
    for run in np.unique(np.asarray(setup.session.run)):
        rows = setup.session.run == run
        readings[rows] += rng.normal(scale=0.01) + rng.normal(size=len(u[rows])) * u[rows]
    return readings


def noise_along(setup: Setup, axis: str, laser: Laser) -> Array:
    """Standard uncertainties `(n,)` of a laser's readings, mm."""
    place, away = setup.session.place(axis), np.zeros(len(setup.session))
    for run in np.unique(np.asarray(setup.session.run)):
        rows = setup.session.run == run
        away[rows] = np.abs(place[rows] - place[rows][0])
    return np.asarray(UM * (laser.u_um + laser.u_um_per_m * away * 1e-3))


def scale_along(setup: Setup, axis: str, laser: Laser, cause: C, times: float) -> C:
    """`scale_to` for a laser: of what is read, and of its noise."""
    moved = exact_readings(setup.having(cause), axis) - exact_readings(setup, axis)
    noise = np.sqrt(np.mean(noise_along(setup, axis, laser) ** 2 / setup.session.visits()))
    return cause.scaled(times * float(noise) / float(np.sqrt(np.mean(moved**2))))
