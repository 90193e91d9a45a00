"""Constructs unknown to ncomp that the user accepts unchanged: `--pass-through`, the machine file and the job file."""

from pathlib import Path

import pytest
from support.command import refusal, succeed

import ncomp

SET_UP = ("--machine", "dmu50", "--work-offset", "G54=-30,-20,150", "--work-offset", "0=-30,-20,150")
TOOL = ("--tool-length", "T1=80")
HEADS = {
    "a.nc": "G21 G17 G90 G94 G54\nT1 M6\nG43 H1\nG0 X0 Y0 Z60 B0 C0\n",
    "a.mpf": "G17 G90 G71 G94 G54\nT1 D1 M6\nG0 X0 Y0 Z60 B0 C0\n",
    "a.h": "BEGIN PGM A MM\nTOOL CALL 1 Z S1000\nL X+0 Y+0 Z+60 B+0 C+0 R0 FMAX\n",
}
TAILS = {"a.nc": "G1 X40 Y30 Z5 F500\nM30\n", "a.mpf": "G1 X40 Y30 Z5 F500\nM30\n"}
TAILS["a.h"] = "L X+40 Y+30 Z+5 F500\nEND PGM A MM\n"
CONSTRUCTS = {
    "G5.7": ("a.nc", "G05.7 P2 E0.01"),
    "G234": ("a.nc", "G234"),
    "G4711": ("a.mpf", "G4711"),
    "CYCLE977": ("a.mpf", "CYCLE977(1,2,,3)"),
    "WRITE_LOG": ("a.mpf", "WRITE_LOG"),
    "FN33": ("a.h", "FN 33: Q1"),
    "CYCLDEF444": ("a.h", "CYCL DEF 444 LOG ~\n Q1=5 ;NUMBER"),
    "FUNCTIONDCM": ("a.h", "FUNCTION DCM OFF"),
}


def write(name, block):
    Path(name).write_text(f"{HEADS[name]}{block}\n{TAILS[name]}")


@pytest.mark.parametrize("construct", CONSTRUCTS)
def test_it_is_refused_unless_it_is_named_and_then_passes_unchanged(construct, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name, block = CONSTRUCTS[construct]
    write(name, block)
    line = (name, *SET_UP, *TOOL, "-o", "out.nc")
    message = refusal(*line)
    assert "is not known to ncomp" in message
    assert f"--pass-through {construct}" in message  # the command that the message gives is the one that works
    assert "is not known" in refusal(*line, "--pass-through", "G999,OTHER")
    assert not Path("out.nc").exists()
    done = succeed(*line, "--pass-through", f"OTHER,{construct.lower()}")
    assert "passes unchanged (--pass-through)" in done.shown
    corrected = Path("out.nc").read_text()
    assert f"\n{block}\n" in corrected
    assert TAILS[name] not in corrected  # what follows is corrected
    plain = f"{HEADS[name]}{TAILS[name]}"
    setup = ncomp.set_up("dmu50", work_offset=[SET_UP[3], SET_UP[5]], tool_length=["T1=80"])
    without = ncomp.correct(
        plain, "dmu50", setup=setup, dialect={"h": "heidenhain", "f": "siemens"}.get(name[-1], "iso")
    )
    assert corrected.splitlines()[-2] == without.text.splitlines()[-2]


def test_a_known_code_and_one_with_coordinates_do_not_pass(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    line = ("a.nc", *SET_UP, *TOOL, "-o", "out.nc", "--pass-through", "G31,G234,G90")
    write("a.nc", "G31 X5 F100")
    assert "probing move" in refusal(*line)
    write("a.nc", "G234 X5")
    assert "a.nc:5: 'G234 X5': G234 passes without coordinates only" in refusal(*line)
    write("a.nc", "G90")  # followed by ncomp: the option has no effect on it
    succeed(*line)
    write("a.mpf", "CYCLE977(1) X5")
    assert "CYCLE977 passes without coordinates only" in refusal("a.mpf", *line[1:-1], "CYCLE977")


def test_no_word_is_added_until_the_program_gives_the_position(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write("a.nc", "G234\nG1 X20 F500")
    succeed("a.nc", *SET_UP, *TOOL, "-o", "out.nc", "--pass-through", "G234")
    line = Path("out.nc").read_text().partition("\nG234\n")[2].splitlines()[0]
    assert line.startswith("G1 X")
    assert "Y" not in line
    assert "Z" not in line


def test_a_cycle_that_passes_is_not_called(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write("a.h", "CYCL DEF 200 DRILL ~\n Q200=2 ;SET-UP ~\n Q201=-5 ;DEPTH ~\n Q203=0 ;SURFACE ~\n Q204=20 ;2ND SET-UP\n"
          "CYCL DEF 444 LOG\nL X+10 Y+10 R0 FMAX M99")  # fmt: skip
    message = refusal("a.h", *SET_UP, *TOOL, "-o", "out.nc", "--pass-through", "CYCL DEF 444")
    assert "cycle 444 runs at positions that are not known" in message


def test_machine_file_and_job_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write("a.nc", "G234")
    shipped = (Path(ncomp.__file__).parent / "machines" / "dmu50.toml").read_text()
    Path("mill.toml").write_text(shipped + '\n[control]\npass_through = ["G234"]\n')
    assert "G234 passes unchanged" in succeed("check", "a.nc", "--machine", "mill.toml", *SET_UP[2:], *TOOL).shown
    Path("job.toml").write_text('machine = "dmu50"\npass_through = ["G234"]\n[programs]\n"a.nc" = "out.nc"\n')
    succeed("job.toml")
    assert "\nG234\n" in Path("out.nc").read_text()


def test_init_without_a_folder_writes_into_the_present_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write("a.nc", "G4 P1")
    succeed("init", "--machine", "dmu50", *SET_UP[2:4], *TOOL, "--program", "a.nc")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.nc", "job.toml"]
    succeed("job.toml")
