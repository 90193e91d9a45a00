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
    entry("two programs into one output", '"in.nc" = "out/out.nc"', '"in.nc" = "out/out.nc"\n"other.nc" = "out/out.nc"', 15, "in.nc has the same output", "out/out.nc"),
    entry("results and page into one file", "[programs]", '[results]\njson = "r"\nreport = "r"\n\n[programs]', 15, "results.report: r is the output of results.json too", "name another file"),
    entry("results onto the program", "[programs]", '[results]\njson = "in.nc"\n\n[programs]', 14, "results.json: in.nc is read by this job", "name another file"),
    entry("results onto the output", "[programs]", '[results]\njson = "out/out.nc"\n\n[programs]', 14, 'is the output of programs."in.nc" too', "name another file"),
    entry("page onto the calibration", "[programs]", '[results]\nreport = "cal.json"\n\n[programs]', 14, "results.report: cal.json is read by this job", "name another file"),
    entry("output onto the calibration of the job", '"out/out.nc"', '"cal.json"', 14, 'programs."in.nc": cal.json is read by this job', "name another file"),
    entry("output onto another program of the job", '"out/out.nc"', '"other.nc"\n"other.nc" = "out/other.nc"', 14, "other.nc is read by this job", "name another file"),
    entry("tool with two names", "1 = 80.0", "1 = 80.0\nT1 = 81.0", 9, "tools.T1: this is tool 1 again", "give its length once"),
    entry("standard output in place of a file", '"out/out.nc"', '"-"', 14, 'programs."in.nc"', "the names of two files or folders"),
    entry("output without a name", '"out/out.nc"', '""', 14, 'programs."in.nc"', "the names of two files or folders"),
    entry("program without a name", '"in.nc" =', '"" =', 14, 'programs.""', "the names of two files or folders"),
    entry("folder of programs into a file", '"in.nc" = "out/out.nc"', '"empty" = "in.nc"', 14, "cannot write in.nc: it is a file", "name a folder"),
    entry("folder without a program", '"in.nc" =', '"empty" =', 14, "folder empty has no program", "expected a name that ends in"),
    entry("programs as a list", "[programs]", "[[programs]]", 13, "programs: expected a table", "not a list in [ ]"),
    entry("entry of the head misspelled", "[programs]", '[report]\noperater = "A. Smith"\n\n[programs]', 14, "report.operater is not known", "did you mean 'operator'?"),
    entry("temperature of the head that is no number", "[programs]", "[report]\ntemperature = nan\n\n[programs]", 14, "nan is not finite", "temperature"),
    entry("machine twice", 'machine = "gantry"', 'machine = "gantry"\nmachine = "dmu50"', 2, "Cannot overwrite a value", "expected name = value"),
    entry("length of a tool with its unit", "1 = 80.0", '1 = "80 mm"', 8, "tools.1", "expected a number, not a text in quotes"),
    entry("negative time", "[programs]", "[conditions]\nelapsed_s = -1\n\n[programs]", 14, "conditions.elapsed_s", "expected a number >= 0"),
    entry("log misspelled", "[programs]", '[conditions]\nlog = "in.csv"\n\n[programs]', 14, "conditions.log: in.csv: No such file", "did you mean"),
    entry("temperature in quotes", "[programs]", '[conditions]\ntemperature = { spindle = "31" }\n\n[programs]', 14, "conditions.temperature", "expected a number, not a text in quotes"),
    entry("switch in quotes", "tolerance_um = 1.0", 'unroll = "yes"', 11, "correction.unroll", "expected true or false, not a text in quotes"),
    Mistake("option of a correction beside a job", "job.toml --work-offset G54=1,2,3", "--work-offset", "unknown option", "entries of the job file (docs/job.md)"),
    Mistake("two job files", "job.toml job.toml", "job: unexpected argument 'job.toml'", "expected JOB.toml", "'ncomp job --help'"),
    Mistake("job without processes", "job.toml --jobs 0", "job: --jobs 0", "expected 1 or more", "'ncomp job --help'"),
)  # fmt: skip
