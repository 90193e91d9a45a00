"""Numbers and types: not finite, with separators of thousands, as a date, a list or a text, twice, or out of range."""

from __future__ import annotations

from tests.mistakes.job_files import entry as job
from tests.mistakes.machine_files import entry as machine
from tests.mistakes.measurements import CORRECT, STUDY, Change, cell, change, data
from tests.mistakes.mistake import Mistake
from tests.mistakes.programs import TAIL, line

OFFSET = "in.nc --machine gantry -c cal.json --work-offset G54=0,0,0 -o out.nc --tool-table t.tbl"
PREDICT = "predict p.csv --machine gantry -c cal.json -o p_out.csv"


def option(made: str, command: str, place: str, cause: str, cure: str, *files: Change) -> Mistake:
    """A mistake in an option, or in a file that it names."""
    return Mistake(made, command, place, cause, cure, files)


def tools(made: str, text: str, cause: str, cure: str) -> Mistake:
    """A mistake in the first line of a tool table of LinuxCNC."""
    return Mistake(made, OFFSET, "tool table t.tbl:1", cause, cure, (("t.tbl", text),))


def study(made: str, old: str, new: str, row: int, cause: str, cure: str) -> Mistake:
    """A mistake in a line of a study."""
    changed = STUDY.replace(old, new)
    return Mistake(made, "study s.toml -o results.csv", f"study s.toml:{row}: ", cause, cure, (("s.toml", changed),))


def log(made: str, rows: str, place: str, cause: str, cure: str) -> Mistake:
    """A mistake in a log of temperatures."""
    return Mistake(
        made, f"in.nc {TAIL} --log log.csv", place, cause, cure, (("log.csv", f"time_s,temp_air\n{rows}\n"),)
    )


MISTAKES = (
    machine("date in a travel", "[-250, 250]", "[2026-01-01, 250]", 14, "axes.X.travel[0]", "expected a number, not date"),
    machine("true in place of a length", "5 = 96.3", "5 = true", 30, "tools.5", "expected a number, not true or false"),
    machine("length that is not finite", "5 = 96.3", "5 = inf", 30, "tools.5: inf", "is not finite"),
    machine("work offset that is no number", "X = -12.5", "X = nan", 27, "work_offsets.G54.X", "nan is not finite"),
    machine("separators of thousands", "[-250, 250]", "[-1'250, 1'250]", 14, "Unclosed array", "without separators of thousands"),
    machine("entry twice in a table", "home = 400", "home = 400\nhome = 300", 22, "Cannot overwrite a value", "expected name = value"),
    machine("number as the name", '"mill"', "4711", 1, "name", "expected a text in quotes, not a whole number"),
    machine("list in a list", "[-250, 250]", "[[-250, 250]]", 14, "a list of 2 entries, not of 1", "one pair of brackets"),
    machine("coordinate with its unit", "[axes.C]\npoint = [0, 0, 154.996]", '[axes.C]\npoint = [0, 0, "154.996 mm"]', 6, "axes.C.point[2]", "expected a number, not a text in quotes"),
    machine("resolution of nothing", "home = 400", "home = 400\nresolution = 0", 22, "resolution 0.0", "must be positive"),
    machine("letter as a direction", "home = 400", 'home = 400\ndirection = "Z"', 22, "axes.Z.direction", "expected a list in [ ]"),
    machine("increment of nothing", '"fanuc"', '"fanuc"\nincrement = 0', 25, "control.increment 0.0", "must be positive"),
    machine("datum misspelled", "[tools]", '[datum]\ndefault = "probd"\n\n[tools]', 30, "datum.default", "expected probed, true, or probed@"),
    job("date as a tolerance", "tolerance_um = 1.0", "tolerance_um = 2026-01-01", 11, "correction.tolerance_um", "expected a number, not date"),
    job("tolerance that is no number", "tolerance_um = 1.0", "tolerance_um = nan", 11, "correction.tolerance_um: nan", "is not finite"),
    job("work offset that is not finite", "X = 10", "X = inf", 5, "work_offsets.G54.X: inf", "is not finite"),
    job("table as the machine", '"gantry"', '{ name = "gantry" }', 1, "machine", "expected a text in quotes, not a table"),
    job("list of calibrations", '"cal.json"', '["cal.json"]', 2, "calibration", "expected a text in quotes or nothing, not a list"),
    job("length with thousands", "1 = 80.0", "1 = 1.080,0", 8, "'1 = 1.080,0': column 10", "without separators of thousands"),
    job("path of Windows", '"in.nc" =', '"C:\\new\\in.nc" =', 14, "Unescaped", "write paths with / in place of"),
    job("one output of two programs", "[programs]", '[programs]\n"other.nc" = "out/out.nc"', 15, "other.nc has the same output", "name another file"),
    job("time of day as an elapsed time", "[programs]", "[conditions]\nelapsed_s = 07:32:00\n\n[programs]", 14, "conditions.elapsed_s", "expected a number or nothing, not time"),
    job("temperature without its sensor", "[programs]", "[conditions]\ntemperature = 21\n\n[programs]", 14, "conditions.temperature", "expected a table"),
    data("reading that is no number", "data.csv:12 column x", "'nan' is no number within", "correct it, or delete the row", cell(2, "x", "nan")),
    data("reading that is not finite", "data.csv:12 column x", "'inf' is no number within", "correct it, or delete the row", cell(2, "x", "inf")),
    data("reading with thousands", "data.csv:12 column x", "'1 255.2' is no number", "correct it, or delete the row", cell(2, "x", "1 255.2")),
    data("cell that is too narrow", "data.csv:12 column x", "'#####' is no number", "correct it, or delete the row", cell(2, "x", "#####")),
    data("time of day in place of seconds", "data.csv:12 column time_s", "'07:31:12' is no number", "write a time in s from the begin", cell(2, "time_s", "07:31:12")),
    data("uncertainty that is no number", "data.csv:5 u_angle_um", "got 'nan'", "expected a number", change("data.csv", "u_angle_um: 10.0", "u_angle_um: nan")),
    data("uncertainty with its unit", "data.csv:5 u_angle_um", "got '10 um'", "without its unit", change("data.csv", "u_angle_um: 10.0", "u_angle_um: 10 um")),
    data("target of two numbers", "data.csv:8 target.1", "got '0.0 0.0'", "expected 3 numbers", change("data.csv", "# target.1: 0.0 0.0 0.0", "# target.1: 0.0 0.0")),
    data("header line without its colon", "data.csv:5 u_angle_um", "the colon is missing", "write '# u_angle_um: 10.0'", change("data.csv", "# u_angle_um: 10.0", "# u_angle_um 10.0")),
    data("header key in capitals", "data.csv:1 Machine", "are in small letters", "write machine", change("data.csv", "# machine", "# Machine")),
    data("column in capitals", "data.csv:10 column TIME_S", "not known", "known are x, y, z", change("data.csv", "time_s,X,Y,Z", "TIME_S,X,Y,Z")),
    data("quote that is not closed", "data.csv:12", "begins with a quote and has no end", "correct the row, or delete it", cell(2, "target", '"1')),
    data("line of a damaged disk", "data.csv:12", "a line of more than 100000 characters", "export it again", cell(2, "x", "9" * 200_000)),
    tools("decimal comma in a tool table", "T1 P1 Z80,5\n", "'T1 P1 Z80,5' is not a tool entry", "write the decimal point as '.'"),
    tools("unit in a tool table", "T1 P1 Z80mm\n", "'T1 P1 Z80mm' is not a tool entry", "expected T1 P1 Z120.5"),
    tools("length that is no number in a tool table", "T1 P1 Znan\n", "'T1 P1 Znan' is not a tool entry", "expected T1 P1 Z120.5"),
    log("temperature that is no number", "0,nan", "log log.csv:2, column temp_air", "'nan' is no number", "write a finite number"),
    log("temperature in kelvin", "0,293.15", "log log.csv:2, column temp_air", "293.15 degC is no temperature of a machine", "write degC (is this kelvin?)"),
    log("rows of a log out of order", "10,20\n0,20", "log log.csv:3, column time_s", "before that of the last row", "sort the rows by time"),
    log("date in a log", "2026-11-03 10:00,20", "log log.csv:2, column time_s", "'2026-11-03 10:00' is no number", "write a time in s from the begin"),
    study("number of points that is none", "points = 60", "points = nan", 7, "case[0].points", "expected a whole number"),
    study("half a draw", "draws = 20", "draws = 20.5", 2, "draws", "expected a whole number"),
    study("case as a table", "[[case]]", "[case]", 4, "case", "expected a list in [ ], not a table"),
    option("tolerance without an end", f"in.nc {TAIL} --tolerance-um inf", "--tolerance-um inf", "expected", "a finite number"),
    option("work offset that is none", "in.nc --machine gantry -c cal.json --work-offset G54=nan,0,0 -o out.nc", "--work-offset G54=nan,0,0", "'nan' is no number", "write a finite number"),
    option("correction of a metre", f"in.nc {TAIL} --max-correction-um 1e9", "--max-correction-um 1e9", "expected 5000 or less", "'ncomp correct --help'"),
    option("minutes and seconds", f"in.nc {TAIL} --elapsed 1:30", "--elapsed 1:30", "expected a number (s)", "'ncomp correct --help'"),
    option("spindle in kelvin", f"in.nc {TAIL} --temperature spindle=293", "--temperature spindle=293", "no temperature of a machine", "write degC (is this kelvin?)"),
    option("thousand points", "plan --machine gantry --strategy grid --points 1.000 -o p.csv", "--points 1.000", "expected a whole number", "without separators"),
    option("noise below zero", "simulate --machine gantry --strategy plan.csv --noise-scale -1 -o d.csv", "--noise-scale -1", "expected 0 or more", "'ncomp simulate --help'"),
    option("position predicted at no number", PREDICT, "p.csv:2 column X", "'nan' is no number", "correct it, or delete the row", ("p.csv", "X,Y,Z\nnan,0,0\n")),
    option("position with thousands", PREDICT, "p.csv:2 column X", "'1,000' is no number", "write the decimal point as '.'", ("p.csv", 'X,Y,Z\n"1,000",0,0\n')),
    Mistake("number beyond the range of JSON", CORRECT, "calibration cal.json", "Number out of range", "take an unchanged copy", (("cal.json", lambda text: text.replace("-10.0", "-1e400", 1)),)),
    Mistake("number of the future", CORRECT, "calibration cal.json", "version 99", "use a newer ncomp", (change("cal.json", '"ncomp_calibration": 1', '"ncomp_calibration": 99'),)),
    line("word in place of a coordinate", "N70 Xnan Y150.", "column 6: 'nan Y150.' is not understood", "correct the block"),
    line("digits of another alphabet", "N70 X\uff12\uff10\uff10. Y150.", "'\uff12\uff10\uff10. Y150.' is not understood", "write plain digits"),
    line("thousands in a program", "N70 X1,200. Y150.", "',200. Y150.' is not understood", "write the decimal point as '.'"),
)  # fmt: skip
