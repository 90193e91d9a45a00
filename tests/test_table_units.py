"""Tables of tools whose lengths have no unit: LinuxCNC's own, lists of FANUC, archives of Siemens."""

import dataclasses
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from clients import rs274
from support.programs import load, source_of

import machines
import ncomp
from kinematics.user_error import UserError
from postproc.control_data.tool_tables import read_tool_table
from postproc.dialects import find_dialect
from postproc.execution import execution
from postproc.motion.motions import merged
from postproc.text.notes import Notes

TABLES = {
    "tool.tbl": "T1 P1 D0.5 Z4.5 ;mill\nT2 P2 Z-1.25\n",
    "offsets.nc": "H1 4.5\nH2 -1.25\nD1 0.25\n",
    "archive.spf": "$TC_DP3[1,1]=4.5\n$TC_DP3[2,1]=-1.25\n$TC_DP6[1,1]=0.25\n",
}
INCHES = "G90 G17 G20 G54\nT1 M6\nG43 H1\nG0 X1 Y2 Z3\nG1 X2 F10\nT2 M6\nG43 H2\nG0 Z3.5\nX1 Y1\nM2\n"
METRIC = INCHES.replace("G20", "G21")


@pytest.fixture(params=TABLES)
def table(request, tmp_path):
    path = tmp_path / request.param
    path.write_text(TABLES[request.param])
    return path


def with_unit(unit, name="gantry"):
    machine = load(name)
    return dataclasses.replace(machine, control=dataclasses.replace(machine.control, unit=unit))


def moves(text, machine, dialect="iso", **options):
    """The moves of a program with a set-up, and the state of the control at its end."""
    language = find_dialect(dialect, "test.nc", "")
    setup = ncomp.set_up(machine, zero=True, **options)
    interpreter = language.interpreter(machine, setup, Notes())
    found = merged([part.motions for part in execution(source_of(text), language, interpreter).parts()])
    return found, interpreter.control_state


@pytest.mark.parametrize(("unit", "mm"), [("", 1.0), ("mm", 1.0), ("inch", 25.4)])
def test_lengths_in_the_unit_that_is_given(table, unit, mm):
    found = read_tool_table(table, unit)
    assert found.tools == pytest.approx({"1": 4.5 * mm, "2": -1.25 * mm})
    assert found.radii["1"] == pytest.approx(0.25 * mm)
    assert bool(found.without_unit) == (not unit)


def test_offsets_in_inches_keep_their_angles(tmp_path):
    (tmp_path / "o.nc").write_text("G10 L2 P1 X1. C30.\n")
    assert read_tool_table(tmp_path / "o.nc", "inch").work_offsets == {"G54": {"X": 25.4, "C": 30.0}}


@pytest.mark.parametrize(("name", "text"), [
    ("TOOL.T", "BEGIN TOOL .T MM\nT  NAME  L    R\n1  A     +2   +0.5\n[END]\n"),
    ("t.json", '{"1": 2.0}'),
    ("o.nc", "G21\nG10 L10 P1 R2.\n"),
])  # fmt: skip
def test_a_table_with_its_own_unit_keeps_it(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    for unit in ("", "mm", "inch"):
        found = read_tool_table(tmp_path / name, unit)
        assert found.tools["1"] == 2.0
        assert not found.without_unit


def test_a_tool_may_have_the_name_of_an_axis():
    assert ncomp.set_up("dmu50", tool_length=["A=3"]).tools == {"A": 3.0}


@pytest.mark.parametrize(("dialect", "text"), [
    ("iso", INCHES), ("siemens", "G70 G90 G54\nG0 X1 Y1 Z1\n"), ("heidenhain", "0 BEGIN PGM A INCH\n1 L X+1 Y+1 Z+1 R0 FMAX\n"),
])  # fmt: skip
def test_a_program_in_inches_is_told_that_its_set_up_is_in_mm(dialect, text):
    language = find_dialect(dialect, "test.nc", "")
    for given, noted in (({"tool_length": ["T1=101.6"]}, True), ({"work_offset": ["G54=1,2,3"]}, True), ({}, False)):
        notes = Notes()
        interpreter = language.interpreter(load("gantry"), ncomp.set_up("gantry", zero=True, **given), notes)
        merged([part.motions for part in execution(source_of(text), language, interpreter).parts()])
        assert ("are in mm" in "".join(notes.texts())) == noted


@pytest.mark.parametrize("text", [INCHES, METRIC], ids=["inches", "metric"])
@pytest.mark.usefixtures("linuxcnc")
def test_rs274_reads_the_same_lengths(text, tmp_path):
    """`rs274 -t` is a machine whose INI file states inches."""
    table, program = tmp_path / "tool.tbl", tmp_path / "part.ngc"
    table.write_text(TABLES["tool.tbl"])
    program.write_text(text)
    done = subprocess.run(
        ["rs274", "-g", "-t", table, program], capture_output=True, text=True, cwd=tmp_path,
        env={"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"}, timeout=60, check=True,
    )  # fmt: skip
    expected = [move.machine[:3] for move in rs274._moves(rs274._canon_lines(done.stdout))]
    for machine, options in ((with_unit("inch"), {}), (with_unit(""), {"table_unit": "inch"})):
        found, _ = moves(text, machine, tool_table=[table], **options)
        # four decimals of an inch
        assert np.allclose(found.machine_target, expected, atol=2.6e-3)


def test_programs_without_a_unit_are_in_that_of_the_control():
    text = INCHES.replace(" G20", "")
    lengths = {"tool_length": ["T1=114.3", "T2=-31.75"]}
    by_code, _ = moves(INCHES, with_unit(""), **lengths)
    by_machine, _ = moves(text, with_unit("inch"), **lengths)
    assert np.array_equal(by_code.target, by_machine.target)
    assert not np.allclose(moves(text, with_unit(""), **lengths)[0].target, by_code.target)


def test_an_assumed_unit_is_shown(table):
    _, state = moves(METRIC, with_unit(""), tool_table=[table])
    assert state.assumption() == (f"Unit of {table} is assumed: T1 4.5 in mm; give --table-unit")
    assert not moves(METRIC, with_unit("mm"), tool_table=[table])[1].assumption()
    assert not moves(METRIC, with_unit(""), tool_table=[table], tool_length=["T1=5", "T2=3"])[1].assumption()


@pytest.mark.parametrize(("dialect", "text"), [
    ("iso", INCHES),
    ("siemens", "G90 G17 G700\nT1 D1\nG1 X10 Y10 Z20 F100\nM30\n"),
    ("heidenhain", "BEGIN PGM A INCH\nTOOL CALL 1 Z\nL X+1 Y+1 Z+1 R0 F100\nEND PGM A INCH\n"),
])  # fmt: skip
def test_a_program_in_inches_needs_the_unit(table, dialect, text):
    with pytest.raises(UserError, match=f"is in inches, and {re.escape(str(table))} contains no unit: give it by"):
        moves(text, with_unit(""), dialect, tool_table=[table])
    for unit in ("mm", "inch"):
        moves(text, with_unit(unit), dialect, tool_table=[table])


def test_siemens_data_in_inches_are_refused():
    text = "G90 G700\n$TC_DP3[1,1]=4.5\nT1 D1\nG1 X10 Y10 Z20 F100\nM30\n"
    with pytest.raises(UserError, match=r"\$TC_DP3 is in inches on this control, which is not supported"):
        moves(text, with_unit("inch"), "siemens")


def test_by_the_command(command, tmp_path):
    (tmp_path / "tool.tbl").write_text(TABLES["tool.tbl"])
    (tmp_path / "a.nc").write_text(METRIC)
    (tmp_path / "mill.toml").write_text(
        (Path(machines.__file__).parent / "gantry.toml").read_text() + '\n[control]\nunit = "inch"\n'
    )
    run = (
        "a.nc",
        "--calibration",
        "none",
        "--work-offset",
        "G54=0,0,0",
        "--tool-table",
        "tool.tbl",
        "-o",
        "b.nc",
        "--no-travel-check",
    )
    shown = command(*run, "--machine", "gantry")
    assert "Unit of tool.tbl is assumed: T1 4.5 in mm; give --table-unit" in shown.out.decode() + shown.err
    for options in (("--machine", "gantry", "--table-unit", "inch"), ("--machine", "mill.toml")):
        done = command(*run, *options)
        assert done.status == 0, done.err
        assert "assumed" not in done.out.decode() + done.err
