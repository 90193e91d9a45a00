"""Assignment of standstills to positions of a plan in the same order; some may be missing, and the frame is unknown.

The first step uses distances alone, which do not depend on the frame: successive standstills are as far apart as
successive positions. These pairs give the pose of the tracker. With the pose as many standstills as possible are
assigned to positions in order, each at most once (dynamic programming, Needleman and Wunsch 1970), and both steps are
repeated. The assignment of a standstill is certain if every assignment of it to another state of the machine contains
fewer pairs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from calibration.registration.registration import rigid
from kinematics.transforms import Array, Pose, turn

NEAR_PLAN_MM, NEAR_PLAN_PER_MM = 1.0, 3e-4
"""Limit, mm, and mm per mm of the plan's extent: standstills farther from every position are not in the plan."""
LEAST_TOLERANCE_MM = 0.05
"""Smallest tolerance for the distance of a standstill from its position, mm."""
OF_TYPICAL = 6.0
"""Largest distance of a standstill from its position, as a multiple of the typical distance."""
GUESS = 25.0
"""Largest distance of a target on table or bed from its approximate position, mm."""
DISTANCE, OF_DISTANCE, OF_GUESSED = 0.2, 1e-3, 0.1
"""Tolerances of the distance between two standstills, mm and as shares of the nominal distance."""
SKIPS = 4
"""Largest number of successive standstills or positions that are left out at a cost of `SKIP` each."""
SKIP, RESTART = 0.3, 2.0
"""Cost of leaving out one standstill or position; cost of continuing at any position. The gain of a pair is 1."""
MATCHING_ROUNDS = 8
TRIALS = 400
UNCERTAIN_LOSS_PAIRS = 0.5
"""Loss of another assignment, in pairs; if it is smaller, the present assignment is uncertain."""


class Positions(NamedTuple):
    """Positions of a plan, one row each, in the order of measuring."""

    base: Array
    """Zero of the carrier of the target `(m, 3)`, mm, in the frame to which the tracker is fixed."""
    turns: Array
    """Rotations `(m, 3, 3)` from the directions of the carrier of the target."""
    target: np.ndarray
    """Number of the target `(m,)`."""
    state: np.ndarray
    """Number of the state of machine and target `(m,)`; positions with the same number are interchangeable."""
    arms_of: Mapping[int, Array]
    """Positions of the targets on their carriers `(3,)`, mm, by number."""
    guessed: frozenset[int]
    """Numbers of the targets whose position is approximate."""

    @property
    def points(self) -> Array:
        """Nominal points `(m, 3)`, mm."""
        arms = np.array([self.arms_of[number] for number in self.target.tolist()]).reshape(-1, 3)
        return np.asarray(self.base + turn(self.turns, arms))

    @property
    def near(self) -> float:
        """Largest distance of a standstill from its position by errors of the machine, mm."""
        return NEAR_PLAN_MM + NEAR_PLAN_PER_MM * float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @property
    def known(self) -> np.ndarray:
        """Mask `(m,)` of positions with a target whose position is known."""
        return ~np.isin(self.target, sorted(self.guessed))


class Matched(NamedTuple):
    """Standstills and positions together."""

    position: np.ndarray
    """Row of the plan `(k,)` of each standstill; -1 for standstills that are not in the plan."""
    certain: np.ndarray
    """Mask `(k,)`: False where another position, or another standstill, fits equally well."""
    distance: Array
    """Distance from the nominal position `(k,)`, mm; from the nearest one for a standstill that is not in the plan."""
    pose: Pose
    """Pose from the frame to which the tracker is fixed to the frame of the tracker."""
    other: tuple[int, int] | None
    """First standstill and its position in another assignment, in which all standstills are shifted along the plan."""


def match(standstills: Array, positions: Positions, allowed: np.ndarray) -> Matched | None:
    """Assign standstills `(k, 3)`, mm, to positions `(m,)`; allowed `(k, m)`: False where the target is another.

    None if they have fewer than four pairs, or if no assignment can be found.
    """
    pairs = _by_distances(standstills, positions, allowed)
    if len(pairs) < 4:
        return None
    pose = _robust_pose(standstills, positions, pairs)
    if pose is None:
        return None
    found = _refined(standstills, positions, allowed, pose)
    if found is None:
        return None
    pose, positions, tolerance = found
    score = _scores(standstills, positions, allowed, pose, tolerance)
    position, certain = _assigned(score, positions.state)
    distance = _distances(standstills, pose.apply(positions.points), position)
    matched = Matched(position, certain, distance, pose, None)
    return matched._replace(other=_shifted(standstills, positions, allowed, matched, tolerance))


def _by_distances(standstills: Array, positions: Positions, allowed: np.ndarray) -> np.ndarray:
    """Pairs `(p, 2)` of successive standstills and successive positions with the same distances."""
    points, (k, m) = positions.points, allowed.shape
    best = np.where(allowed, 1.0, -np.inf)
    came = np.full((k, m, 2), -1)
    anywhere, reached = np.full(m, -np.inf), np.full((m, 2), -1)
    for i in range(k):
        for back in range(1, min(SKIPS, i) + 1):
            for step in range(1, min(SKIPS, m - 1) + 1):
                cost = SKIP * (back + step - 2) + _misfit(standstills, points, positions, (i - back, i), step)
                _take(best[i], came[i], best[i - back, :-step] + 1.0 - cost, (i - back, step), slice(step, m))
        if i:
            _restart(best[i], came[i], anywhere, reached)
        better = best[i] > anywhere
        anywhere, reached = np.where(better, best[i], anywhere), np.where(better[:, None], _here(i, m), reached)
        anywhere, reached = _running(anywhere, reached)
    return _followed(best, came, allowed)


def _misfit(standstills: Array, points: Array, positions: Positions, ends: tuple[int, int], step: int) -> Array:
    """Misfit `(m - step,)` of the distance of two standstills to those of positions `step` apart; 1 is large."""
    nominal = np.linalg.norm(points[step:] - points[:-step], axis=1)
    observed = float(np.linalg.norm(standstills[ends[1]] - standstills[ends[0]]))
    known = positions.known[step:] & positions.known[:-step]
    same = positions.target[step:] == positions.target[:-step]
    loose = np.where(known, 0.0, np.where(same, OF_GUESSED * nominal, GUESS))
    misfit = ((observed - nominal) / (DISTANCE + OF_DISTANCE * nominal + loose)) ** 2
    return np.where(misfit > 4.0, np.inf, 0.25 * misfit)


def _take(best: Array, came: np.ndarray, offered: Array, source: tuple[int, int], rows: slice) -> None:
    """Update the best sums of `rows` where `offered` is better; `source`: its standstill, and its positions before."""
    better = np.isfinite(best[rows]) & (offered > best[rows])
    numbers = np.arange(rows.start, rows.stop)[better]
    best[numbers] = offered[better]
    came[numbers, 0], came[numbers, 1] = source[0], numbers - source[1]


def _restart(best: Array, came: np.ndarray, anywhere: Array, reached: np.ndarray) -> None:
    """Continue at any position, from the best pair at an earlier one."""
    offered = anywhere[:-1] + 1.0 - RESTART
    better = np.isfinite(best[1:]) & (offered > best[1:])
    best[1:][better], came[1:][better] = offered[better], reached[:-1][better]


def _here(i: int, m: int) -> np.ndarray:
    return np.stack([np.full(m, i), np.arange(m)], axis=1)


def _running(values: Array, reached: np.ndarray) -> tuple[Array, np.ndarray]:
    """Running maxima, and the pairs that reach them."""
    highest = np.maximum.accumulate(values)
    number = np.maximum.accumulate(np.where(values >= highest, np.arange(len(values)), 0))
    return highest, reached[number]


def _followed(best: Array, came: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """The pairs of the best sequence, in order."""
    if not allowed.any():
        return np.empty((0, 2), int)
    at = np.unravel_index(int(np.argmax(best)), best.shape)
    i, j, pairs = int(at[0]), int(at[1]), []
    while i >= 0:
        pairs.append((i, j))
        i, j = came[i, j].tolist()
    return np.array(pairs[::-1])


def _robust_pose(standstills: Array, positions: Positions, pairs: np.ndarray) -> Pose | None:
    """The pose with the most agreeing pairs; of pairs with known targets if there are enough."""
    known = pairs[positions.known[pairs[:, 1]]]
    use, near = (known, positions.near) if len(known) >= 4 else (pairs, GUESS)
    nominal, observed = positions.points[use[:, 1]], standstills[use[:, 0]]
    rng, best, most = np.random.default_rng(0), None, 0
    for trial in range(TRIALS):
        some = np.arange(len(use)) if trial == 0 else rng.choice(len(use), 3, replace=False)
        near_rows = _near(rigid(nominal[some], observed[some]), nominal, observed, near)
        for _ in range(2):
            if near_rows.sum() >= 3:
                near_rows = _near(rigid(nominal[near_rows], observed[near_rows]), nominal, observed, near)
        if near_rows.sum() > most:
            best, most = near_rows, int(near_rows.sum())
        if most == len(use):
            break
    return None if best is None or most < 4 else rigid(nominal[best], observed[best])


def _near(pose: Pose, nominal: Array, observed: Array, near: float) -> np.ndarray:
    return np.asarray(np.linalg.norm(pose.apply(nominal) - observed, axis=1) < near)


def _refined(
    standstills: Array, positions: Positions, allowed: np.ndarray, pose: Pose
) -> tuple[Pose, Positions, Array] | None:
    """Pose, targets and tolerances `(m,)` from all assigned standstills, iterated until the assignment is constant."""
    tolerance = np.where(positions.known, positions.near, GUESS)
    before: np.ndarray | None = None
    for _ in range(MATCHING_ROUNDS):
        position, _ = _assigned(_scores(standstills, positions, allowed, pose, tolerance), positions.state)
        rows = np.flatnonzero(position >= 0)
        if len(rows) < 4:
            return None
        if before is not None and np.array_equal(position, before):
            break
        before = position
        pose, positions = _posed(standstills, positions, position, rows)
        away = np.linalg.norm(pose.apply(positions.points[position[rows]]) - standstills[rows], axis=1)
        own = float(np.clip(OF_TYPICAL * np.median(away), LEAST_TOLERANCE_MM, positions.near))
        tolerance = np.full(len(positions.target), own)
    return pose, positions, tolerance


def _posed(standstills: Array, positions: Positions, position: np.ndarray, rows: np.ndarray) -> tuple[Pose, Positions]:
    """Pose, and positions of guessed targets, from assigned standstills."""
    known = rows[positions.known[position[rows]]]
    use = known if len(known) >= 4 else rows
    arms_of = dict(positions.arms_of)
    for _ in range(1 if len(known) == len(rows) else MATCHING_ROUNDS):
        pose = rigid(positions.points[position[use]], standstills[use])
        back = pose.inverse().apply(standstills[rows])
        arms = turn(np.swapaxes(positions.turns[position[rows]], 1, 2), back - positions.base[position[rows]])
        for number in positions.guessed:
            own = positions.target[position[rows]] == number
            if own.any():
                arms_of[number] = np.median(arms[own], axis=0)
        positions = positions._replace(arms_of=arms_of)
        use = rows if len(known) < 4 else known
    return pose, positions


def _scores(standstills: Array, positions: Positions, allowed: np.ndarray, pose: Pose, tolerance: Array) -> Array:
    """Gain of each pair of standstill and position `(k, m)`: 1 at distance 0, decreasing, -inf beyond the tolerance."""
    points = pose.apply(positions.points)
    score = np.empty(allowed.shape)
    for i, standstill in enumerate(standstills):
        share = np.linalg.norm(points - standstill, axis=1) / tolerance
        score[i] = np.where(allowed[i] & (share < 1.0), 1.0 - share**2 / 4.0, -np.inf)
    return score


def _sums(score: Array) -> Array:
    """Largest sums `(k + 1, m + 1)` of pairs in order among the first standstills and the first positions."""
    sums = np.zeros((score.shape[0] + 1, score.shape[1] + 1))
    for i, row in enumerate(score):
        sums[i + 1, 1:] = np.maximum.accumulate(np.maximum(sums[i, 1:], sums[i, :-1] + row))
    return sums


def _assigned(score: Array, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position `(k,)` of each standstill, -1 for none, and whether it is certain `(k,)`."""
    before, after = _sums(score), _sums(score[::-1, ::-1])[::-1, ::-1]
    total = before[:-1, :-1] + score + after[1:, 1:]
    best = float(before[-1, -1])
    position = _traced(before, score)
    certain = np.ones(len(score), bool)
    for i in np.flatnonzero(position >= 0).tolist():
        rivals = (state != state[position[i]]) & (total[i] > best - UNCERTAIN_LOSS_PAIRS)
        others = total[:, position[i]] > best - UNCERTAIN_LOSS_PAIRS
        others[i] = False
        certain[i] = not (rivals.any() or others.any())
    return position, certain


def _traced(sums: Array, score: Array) -> np.ndarray:
    """Position `(k,)` of each standstill in the assignment with the largest sum; -1 for none."""
    position = np.full(len(score), -1)
    i, j = score.shape
    while i and j:
        if sums[i, j] == sums[i - 1, j]:
            i -= 1
        elif sums[i, j] == sums[i, j - 1]:
            j -= 1
        else:
            i, j = i - 1, j - 1
            position[i] = j
    return position


def _distances(standstills: Array, points: Array, position: np.ndarray) -> Array:
    own = np.linalg.norm(standstills - points[position], axis=1)
    for i in np.flatnonzero(position < 0).tolist():
        own[i] = np.linalg.norm(points - standstills[i], axis=1).min()
    return np.asarray(own)


def _shifted(
    standstills: Array, positions: Positions, allowed: np.ndarray, matched: Matched, tolerance: Array
) -> tuple[int, int] | None:
    """Another assignment, with all standstills shifted along the plan, that has as many pairs."""
    rows = np.flatnonzero(matched.position >= 0)
    free = len(positions.target) - len(rows)
    points = positions.points
    for shift in (s for size in range(1, free + 1) for s in (-size, size)):
        there = matched.position[rows] + shift
        inside = (there >= 0) & (there < len(points))
        if inside.sum() < len(rows) - free or inside.sum() < 4:
            continue
        pose = _agreed(points[there[inside]], standstills[rows[inside]], float(tolerance.max()))
        if pose is None:
            continue
        score = _scores(standstills, positions, allowed, pose, tolerance)
        position = _traced(_sums(score), score)
        both = rows[(position[rows] >= 0)]
        differ = positions.state[position[both]] != positions.state[matched.position[both]]
        if (position >= 0).sum() >= len(rows) and differ.sum() > len(rows) / 2:
            first = int(both[np.argmax(differ)])
            return first, int(position[first])
    return None


def _agreed(nominal: Array, observed: Array, tolerance: float) -> Pose | None:
    """A pose for which at least half of the pairs agree, found by iteration from all pairs; None if there is none."""
    near = np.ones(len(nominal), bool)
    for _ in range(3):
        pose = rigid(nominal[near], observed[near])
        away = np.linalg.norm(pose.apply(nominal) - observed, axis=1)
        near = away <= max(float(np.median(away)), tolerance)
    return pose if np.median(away) < tolerance else None
