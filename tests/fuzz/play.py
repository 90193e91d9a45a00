"""Examiner: axes with backlash as mechanics: the carriage lies somewhere in the gap, and moves when it is pushed."""

from __future__ import annotations

import random
from collections.abc import Iterable

import numpy as np
from scipy.spatial import cKDTree

from tests.fuzz.case import Case, Outcome, Verdict
from tests.fuzz.gantry import Array, Errors, flat, gentle, machine_text, read_errors
from tests.fuzz.groups import DisorderError, Group, Placed, grouped, tip
from tests.fuzz.linuxcnc import CONTROL, at_a_border, environment_of, executed, options_of
from tests.fuzz.path import Move, moves
from tests.fuzz.rs274_programs import program

ALONG = 1.3e-3
"""Distance from the programmed path, mm, where every axis is known: the tolerance, and rounding."""
DENSE, COARSE, NEAR = 97, 2001, 17
"""Points along a written move, along a programmed one, and near one of these."""


def draw(seed: int) -> Case:
    """A random program for a machine with backlash in some axes, and gentle or no other errors."""
    rng = random.Random(seed)
    play = tuple(rng.choice([0.0, 6.0, 15.0, 40.0]) for _ in range(3))
    errors = (gentle if rng.random() < 0.5 else flat)(rng, play if any(play) else (15.0, 15.0, 15.0))
    return Case(
        at_a_border(rng, program(seed, plain=True)),
        machine=machine_text(CONTROL),
        calibration=errors.text(),
        options=options_of(rng),
    )


def judge(case: Case) -> Outcome:
    """Both programs by LinuxCNC, and by the machine with backlash."""
    environment = environment_of(case)
    found = executed(case, environment)
    if isinstance(found, Outcome):
        return found
    tools, text = environment.tools, found.run.text or ""
    try:
        groups = grouped(moves(found.before, tools, DENSE), moves(found.after, tools, DENSE), text)
    except DisorderError as fault:
        return Outcome(Verdict.DIFFERS, f"{fault}\n{text}")
    return Mechanics(case, groups, found.run.report, text).outcome()


class Play:
    """Carriages with backlash, at all positions at which they may lie: between `low` and `high`."""

    def __init__(self, play: Iterable[float]) -> None:
        self.half = 0.5e-3 * np.array(list(play))
        self.low, self.high = -self.half.copy(), self.half.copy()
        """Lower and upper limits of the lag of the carriage behind the command, mm; if they agree it is known."""
        self.at = np.zeros(3)

    def follow(self, q: Array) -> tuple[Array, Array]:
        """Sides of the backlash (n, 3) in -1..1, lowest and highest, along commanded positions (n, 3)."""
        sides = np.empty((2, *q.shape))
        for n, position in enumerate(q):
            step = position - self.at
            self.low = np.clip(self.low - step, -self.half, self.half)
            self.high = np.clip(self.high - step, -self.half, self.half)
            self.at = position
            # a carriage that lies below the command has come from below: side +1
            sides[:, n] = -self.high, -self.low
        with np.errstate(invalid="ignore"):
            sides = np.nan_to_num(sides / self.half)
        return sides[0], sides[1]

    @property
    def known(self) -> Array:
        """True (3,) where it is known on which side the carriage lies."""
        return np.asarray(self.high - self.low < 1e-9)


class Mechanics:
    """The machine with backlash on both programs."""

    def __init__(self, case: Case, groups: list[Group], report: dict[str, object], text: str) -> None:
        self.groups, self.errors, self.text = groups, read_errors(case.calibration), text
        self.placed = Placed(case.program, groups)
        self.before, self.after = Play(self.errors.play), Play(self.errors.play)
        self.sure = np.zeros(3, bool)
        """Axes whose direction the program lets a reader know: placed, and moved by more than the backlash since."""
        self.placed_before: set[str] = set()
        """Axes that were placed behind the block before."""
        self.placed_last: set[str] = set()
        self.excused = _excused(report)
        bare = Errors(self.errors.parameters)
        strays = [
            np.abs(bare.tool_point(g.programmed.points, g.programmed.tool) - tip(g.programmed)).max() for g in groups
        ]
        self.loose = 3.0 * max(strays, default=0.0) + 2e-3 * float(np.linalg.norm(self.errors.play)) + ALONG

    def outcome(self) -> Outcome:
        """The first move that is cut wrongly."""
        for i, group in enumerate(self.groups):
            fault = self._fault(i, group)
            if fault:
                return Outcome(Verdict.DIFFERS, f"{fault}\nline {group.programmed.line} of\n{self.text}")
        return Outcome(Verdict.COMPARED) if self.groups else Outcome(Verdict.REFUSED, "no move")

    def _fault(self, i: int, group: Group) -> str:
        programmed = group.programmed
        placed = self.placed.follow(i)
        if i and programmed.line != self.groups[i - 1].programmed.line:
            self.placed_before = self.placed_last
        self.placed_last = placed
        strict = {axis for axis in placed if axis in self.placed_before}
        old = self._cut([programmed], self.before)
        taken = self._cut(group.taken, self.after) if group.taken else None
        new = self._cut(group.written, self.after)
        limit = self._limit(i, placed, strict)
        self._learn(i, strict)
        wanted = tip(programmed)
        if taken is not None:
            first, whole = (_from(part, wanted[0]) for part in (taken[:, :1], taken))
            if whole > max(limit, first + 0.3e-3):
                return f"take-up moves the tool: by {whole * 1e3:.2f} um, tolerance {limit * 1e3:.2f}"
        error, was = _from(new[:, -1:], wanted[-1]), _from(old[:, -1:], wanted[-1])
        if programmed.kind != "rapid":
            error, was = max(error, _distance(new, programmed).max()), max(was, _distance(old, programmed).max())
        if error <= limit:
            return ""
        if self.excused and error <= limit + 1e-3 * float(np.linalg.norm(self.errors.play)):
            self.excused -= 1
            return ""
        return f"{programmed.kind}: off by {error * 1e3:.2f} um, before {was * 1e3:.2f}, tolerance {limit * 1e3:.2f}"

    def _cut(self, written: list[Move], play: Play) -> Array:
        """Tool points (2, n, 3) along moves, for both extremes of the unknown lag."""
        cut = []
        for move in written:
            sides = play.follow(move.points)
            cut.append([self.errors.tool_point(move.points, move.tool, side) for side in sides])
        return np.concatenate(cut, axis=1)

    def _limit(self, i: int, placed: set[str], strict: set[str]) -> float:
        if self.placed.in_cycle(i):
            return self.loose
        unknown = ~(self.sure & self.after.known)
        free = np.array([axis not in placed or axis not in strict for axis in "XYZ"])
        half = 0.5e-3 * np.array(self.errors.play) * unknown
        return float(ALONG + np.linalg.norm(np.where(free, self.loose, half)))

    def _learn(self, i: int, strict: set[str]) -> None:
        """Directions that a reader of the program knows behind a move."""
        if self.placed.in_cycle(i):
            self.sure[:] = False
            return
        programmed = self.groups[i].programmed
        moved = np.abs(np.diff(programmed.points, axis=0)).sum(axis=0)
        enough = 2e-3 * np.array(self.errors.play) + 0.01
        for k, axis in enumerate("XYZ"):
            self.sure[k] = axis in strict and (self.sure[k] or bool(moved[k] > enough[k]))


def _distance(points: Array, move: Move) -> Array:
    """Distance (2, n) of points (2, n, 3) from the programmed path of the tool, to about 0.05 um."""
    flat_points = points.reshape(-1, 3)
    shares = np.linspace(0.0, 1.0, COARSE)
    nearest = shares[cKDTree(move.at(shares) - [0.0, 0.0, move.tool]).query(flat_points)[1]]
    near = nearest[:, None] + shares[1] * np.linspace(-1.0, 1.0, NEAR)
    way = move.at(near.reshape(-1)).reshape(len(flat_points), NEAR, 3) - [0.0, 0.0, move.tool]
    first, step = way[:, :-1], np.diff(way, axis=1)
    to = flat_points[:, None] - first
    share = np.clip((to * step).sum(axis=2) / np.maximum((step**2).sum(axis=2), 1e-18), 0.0, 1.0)
    distance = np.linalg.norm(to - share[..., None] * step, axis=2).min(axis=1)
    return np.asarray(distance.reshape(points.shape[:2]))


def _from(points: Array, place: Array) -> float:
    """Largest distance of points (2, n, 3) from one."""
    return float(np.linalg.norm(points - place, axis=2).max())


def _excused(report: dict[str, object]) -> int:
    """Number of moves that may be off by a backlash according to a note."""
    notes = [str(note) for note in report.get("notes", ())]  # type: ignore[attr-defined]
    said = [note for note in notes if "taken up along" in note or "is not cut where an axis reverses" in note]
    counts = [note.rpartition(", ")[2].partition(" times")[0] for note in said]
    return sum(int(count) if count.isdigit() else 1 for count in counts)
