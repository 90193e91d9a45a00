"""No move is predicted to be worse than in the input by more than the rounding of its words, whatever the tolerance."""

import io
import json
import math
from pathlib import Path

import pytest
from hypothesis import strategies as st
from support.programs import load, model_of, read, setup_of, source_of
from support.tiers import drawn

from kinematics.effects import Cyclic, LocationError, QuantisedCompensation
from kinematics.error_model.model import write_model
from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.source import ENCODING
from postproc.verification.verify import verify
from postproc.write.writer import Writer

GANTRY = load("gantry")
ROUNDING_UM = math.sqrt(3.0) / 2 * 0.1
RANDOM = frozenset(("stale", "future", "temperature", "outside", "insignificant"))
LONG = "G21 G17 G90\nG0 X{}.37 Y300.0 Z100.0\nG1 X{}.81 Y331.0 F500\nM30\n"
ROUND = "G21 G17 G90\nG0 X{}.37 Y300.0 Z100.0\nG3 X{}.37 Y300.0 I20.0 J0 F500\nM30\n"


def judged(text, model, tolerance_um):
    """The verdict on a corrected program of one feed move, which no `--accept worse` let pass, and its notes."""
    source, out = source_of(text), io.BytesIO()
    job = Job(source, find_dialect("iso", "", ""), GANTRY, model, setup_of(GANTRY), tolerance_um=tolerance_um,
              accepted=RANDOM)  # fmt: skip
    report = Pipeline(job).run(out, lambda _: None)
    corrected = out.getvalue().decode(ENCODING)
    return verify(read(text, GANTRY), read(corrected, GANTRY), model, tolerance_um=tolerance_um), report


@pytest.mark.parametrize("tolerance", [1.0, 5.0, 1000.0])
@drawn(
    few=5,
    many=12,
    amplitude=st.floats(0.1, 6.0),
    period=st.floats(7.0, 90.0),
    start=st.integers(100, 160),
    way=st.booleans(),
)
def test_a_wave_within_the_tolerance_does_not_double(tolerance, amplitude, period, start, way):
    """Corrected at its ends alone, a move may deviate from its path by twice its error in the input."""
    model = model_of(GANTRY, Cyclic("X", "X", period, (amplitude,), (0.0,)))
    text = LONG.format(start, start + 77) if way else ROUND.format(start, start + 40)
    verdict, _ = judged(text, model, tolerance)
    assert verdict.after.largest <= verdict.before.largest + ROUNDING_UM
    assert verdict.path_after.largest <= max(verdict.path_before.largest, amplitude) + 4 * ROUNDING_UM


@drawn(few=6, many=20, step=st.floats(0.2, 20.0), pitch=st.floats(9.0, 80.0), start=st.integers(100, 160))
def test_a_jump_is_crossed_in_its_middle(step, pitch, start):
    """Beside a jump the machine errs by half of it at least; the ramp of a line over it may leave no more."""
    model = model_of(GANTRY, QuantisedCompensation("X", step, pitch, 10.0))
    try:
        verdict, report = judged(LONG.format(start, start + 77), model, 1.0)
    except UserError as refusal:  # an end of the move lies at the jump itself
        assert "predicted to be worse" in str(refusal)
        at = [(end - 10.0) / pitch for end in (start + 0.37, start + 77.81)]
        assert min(abs(place - round(place)) * pitch for place in at) < 0.05
        return
    assert verdict.path_after.largest <= max(verdict.path_before.largest, step / 2) * 1.1 + 2 * ROUNDING_UM
    assert report.accepted == {}


def test_what_the_rounding_does_is_said_with_its_figure():
    model = model_of(GANTRY, Cyclic("X", "X", 20.0, (0.08,), (0.0,)))
    _, report = judged("G21 G17 G90\nG0 X105.0 Y300.0 Z100.0\nG1 X125.0 F500\nX145.0\nX185.0\nM30\n", model, 1.0)
    notes = [note for note in report.notes if "the rounding of their words" in note]
    assert len(notes) == 1
    assert "moves are predicted to be worse than in the input between their ends by at most 0." in notes[0]


def test_a_worse_end_within_the_tolerance_is_refused(command, monkeypatch):
    """A writer that goes astray by 0.6 um in one block, with a tolerance of 5."""
    write = Writer.write

    def astray(self, *chunk):
        written = write(self, *chunk)
        written.ends[-1, 0] += 6e-4
        return written

    monkeypatch.setattr(Writer, "write", astray)
    Path("in.nc").write_text("G21 G17 G90\nG0 X100.0 Y100.0 Z100.0\nG1 X200.0 F500\nY300.0\nM30\n")
    write_model(model_of(GANTRY, LocationError("X", "X", 0.3, u=(0.01,))), Path("cal.json"))
    options = ("-m", "gantry", "-c", "cal.json", "--datum", "G54=true", "--set-up-zero", "--tolerance-um", "5")
    refused = command("in.nc", *options, "-o", "out.nc")
    assert refused.status == 2
    assert "in.nc:4: 'Y300.0': predicted to be worse than in the input at its end: 0.6 um instead of 0.3" in refused.err
    assert not Path("out.nc").exists()
    accepted = command("in.nc", *options, "-o", "out.nc", "--accept", "worse", "--json", "-")
    assert accepted.status == 0, accepted.err
    assert "at most 0.6 um instead of 0.3 um (lines 4)" in json.loads(accepted.out)["accepted"]["worse"]


def test_a_refusal_has_the_reason_why_the_move_is_not_split():
    """A block of a loop that goes elsewhere every time stays in one piece, also over a jump."""
    model = model_of(GANTRY, QuantisedCompensation("X", 4.7, 18.0, 10.0))
    loop = "#100=0\nWHILE[#100 LT 3]DO1\nG1 X[112.3+#100*0.7] F500\nX[101.9+#100]\n#100=#100+1\nEND1\nM30\n"
    with pytest.raises(UserError, match=r"worse than in the input between its ends: .*its block runs several times"):
        judged(f"G21 G17 G90\nG0 X96.0 Y300.0 Z100.0\n{loop}", model, 5.0)
