"""Mistakes in measured data and in studies."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from itertools import pairwise

from tests.mistakes.mistake import Mistake, change

HEAD = 10
"""Lines of the measurement file up to the names of its columns."""
Change = tuple[str, str | bytes | Callable[[str], str | bytes]]


def data(made: str, place: str, cause: str, cure: str, *files: Change) -> Mistake:
    """A mistake in the measurement file."""
    return Mistake(made, "fit data.csv --machine gantry -o new.json", place, cause, cure, files)


def column(name: str, value: Callable[[float], float]) -> Change:
    """The measurement file with other numbers in a column."""

    def changed(text: str) -> str:
        lines = text.splitlines()
        at = lines[HEAD - 1].split(",").index(name)
        rows = [line.split(",") for line in lines[HEAD:]]
        for row in rows:
            row[at] = repr(value(float(row[at])))
        return "\n".join([*lines[:HEAD], *(",".join(row) for row in rows)]) + "\n"

    return "data.csv", changed


def cell(row: int, name: str, text: str) -> Change:
    """The measurement file with another text in one cell; rows count from 1."""

    def changed(content: str) -> str:
        lines = content.splitlines()
        cells = lines[HEAD - 1 + row].split(",")
        cells[lines[HEAD - 1].split(",").index(name)] = text
        lines[HEAD - 1 + row] = ",".join(cells)
        return "\n".join(lines) + "\n"

    return "data.csv", changed


def _cut(lines: int) -> Change:
    return "data.csv", lambda text: "\n".join(text.splitlines()[:lines]) + "\n"


def _by_semicolons(text: str) -> str:
    lines = text.splitlines()
    return "\n".join(line if line.startswith("#") else line.replace(",", ";").replace(".", ",") for line in lines)


def _shifted(text: str) -> str:
    """The points of each row in the row before it."""
    lines = text.splitlines()
    rows = [line.split(",") for line in lines[HEAD:]]
    mixed = [[*row[:7], *below[7:]] for row, below in pairwise(rows)]
    return "\n".join([*lines[:HEAD], *(",".join(row) for row in mixed)]) + "\n"


CORRECT = "in.nc --machine gantry -c cal.json --set-up-zero -o out.nc"
GERMAN = (
    "Messprotokoll;;\nPosition [mm];Lauf 1 vor;Lauf 1 zur\u00fcck\n0,000;0,5;-2,1\n100,000;1,2;-1,0\n200,000;2,5;0,1\n"
)
STUDY = 'machine = "gantry"\ndraws = 20\n\n[[case]]\nname = "a"\nstrategy = "grid"\npoints = 60\n'


def study(made: str, old: str, new: str, line: int | None, cause: str, cure: str) -> Mistake:
    """A mistake in a study."""
    place = "study s.toml: " if line is None else f"study s.toml:{line}: "
    assert old in STUDY
    return Mistake(made, "study s.toml -o results.csv", place, cause, cure, (("s.toml", STUDY.replace(old, new)),))


def _remark(text: str) -> str:
    """A remark in the second row."""
    lines = text.split("\n")
    return "\n".join([*lines[: HEAD + 1], "# pause", *lines[HEAD + 1 :]])


def _with_effect(text: str, **entries: object) -> str:
    """A calibration with backlash, written by hand."""
    content = json.loads(text)
    content["effects"].append({"kind": "backlash", **entries})
    return json.dumps(content)


MISTAKES = (
    data("instrument misspelled", "data.csv:2 instrument", "'laser-traker' is none of", "did you mean 'laser-tracker'?", change("data.csv", "laser-tracker", "laser-traker")),
    data("data of another machine", "data.csv:1 machine", "the file is of 'cframe', not of gantry", "give its machine", change("data.csv", "machine: gantry", "machine: cframe")),
    data("uncertainties forgotten", "data.csv", "the standard uncertainty (k=1) of the laser-tracker is missing", "header line '# u_", change("data.csv", "# u_angle_um: 10.0\n", ""), change("data.csv", "# u_angle_um_per_m: 2.5\n", "")),
    data("negative uncertainty", "data.csv:5 u_angle_um", "-10 is negative", "expected 0 or more", change("data.csv", "u_angle_um: 10.0", "u_angle_um: -10.0")),
    data("uncertainty with a comma", "data.csv:5 u_angle_um", "got '10,0'", "decimal point as '.'", change("data.csv", "u_angle_um: 10.0", "u_angle_um: 10,0")),
    data("target not described", "data.csv:9 column target", "the position of no target", "write # target.1: x y z", change("data.csv", "# target.1: 0.0 0.0 0.0\n", "")),
    data("column misspelled", "data.csv:10 column tme_s", "not known", "did you mean time_s?", change("data.csv", "time_s,X,Y,Z", "tme_s,X,Y,Z")),
    data("seconds as time stamps", "data.csv:11 column time", "is no date with a time of day", "a time in s is a column time_s", change("data.csv", "time_s,X,Y,Z", "time,X,Y,Z")),
    data("column of an axis misspelled", "data.csv:10 column Q", "not known", "known are x, y, z, X, Y, Z", change("data.csv", "time_s,X,Y,Z", "time_s,X,Y,Q")),
    data("semicolons and decimal commas", "data.csv:10", "separate cells by commas", "numbers with a decimal point", ("data.csv", _by_semicolons)),
    data("names of columns forgotten", "data.csv:10", "the line with the names of columns", "above the numbers is missing", change("data.csv", "time_s,X,Y,Z,target,station,run,x,y,z\n", "")),
    data("reading lost", "data.csv:12 column x", "empty", "fill it in, or delete the row", cell(2, "x", "")),
    data("word in place of a reading", "data.csv:12 column x", "'beam lost' is no number", "correct it, or delete the row", cell(2, "x", "beam lost")),
    data("last line cut off", "data.csv:130", "8 cells, but 10 columns", "or delete it", ("data.csv", lambda text: text[:-25])),
    data("cell too many", "data.csv:12", "11 cells, but 10 columns have names", "a decimal comma?", cell(2, "x", "1255.2,7")),
    data("readings in metres", "data.csv", "the points differ from the commanded positions", "m, mm or um mixed up", *(column(name, lambda value: value / 1000.0) for name in "xyz")),
    data("y and z exchanged", "data.csv", "the points differ from the commanded positions by", "or with columns Y and Z exchanged", change("data.csv", "run,x,y,z", "run,x,z,y")),
    data("readings of the next row", "data.csv", "no exchange of columns, targets, signs or units explains this", "are these points of this machine and of these positions?", ("data.csv", _shifted)),
    data("five points only", "data.csv", "are too few for", "measure about", _cut(15)),
    data("one point only", "data.csv", "no axis moves in these data", "measure at several positions", _cut(11)),
    data("header only", "data.csv", "there are no rows", "below the names of columns", _cut(10)),
    data("saved as Unicode by a spreadsheet", "data.csv", "is UTF-16 text", "save it as plain text", ("data.csv", lambda text: text.encode("utf-16"))),
    data("packed data", "data.csv", "this is a packed archive", "give the data of an instrument", ("data.csv", b"\x1f\x8b\x08\0" + bytes(60))),
    data("empty file from a failed export", "data.csv", "is empty", "export it again", ("data.csv", "")),
    data("uncertainty stated twice", "data.csv:6 u_angle_um", "given before, in line 5", "delete one of them", change("data.csv", "# u_angle_um: 10.0", "# u_angle_um: 10.0\n# u_angle_um: 20.0")),
    data("two columns of one name", "data.csv:10 column x", "twice", "delete or rename one", change("data.csv", "run,x,y,z", "run,x,x,z")),
    Mistake("data given twice", "fit data.csv data.csv --machine gantry -o new.json", "data.csv and data.csv", "contain the same data", "give each measurement once"),
    Mistake("calibration cut off by the mail", f"{CORRECT}", "calibration cal.json", "the file is incomplete", "take an unchanged copy", (("cal.json", lambda text: text[:-40]),)),
    Mistake("entry twice in a calibration", f"{CORRECT}", "calibration cal.json", "'effects' is given twice", "delete one of them", (("cal.json", lambda text: text.replace('"effects"', '"effects": [], "effects"', 1)),)),
    Mistake("effect of another program in a calibration", f"{CORRECT}", "calibration cal.json: effects[0].kind", "Invalid value 'magic'", "make the calibration anew", (change("cal.json", '"location"', '"magic"'),)),
    Mistake("remark in a calibration", f"{CORRECT}", "calibration cal.json", "there is no entry remark", "make the calibration anew", (change("cal.json", '"effects"', '"remark": "x", "effects"'),)),
    Mistake("output onto the data", "fit data.csv --machine gantry -o data.csv", "data.csv", "is an input and would be overwritten", "name another file"),
    Mistake("plan in place of the data", "fit plan.csv --machine gantry -o new.json", "plan.csv", "this is a plan, not its measurement", "header line '# instrument:"),
    Mistake("calibration in place of the data", "fit cal.json --machine gantry -o new.json", "cal.json", "this is a calibration of ncomp", "give the data of an instrument"),
    Mistake("program in place of the data", "fit in.nc --machine gantry -o new.json", "in.nc", "this is an NC program, no measurement", "give the data of an instrument"),
    Mistake("data misspelled", "fit dta.csv --machine gantry -o new.json", "measurement file dta.csv", "No such file", "did you mean 'data.csv'?"),
    Mistake("ISO 230-2 of tracker data", "iso230 data.csv --machine gantry", "data.csv", "ISO 230-2 needs", "data of an interferometer"),
    Mistake("table of a German display", "iso230 t.csv --machine gantry", "t.csv", "the format of the file is unknown", "write 'target_mm;1 up;1 down;...' above the numbers", (("t.csv", GERMAN),)),
    Mistake("targets without the names of runs", "iso230 t.csv --machine gantry --format iso230-table", "t.csv:1", "expected the names of the columns", "as in 'target_mm;1 up;1 down'", (("t.csv", GERMAN),)),
    Mistake("circles of tracker data", "ballbar data.csv --machine gantry", "data.csv", "circles need the measurement of a ballbar", "# instrument: ballbar"),
    Mistake("present calibration misspelled", "diagnose data.csv --machine gantry -c ca.json -o new.json", "calibration ca.json", "No such file", "did you mean 'cal.json'?"),
    Mistake("measurement in place of a calibration", "compare cal.json data.csv", "calibration data.csv", "this is a measurement file", "ncomp fit and ncomp diagnose read it"),
    Mistake("points without axis positions", "predict p.csv --machine gantry -c cal.json -o out.csv", "p.csv:1", "no column has commanded positions of an axis (X, Y, Z)", "--plan PLAN.csv", (("p.csv", "x,y,z\n1,2,3\n"),)),
    study("entry misspelled", "draws =", "drws =", 2, "drws is not known", "did you mean 'draws'?"),
    study("entry of a case misspelled", "points =", "point =", 7, "case[0].point is not known", "did you mean 'points'?"),
    study("strategy misspelled", '"grid"', '"gird"', None, "'gird' is none of", "did you mean 'grid'?"),
    study("no case", '[[case]]\nname = "a"\nstrategy = "grid"\npoints = 60\n', "", None, "case is missing", "write [[case]] with name, strategy and points"),
    data("remark between the rows", "data.csv:12", "header lines must be above", "move it there, or delete it", ("data.csv", _remark)),
    data("name in Latin-1", "data.csv:1", "not UTF-8 text", "save it as UTF-8", ("data.csv", lambda text: b"# operator: M\xfcller\n" + text.encode())),
    data("zero byte of a damaged disk", "data.csv:15", "a zero byte", "export it again", ("data.csv", lambda text: "\n".join([*text.split("\n")[:14], "\0", *text.split("\n")[14:]]))),
    Mistake("program in place of tests", "tracker in.nc", "in.nc", "this is an NC program", "give a CSV file of the tests"),
    Mistake("three points of a tracker on the table", "three-points data.csv --machine gantry -o t.json", "data.csv", "needs the tracker on the bed", "# stands_on: bed"),
    Mistake("calibration saved as Unicode", CORRECT, "calibration cal.json", "is UTF-16 text", "save it as UTF-8", (("cal.json", lambda text: text.encode("utf-16")),)),
    Mistake("remark of C in a calibration", CORRECT, "calibration cal.json", "JSON is malformed", "take an unchanged copy", (("cal.json", lambda text: "// of May\n" + text),)),
    Mistake("empty calibration", CORRECT, "calibration cal.json", "no ncomp calibration", "give a file of ncomp fit", (("cal.json", "{}"),)),
    Mistake("value in quotes in a calibration", CORRECT, "calibration cal.json: effects[0]", "expected a number, not a text in quotes", "make the calibration anew", (("cal.json", lambda text: re.sub(r"-?\d+\.\d+", '"1.5"', text, count=1)),)),
    Mistake("effect of an axis that is not there", CORRECT, "calibration cal.json", "backlash Q is of an axis that", "make the calibration anew", (("cal.json", lambda text: _with_effect(text, axis="Q", width=1.0)),)),
    Mistake("backlash in nanometres", CORRECT, "in.nc:9", "more than 500 um", "check calibration, machine and set-up", (("cal.json", lambda text: _with_effect(text, axis="X", width=1e6)),)),
)  # fmt: skip
