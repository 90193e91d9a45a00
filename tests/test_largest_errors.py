"""The largest error that a result leads with is that of all moves, at their ends and between them."""

import json
import re
from pathlib import Path

import pytest
from support.programs import load, model_of

from kinematics.basis import Polynomial
from kinematics.effects import Cyclic, ErrorMotion
from kinematics.error_model.model import write_model

GANTRY = load("gantry")
OPTIONS = ("--machine", "gantry", "-c", "cal.json", "--set-up-zero", "--datum", "G54=true", "--datum", "G55=true")
NEW_FRAME = "G21 G90 G17 G54\nG0 X100. Y100. Z100.\nG1 X110. F500\nG55\nG1 X300.\nM30\n"
"""Behind G55 the program has given X alone: the error of Y there, 100 um per metre of X, is not corrected."""
ONE_PIECE = "G21 G90 G17 G54\nG0 X100. Y100. Z100.\n#1=0\nWHILE[#1 LT 2]DO1\nG1 X[110.+#1*0.37] F500\nX100.\n#1=#1+1\nEND1\nM30\n"
"""A block of a loop that goes elsewhere every time is not split: between its ends a wave remains."""


@pytest.fixture
def largest(command):
    """The figures of a correction and of its verification: results of both, and their first lines."""

    def run(text: str, *effects: object) -> tuple[dict, str, dict, str]:
        Path("in.nc").write_text(text)
        write_model(model_of(GANTRY, *effects), Path("cal.json"))
        shown = command("in.nc", *OPTIONS, "-o", "out.nc", "--json", "done.json")
        assert shown.status == 0, shown.err
        verified = command("verify", "in.nc", "out.nc", *OPTIONS, "--json", "verified.json")
        assert verified.status == 0, verified.err
        return (
            json.loads(Path("done.json").read_text())["predicted_error_um"],
            shown.shown,
            json.loads(Path("verified.json").read_text()),
            verified.shown,
        )

    return run


def tilted() -> ErrorMotion:
    """Y deviates by 100 um per metre of X."""
    return ErrorMotion("Y", "X", Polynomial((0.0, 1000.0), 1), (0.0, 100.0))


def test_a_move_with_an_axis_that_is_not_corrected_counts(largest):
    errors, shown, verified, verdict = largest(NEW_FRAME, tilted())
    assert errors["after"]["max"] < 0.1
    assert errors["anywhere"]["before"] == pytest.approx(30.0, abs=0.1)
    assert errors["anywhere"]["after"] == pytest.approx(30.0 - 11.0, abs=0.1)  # Y keeps its correction at X110
    assert re.search(
        rf"at most [\d.]+ -> {errors['anywhere']['after']:.2f} um \(where an axis is not corrected\)", shown
    )
    assert verified["anywhere_um"]["after"] == pytest.approx(errors["anywhere"]["after"], abs=0.01)
    assert "(where an axis is not corrected)" in verdict


def test_a_move_with_an_axis_that_is_not_corrected_counts_where_its_error_is_largest(largest):
    """A wave with four periods along the move: at its quarters the error is the same."""
    wave = Cyclic("Y", "X", 120.0, (0.0,), (20.0,))
    errors, _, verified, _ = largest(NEW_FRAME.replace("X300", "X590"), wave)
    assert verified["anywhere_um"]["after"] > 20.0
    assert errors["anywhere"]["after"] == pytest.approx(verified["anywhere_um"]["after"], abs=0.05)


def test_a_move_from_the_place_of_another_frame_counts(largest):
    errors, _, verified, _ = largest(
        NEW_FRAME.replace("X300.", "X320. Y100. Z100."), Cyclic("Y", "X", 100.0, (5.0,), (0.0,))
    )
    assert verified["anywhere_um"]["after"] > 4.0
    assert errors["anywhere"]["after"] == pytest.approx(verified["anywhere_um"]["after"], abs=0.05)


def test_an_error_between_the_ends_counts(largest):
    errors, shown, verified, _ = largest(ONE_PIECE, Cyclic("X", "X", 20.0, (3.0,), (0.0,)))
    between = errors["between_block_ends_after"]["max"]
    assert between > 2.0 > errors["after"]["max"]
    assert errors["anywhere"]["after"] == between
    assert f" -> {between:.2f} um (between block ends)" in shown
    assert verified["anywhere_um"]["after"] == pytest.approx(between, abs=0.6)


def test_a_wave_of_whole_periods_along_a_move_that_is_not_split_is_seen(command):
    """Eight periods of a screw: at its quarters and eighths the error is that of the ends."""
    Path("in.nc").write_text(ONE_PIECE.replace("X[110.+#1*0.37]", "X[580.+#1*0.01]"))
    write_model(model_of(GANTRY, Cyclic("X", "X", 60.0, (0.0,), (5.0,))), Path("cal.json"))
    refused = command("in.nc", *OPTIONS, "-o", "out.nc")
    assert refused.status == 2
    assert "its block runs several times" in refused.err
    done = command("in.nc", *OPTIONS, "--accept", "worse", "-o", "out.nc", "--json", "done.json")
    assert done.status == 0, done.err
    found = json.loads(Path("done.json").read_text())["predicted_error_um"]["anywhere"]
    assert (found["before"], found["after"]) == pytest.approx((5.0, 7.5), abs=0.1)
    assert command("verify", "in.nc", "out.nc", *OPTIONS, "--json", "verified.json").status == 0
    found = json.loads(Path("verified.json").read_text())["anywhere_um"]
    assert (found["before"], found["after"]) == pytest.approx((5.0, 7.5), abs=0.1)


def test_a_folder_shows_the_same_figures(command):
    Path("posted").mkdir()
    Path("posted/in.nc").write_text(NEW_FRAME)
    write_model(model_of(GANTRY, tilted()), Path("cal.json"))
    done = command("batch", "posted", "corrected", *OPTIONS, "--jobs", "1", "--report", "page.html", "--json", "-")
    assert done.status == 0, done.err
    page = Path("page.html").read_text()
    assert "30.00" in page
    assert "19.00" in page


def test_a_correction_without_any_evaluated_move_has_no_headline(largest):
    *_, shown, _, verdict = largest("G21 G90 G54\nG0 X100.\nM30\n", tilted())
    assert "No error is evaluated" in shown
    assert "No error is evaluated" in verdict
