"""The mark of a corrected program: its fingerprints, and `verify` finds another calibration or set-up."""

import itertools
import json
import re
from pathlib import Path

import pytest
from support.programs import load, model_of

import ncomp
from kinematics.effects import LocationError
from kinematics.error_model.model import write_model
from postproc.correct.mark import Mark, mark_in

PROGRAM = "G21 G17 G90\nT1 M6\nG43 H1\nG54 G0 X100.0 Y100.0 Z100.0\nG1 X200.0 F500\nM30\n"
GIVEN = {"--work-offset": "G54=10,20,300", "--tool-length": "T1=80", "--datum": "G54=probed"}
OLD = "(NCOMP 0.1.0 MACHINE GANTRY CALIBRATION ABC123 PROGRAM 0123456789AB)"


def options(**changed: str) -> list[str]:
    given = GIVEN | {f"--{name.replace('_', '-')}": value for name, value in changed.items()}
    return list(itertools.chain.from_iterable(given.items()))


@pytest.fixture
def corrected(command, tmp_path):
    """`in.nc` and its correction `out.nc`, and the command that verifies it."""
    (tmp_path / "in.nc").write_text(PROGRAM)
    for name, um in (("cal", 30.0), ("other", 31.0)):
        model = model_of(load("gantry"), LocationError("X", "X", um, u=(0.1,)), LocationError("C", "Y", 5.0, u=(0.1,)))
        write_model(model, tmp_path / f"{name}.json")
    done = command("in.nc", "-m", "gantry", "-c", "cal.json", "-o", "out.nc", *options())
    assert done.status == 0, done.err

    def verify(*more: str, calibration: str = "cal.json", **changed: str):
        return command("verify", "in.nc", "out.nc", "-m", "gantry", "-c", calibration, *options(**changed), *more)

    return verify


def test_the_mark_is_short_and_plain(corrected):
    (line,) = (line for line in Path("out.nc").read_text().splitlines() if mark_in(line))
    pattern = r"\(NCOMP \S+ MACHINE GANTRY CALIBRATION [0-9A-F]{12} PROGRAM [0-9A-F]{12} SETUP [0-9A-F]{8} DATUM [0-9A-F]{8} TEXT [0-9A-F]{8}\)"
    assert re.fullmatch(pattern, line)
    assert len(line) < 130
    assert corrected().status == 0


def test_marks_of_older_versions_are_known(command):
    assert mark_in(OLD) == Mark("ABC123")
    Path("in.nc").write_text(f"{OLD}\n{PROGRAM}")
    done = command("in.nc", "-m", "gantry", "-c", "none", "-o", "out.nc")
    assert done.status == 0


@pytest.mark.parametrize(
    ("changed", "parts"),
    [
        ({"calibration": "other.json"}, "calibration"),
        ({"calibration": "none"}, "calibration"),
        ({"work_offset": "G54=10,20,300.001"}, "set-up"),
        ({"tool_length": "T1=80.5"}, "set-up"),
        ({"datum": "G54=true"}, "datum"),
        ({"datum": "G54=probed@X50"}, "datum"),
        ({"datum": "G54=probed@probe=50"}, "datum"),
        ({"datum": "G54=true", "tool_length": "T1=79"}, "set-up,datum"),
    ],
)
def test_verify_finds_what_differs(corrected, changed, parts):
    refused = corrected(**changed)
    assert refused.status == 2
    assert refused.out == b""
    for part in parts.split(","):
        assert f"out.nc was corrected with another {part}: its mark has" in refused.err
    assert f"--accept {parts} continues nevertheless" in refused.err
    accepted = corrected("--accept", parts, **changed)
    assert accepted.status == 0, accepted.err
    assert "was corrected with another" in accepted.err
    assert b"block ends" in accepted.out


def test_what_the_program_does_not_use_makes_no_difference(corrected):
    assert corrected("--work-offset", "G55=1,2,3", "--tool-length", "T7=50").status == 0


def test_an_earlier_calibration_is_no_other_one(corrected):
    assert corrected("--old", "cal.json", calibration="other.json").status == 0
    assert corrected("--old", "none", calibration="other.json").status == 2


def test_without_a_mark_verify_says_so(corrected):
    lines = Path("out.nc").read_text().splitlines(keepends=True)
    Path("out.nc").write_text("".join(line for line in lines if mark_in(line) is None))
    done = corrected(work_offset="G54=1,2,3")
    assert done.status == 0
    assert "has no mark" in done.err


def test_the_names_are_listed(corrected):
    done = corrected("--accept", "all")
    assert done.status == 2
    assert "calibration, set-up, datum" in done.err


def test_what_was_accepted_is_in_the_mark(command):
    model = model_of(load("gantry"), LocationError("X", "X", 10.0, u=(6.0,)))
    write_model(model, Path("cal.json"))
    Path("in.nc").write_text(PROGRAM)
    accept = ("--accept", "stale,insignificant")
    done = command("in.nc", "-m", "gantry", "-c", "cal.json", "-o", "out.nc", *options(datum="G54=true"), *accept)
    assert done.status == 0, done.err
    (line,) = (line for line in Path("out.nc").read_text().splitlines() if mark_in(line))
    assert line.endswith(" ACCEPTED INSIGNIFICANT)")
    again = command("out.nc", "-m", "gantry", "-c", "cal.json", "-o", "twice.nc", *options())
    assert again.status == 2
    assert "already corrected by ncomp" in again.err


@pytest.mark.parametrize(("name", "text"), [("in.mpf", "N10 G90 G54\nN20 G0 X100 Y100 Z100\nN30 M30\n"), ("in.h", "BEGIN PGM A MM\nTOOL CALL 1 Z\nL X+100 Y+100 Z+100 R0 FMAX\nEND PGM A MM\n")])  # fmt: skip
def test_other_dialects(command, name, text):
    write_model(model_of(load("gantry"), LocationError("X", "X", 30.0, u=(0.1,))), Path("cal.json"))
    Path(name).write_text(text)
    offset = "G54" if name.endswith("mpf") else "0"
    setup = ("--tool-length", "T1=80", "--work-offset")
    common = ("-m", "gantry", "-c", "cal.json", "--datum", f"{offset}=true")
    assert command(name, *common, *setup, f"{offset}=1,2,3", "-o", "out.nc").status == 0
    assert command("verify", name, "out.nc", *common, *setup, f"{offset}=1,2,3").status == 0
    refused = command("verify", name, "out.nc", *common, *setup, f"{offset}=1,2,4")
    assert refused.status == 2
    assert "another set-up" in refused.err
    assert stated(command, "out.nc")["edited"] is False
    edited = re.sub(r"(?<=X)[+]?\d", "-1", Path("out.nc").read_text())
    Path("out.nc").write_text(edited)
    assert stated(command, "out.nc")["edited"] is True


def stated(command, name: str) -> dict:
    """What `ncomp verify NAME` says."""
    done = command("verify", name, "--json", "-")
    assert done.status == 0, done.err
    return json.loads(done.out)


@pytest.mark.usefixtures("corrected")
def test_a_program_alone_says_by_what_it_was_corrected(command):
    found = stated(command, "out.nc")
    original = json.loads(
        command("in.nc", "-m", "gantry", "-c", "cal.json", "-o", "2.nc", *options(), "--json", "-").out
    )
    assert found["machine"] == "GANTRY"
    assert found["calibration"] == ncomp.load_calibration("gantry", "cal.json").id.upper()
    assert found["program"] == original["provenance"]["inputs"]["in.nc"].upper()
    assert found["edited"] is False
    shown = command("verify", "out.nc").out.decode()
    assert "for the machine GANTRY with the calibration" in shown
    assert "It was not edited since" in shown


EDITS = {
    "a sign": ("X200", "X-200"),
    "a word": (" F500", " F400"),
    "a comment": ("M30", "M30 (x)"),
    "a blank": ("G1 X", "G1  X"),
    "another line": ("M30\n", "G0 Z400\nM30\n"),
    "no last line end": ("M30\n", "M30"),
}


@pytest.mark.parametrize("edit", EDITS)
@pytest.mark.usefixtures("corrected")
def test_an_edit_is_seen(command, edit):
    text = Path("out.nc").read_text()
    old, new = EDITS[edit]
    Path("out.nc").write_text(re.sub(r"X(?=2\d\d)", "X-", text) if edit == "a sign" else text.replace(old, new))
    assert Path("out.nc").read_text() != text
    assert stated(command, "out.nc")["edited"] is True
    assert "It was EDITED since" in command("verify", "out.nc").out.decode()


@pytest.mark.usefixtures("corrected")
def test_other_ends_of_lines_are_no_edit(command):
    Path("out.nc").write_bytes(Path("out.nc").read_bytes().replace(b"\n", b"\r\n"))
    assert stated(command, "out.nc")["edited"] is False


@pytest.mark.parametrize(
    "options_given", [("-m", "gantry"), ("--tolerance-um", "2"), ("--datum", "G54=true"), ("--classes",)]
)
@pytest.mark.usefixtures("corrected")
def test_options_of_a_comparison_need_two_programs(command, options_given):
    done = command("verify", "out.nc", *options_given)
    assert done.status == 2
    assert "give the original as well" in done.err


@pytest.mark.usefixtures("corrected")
def test_a_program_without_a_mark_or_with_an_old_one(command):
    done = command("verify", "in.nc")
    assert done.status == 2
    assert "has no mark of ncomp" in done.err
    Path("old.nc").write_text(f"{OLD}\n{PROGRAM}")
    assert stated(command, "old.nc")["edited"] is None
    assert command("verify", "in.nc", "out.nc").status == 2  # no machine


@pytest.mark.usefixtures("corrected")
def test_a_program_that_was_corrected_twice_states_the_last_correction(command):
    assert command("out.nc", "-m", "gantry", "-c", "other.json", "-o", "twice.nc", *options(), "--force").status == 0
    found = stated(command, "twice.nc")
    assert found["calibration"] == ncomp.load_calibration("gantry", "other.json").id.upper()
    assert found["edited"] is False
    assert command("verify", "out.nc", "twice.nc", "-m", "gantry", "-c", "other.json", *options()).status == 0
