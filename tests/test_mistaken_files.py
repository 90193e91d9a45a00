"""Names that are nearly right, and files of another kind: messages name the likeliest one."""

import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import machines
from kinematics.files.mistaken import KIND_HEAD_BYTES, PROGRAM, did_you_mean, kind_of_file
from kinematics.user_error import UserError
from postproc.text.source import open_source

MEASUREMENT = b"# machine: gantry\r\n# instrument: laser-tracker\r\nX,Y,Z,x,y,z\r\n"
CALIBRATION = b'{\n "ncomp_calibration": 1, "machine": {}}'


@pytest.mark.parametrize(
    ("data", "kind"),
    [
        (MEASUREMENT, "a measurement file"),
        (CALIBRATION, "a calibration of ncomp"),
        (b'{"a": 1}', "a JSON file"),
        (b"# strategy: random\nX,Y\n", "a plan"),
        (b'# a mill\nname = "mill"\n', "a machine file"),
        (b"%\nO0001 (PART)\nG21 G90\n", "an NC program"),
        (b"(PART) (OF TWO)\n\nN10 G54\n", "an NC program"),
        (b"0  BEGIN PGM 7 MM\n", "an NC program"),
        (b"%PDF-1.7\n", "a PDF"),
        (b"PK\x03\x04....", "a ZIP"),
        (b"\xef\xbb\xbf<!DOCTYPE html>", "a web page"),
        (b"hello", ""),
        (b"", ""),
    ],
)
def test_the_kind_of_a_file(data, kind):
    assert kind_of_file(data).startswith(kind)
    assert bool(kind_of_file(data)) == bool(kind)


@given(st.text("#()%\r\n \tGXinstrume: 1", max_size=KIND_HEAD_BYTES).map(str.encode))
def test_no_file_takes_long(data):
    start = time.process_time()
    kind_of_file(data)
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize("line", [b"# a\r\n", b"(a) \r\n", b"%\r\n", b" \t", b"(a)(b)"])
def test_many_lines_before_the_end_take_no_longer(line):
    start = time.process_time()
    kind_of_file(line * (KIND_HEAD_BYTES // len(line)) + b"!")
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize(
    ("name", "meant"), [("dmu5", " (did you mean 'dmu50'?)"), ("gantri", " (did you mean 'gantry'?)"), ("xyz", "")]
)
def test_the_machine_that_was_meant(name, meant):
    assert did_you_mean(name, machines.names()) == meant
    with pytest.raises(UserError) as refused:
        machines.load(name)
    assert str(refused.value).startswith(f"unknown machine {name!r}{meant}: shipped are ")


@pytest.mark.parametrize("data", [MEASUREMENT, CALIBRATION])
def test_a_file_of_another_kind_is_no_program(tmp_path, data):
    path = tmp_path / "in.nc"
    path.write_bytes(data)
    with pytest.raises(UserError, match="no NC program"):
        open_source(str(path))


def test_every_real_program_is_none_of_the_other_kinds(nc_data):
    programs = [
        path for path in nc_data.rglob("*") if path.suffix.lower() in (".nc", ".ngc", ".h", ".mpf", ".spf", ".tap")
    ]
    assert len(programs) > 40
    for path in programs:
        assert kind_of_file(path.read_bytes()) in ("", PROGRAM), path.name


def test_commands_say_what_was_meant(command):
    Path("data.csv").write_bytes(MEASUREMENT)
    Path("cal.json").write_bytes(CALIBRATION)
    for words, text in (
        (["dignose", "data.csv"], "'dignose' is neither a command nor a file (did you mean 'diagnose'?)"),
        (["fit", "cal.json", "--machine", "gantry", "-o", "x.json"], "this is a calibration of ncomp"),
        (["predict", "data.csv", "--machine", "gantry", "-c", "data.csv"], "this is a measurement file"),
    ):
        done = command(*words)
        assert done.status == 2
        assert text in done.err
