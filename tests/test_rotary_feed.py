"""Feed moves of rotary axes alone: left, or corrected such that they take the programmed time on the control."""

import itertools
import json
import math
import re
from pathlib import Path

import pytest

import machines

CALIBRATION = machines.FOLDER / "calibrations" / "dmu50.json"
HEAD = "G21 G90 G17 G94\nT1 M6\nG54\nG43.4 H1\nG0 X10. Y20. Z30. B0. C0.\n"
ISO = HEAD + "G1 X12. F500\nG1 C150.\nG1 X14.\nM30\n"
SIEMENS = "G17 G90 G710 G94 G54\nT1 M6 D1\nTRAORI\nG0 X10 Y20 Z30 B0 C0\nG1 X12 F500\nC150\nX14\nM30\n"
MINUTES = 150.0 / 500.0
OPTIONS = ("-c", CALIBRATION, "--work-offset", "G54=3,-7,160", "--tool-length", "T1=80", "--datum", "G54=true")


@pytest.fixture
def corrected(command):
    """The lines of a corrected program between X12 and X14, and the errors by its run and by `verify`."""

    def run(text: str, *options: str, name: str = "part.nc", family: str = "any") -> tuple[list[str], dict, dict]:
        machine = (machines.FOLDER / "dmu50.toml").read_text()
        Path("m.toml").write_text(machine.replace("[axes.C]", f'[control]\nfamily = "{family}"\n\n[axes.C]', 1))
        Path(name).write_text(text)
        done = command(name, "-m", "m.toml", *OPTIONS, *options, "-o", f"out{name}", "--json", "done.json")
        assert done.status == 0, done.err
        checked = command("verify", name, f"out{name}", "-m", "m.toml", *OPTIONS, "--json", "verified.json")
        assert checked.status == 0, checked.err
        lines = Path(f"out{name}").read_text().splitlines()
        first = next(i for i, line in enumerate(lines) if line.startswith("G1 X1"))
        last = max(i for i, line in enumerate(lines) if re.search(r"X1[34]\.", line) and "NCOMP" not in line)
        return lines[first + 1 : last], *(json.loads(Path(each).read_text()) for each in ("done.json", "verified.json"))

    return run


def positions(lines: list[str]) -> list[dict[str, float]]:
    """The axis words and F of each line that has some."""
    found = [{m[1]: float(m[2]) for m in re.finditer(r"([XYZCF])([-\d.]+)", line.partition("(")[0].partition(";")[0])} for line in lines]  # fmt: skip
    return [words for words in found if "C" in words]


def test_it_is_left_by_default_and_a_note_names_the_option(corrected):
    lines, done, _ = corrected(ISO)
    assert lines == ["G1 C150."]
    assert any("--rotary-feed inverse-time corrects it" in note for note in done["notes"])
    assert done["predicted_error_um"]["anywhere"]["after"] > 5.0


@pytest.mark.parametrize(("name", "text"), [("part.nc", ISO), ("part.mpf", SIEMENS)])
def test_inverse_time_keeps_the_time(corrected, name, text):
    lines, done, verified = corrected(text, "--rotary-feed", "inverse-time", name=name)
    assert lines[0].startswith("G93 ")
    assert lines[-1].startswith("G94 F500 ")
    assert sum(1.0 / words["F"] for words in positions(lines)) == pytest.approx(MINUTES, rel=1e-5)
    assert done["predicted_error_um"]["anywhere"]["after"] < 1.1
    assert verified["anywhere_um"]["after"] == pytest.approx(done["predicted_error_um"]["anywhere"]["after"], abs=0.05)


def test_a_program_that_begins_with_it_is_left_there_with_the_reason(command):
    """The program has not placed X, Y and Z, which would have to move with C."""
    Path("part.nc").write_text("G21 G90 G17 G94\nT1 M6\nG54\nG1 C150. F500\nG1 X14. Y2. Z30.\nG1 C20.\nM30\n")
    options = ("-m", "dmu50", *OPTIONS, "--rotary-feed", "inverse-time", "-o", "out.nc", "--json", "done.json")
    done = command("part.nc", *options)
    assert done.status == 0, done.err
    lines = Path("out.nc").read_text().splitlines()
    assert lines[4] == "G1 C150. F500"
    assert re.match(r"G1 X1\d\.\d+ Y\d\.\d+ Z[23]\d\.\d+$", lines[5])
    assert lines[6].startswith("G93 ")
    assert sum(1.0 / words["F"] for words in positions(lines[6:])) == pytest.approx(130.0 / 500.0, rel=1e-5)
    notes = json.loads(Path("done.json").read_text())["notes"]
    assert any("has not given X Y Z in this frame (line 4)" in note for note in notes)


def test_f_stands_behind_the_brackets_of_a_word(corrected):
    text = SIEMENS.replace("\nC150\n", "\nC=DC(150)\n")
    lines, _, _ = corrected(text, "--rotary-feed", "inverse-time", name="part.mpf")
    moves = [line for line in lines if "C=" in line]
    assert len(moves) > 1
    assert all(re.search(r"C=DC\([\d.]+\).* F[\d.]+", line) for line in moves), moves


def test_a_scaled_feed_keeps_the_time_where_f_counts_the_linear_axes(corrected):
    lines, done, _ = corrected(ISO, "--rotary-feed", "scaled", family="linuxcnc")
    assert lines[-1].startswith("F500 ")
    assert not any("G93" in line for line in lines)
    angles, lengths = 0.0, 0.0
    for before, words in itertools.pairwise(positions(lines)):  # of each segment but the first, whose start is not here
        moved = math.dist(*([at[axis] for axis in "XYZ"] for at in (before, words)))
        assert moved / words["F"] == pytest.approx((words["C"] - before["C"]) / 500.0, rel=1e-4)
        angles, lengths = angles + words["C"] - before["C"], lengths + moved
    assert angles > 100.0
    assert lengths > 0.0
    assert done["predicted_error_um"]["anywhere"]["after"] < 1.1


def test_where_f_counts_all_axes_it_stays(corrected):
    text = ISO.replace("G43.4 H1", "G43 H1")
    lines, _, _ = corrected(text, "--rotary-feed", "scaled", family="fanuc")
    assert all("F" not in line.partition("(")[0] for line in lines)
    assert any(re.search(r"[XYZ]", line) for line in lines)


def test_an_unknown_control_is_asked_for(command):
    Path("part.nc").write_text(ISO)
    done = command("part.nc", "-m", "dmu50", *OPTIONS, "--rotary-feed", "scaled", "-o", "out.nc")
    assert done.status == 2
    assert 'write family = "linuxcnc" or "fanuc" under [control]' in done.err
    assert not Path("out.nc").exists()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (ISO.replace("F500", "F#1").replace("G21", "#1=500\nG21"), "F is no speed in force"),
        (ISO.replace("G94\n", "G95\n"), "F is no speed in force"),
        (ISO.replace("G1 C150.", "G94 G1 C150. F500"), "changes the feed mode"),
        (HEAD + "G1 X12. F500\nM98 P7\nG1 X14.\nM30\nO7\nC150.\nM99\n", "loops or calls"),
    ],
)
def test_what_is_not_known_is_left_with_the_reason(corrected, text, reason):
    _, done, _ = corrected(text, "--rotary-feed", "inverse-time")
    assert any("is left without a correction" in note and reason in note for note in done["notes"]), done["notes"]


def test_the_machine_file_and_the_job_file_choose_it(command):
    machine = (machines.FOLDER / "dmu50.toml").read_text()
    Path("m.toml").write_text(machine.replace("[axes.C]", '[control]\nrotary_feed = "inverse-time"\n\n[axes.C]', 1))
    Path("part.nc").write_text(ISO)
    for number, options in enumerate(((), ("--rotary-feed", "leave"))):
        done = command("part.nc", "-m", "m.toml", *OPTIONS, *options, "-o", "out.nc")
        assert done.status == 0, done.err
        assert ("G93" in Path("out.nc").read_text()) is (number == 0)


@pytest.mark.parametrize("how", ["inverse-time", "scaled"])
def test_linuxcnc_runs_it(corrected, linuxcnc, how):
    """The words, F and the line behind the move are understood: all moves are those of the program."""
    text = ISO.replace("G43.4 H1", "G43 H1").replace("T1 M6\n", "").replace("G43 H1\n", "")
    corrected(text, "--rotary-feed", how, family="linuxcnc")
    before, after = (linuxcnc.run(Path(name).read_text()) for name in ("part.nc", "outpart.nc"))
    assert (before.exit_status, after.exit_status) == (0, 0), after.message
    assert after.moves[-1].feed == before.moves[-1].feed == 500.0


def test_klartext_is_not_told_to_use_it(command):
    Path("part.h").write_text(
        "BEGIN PGM A MM\nCYCL DEF 247 DATUM Q339=+1\nTOOL CALL 1 Z S1\nL X+10 Y+20 Z+30 B+0 C+0 R0 FMAX\nL C+150 F500\nL X+14\n"
        "M30\nEND PGM A MM\n"
    )
    options = (*OPTIONS[:2], "--work-offset", "1=3,-7,160", "--tool-length", "T1=80", "--datum", "1=true")
    done = command("part.h", "-m", "dmu50", *options, "--json", "done.json", "-o", "out.h")
    assert done.status == 0, done.err
    notes = [note for note in json.loads(Path("done.json").read_text())["notes"] if "--rotary-feed" in note]
    assert notes
    assert all("except in Klartext" in note for note in notes)
