"""Examiner: LinuxCNC runs a program and its correction; a gantry with errors must then cut the programmed path."""

from __future__ import annotations

import random
import re
from collections import Counter
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tests.fuzz import reading
from tests.fuzz.canon import OFFSETS, Call, ClientError, Environment, RefusedError, calls
from tests.fuzz.case import Case, Outcome, Verdict
from tests.fuzz.gantry import Array, Errors, constant, machine_text, read_errors, repeated, smooth
from tests.fuzz.groups import DisorderError, Group, Moves, Placed, grouped, tip
from tests.fuzz.ncomp import Run, correct
from tests.fuzz.path import Move, moves
from tests.fuzz.rs274_programs import program

CONTROL = 'family = "linuxcnc"\ntool_change_moves = []'
DIAMETERS = {1: 8.0, 2: 10.0, 3: 6.0}
AT_ENDS, ALONG, BELIEF = 0.25e-3, 1.2e-3, 3.0
"""Tolerances, mm; and how many times the largest deviation an axis may be off that the program has not placed."""
HALF_TOLERANCE = 0.5e-3
"""A block that runs several times has one text where that is off by no more, mm."""
CHUNK = 4096
"""Lines that ncomp reads at once."""
NEAR_STEP = 1.0
"""Distance of a step of the error, mm, within which a correction may meet it."""
COMPENSATION = re.compile(r"G4[12]")


def draw(seed: int) -> Case:
    """A random program with offsets and tools, for a machine with a constant or a smooth error."""
    rng = random.Random(seed)
    contours = seed % 5 == 0
    errors = (constant if contours else rng.choice([constant, constant, smooth, smooth, smooth, repeated]))(rng)
    options = options_of(rng)
    return Case(
        at_a_border(rng, program(seed, contours=contours)),
        machine=machine_text(CONTROL),
        calibration=errors.text(),
        options=options,
    )


def at_a_border(rng: random.Random, text: str) -> str:
    """Now and then a program behind so many blank lines that ncomp's chunks meet within it."""
    lines = text.count("\n")
    blank = "\n" * (CHUNK - rng.randint(0, lines))
    if rng.random() > 0.02:
        return text
    leader, end, rest = text.partition("\n") if text.startswith("%") else ("", "", text)
    return leader + end + blank + rest  # LinuxCNC does not count lines before a leading %


def options_of(rng: random.Random) -> tuple[str, ...]:
    """Offsets, tools, and the options for a machine with such large errors."""
    options = ["--no-travel-check", "--max-correction-um", "5000", "--accept", "outside,insignificant"]
    options += ["--unroll"] if rng.random() < 0.25 else []
    for name in OFFSETS:
        options += ["--work-offset", f"{name}={','.join(str(round(rng.uniform(-50, 50), 2)) for _ in range(3))}"]
        options += ["--datum", f"{name}=true"]
    for number in DIAMETERS:
        options += ["--tool-length", f"T{number}={round(rng.uniform(0, 120), 2)}"]
    return tuple(options)


class Executed(NamedTuple):
    """What LinuxCNC makes of a program and of its correction, and the run of ncomp between them."""

    before: list[Call]
    after: list[Call]
    run: Run


def executed(case: Case, environment: Environment) -> Executed | Outcome:
    """The program, its correction, and again; the outcome where one of the three ends the examination."""
    try:
        before = calls(case.program, environment)
    except (RefusedError, ClientError) as refusal:
        return Outcome(Verdict.REFUSED, f"rs274: {re.sub(r'[-+]?[0-9.]+', '0', str(refusal))[:60]}")
    run = correct(case)
    if run.status == 2:
        left = "" if run.text is None else "refused and written: "
        return Outcome(Verdict.DIFFERS if left else Verdict.REFUSED, left + run.refusal)
    if run.status or run.text is None:
        return Outcome(Verdict.DIFFERS, f"exit status {run.status}: {run.shown}")
    try:
        return Executed(before, calls(run.text, environment), run)
    except (RefusedError, ClientError) as refusal:
        return Outcome(Verdict.DIFFERS, f"LinuxCNC refuses the correction: {refusal}\n{run.text}")


def judge(case: Case) -> Outcome:
    """Both programs by LinuxCNC, and the tool point of the machine with errors."""
    environment = environment_of(case)
    found = executed(case, environment)
    if isinstance(found, Outcome):
        return found
    tools, run, text = environment.tools, found.run, found.run.text or ""
    before, after = moves(found.before, tools), moves(found.after, tools)
    misread = reading.fault(case, before[0])
    if misread:
        return Outcome(Verdict.DIFFERS, f"read: {misread}")
    unsplit = run.report.get("not_split", ())
    if unsplit and "--unroll" in case.options:  # its lines are those of the program written out
        return Outcome(Verdict.COMPARED)
    whole = {line for entry in unsplit for line in _lines(entry["lines"])}
    return examine((case.program, text), before, after, read_errors(case.calibration), whole)


def environment_of(case: Case) -> Environment:
    """Offsets and tools from the options."""
    offsets, tools = {}, {}
    for option, value in pairwise(case.options):
        name, _, figures = value.partition("=")
        if option == "--work-offset":
            offsets[name] = [float(figure) for figure in figures.split(",")]
        elif option == "--tool-length":
            tools[int(name[1:])] = (float(figures), DIAMETERS.get(int(name[1:]), 0.0))
    return Environment(offsets, tools)


def _lines(ranges: object) -> list[int]:
    found: list[int] = []
    for first, last in re.findall(r"(\d+)(?:\D+(\d+))?", str(ranges).replace("],", "];").replace(", ", "-")):
        found += range(int(first), int(last or first) + 1)
    return found


def examine(texts: tuple[str, str], before: Moves, after: Moves, errors: Errors, whole: set[int]) -> Outcome:
    """Compare the moves of a program and of its correction, by their texts."""
    try:
        groups = grouped(before, after, texts[1])
    except DisorderError as fault:
        return Outcome(Verdict.DIFFERS, f"{fault}\n{texts[1]}")
    judge = Judge(texts[0], errors, groups, whole)
    for i in range(len(groups)):
        found = judge.fault(i)
        if found:
            return Outcome(Verdict.DIFFERS, f"{found}\nline {groups[i].programmed.line} of\n{texts[1]}")
    return Outcome(Verdict.COMPARED) if groups else Outcome(Verdict.REFUSED, "no move")


class Judge:
    """Compares the cut of the machine with errors, for each corrected move, with the programmed move."""

    def __init__(self, text: str, errors: Errors, groups: list[Group], whole: set[int]) -> None:
        self.groups, self.errors, self.whole = groups, errors, whole
        self.runs = Counter(group.programmed.line for group in groups)
        self.placed = Placed(text, groups)
        self.strict_before = False
        self.beside = False
        """A contour with the tool beside it has begun where the program had not placed every axis."""
        deviations = [
            np.abs(errors.tool_point(g.programmed.points, g.programmed.tool) - tip(g.programmed)).max() for g in groups
        ]
        self.loose = BELIEF * max(deviations, default=0.0) + 0.01

    def fault(self, i: int) -> str:
        """The fault of a move, empty for none."""
        group = self.groups[i]
        programmed, written = group.programmed, group.written
        limits = self._limits(i)
        end = self.errors.tool_point(written[-1].end[None], written[-1].tool)[0] - tip(programmed)[-1]
        if (np.abs(end) > limits).any():
            return f"end: off by {np.round(end * 1e3, 3)} um, tolerance {np.round(limits * 1e3, 2)}"
        strict = bool((limits < self.loose / 2).all())
        both, self.strict_before = strict and self.strict_before, strict
        if both and programmed.kind in {"line", "arc"} and programmed.line not in self.whole:
            strayed = self._strayed(programmed, written, group.shares)
            if strayed > ALONG + (1.2e-3 * self.errors.teeth[0] if self._over_a_step(programmed) else 0.0):
                return f"between ends: off by {strayed * 1e3:.3f} um"
        return self._feed_fault(programmed, written)

    def _over_a_step(self, move: Move) -> bool:
        """True where no path that hangs together can follow the error."""
        _, pitch, offset = self.errors.teeth
        low, high = move.points.min(axis=0) - NEAR_STEP, move.points.max(axis=0) + NEAR_STEP
        return bool((np.floor((low - offset) / pitch) != np.floor((high - offset) / pitch)).any())

    def _limits(self, i: int) -> Array:
        """Tolerance of the end (3,), mm: large for axes that the program has not placed in the frame in force."""
        placed = self.placed.follow(i)
        limits = np.array([AT_ENDS if axis in placed else self.loose for axis in "XYZ"])
        if len(placed) < 3:  # a nearly full arc that is not split, because an axis is unknown, stays round
            limits += (2e-2 if _nearly_full(self.groups[i].programmed) else 2e-3) * self.loose
        code = self.placed.code(i)
        if COMPENSATION.search(code):
            self.beside = not self.strict_before
        if self.runs[self.groups[i].programmed.line] > 1:
            limits += HALF_TOLERANCE
        limits += 2e-3 * self.errors.teeth[0] * (self.errors.to_step(self.groups[i].programmed.end[None]) < NEAR_STEP)
        if self.placed.in_cycle(i) or self.beside:
            limits[:] = self.loose
        self.beside = self.beside and not re.search(r"G40(?![\d.])", code)
        return limits

    def _strayed(self, programmed: Move, written: list[Move], shares: list[float]) -> float:
        """Largest distance, mm, of the cut from the programmed path at the same share of it."""
        worst = 0.0
        for move, begin, end in zip(written, shares, [*shares[1:], 1.0], strict=True):
            actual = self.errors.tool_point(move.points, move.tool)
            share = begin + (end - begin) * np.linspace(0.0, 1.0, len(actual))
            wanted = programmed.at(share) - [0.0, 0.0, programmed.tool]
            worst = max(worst, float(np.linalg.norm(actual - wanted, axis=1).max()))
        return worst

    def _feed_fault(self, programmed: Move, written: list[Move]) -> str:
        if programmed.kind == "rapid":
            return ""
        if all(abs(move.feed - programmed.feed) < 0.01 + 1e-4 * programmed.feed for move in written):
            return ""
        time = programmed.length / max(programmed.feed, 1e-9)
        new = sum(move.length / max(move.feed, 1e-9) for move in written)
        if abs(new - time) < 0.02 * time + 1e-3:
            return ""
        return f"feed: {programmed.feed} mm/min has become {[move.feed for move in written]}"


def _nearly_full(move: Move) -> bool:
    """True of an arc of more than about 300 degrees: its length is five times the distance of its ends."""
    return move.kind == "arc" and bool(move.length > 5.0 * np.linalg.norm(move.points[-1] - move.points[0]))
