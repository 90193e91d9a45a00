"""LN of Klartext: lines with surface normals, and with tool axes as vectors under M128; programs called elsewhere."""

import dataclasses
import io
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.klartext_run import HEAD, TOOLS, Run, tips
from support.programs import WHOLE, load, random_model, setup_of, source_of

from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.block import Refusal

TCP = "L B+0 C+0 FMAX\nM128\n"
components = st.integers(-40, 40).map(lambda i: i / 100)


def run(text):
    return Run(HEAD + text, lengths=TOOLS)


def corrected(text, model):
    machine, out = load("dmu50"), io.BytesIO()
    klartext, setup = find_dialect("heidenhain", "", ""), setup_of(machine, (), TOOLS)
    job = Job(source_of(text, "t.h"), klartext, machine, model, setup, travel_check=False, **WHOLE)
    Pipeline(job).run(out, lambda _: None)
    return out.getvalue().decode()


@settings(max_examples=30)
@given(components, components, st.integers(-60, 60), st.integers(-60, 60))
def test_the_tool_lies_along_its_vector(a, b, x, y):
    program = run(TCP + f"LN X{x:+d} Y{y:+d} Z+20 NX+0 NY+0 NZ+1 TX{a:+} TY{b:+} TZ+1 F500\nLN X+5 NX+0 NY+1 NZ+1\n")
    tip, axis = tips(program, slice(-2, None))
    np.testing.assert_allclose(tip, [[x, y, 20], [5, y, 20]], atol=1e-6)
    np.testing.assert_allclose(axis, [np.array([a, b, 1.0]) / math.sqrt(a * a + b * b + 1.0)] * 2, atol=1e-8)


def test_vectors_stay_and_the_point_is_corrected():
    vectors = "NX+0 NY+0,6 NZ+0,8 TX+0,1 TY+0,2 TZ+0,97 F1000"
    text = HEAD + TCP + f"LN X+10 Y+5,5 Z+20 {vectors}\nM129\nL Z+100 FMAX\n"
    model = random_model(load("dmu50"), 4)
    written = corrected(text, model)
    (line,) = [line for line in written.splitlines() if line.startswith("LN")]
    found = re.fullmatch(r"LN X(\S+) Y(\S+) Z(\S+) (.*)", line)
    assert found[4] == vectors
    places = np.array([float(found[i].replace(",", ".")) for i in (1, 2, 3)])
    assert np.all(places != [10, 5.5, 20])
    # as a straight line to the same axis positions
    b, c = run(TCP + f"LN X+10 Y+5,5 Z+20 {vectors}\n").axes("BC")[-1]
    turned = text.replace(f"LN X+10 Y+5,5 Z+20 {vectors}", f"L X+10 Y+5,5 Z+20 B{b:+.9f} C{c:+.9f} F1000")
    said = corrected(turned, model)
    found = re.search(r"L X(\S+) Y(\S+) Z(\S+) B\S+ C\S+ F1000", said)
    np.testing.assert_allclose(places, [float(found[i].replace(",", ".")) for i in (1, 2, 3)], atol=2e-4)


def test_nothing_is_put_between_normals():
    program = run("LN X+0 Y+0 Z+0 NX+0 NY+0 NZ+1 F500\nLN X+400 NX+0 NY+0 NZ+1\nL X+0\n")
    assert [block.text.split()[0] for block in program.motions.blocks if block.no_insertion] == ["LN", "LN"]
    assert "surface normals" in " ".join(program.notes.texts())


REFUSED = {
    "LN X+1 Y+2": "LN needs a vector: write NX NY NZ, or TX TY TZ, or both",
    "LN X+1 NZ+1": "NX NY NZ must all be in the block, each once",
    "LN X+1 NX+0 NX+0 NY+0 NZ+1": "NX NY NZ must all be in the block, each once",
    "LN X+1 TX+0 TY+0 TZ+1": "TX TY TZ need M128 and coordinates that are not rotated",
    "M128\nCYCL DEF 10.0 R\nCYCL DEF 10.1 ROT+5\nLN X+1 TX+0 TY+0 TZ+1": "TX TY TZ need M128 and coordinates that are not rotated",
    "M128\nLN X+1 C+5 TX+0 TY+0 TZ+1": "TX TY TZ and a rotary axis in one block",
    "M128\nLN X+1 TX+0 TY+0 TZ+0": "the tool axis has the length 0",
    "M128\nLN X+1 TX+0 TY+0 TZ-1": "no position of the rotary axes gives this tool axis",
    "LN X+1 NX+Q5 NY+0 NZ+1": "NX+Q5: Q5 is not set by the program",
}


@pytest.mark.parametrize("text", REFUSED)
def test_refused(text):
    with pytest.raises(Refusal, match=re.escape(REFUSED[text])):
        run(text)


def test_a_machine_without_rotary_axes():
    with pytest.raises(Refusal, match="machine gantry has none"):
        Run("BEGIN PGM A MM\nL X+0 Y+0 Z+0\nM128\nLN X+1 TX+0 TY+0 TZ+1\n", machine="gantry")


CALLING = "Q1 = 5\nL X+1 Y+2 Z+3\nCC X+0 Y+0\nCALL PGM ROUGH.H\n"


def calling(text):
    machine = load("gantry")
    control = dataclasses.replace(machine.control, calls_leave_state=True)
    return Run("BEGIN PGM A MM\n" + text, machine=dataclasses.replace(machine, control=control))


def test_programs_that_leave_the_state_as_it_is():
    program = calling(CALLING + "L X+10 Y+20 Z+30\nQ1 = 6\nL XQ1\n")
    assert program.axes("XYZ")[-1].tolist() == [6, 20, 30]
    assert program.motions.known_start[1].any() is np.False_
    assert "CALL PGM ROUGH.H is taken to leave tool, frames and modes as they are" in " ".join(program.notes.texts())


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("L IX+1", "increment"),
        ("LP PR+1 PA+2", "no pole"),
        ("L XQ1", "Q1 is not known: CALL PGM ROUGH.H may set parameters"),
    ],
)
def test_what_they_leave_unknown(text, reason):
    with pytest.raises(Refusal, match=reason):
        calling(CALLING + text + "\n")


def test_they_are_refused_elsewhere():
    with pytest.raises(Refusal, match="calls_leave_state = true in the machine file"):
        Run("BEGIN PGM A MM\n" + CALLING, machine="gantry")
