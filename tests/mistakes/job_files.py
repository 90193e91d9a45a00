"""Mistakes in job files."""

from __future__ import annotations

from tests.mistakes.mistake import Mistake, change


def entry(made: str, old: str, new: str, line: int | None, cause: str, cure: str) -> Mistake:
    """A mistake in a line of the job file; None for an entry that is nowhere."""
    place = "job file job.toml: " if line is None else f"job file job.toml:{line}: "
    return Mistake(made, "job.toml", place, cause, cure, (change("job.toml", old, new),))


MISTAKES = (
    entry("entry misspelled", "machine =", "machne =", 1, "machne is not known", "did you mean 'machine'?"),
    entry("table misspelled", "[tools]", "[tool]", 7, "tool is not known", "did you mean 'tools'?"),
    entry("machine misspelled", '"gantry"', '"gantri"', 1, "unknown machine 'gantri'", "did you mean 'gantry'?"),
    entry("text without quotes", '"gantry"', "gantry", 1, "Invalid value", "write texts in quotes"),
    entry("decimal comma", "tolerance_um = 1.0", "tolerance_um = 1,0", 11, "'tolerance_um = 1,0': column", "decimal point as '.'"),
    entry("path of another computer", '"in.nc"', '"C:/jobs/in.nc"', 14, "No such file", "the folder C:/jobs does not exist"),
    entry("program misspelled", '"in.nc"', '"inn.nc"', 14, "No such file", "did you mean 'in.nc'?"),
    entry("calibration misspelled", '"cal.json"', '"call.json"', 2, "calibration: call.json: No such file", "did you mean 'cal.json'?"),
    entry("axis that is not there", "Y = 20", "B = 20", 5, "has no axis B", "machine gantry (w b X Y Z t)"),
    entry("offset in quotes", "Y = 20", 'Y = "20"', 5, "not '20'", "work_offsets.G54.Y: expected a number"),
    entry("datum misspelled", '"probed"', '"probbed"', 5, "work_offsets.G54.datum", "expected probed, true, or probed@"),
    entry("negative tool", "1 = 80.0", "-1 = 80.0", 8, "tools.-1", "the number of a tool is not negative"),
    entry("output onto the input", '"out/out.nc"', '"in.nc"', 14, "the output is the program itself", "name another file"),
    entry("programs forgotten", '[programs]\n"in.nc" = "out/out.nc"\n', "", None, "programs is missing", "write programs"),
    entry("acceptance misspelled", "tolerance_um = 1.0", 'accept = ["stal"]', 11, "'stal' is unknown", "did you mean 'stale'?"),
    entry("class misspelled", "tolerance_um = 1.0", 'classes = "L-VOLL"', 11, "'L-VOLL' is none of", "did you mean 'L-VOL'?"),
    entry("dialect misspelled", "calibration =", 'dialect = "heidenhein"\ncalibration =', 2, "'heidenhein' is none of", "did you mean 'heidenhain'?"),
    entry("negative tolerance", "tolerance_um = 1.0", "tolerance_um = -1.0", 11, "correction.tolerance_um", "expected a number >= 0"),
    entry("output onto the job file", '"out/out.nc"', '"job.toml"', 14, "the output is the job file itself", "name another file"),
    entry("page onto the job file", "[programs]", '[results]\nreport = "job.toml"\n\n[programs]', 14, "results.report: the output is the job file itself", "name another file"),
    entry("folder in place of the calibration", '"cal.json"', '"empty"', 2, "calibration: empty: this is a folder", "give a file"),
    Mistake("saved as Unicode", "job.toml", "job file job.toml", "not UTF-8 text", "save it as UTF-8", (("job.toml", 'machine = "gantry"\n'.encode("utf-16")),)),
    Mistake("job file misspelled", "jb.toml", "job file jb.toml", "No such file", "did you mean 'job.toml'?"),
    Mistake("machine file in place of the job file", "mill.toml", "job file mill.toml", "this is a machine file", "(--machine)"),
    entry("program without quotes", '"in.nc" =', "in.nc =", 14, "expected a text in quotes, not a table", "write a name with a point in it in quotes"),
    entry("number in place of an output", '"out/out.nc"', "5", 14, 'programs."in.nc"', "expected a text in quotes, not a whole number"),
    entry("job file as its machine", '"gantry"', '"job.toml"', 1, "machine file job.toml:1: machine is not known", "did you mean 'chain'?"),
    entry("path with backslashes", '"in.nc" =', '"jobs\\upper\\in.nc" =', 14, "column", "write paths with /"),
    entry("impossible date", "[programs]", "[report]\nmeasured = 2026-13-40\n\n[programs]", 14, "'measured = 2026-13-40'", "write a date as year-month-day"),
    entry("date with points", "[programs]", "[report]\nmeasured = 03.11.2026\n\n[programs]", 14, "'measured = 03.11.2026'", "write a date as year-month-day"),
)  # fmt: skip
