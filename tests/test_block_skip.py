"""Blocks with a slash: skipped or run as the switch is stated, in all dialects; refused where it matters and is not."""

import json

import pytest
from support.command import refusal, run_command, succeed
from support.machine_texts import machine_text
from support.programs import load, random_model

import ncomp
from kinematics.error_model.model import write_model

SETTINGS = ("--machine", "gantry", "--set-up-zero", "--no-travel-check")
NONE = (*SETTINGS, "--calibration", "none")
HEADS = {
    "iso": ("G21 G90 G17 G54 G94\nG0 X10. Y10. Z20.\nG1 Z-1. F300\n", "G0 Z20.\nM30\n"),
    "siemens": ("G71 G90 G17 G54\nT1 D1 M6\nG0 X10 Y10 Z20\nG1 Z-1 F300\n", "G0 X33 Z20\nM30\n"),
    "heidenhain": (
        "BEGIN PGM A MM\nTOOL CALL 1 Z S1000\nL X+10 Y+10 Z+20 R0 FMAX\nL Z-1 F300\n",
        "L X+33 Z+20 FMAX\nM30\nEND PGM A MM\n",
    ),
}
ASKED = {
    "iso a move": ("iso", "/ X30.\n", 30.0, 10.0),
    "iso with a level": ("iso", "/2 X30.\n", 30.0, 10.0),
    "iso behind the number": ("iso", "N5 /9 X30.\n", 30.0, 10.0),
    "iso a tool": ("iso", "/ T2\nX30.\n", 30.0, 30.0),
    "iso a variable": ("iso", "#1=30.\n/ #1=40.\nX#1\n", 40.0, 30.0),
    "iso a jump": ("iso", "X30.\n/ GOTO 9\nX40.\nN9 Y11.\n", 30.0, 40.0),
    "iso an end": ("iso", "X30.\n/ M30\nX40.\n", 30.0, 40.0),
    "siemens a move": ("siemens", "/ X30\n", 30.0, 10.0),
    "siemens with a level": ("siemens", "/3 X=30\n", 30.0, 10.0),
    "siemens before the number": ("siemens", "/7 N10 X30\n", 30.0, 10.0),
    "siemens a variable": ("siemens", "R1=30\n/R1=40\nX=R1\n", 40.0, 30.0),
    "siemens a jump": ("siemens", "X30\n/ GOTOF ENDE\nX40\nENDE: Y11\n", 30.0, 40.0),
    "siemens a frame": ("siemens", "/ TRANS X5\nX30\n", 35.0, 30.0),
    "klartext a move": ("heidenhain", "/ L X+30\n", 30.0, 10.0),
    "klartext behind the number": ("heidenhain", "7 / L X+30\n", 30.0, 10.0),
    "klartext a variable": ("heidenhain", "Q1 = 30\n/ Q1 = 40\nL X+Q1\n", 40.0, 30.0),
    "klartext a call": ("heidenhain", "LBL 1\nL IX+20\nLBL 0\n/ CALL LBL 1\n", 50.0, 30.0),
    "klartext a tool": ("heidenhain", "/ TOOL CALL 2 Z\nL X+30 Y+5 Z+3\n", 30.0, 30.0),
}  # fmt: skip
ENDINGS = {"iso": ".nc", "siemens": ".mpf", "heidenhain": ".h"}


def positions(text, dialect, switch):
    """Machine positions of X at the ends of the moves of the middle part."""
    setup = ncomp.set_up("gantry", zero=True, block_skip=switch)
    done = ncomp.correct(text, "gantry", "none", dialect=dialect, setup=setup, travel_check=False)
    moves = done.moves
    return moves.machine_target[:, moves.machine.index("X")].tolist()


@pytest.mark.parametrize("case", ASKED)
def test_blocks_run_as_the_switch_is_stated(case, tmp_path):
    dialect, block, off, on = ASKED[case]
    head, tail = HEADS[dialect]
    middle = tail.replace("X33 ", "").replace("X+33 ", "")
    text = head + block + middle
    program = tmp_path / f"a{ENDINGS[dialect]}"
    program.write_text(text)
    assert "--block-skip on" in " ".join(refusal(program, *NONE, "-o", tmp_path / "o").split())
    assert positions(text, dialect, "off")[-1] == off
    assert positions(text, dialect, "on")[-1] == on
    for switch, said in (("on", "are taken to be skipped"), ("off", "are taken to run")):
        done = succeed(program, *NONE, "--block-skip", switch, "-o", tmp_path / "o")
        assert said in done.shown


HARMLESS = {
    "iso": "/ M0\n/1 M8\n/ G4 P1.\n/ (text)\n/ G61\n",
    "siemens": '/ M0\n/ MSG("HALLO")\n/ STOPRE\n/ G4 F2\n/3 M1\n/ SETMS(2)\n',
    "heidenhain": "/ STOP\n/ M0\n/ STOP M5\n/ ; text\n/ M8\n/ L M3\n/ FN 16: F-PRINT A.A / B.B\n/ CYCL DEF 9.0 DWELL TIME\n"
    "/ CYCL DEF 9.1 DWELL 0.5\n/ CYCL DEF 32.0 TOLERANCE\n/ TOOL DEF 5\n",
}


@pytest.mark.parametrize("dialect", HARMLESS)
def test_blocks_that_change_nothing_need_no_answer(dialect, tmp_path):
    program = tmp_path / f"a{ENDINGS[dialect]}"
    program.write_text(HARMLESS[dialect].join(HEADS[dialect]))
    for switch in ((), ("--block-skip", "on"), ("--block-skip", "off")):
        done = succeed(program, *NONE, *switch, "-o", tmp_path / "o")
        assert ("block skip" in done.shown) == bool(switch)


def test_skipped_blocks_stay_and_others_are_corrected(tmp_path):
    program = tmp_path / "a.nc"
    program.write_text(HEADS["iso"][0] + "/ X30.\n" + HEADS["iso"][1])
    lines = {}
    machine = load("gantry")
    write_model(random_model(machine, 3), tmp_path / "cal.json")
    options = ("--calibration", tmp_path / "cal.json", "--accept", "outside")
    for switch in ("on", "off"):
        succeed(program, *SETTINGS, *options, "--block-skip", switch, "-o", tmp_path / "o.nc")
        lines[switch] = [line for line in (tmp_path / "o.nc").read_text().splitlines() if line.startswith("/")]
    assert lines["on"] == ["/ X30."]
    assert lines["off"] != ["/ X30."]


@pytest.mark.parametrize("block", ["X1. / Y1.\n", "/ LBL 1\nL X+1\nLBL 0\n"])
def test_what_controls_skip_differently_is_refused(block, tmp_path):
    dialect = "heidenhain" if "LBL" in block else "iso"
    program = tmp_path / f"a{ENDINGS[dialect]}"
    program.write_text(block.join(HEADS[dialect]))
    said = refusal(program, *NONE, "--block-skip", "on", "-o", tmp_path / "o")
    assert "what the control skips here depends on it" in said


MACHINE = machine_text(more='[control]\nblock_skip = "on"\n')


def test_machine_file_and_job_file_state_the_switch(tmp_path):
    (tmp_path / "mill.toml").write_text(MACHINE)
    (tmp_path / "a.nc").write_text("/ X30.\n".join(HEADS["iso"]))
    options = ("--machine", tmp_path / "mill.toml", "--calibration", "none", "--set-up-zero")
    assert "skipped (block skip on)" in succeed(tmp_path / "a.nc", *options, "-o", tmp_path / "o.nc").shown
    assert (
        "run (block skip off)"
        in succeed(tmp_path / "a.nc", *options, "--block-skip", "off", "-o", tmp_path / "o.nc").shown
    )
    job = 'machine = "mill.toml"\ncalibration = "none"\nset_up_zero = true\nblock_skip = "off"\n[programs]\n"a.nc" = "b.nc"\n'
    (tmp_path / "job.toml").write_text(job)
    assert "run (block skip off)" in succeed(tmp_path / "job.toml").shown


def test_other_commands_have_the_option(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.nc").write_text("/ X30.\n".join(HEADS["iso"]))
    program = tmp_path / "in" / "a.nc"
    assert run_command("check", program, *NONE[:4]).status == 2
    assert run_command("check", program, *NONE[:4], "--block-skip", "off").status == 0
    write_model(random_model(load("gantry"), 3), tmp_path / "cal.json")
    verify = ("verify", program, program, *SETTINGS[:3], "--calibration", tmp_path / "cal.json")
    assert "--block-skip" in refusal(*verify)
    succeed(*verify, "--block-skip", "off")
    succeed("batch", tmp_path / "in", tmp_path / "out", *NONE, "--block-skip", "on", "--json", tmp_path / "r.json")
    assert json.loads((tmp_path / "r.json").read_text())
