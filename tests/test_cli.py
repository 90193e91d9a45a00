"""The command line: what goes wrong ends with one line and no file, what goes right with status 0."""

import ast
import hashlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from support.file_examples import PROGRAM
from support.programs import load, model_of, shifted

from kinematics.effects import Backlash, DriftWithSensor
from kinematics.error_model.model import encode_model, write_model
from kinematics.version import VERSION
from postproc import cli

OLD = b"what was there before"


TRUE = ("--datum", "G54=true")
"""A touched-off work offset holds the error of a constant model already."""
GANTRY = ("--machine", "gantry", "--calibration", "cal.json", *TRUE, "--set-up-zero")


def corrected(stdin=PROGRAM):
    return re.sub(r"X(\d+)\.0\b", lambda m: f"X{m[1]}.0100", stdin)


def split_mark(text):
    mark = re.search(r"\(NCOMP .*\)\n", text)
    assert mark
    return text.replace(mark[0], "")


# ---- what goes wrong

TOML = Path(cli.__file__).parents[1] / "machines" / "gantry.toml"
BAD_FILES = {
    "missing.nc": None,
    "empty.nc": b"",
    "blank.nc": b" \r\n\0\n",
    "binary.nc": b"\x7fELF\x01\x02\x00\x03\xff" * 50,
    "image.nc": b"\x89PNG\r\n\x1a\n" + bytes(range(256)),
    "nul.nc": b"G0 X1\0\0G0 X2\n",
    "utf16.nc": "G0 X1 Y1\n".encode("utf-16"),
    "utf16be.nc": b"\xfe\xff" + "G0 X1 Y1\n".encode("utf-16-be"),
    "utf16bare.nc": "G0 X1 Y1\n".encode("utf-16-le"),
    "folder.nc": Path,
    "siemens.mpf": b"N10 G0 X1 Y1\nCYCLE97(1)\n",
    "siemens.nc": b"TRANS X1\nN10 G0 X=R10 Y1\n",
    "refused.nc": b"G0 X1 Y1 Z1\nG31 X5\n",
    "outside.nc": b"G0 X5000.5 Y1 Z1\n",
    "outside_after.nc": b"G0 X5000 Y1 Z1\n",
    "marked.nc": b"(NCOMP 0.1.0 MACHINE GANTRY CALIBRATION ABC123 PROGRAM 123)\nG0 X1 Y1 Z1\n",
    "nested.nc": b"G0 X1 (a (b))\n",
}  # fmt: skip
BAD_FILE_WORDS = {
    "missing.nc": "No such file",
    "empty.nc": "is empty",
    "blank.nc": "is empty",
    "binary.nc": "this is a program of a computer",
    "image.nc": "this is a picture, no NC program",
    "nul.nc": "is a binary file",
    "utf16.nc": "UTF-16",
    "utf16be.nc": "UTF-16",
    "utf16bare.nc": "binary file",
    "folder.nc": "Is a directory",
    "siemens.mpf": "siemens.mpf:2: 'CYCLE97.1.': CYCLE97 is not known",
    "siemens.nc": "siemens.nc:2: 'N10 G0 X=R10 Y1': X=R10: R10 is not set by the program",
    "refused.nc": "refused.nc:2: 'G31 X5': G31 is a probing move",
    "outside.nc": "outside.nc:1: 'G0 X5000.5 Y1 Z1': X would go to 5000.5000 mm as programmed",
    "outside_after.nc": "outside_after.nc:1: 'G0 X5000 Y1 Z1': X would go to 5000.0100 mm after correction",
    "marked.nc": "marked.nc:1: .*already corrected by ncomp .calibration ABC123.; --force",
    "nested.nc": "nested.nc:1: .*controls differ in parentheses that do not match",
}
BAD_OPTIONS = {
    "unknown machine": (["in.nc", "--machine", "nomill"], "unknown machine 'nomill': shipped are .*dmu50"),
    "missing machine file": (["in.nc", "--machine", "my.toml"], "machine file my.toml: No such file"),
    "bad machine file": (["in.nc", "--machine", "bad.toml"], "machine file bad.toml"),
    "machine without calibration": (["in.nc", "--machine", "gantry"], "gantry has no calibration of its own: .*'ncomp fit'"),
    "calibration of another machine": (["in.nc", "--machine", "cframe", "-c", "cal.json"], "is of machine gantry .*not of cframe"),
    "missing calibration": (["in.nc", "--machine", "gantry", "-c", "no.json"], "calibration no.json: No such file"),
    "cut calibration": (["in.nc", "--machine", "gantry", "-c", "cut.json"], "calibration cut.json"),
    "calibration that is none": (["in.nc", "--machine", "gantry", "-c", "other.json"], "other.json: no ncomp calibration"),
    "binary calibration": (["in.nc", "--machine", "gantry", "-c", "binary.json"], "calibration binary.json"),
    "later calibration": (["in.nc", "--machine", "gantry", "-c", "later.json"], "later.json: version 2"),
    "calibration off by mm": (["in.nc", "--machine", "gantry", "-c", "huge.json", *TRUE], "check calibration, machine and set-up"),
    "unknown dialect": (["in.nc", *GANTRY, "--dialect", "pascal"], "--dialect .pascal. is none of auto, iso"),
    "work offset of too few values": (["in.nc", *GANTRY, "--work-offset", "G54=1"], "G54=1: expected G54=x,y,z, got 1 of 3"),
    "time before zero": (["in.nc", *GANTRY, "--elapsed", "-5"], "--elapsed -5: expected a time in s"),
    "bad work offset": (["in.nc", *GANTRY, "--work-offset", "G54=1,x"], "--work-offset G54=1,x: 'x' is no number"),
    "work offset that is no number": (["in.nc", *GANTRY, "--work-offset", "G54=nan,0,0"], "'nan' is no number"),
    "work offset of no axis": (["in.nc", *GANTRY, "--work-offset", "G54=1,2,3,C=4"], "machine gantry has no axis C"),
    "bad tool length": (["in.nc", *GANTRY, "--tool-length", "long"], "--tool-length long: expected T1=mm"),
    "missing tool table": (["in.nc", *GANTRY, "--tool-table", "no.tbl"], "tool table no.tbl: No such file"),
    "bad tool table": (["in.nc", *GANTRY, "--tool-table", "in.nc"], "tool table in.nc:3: 'G21 G17 G90': G17 may not be in a list of offsets"),
    "json and program on one stream": (["in.nc", *GANTRY, "--json", "-", "-o", "-"], "cannot both go to standard output"),
    "json and program in one file": (["in.nc", *GANTRY, "--json", "./out.nc", "-o", "out.nc"], "--output and --json both name ./out.nc"),
    "missing output folder": (["in.nc", *GANTRY, "-o", "no/out.nc"], "cannot write no/out.nc: No such file"),
    "output folder that is a file": (["in.nc", *GANTRY, "-o", "in.nc/out.nc"], "cannot write in.nc/out.nc: Not a directory"),
    "output that is a folder": (["in.nc", *GANTRY, "-o", "folder.nc"], "cannot write folder.nc: Is a directory"),
    "missing json folder": (["in.nc", *GANTRY, "-o", "out.nc", "--json", "no/x.json"], "cannot write no/x.json: No such file"),
}  # fmt: skip


def fill(folder):
    for name, data in BAD_FILES.items():
        if data is Path:
            (folder / name).mkdir()
        elif data is not None:
            (folder / name).write_bytes(data)
    calibration = (folder / "cal.json").read_bytes()
    (folder / "cut.json").write_bytes(calibration[:-40])
    (folder / "other.json").write_bytes(b'{"a": 1}')
    (folder / "binary.json").write_bytes(bytes(range(256)))
    (folder / "later.json").write_bytes(calibration.replace(b'"ncomp_calibration": 1', b'"ncomp_calibration": 2'))
    (folder / "huge.json").write_bytes(encode_model(shifted(load("gantry"), X=5001.0)))
    (folder / "bad.toml").write_text(TOML.read_text().replace("travel", "travvel", 1))


def check_refusal(result, pattern, folder, before):
    assert result.status == 2
    assert result.out == b""
    lines = result.err.splitlines()
    assert len(lines) == 1, result.err
    assert lines[0].startswith("ncomp: ")
    assert re.search(pattern, lines[0]), lines[0]
    assert "Traceback" not in result.err
    assert {path.name: path.is_file() and path.read_bytes() for path in folder.iterdir()} == before


def snapshot(folder):
    return {path.name: path.is_file() and path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("name", BAD_FILES)
@pytest.mark.parametrize("output", ["out.nc", "old.nc", "-"])
def test_programs_that_can_not_be_used(ncomp, tmp_path, name, output):
    fill(tmp_path)
    (tmp_path / "old.nc").write_bytes(OLD)
    before = snapshot(tmp_path)
    result = ncomp(name, *GANTRY, "-o", output, "--json", "results.json")
    check_refusal(result, BAD_FILE_WORDS[name], tmp_path, before)


@pytest.mark.parametrize("name", BAD_OPTIONS)
def test_options_that_can_not_be_used(ncomp, tmp_path, name):
    fill(tmp_path)
    arguments, pattern = BAD_OPTIONS[name]
    before = snapshot(tmp_path)
    outputs = [] if "-o" in arguments else ["-o", "out.nc"]
    check_refusal(ncomp(*arguments, *outputs), pattern, tmp_path, before)


WRONG_USAGE = [
    (["in.nc", *GANTRY, "--nonsense"], "correct: unknown option --nonsense; "),
    (["in.nc", *GANTRY, "--tolerance-u", "2"], "correct: unknown option --tolerance-u (did you mean '--tolerance-um'?)"),
    (["in.nc", "-machine", "gantry"], "correct: unknown option -machine (did you mean '--machine'?)"),
    (["in.nc", "\u2014machine", "gantry"], "unexpected argument '\u2014machine' (did you mean '--machine'?)"),
    (["in.nc"], "correct: --machine NAME is missing: name of a machine, or path of its .toml file; 'ncomp correct --help'"),
    ([*GANTRY], "correct: IN.nc is missing: NC program"),
    (["verify", "in.nc", "in.nc", "in.nc", *GANTRY], "verify: unexpected argument 'in.nc': expected IN.nc OUT.nc"),
    (["in.nc", "cal.json", *GANTRY], "2 programs are given: name a folder for their outputs, -o FOLDER"),
    (["in.nc", "in.nc", *GANTRY, "-o", "new"], "in.nc and in.nc have the same name, and so the same output new/in.nc"),
    (["in.nc", "other.nc", *GANTRY, "-o", "new"], "program other.nc: No such file"),
    (["in.nc", "cal.json", *GANTRY, "-o", "in.nc"], "--output in.nc is a file, and 2 programs are given: name a folder"),
    (["in.nc", "-", *GANTRY, "-o", "new"], "standard input (-) is one program"),
    (["in.nc", "cal.json", *GANTRY, "--in-place"], "--in-place replaces one program, and 2 are given: give -o FOLDER"),
    (["in.nc", "--machine"], "correct: --machine needs a value, NAME: name of a machine"),
    (["in.nc", "--machine", "-o", "out.nc"], "correct: --machine needs a value, NAME; -o follows it: name of a machine"),
    (["in.nc", *GANTRY, "--machine", "dmu50"], "correct: --machine is given twice"),
    (["in.nc", *GANTRY, "--force=yes"], "correct: --force takes no value, and 'yes' is given"),
    (["in.nc", *GANTRY, "--tolerance-um", "-1"], "correct: --tolerance-um -1: expected 0 or more"),
    (["in.nc", *GANTRY, "--max-correction-um", "1e9"], "correct: --max-correction-um 1e9: expected 5000 or less"),
    (["in.nc", *GANTRY, "--tolerance-um", "much"], "correct: --tolerance-um much: expected a number (um);"),
    (["in.nc", *GANTRY, "--tolerance-um", "1,5"], "expected a number (um); write the decimal point as '.'"),
    (["in.nc", *GANTRY, "--jobs", "1.5"], "correct: --jobs 1.5: expected a whole number"),
    (["verify", "in.nc", "--machine", "gantry"], "--machine is for the comparison of two programs: give the original as well"),
    (["fit", "--machine", "gantry", "-o", "x"], "fit: DATA.csv... is missing: measurement files"),
    (["fit", "d.csv", "--machine", "gantry"], "fit: --output CAL.json is missing: file for the calibration"),
    (["--nonsense"], "correct: unknown option --nonsense"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "words"), WRONG_USAGE)
def test_wrong_usage(ncomp, tmp_path, arguments, words):
    before = snapshot(tmp_path)
    check_refusal(ncomp(*arguments), re.escape(words), tmp_path, before)


def test_a_fault_of_ours_is_told_from_one_of_the_user(ncomp, monkeypatch):
    monkeypatch.setattr("postproc.correct.pipeline.Pipeline.run", lambda *_: 1 / 0)
    result = ncomp("in.nc", *GANTRY, "-o", "out.nc")
    assert result.status == 1
    assert "internal fault: ZeroDivisionError" in result.err.splitlines()[-1]
    assert not Path("out.nc").exists()


# ---- what goes right


def test_main_job(ncomp):
    result = ncomp("in.nc", *GANTRY, "-o", "out.nc")
    assert (result.status, result.out) == (0, b"")
    assert split_mark(Path("out.nc").read_text()) == corrected()
    for words in (
        "3 read, 3 corrected",
        "work offsets G54: 0 (--set-up-zero)",
        "machine      gantry",
        "correction X",
        "iso, 8 blocks",
    ):
        assert words in result.err
    assert sorted(path.name for path in Path().iterdir()) == ["cal.json", "in.nc", "out.nc"]


def test_named_as_a_subcommand_and_with_options_first(ncomp):
    outputs = []
    for arguments in (("in.nc", *GANTRY), ("correct", "in.nc", *GANTRY), (*GANTRY, "in.nc")):
        result = ncomp(*arguments)
        assert result.status == 0
        outputs.append(result.out)
    assert outputs[0] == outputs[1] == outputs[2]
    assert split_mark(outputs[0].decode()) == corrected()


def test_several_programs(ncomp):
    Path("more").mkdir()
    Path("more/second.nc").write_text(PROGRAM)
    result = ncomp("in.nc", "more/second.nc", *GANTRY, "-o", "out", "--json", "all.json", "--jobs", "1")
    assert result.status == 0, result.err
    assert {path.name for path in Path("out").iterdir()} == {"in.nc", "second.nc"}
    assert split_mark(Path("out/second.nc").read_text()) == corrected()
    assert json.loads(Path("all.json").read_text())["counts"] == {"corrected": 2}
    assert ncomp("in.nc", "cal.json", *GANTRY, "-o", "out").status == 2


def test_output_that_is_the_input(ncomp):
    Path("in.nc").chmod(0o640)
    assert ncomp("in.nc", *GANTRY, "-o", "in.nc", "--in-place").status == 0
    assert split_mark(Path("in.nc").read_text()) == corrected()
    assert Path("in.nc").stat().st_mode & 0o777 == 0o640
    result = ncomp("in.nc", *GANTRY, "-o", "in.nc", "--in-place")
    assert result.status == 2
    assert "already corrected" in result.err
    assert split_mark(Path("in.nc").read_text()) == corrected()
    assert ncomp("in.nc", *GANTRY, "-o", "in.nc", "--in-place", "--force").status == 0


def test_standard_input_and_output(ncomp):
    data = PROGRAM.replace("\n", "\r\n").encode() + b"\0\0"
    result = ncomp("-", "--machine", "gantry", "--calibration", "none", stdin=data)
    assert (result.status, result.out) == (0, data)
    result = ncomp("-", *GANTRY, "-o", "-", stdin=PROGRAM.encode())
    assert split_mark(result.out.decode()) == corrected()
    result = ncomp("-", *GANTRY, "-o", "out.nc", stdin=b"")
    assert result.status == 2
    assert "program <stdin> is empty" in result.err
    result = ncomp("-", *GANTRY, stdin=b"G31\n")
    assert result.status == 2
    assert "<stdin>:1: 'G31'" in result.err


def test_without_errors_byte_for_byte(ncomp):
    result = ncomp("in.nc", "--machine", "gantry", "--calibration", "none", "-o", "out.nc")
    assert result.status == 0
    assert Path("out.nc").read_bytes() == Path("in.nc").read_bytes()


def test_no_calibration_has_no_age(ncomp):
    result = ncomp("in.nc", "--machine", "gantry", "--calibration", "none", "-o", "out.nc", "--json", "-")
    calibration = json.loads(result.out)["calibration"]
    assert (calibration["id"], calibration["age_days"]) == ("none", None)


JSON_KEYS = {
    "program": {"name", "sha256", "dialect"},
    "machine": {"name", "chain"},
    "calibration": {"id", "made_at", "age_days", "made_by", "demonstration"},
    "conditions": {"elapsed_s", "temperatures_degC", "log"},
    "blocks": {"read", "changed", "added"},
    "correction_urad": set(),
    "predicted_absolute_error_um": {"before", "after"},
    "predicted_tool_axis_error_urad": {"before", "after"},
    "moves": {"read", "corrected", "split", "not_judged"},
    "correction_um": {"X", "Y", "Z"},
    "predicted_error_um": {
        "before",
        "after",
        "between_block_ends_after",
        "anywhere",
        "standard_uncertainty_of_prediction",
        "significant_share_of_improvement",
    },
    "accepted": set(),
    "work_offsets": {"G54"},
    "tools": set(),
}


def test_json(ncomp):
    result = ncomp("in.nc", *GANTRY, "-o", "out.nc", "--json", "-")
    data = json.loads(result.out)
    assert ncomp("in.nc", *GANTRY, "--json", "results.json").status == 0
    from_file = json.loads(Path("results.json").read_text())
    for each in (data, from_file):
        each["calibration"].pop("age_days")
    assert data == from_file
    data["calibration"]["age_days"] = 0
    assert data.keys() == {
        *JSON_KEYS,
        "mark",
        "max_correction_um",
        "not_split",
        "not_corrected",
        "left_outside",
        "notes",
        "datum",
        "errors_relative_to",
        "assumed",
        "provenance",
    }
    assert data["provenance"]["made_by"] == f"ncomp {VERSION}"
    assert data["provenance"]["machine"] == "gantry"
    known = {"in.nc": hashlib.sha256(Path("in.nc").read_bytes()).hexdigest()[:12]}
    assert known.items() <= data["provenance"]["inputs"].items()
    for key, keys in JSON_KEYS.items():
        assert keys == data[key].keys()
    assert data["correction_um"]["X"] == {"max": 10.0, "rms": 10.0, "count": 3}
    assert data["predicted_error_um"]["before"] == {"max": 10.0, "rms": 10.0, "count": 3}
    assert data["predicted_error_um"]["after"]["max"] == 0.0
    assert isinstance(data["notes"], list)


def test_setup_options(ncomp):
    Path("tools.json").write_text('{"1": 50, "2": 60}')
    Path("part.nc").write_text("G21 G90 T1 M6\nG55 G0 X10.0 Y10.0\nG43 H2 Z10.0\n")
    result = ncomp(
        "part.nc", "--machine", "gantry", "-c", "cal.json", "--datum", "G55=true", "--work-offset", "G55=100,200,300", "--work-offset", "G56=1,2,3",
        "--tool-table", "tools.json", "--tool-length", "T2=70", "--tool-length", "T3=1", "--json", "-", "-o", "out.nc",
    )  # fmt: skip
    data = json.loads(result.out)
    assert data["work_offsets"] == {"G55": "X 100, Y 200, Z 300"}
    assert data["tools"] == {"1": "50", "2": "70"}
    assert "work offset G56 was given and is not used" in data["notes"]
    assert [note for note in data["notes"] if "tool length" in note] == ["tool length T3 was given and is not used"]


def test_travel_option(ncomp):
    Path("far.nc").write_text("G21 G90 G0 X5000.0 Y1.0 Z1.0\n")
    assert ncomp("far.nc", *GANTRY, "-o", "out.nc").status == 2
    result = ncomp("far.nc", *GANTRY, "-o", "out.nc", "--no-travel-check")
    assert result.status == 0
    assert "X outside its travel 0..5000 mm" in result.err


def test_demonstration_is_announced(ncomp):
    Path("part.nc").write_text("G0 X1 Y1 Z1\n")
    result = ncomp("part.nc", "--machine", "dmu50", "-o", "out.nc")
    assert result.status == 0
    assumed, demonstration, *_ = result.err.splitlines()
    assert assumed.startswith("Work offset G54 is assumed: ")
    assert demonstration == "DEMONSTRATION CALIBRATION: it describes no real machine; do not cut with it."


def test_pipes_are_read_once(ncomp):
    """`ncomp <(unpack part)`: a pipe by its name."""
    reader, writer = os.pipe()
    long = PROGRAM.replace("M30", "G1 X100.0\nX200.0\n" * 5000 + "M30").encode()
    pid = os.fork()
    if pid == 0:
        os.close(reader)
        with os.fdopen(writer, "wb") as pipe:
            pipe.write(long)
        os._exit(0)
    os.close(writer)
    result = ncomp(f"/dev/fd/{reader}", "--machine", "gantry", "--calibration", "none")
    os.waitpid(pid, 0)
    assert result.status == 0
    assert result.out == long


def test_devices_are_not_replaced(ncomp, tmp_path):
    fifo = tmp_path / "pipe.nc"
    os.mkfifo(fifo)
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    assert ncomp("in.nc", *GANTRY, "-o", fifo).status == 0
    assert split_mark(os.read(reader, 10_000).decode()) == corrected()
    os.close(reader)
    assert fifo.is_fifo()
    assert ncomp("in.nc", *GANTRY, "-o", "/dev/null").status == 0
    assert ncomp("in.nc", *GANTRY, "-o", "out.nc", "--json", "/dev/null").status == 0
    assert Path("/dev/null").is_char_device()


# ---- the other commands


def test_verify(ncomp):
    ncomp("in.nc", *GANTRY, "-o", "out.nc")
    result = ncomp("verify", "in.nc", "out.nc", *GANTRY, "--json", "-")
    assert result.status == 0
    data = json.loads(result.out)
    assert data["moves"] == 3
    assert data["block_ends_um"]["before"]["max"] == 10.0
    assert data["block_ends_um"]["after"]["max"] == 0.0
    assert data["along_feed_moves_um"]["after"]["max"] < 0.1
    assert data["contributions_before_um"]["E_XX"]["max"] == 10.0
    assert "block ends" in result.err
    assert b"block ends" in ncomp("verify", "in.nc", "out.nc", *GANTRY).out


def test_verify_by_an_old_model_as_well(ncomp):
    ncomp("in.nc", *GANTRY, "-o", "out.nc")
    one = json.loads(ncomp("verify", "in.nc", "out.nc", *GANTRY, "--json", "-").out)
    both = json.loads(ncomp("verify", "in.nc", "out.nc", *GANTRY, "--old", "none", "--json", "-").out)
    old = both.pop("by_old_model")
    assert both["provenance"].pop("calibration") == f"{one['provenance'].pop('calibration')}; none"
    assert both == one
    # a machine without errors goes where it is told to, and so misses by the correction
    assert old["block_ends_um"]["before"]["max"] == 0.0
    assert old["block_ends_um"]["after"]["max"] == pytest.approx(one["block_ends_um"]["before"]["max"], rel=1e-2)
    assert b"--old" in ncomp("verify", "in.nc", "out.nc", *GANTRY, "--old", "none").out


def test_verify_programs_that_do_not_match(ncomp):
    Path("other.nc").write_text("G0 X1 Y1 Z1\n")
    result = ncomp("verify", "in.nc", "other.nc", *GANTRY)
    assert result.status == 2
    assert "do not make the same moves" in result.err


def test_machines(ncomp):
    listed = ncomp("machines")
    assert listed.status == 0
    assert [line.split()[0] for line in listed.out.decode().splitlines()] == [
        "bzt_pfu", "cframe", "dmu50", "gantry", "head_head", "head_table", "trunnion_ac", "trunnion_bc",
    ]  # fmt: skip
    shown = ncomp("machines", "dmu50")
    assert shown.status == 0
    for words in ("w C B b X Y Z t", "dmu50.json", "-250..250 mm", "0..180 deg"):
        assert words in shown.out.decode()
    Path("mine.toml").write_text(TOML.read_text().replace('"gantry"', '"mine"'))
    assert b"none of its own" in ncomp("machines", "mine.toml").out


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("travel", "travvel"), "travvel"),
        (('chain = "w b X Y Z t"', 'chain = "b X Y Z"'), "is not of the form"),
        (("[0, 5000]", "[5000, 0]"), "axis X: travel"),
        (("[0, 5000]", '"long"'), "axes.X"),
        (('name = "gantry"', "name = "), "machine file bad.toml"),
    ],
)
def test_bad_machine_files(ncomp, change, words):
    Path("bad.toml").write_text(TOML.read_text().replace(*change, 1))
    result = ncomp("machines", "bad.toml")
    assert (result.status, result.out) == (2, b"")
    assert re.fullmatch(r"ncomp: machine file bad\.toml:\d+: .*\n", result.err)
    assert words in result.err


def test_help(ncomp):
    main = ncomp("--help")
    assert main.status == 0
    for words in (
        "correct",
        "verify",
        "machines",
        "ncomp IN.nc --machine M -o OUT.nc",
        "─ Programs ─",
        "─ Calibrations ─",
    ):
        assert words in main.out.decode()
    assert ncomp("help", "verify").out == ncomp("verify", "--help").out
    for each in ("--help", "touches --help", "import --help"):
        assert not re.search(r"<(bool|str|path|list\[\w+\])>", ncomp(*each.split()).out.decode())  # types of Python
    for command, example in (
        ("correct", "ncomp part.nc --machine dmu50"),
        ("verify", "ncomp verify part.nc"),
        ("machines", "ncomp machines dmu50"),
    ):
        shown = ncomp(command, "--help")
        assert shown.status == 0
        assert "Example" in shown.out.decode()
        assert example in shown.out.decode()
    assert re.fullmatch(rb"ncomp \d+\.\d+\.\d+\n", ncomp("--version").out)
    assert ncomp().status in (0, 2)


# ---- as a program of its own


def test_as_a_process(tmp_path):
    """Status, streams and a closed pipe as a shell sees them."""
    write_model(shifted(load("gantry"), X=-10.0), tmp_path / "cal.json")
    command = [sys.executable, "-c", "from postproc.cli import run; run()"]
    done = subprocess.run(
        [*command, "-", *GANTRY], input=PROGRAM.encode(), capture_output=True, cwd=tmp_path, check=False, timeout=60
    )
    assert done.returncode == 0
    assert split_mark(done.stdout.decode()) == corrected()
    refused = subprocess.run(
        [*command, "-", *GANTRY], input=b"G31\n", capture_output=True, cwd=tmp_path, check=False, timeout=60
    )
    assert (refused.returncode, refused.stdout) == (2, b"")
    assert refused.stderr.decode().startswith(
        "ncomp: <stdin>:1: 'G31': G31 is a probing move, and its end position is not known from the program: "
    )
    long = PROGRAM.replace("M30", f"G1 X100.0 ({'a' * 90})\nX200.0\n" * 1_500 + "M30").encode()  # a pipe holds less
    (tmp_path / "long.nc").write_bytes(long)
    with subprocess.Popen(
        [*command, "long.nc", *GANTRY], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=tmp_path
    ) as process:
        assert process.stdout is not None
        process.stdout.read(10)
        process.stdout.close()
        assert process.wait(60) == 1
        assert process.stderr is not None
        assert b"Traceback" not in process.stderr.read()


def test_help_comes_without_heavy_libraries():
    shown = "import sys; sys.argv = ['ncomp', '--help']\nfrom postproc.cli import run\ntry: run()\nexcept SystemExit: pass\n"
    names = "print({name.partition('.')[0] for name in sys.modules}, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", shown + names], capture_output=True, text=True, check=True, timeout=60)
    loaded = ast.literal_eval(done.stderr)
    assert "typer" in loaded
    assert not loaded & {"numpy", "scipy", "sympy", "plotly", "lark"}


def test_backlash_and_temperatures(ncomp, tmp_path):
    drift = DriftWithSensor(component="Z", sensor="spindle", coefficient=-6.0)
    write_model(model_of(load("gantry"), Backlash("X", 20.0), drift), tmp_path / "cal.json")
    (tmp_path / "in.nc").write_text("G21 G90\nG0 X100. Y100. Z100.\nX110.\nG1 X105. F500\nG2 X95. I-5.\nG3 X95. I5.\n")
    refused = ncomp("in.nc", *GANTRY, "-o", "out.nc")
    assert refused.status == 2
    assert "needs the temperature 'spindle': give --temperature spindle=degC or --log" in refused.err
    assert not Path("out.nc").exists()
    (tmp_path / "log.csv").write_text("time_s,temp_spindle\n0,20\n60,30\n")
    for given in (("--temperature", "spindle=30"), ("--log", "log.csv"), ("--log", "log.csv", "--elapsed", "5")):
        result = ncomp("in.nc", *GANTRY, "-o", "out.nc", *given)
        assert result.status == 0
        text = Path("out.nc").read_text()
        assert "Z100.0600" in text
        assert "G1 X109.9900 F500 (NCOMP TAKE-UP)" in text
        assert "blocks added where backlash is taken up" in result.err
        assert "held over the program" in result.err
        judged = ncomp("verify", "in.nc", "out.nc", *GANTRY, *given, "--json", "-")
        verdict = json.loads(judged.out)
        assert verdict["block_ends_um"]["after"]["max"] < 0.1
        assert verdict["along_feed_moves_um"]["after"]["max"] < 0.1
        assert verdict["along_feed_moves_um"]["before"]["max"] > 60
    assert ncomp("verify", "in.nc", "out.nc", *GANTRY).status == 2
    table = ncomp("verify", "in.nc", "out.nc", *GANTRY, "--temperature", "spindle=30", "--classes")
    assert table.status == 0
    assert "L-POS" in table.out.decode()
