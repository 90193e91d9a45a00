"""Sections of real programs that somebody has spoiled: refused in words, or read and given back byte for byte.

Some of those that are accepted are corrected as well: the corrected program is read again, and makes the same moves
within the correction.
"""

from __future__ import annotations

import io
import random
import re
import resource
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, lru_cache
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from kinematics.basis import Polynomial
from kinematics.effects import Backlash, ErrorMotion
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.user_error import UserError
from postproc.control.setup import Setup
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import Dialect, find_dialect
from postproc.motion.motions import merged
from postproc.motion.segments import like
from postproc.text import flow
from postproc.text.source import ENCODING, HEAD_SIZE, Source, _check
from postproc.verification.verify import read_motions
from tests.fuzz.case import Case, Outcome, Verdict
from tests.fuzz.mutate import mutated

TESTS = Path(__file__).parents[1]
FOLDERS = (TESTS.parents[1] / "shared" / "data" / "nc", TESTS.parent / "examples", TESTS / "data" / "freecad")
ENDINGS = {"iso": (".nc", ".ngc", ".cnc", ".tap"), "heidenhain": (".h",), "siemens": (".mpf", ".spf", ".arc")}
MACHINES = ("gantry", "dmu50", "trunnion_bc", "head_head")
SECONDS = 5
"""Time of the processor for one examination."""
LEAST_COMPARED = 0.05
"""Share of programs that are not refused."""
MEMORY = 4 << 30
"""Address space of the process, bytes."""
LONGEST_RUN = 2_000
"""Blocks after which a loop is endless."""
CORRECTED_SHARE = 0.01
"""Share of accepted programs that are corrected as well."""
LARGEST_MM = 0.5
"""Largest correction by the models used here, mm, with backlash and the lengths of levers."""
HEAD_LINES, SECTION_LINES = 12, 14


class Program(NamedTuple):
    """A real program."""

    name: str
    dialect: str
    lines: tuple[str, ...]


@cache
def programs() -> tuple[Program, ...]:
    """Those of the folders that are there; ISO, Siemens and Klartext alike in number of draws."""
    found = []
    for folder in FOLDERS:
        for path in sorted(p for p in folder.rglob("*") if p.is_file()):
            parts = path.relative_to(folder).parts
            ending = path.suffix.lower()
            dialect = parts[0] if parts[0] in ENDINGS else next((d for d, e in ENDINGS.items() if ending in e), None)
            if dialect is not None:
                text = path.read_bytes().decode(ENCODING)
                found.append(Program(path.name, dialect, tuple(text.splitlines(keepends=True))))
    return tuple(found)


@cache
def by_dialect() -> dict[str, tuple[Program, ...]]:
    """The programs of each dialect."""
    return {name: tuple(p for p in programs() if p.dialect == name) for name in ENDINGS}


def section(program: Program, rng: random.Random) -> str:
    """The head of a program, a section of it, and its last line."""
    lines = program.lines
    if len(lines) <= HEAD_LINES + SECTION_LINES:
        return "".join(lines)
    head = lines[: rng.choice((4, HEAD_LINES))]
    start = rng.randrange(len(head), len(lines))
    return "".join([*head, *lines[start : start + rng.randint(1, SECTION_LINES)], lines[-1]])


def draw(seed: int) -> Case:
    """A section of a real program with one to five changes."""
    rng = random.Random(seed)
    dialect = rng.choice(list(ENDINGS))
    program, other = rng.choice(by_dialect()[dialect]), rng.choice(programs())
    text = mutated(section(program, rng), section(other, rng), rng)
    return Case(text, f"part{ENDINGS[dialect][0]}", rng.choice(MACHINES), str(rng.randrange(4)), (dialect,))


def judge(case: Case) -> Outcome:
    """Read and write it back, and perhaps correct it."""
    with limited(SECONDS):
        return _judge(case)


def _judge(case: Case) -> Outcome:
    (dialect_name,) = case.options
    data = case.program.encode(ENCODING)
    source = Source(case.name, data[:HEAD_SIZE].decode(ENCODING), data)
    try:
        _check(source)
        dialect = _dialect(dialect_name)
        machine, setup = _machine(case.machine)
        job = Job(source, dialect, machine, no_errors(machine), setup, travel_check=False)
        if _written(job) != data:
            return Outcome(Verdict.DIFFERS, "other bytes: without errors the program is not given back")
    except UserError as refusal:
        return _refused(str(refusal), case.name)
    if random.Random(case.program).random() >= CORRECTED_SHARE:
        return Outcome(Verdict.COMPARED)
    return _judge_corrected(job, _model(case.machine, int(case.calibration)))


def _judge_corrected(job: Job, model: ErrorModel) -> Outcome:
    source, machine, setup = job.source, job.machine, job.setup
    try:
        data = _written(Job(source, job.dialect, machine, model, setup, travel_check=False))
    except UserError as refusal:
        return _refused(str(refusal), source.name)
    text = data.decode(ENCODING)
    if _odd_numbers(text) > _odd_numbers(source.data.decode(ENCODING)):  # type: ignore[union-attr]
        return Outcome(Verdict.DIFFERS, "no number: nan or inf is written")
    corrected = Source(source.name, text[:HEAD_SIZE], data)
    try:
        before, after = (merged(read_motions(s, job.dialect, machine, setup)) for s in (source, corrected))
    except UserError as refusal:
        return Outcome(Verdict.DIFFERS, f"not read again: {refusal}")
    matched = like(before, after)
    if matched is None:
        return Outcome(Verdict.DIFFERS, "other moves: the corrected program does not make the same moves")
    rows = matched.evaluated & matched.programmed & ~matched.added
    apart = np.abs(after.machine_target - matched.machine_target)[rows][:, machine.translators]
    if not (apart <= LARGEST_MM).all():
        return Outcome(Verdict.DIFFERS, f"far off: an axis is {apart.max():.3g} mm from where it was")
    return Outcome(Verdict.COMPARED)


def _refused(message: str, name: str) -> Outcome:
    """A refusal names the program, and gives a reason."""
    if not message.startswith((f"{name}:", f"program {name}")) or len(message) < len(name) + 8:
        return Outcome(Verdict.DIFFERS, f"a message without program name: {message}")
    return Outcome(Verdict.REFUSED, "in words")


def _written(job: Job) -> bytes:
    out = io.BytesIO()
    Pipeline(job).run(out, lambda _: None)
    return out.getvalue()


def _odd_numbers(text: str) -> int:
    return len(re.findall(r"nan|inf", text, re.IGNORECASE))


@contextmanager
def limited(seconds: int) -> Iterator[None]:
    """TimeoutError after so many seconds of the processor; less memory; refusal of a long loop. All undone at the end."""

    def late(*_: object) -> None:
        raise TimeoutError

    before, longest = signal.signal(signal.SIGVTALRM, late), flow.MOST_RUN_BLOCKS
    memory, most = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, most))
    flow.MOST_RUN_BLOCKS = LONGEST_RUN
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)
        flow.MOST_RUN_BLOCKS = longest
        resource.setrlimit(resource.RLIMIT_AS, (memory, most))


@cache
def _dialect(name: str) -> Dialect:
    """A dialect that reads a line once: those that nobody spoiled come again and again."""
    dialect = find_dialect(name, "", "")
    read = lru_cache(100_000)(lambda first, text: dialect.read_block(1 if first else 2, text))
    return msgspec.structs.replace(dialect, read_block=lambda line, text: read(line == 1, text)._replace(line=line))


@cache
def _machine(name: str) -> tuple:
    sys.path.insert(0, str(TESTS))
    from support.programs import load, setup_of

    machine = load(name)
    setup: Setup = setup_of(machine)
    return machine, setup


@cache
def _model(name: str, number: int) -> ErrorModel:
    """Constant, straight, curved, and with backlash."""
    from support.programs import model_of

    machine, _ = _machine(name)
    if number == 3:
        return model_of(machine, *(Backlash(axis, 15.0) for axis in "XYZ"))
    values = [(40.0,), (10.0, 30.0), (10.0, -20.0, 30.0)][number]
    effects = []
    for axis in "XYZ":
        low, high = machine.axes[machine.index(axis)].travel
        effects.append(ErrorMotion(axis, axis, Polynomial((low, high), number), values, u=(1.0,) * len(values)))
    return model_of(machine, *effects)
