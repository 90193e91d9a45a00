"""Blocks that run several times: one text for all iterations that differ by less than the tolerance, and its errors."""

import io

import numpy as np
import pytest
from hypothesis import strategies as st
from support.programs import correct, load, random_model, read, setup_of, shifted, source_of
from support.three_dialects import WRITERS, loops, paths
from support.tiers import drawn

from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.motion.motions import merged
from postproc.text.source import ENCODING
from postproc.verification.verify import read_motions, verify

GANTRY = load("gantry")


def test_iterations_of_another_style():
    text = "G21 G90\nM98 P100\nG0 X.5 Y.5\nM98 P100\nM30\nO100\nG0 X0 Y0 Z0\nM99\n"
    result = correct(text, GANTRY, shifted(GANTRY, X=100.0, Y=-200.0, Z=300.0), travel_check=False)
    assert "G0 X-0.1000 Y0.2000 Z-0.3000" in result.text


LOOP = "G21 G90\nG0 X1000 Y1000 Z500\n#1=0\nWHILE [#1 LT 6] DO1\n{body}\n#1=#1+1\nEND1\nG0 Z600\nM30\n"
BODIES = {
    "increments": "G91 G1 X100. F500\nX-99.9 Y.05\nG90",
    "a formula": "G1 X[1000.+#1*0.05] Y1100 F500\nX[1000.+#1*0.05] Y1000",
    "an arc": "G91 G1 X.02 F500\nG2 X20. I10.\nG1 X-20.\nG90",
    "a radius": "G91 G1 X.02 F500\nG2 X20. R12.\nG1 X-20.\nG90",
    "an axis left out": "G1 X1000. Y[1000.+#1*0.05] Z500 F500\nX1200 Y[1000.+#1*0.05]\nX1100 Y[1000.+#1*0.05]",
    "inches": "G20 G91 G1 X4. F50\nX-3.995 Y.002\nG90 G21",
}


@pytest.mark.parametrize("name", BODIES)
def test_iterations_that_differ_by_less_than_the_tolerance(name):
    """The prediction is that of the written text: `verify`, which reads both texts, finds the same."""
    text, model = LOOP.format(body=BODIES[name]), random_model(GANTRY, 11, 60.0)
    result = correct(text, GANTRY, model)
    verdict = verify(read(text, GANTRY), read(result.text, GANTRY), model)
    assert result.report.after.largest == pytest.approx(verdict.after.largest, abs=1e-6)
    assert 0.05 < verdict.after.largest < 1.0 < verdict.before.largest
    assert result.text.count("\n") == text.count("\n") + 1 + result.report.added_blocks
    assert result.report.added_blocks == 0


def test_iterations_that_differ_by_more_are_refused():
    with pytest.raises(UserError, match="--unroll writes it out"):
        correct(LOOP.format(body="Z400\nG91 G1 X900. F500\nX-600. Y5\nG90"), GANTRY, random_model(GANTRY, 11))
    with pytest.raises(UserError, match="--unroll writes it out"):
        correct(LOOP.format(body=BODIES["increments"]), GANTRY, random_model(GANTRY, 11, 60.0), tolerance_um=0.05)


@st.composite
def drifting(draw):
    """A loop that may end a little beside where it begins."""
    first, loop = draw(loops())
    return [first, *draw(paths(1)), first, loop]


@pytest.mark.parametrize("writer", WRITERS)
@drawn(few=3, many=8, part=drifting(), seed=st.integers(0, 2**32 - 1))
def test_what_is_predicted_is_what_is_written(writer, part, seed):
    text, dialect = writer().program(part), find_dialect(writer.name, "", "")
    setup = setup_of(GANTRY, [f"{'0' if writer.name == 'heidenhain' else 'G54'}=1000,1000,500"], ["T1=80"])
    model, source, out = random_model(GANTRY, seed), source_of(text), io.BytesIO()
    try:
        report = Pipeline(Job(source, dialect, GANTRY, model, setup, travel_check=False)).run(out, lambda _: None)
    except UserError as refusal:
        assert "--unroll" in str(refusal)
        return
    sources = source, source_of(out.getvalue().decode(ENCODING))
    motions = [merged(read_motions(each, dialect, GANTRY, setup)) for each in sources]
    verdict = verify(*motions, model)
    assert report.after.largest == pytest.approx(verdict.after.largest, abs=1e-5)
    assert verdict.after.largest < 1.0
    assert np.isfinite(verdict.path_after.largest)
