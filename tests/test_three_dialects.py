"""One part in three dialects: the same moves, and the same corrections at the same points."""

import dataclasses
import io
import math

import numpy as np
import pytest
from hypothesis import given, settings
from support.programs import WHOLE, load, model_of, random_model, source_of
from support.three_dialects import (
    LEVEL,
    WRITERS,
    Arc,
    Go,
    Hole,
    Loop,
    Shift,
    Turned,
    parts,
    setup,
    tilted_parts,
)
from support.tiers import drawn

from kinematics.basis import Polynomial
from kinematics.effects import ErrorMotion
from kinematics.error_model.model import no_errors
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.motion.motions import merged
from postproc.motion.moves import Kind
from postproc.text.source import ENCODING
from postproc.verification.verify import read_motions

ROUNDING = 1.6e-4
"""mm: of X, Y and Z, in coordinates that may be turned."""


def run(writer, part, machine, model, *, tcp=False):
    """Text, corrected text, and the moves of both without those that cycles make by themselves."""
    text, dialect = writer(tcp).program(part), find_dialect(writer.name, "", "")
    source, out = source_of(text), io.BytesIO()
    job = Job(source, dialect, machine, model, setup(machine, dialect.name), travel_check=False, **WHOLE)
    Pipeline(job).run(out, lambda _: None)
    written = out.getvalue().decode(ENCODING)
    moves = [
        merged(read_motions(source_of(t), dialect, machine, setup(machine, dialect.name))) for t in (text, written)
    ]
    return text, written, [motions.take(np.flatnonzero(motions.kind != Kind.MACHINE)) for motions in moves]


def check_same(part, machine, model, *, tcp=False):
    """The dialects make the same moves, before and after the correction, which is one."""
    control = dataclasses.replace(machine.control, klartext_arcs="axes")  # as the others have it
    machine = dataclasses.replace(machine, control=control)
    (_, _, (nominal, first)), *others = [run(writer, part, machine, model, tcp=tcp) for writer in WRITERS]
    compared = np.ones_like(nominal.target, bool)
    compared[nominal.kind == Kind.CYCLE, machine.index("Z")] = False
    assert np.abs(first.machine_target - nominal.machine_target)[compared].max() > 10.0 * ROUNDING
    for text, _, (before, after) in others:
        assert len(before) == len(after) == len(nominal), text
        for other, own, tolerance in ((before, nominal, 1e-9), (after, first, ROUNDING)):
            apart = np.abs(other.machine_target - own.machine_target)[compared]
            assert apart.max() < tolerance, text
        for row in nominal.arcs:
            assert radius(after, row) == pytest.approx(radius(first, row), abs=5e-4)


def radius(motions, row):
    arc = motions.arcs[row]
    return math.dist(arc.centre, motions.target[row, list(arc.plane[:2])])


SQUARE = [Go(False, {"X": 10.0, "Y": 60.0, "Z": 5.0}), Go(False, {"X": 50.0}), Go(False, {"Y": 10.0})]
PART = [
    Go(True, {"X": 10.0, "Y": 10.0, "Z": 5.0}), *SQUARE, Arc(-1, (10.0, 10.0), (30.0, 10.0), (50.0, 10.0)),
    Shift((5.0, -7.0, 1.0), SQUARE), Turned((20.0, 30.0), 25.0, SQUARE),
    Go(True, {"X": 1.0, "Y": 2.0, "Z": 3.0}), Loop(3, [*SQUARE, Go(False, {"X": 1.0, "Y": 2.0, "Z": 3.0})]),
]  # fmt: skip
DRILLED = [Go(True, {"X": 0.0, "Y": 0.0, "Z": LEVEL}), Hole((20.0, 30.0), -5.0), Hole((40.0, 30.0), -15.0), *PART]


@drawn(few=2, many=4, also={"part": PART}, part=parts())
def test_three_axes(part):
    machine = load("gantry")
    check_same(part, machine, random_model(machine, 7))


@drawn(few=1, many=3, also={"part": DRILLED}, part=parts(drilled=True))
def test_holes(part):
    """By an error of X and Y that is the same at all heights: ISO corrects the bottom, the others where they start."""
    machine = load("gantry")
    ramp = Polynomial(machine.axes[machine.index("X")].travel, 2)
    motions = [ErrorMotion(component, "X", ramp, (20.0, 60.0, -30.0), u=(1.0,) * 3) for component in "XY"]
    check_same(part, machine, model_of(machine, *motions))


@pytest.mark.parametrize("machine", ["trunnion_bc", "head_table"])
@drawn(few=1, many=4, part=tilted_parts(("B", "C")))
def test_the_tool_point_with_five_axes(machine, part):
    machine = load(machine)
    check_same(part, machine, random_model(machine, 7), tcp=True)


@settings(max_examples=4)
@given(parts(drilled=True))
def test_without_errors_the_bytes_stay(part):
    machine = load("gantry")
    for writer in WRITERS:
        text, written, _ = run(writer, part, machine, no_errors(machine))
        assert written == text


@pytest.mark.statistical
@settings(max_examples=150)
@given(parts())
def test_many_parts(part):
    machine = load("gantry")
    check_same(part, machine, random_model(machine, 11))
