"""Mistakes in names of files and folders, in batches, watched folders, hooks, heads of pages and exports."""

from __future__ import annotations

from tests.mistakes.mistake import Mistake

GIVEN = "--machine gantry -c cal.json --set-up-zero"
PLAIN = "G21 G90\nG0 X1. Y1. Z1.\n"
PROGRAMS = (("p/in.nc", PLAIN),)
EXPORT = "export --machine dmu50 --format fanuc-kinematics"


def head(made: str, text: str, place: str, cause: str, cure: str) -> Mistake:
    """A mistake in a file of the page's head."""
    command = f"in.nc {GIVEN} -o out.nc --report page.html --report-head head.toml"
    return Mistake(made, command, place, cause, cure, (("head.toml", text),))


MISTAKES = (
    Mistake("batch without its output", "batch empty --machine gantry", "batch: OUT", "is missing", "folder of the corrected programs"),
    Mistake("batch into a file", f"batch p in.nc {GIVEN}", "in.nc", "it is a file", "name a folder", PROGRAMS),
    Mistake("pattern that no name has", f"batch p out --glob '*.mpf' {GIVEN}", "folder p", "has no program", "expected *.mpf", PROGRAMS),
    Mistake("batch with -1 processes", f"batch p out --jobs -1 {GIVEN}", "batch: --jobs -1", "expected 1 or more", "'ncomp batch --help'", PROGRAMS),
    Mistake("folder of a batch misspelled", f"batch empti out {GIVEN}", "folder empti", "No such file", "did you mean 'empty'?"),
    Mistake("page of a batch onto a program", f"batch p out {GIVEN} --report p/in.nc", "p/in.nc", "is an input and would be overwritten", "name another file", PROGRAMS),
    Mistake("watched folder misspelled", f"watch empti out {GIVEN}", "folder empti", "No such file", "did you mean 'empty'?"),
    Mistake("folder watched into itself", f"watch empty empty {GIVEN}", "the output folder empty", "is the input", "name another one"),
    Mistake("file watched", f"watch in.nc out {GIVEN}", "folder in.nc", "it is a file", "'ncomp correct' corrects one program"),
    Mistake("folder watched into a file", f"watch empty in.nc {GIVEN} --idle 0", "in.nc", "it is a file", "name a folder"),
    Mistake("no time to settle", f"watch empty out {GIVEN} --settle 0", "watch: --settle 0", "expected 0.1 or more", "'ncomp watch --help'"),
    Mistake("machine of a watched folder misspelled", "watch empty out --machine gantri --idle 0", "machine 'gantri'", "unknown machine", "did you mean 'gantry'?"),
    Mistake("calibration of a watched folder misspelled", "watch empty out --machine gantry -c call.json --idle 0", "calibration call.json", "No such file", "did you mean 'cal.json'?"),
    Mistake("hook misspelled", "hook freecat", "hook 'freecat'", "unknown", "did you mean 'freecad'?"),
    Mistake("comparison of a calibration with itself", "compare cal.json cal.json", "cal.json and cal.json", "are one file", "name the calibrations"),
    Mistake("hook onto a file", "hook nx -o in.nc", "cannot write in.nc", "it is a file", "name a folder"),
    Mistake("two hooks", "hook nx fusion", "hook", "unexpected argument 'fusion'", "'ncomp hook --help'"),
    Mistake("installation of a hook that is not FreeCAD's", "hook nx --install", "--install", "is for freecad alone", "with -o FOLDER"),
    Mistake("kinematic parameters of three axes", "export --machine gantry -c cal.json --format fanuc-kinematics -o kins", "machine gantry", "has types for two rotary axes", "in the head (2), in the table (12)"),
    Mistake("setting of another format", f"{EXPORT} --set pitch=1 -o kins", "--set pitch=1", "expected NAME=VALUE", "decimals"),
    Mistake("kinematic format misspelled", f"{EXPORT[:-1]} -o kins", "--format fanuc-kinematic", "expected one of", "did you mean 'fanuc-kinematics'?"),
    Mistake("kinematic parameters onto a file", f"{EXPORT} -o in.nc", "cannot write in.nc", "expected a new or empty folder", "empty folder"),
    Mistake("sign in words", f"{EXPORT} --sign plus -o kins", "--sign plus", "expected", "error or correction"),
    Mistake("length of the tool in words", f"{EXPORT} --tool-mm long -o kins", "--tool-mm long", "expected a number (mm)", "'ncomp export --help'"),
    Mistake("sign that no source states", "export --machine head_table -c none --format heidenhain-kinematics -o kins", "heidenhain-kinematics", "no source states", "give --sign error or --sign correction"),
    head("entry of the head misspelled", '[report]\noperater = "x"\n', "report head head.toml:2", "report.operater is not known", "did you mean 'operator'?"),
    head("head without its table", 'operator = "x"\n', "report head head.toml", "has no table [report]", "write [report] above its entries"),
    head("list in the head", '[report]\noperator = ["x"]\n', "report head head.toml:2", "report.operator", "expected a text, a number or a date"),
    Mistake("head without a page", f"in.nc {GIVEN} -o out.nc --report-head job.toml", "--report-head job.toml", "there is no page", "add --report FILE.html"),
    Mistake("measurement as a head", f"in.nc {GIVEN} -o out.nc --report page.html --report-head data.csv", "report head data.csv", "this is a measurement file", "ncomp fit and ncomp diagnose read it"),
    Mistake("letters of another alphabet in a missing folder", f"in.nc {GIVEN} -o Größe/тест.nc", "Größe/тест.nc", "the folder Größe does not exist", "make the folder"),
    Mistake("line end in a name", f"in.nc {GIVEN} -o 'no/a\nb.nc'", r"no/a\nb.nc", "the folder no does not exist", "make the folder"),
    Mistake("escape sequence in a name", f"'in\x1b[2J.nc' {GIVEN} -o out.nc", r"program in\x1b[2J.nc", "No such file", "did you mean 'in.nc'?"),
    Mistake("folder with a slash as output", f"in.nc {GIVEN} -o no/", "cannot write no/", "Is a directory", "give the name of a file"),
    Mistake("pattern in quotes", f"'*.nc' {GIVEN} -o out.nc", "program *.nc", "No such file", "did you mean 'in.nc'?"),
    Mistake("address in place of a file", f"https://shop/in.nc {GIVEN} -o out.nc", "program https://shop/in.nc", "No such file", "the folder https:/shop does not exist"),
    Mistake("full disk", f"in.nc {GIVEN} -o /dev/full", "cannot write /dev/full", "No space left on device", "make room on the disk"),
    Mistake("drawing onto its machine", "machines mill.toml --draw mill.toml", "mill.toml", "is an input and would be overwritten", "name another file"),
    Mistake("calibration onto its data", "fit data.csv --machine gantry -o data.csv", "data.csv", "is an input and would be overwritten", "name another file"),
    Mistake("prediction onto its points", "predict data.csv --machine gantry -c cal.json -o data.csv", "data.csv", "is an input and would be overwritten", "name another file"),
    Mistake("PDF onto its page", "report p.html --pdf p.html", "p.html", "is an input and would be overwritten", "name another file", (("p.html", '<meta name="generator" content="ncomp">'),)),
    Mistake("true errors onto the data", "simulate --machine gantry --strategy plan.csv --truth d.csv -o d.csv", "--output and --truth", "both name d.csv", "name two files"),
    Mistake("measurement onto its plan", "simulate --machine gantry --strategy plan.csv -o plan.csv", "plan.csv", "is an input and would be overwritten", "name another file"),
    Mistake("page of a comparison onto a calibration", "compare cal.json cal.json --report cal.json", "cal.json", "is an input and would be overwritten", "name another file"),
    Mistake("results of a study onto the study", "study s.toml -o s.toml", "s.toml", "is an input and would be overwritten", "name another file", (("s.toml", 'machine = "gantry"\n'),)),
    Mistake("program and results on one standard output", f"in.nc {GIVEN} -o - --json -", "--output and --json", "cannot both go to standard output", "name a file for one"),
    Mistake("standard input in its place", f"- {GIVEN} --in-place", "--in-place", "standard input is not a file", "give -o OUT.nc instead"),
    Mistake("replaced and written elsewhere", f"in.nc {GIVEN} --in-place -o out.nc", "--in-place replaces the input in.nc", "--output names out.nc", "give one of them"),
    Mistake("nothing on standard input", f"- {GIVEN} -o out.nc", "program <stdin>", "is empty", "write it again from the CAM"),
    Mistake("path as the name of a machine", "init new --name ../x --chain 'w b X Y Z t'", "--name ../x", "expected a name of letters", "digits, - and _"),
    Mistake("travel with its unit", "init new --name m --chain 'w b X Y Z t' --travel X=0:500mm", "--travel X=0:500mm", "is not 2 numbers", "with ':' between them"),
    Mistake("travel with one end", "init new --name m --chain 'w b X Y Z t' --travel X=0:inf", "--travel X=0:inf", "travel 0:inf", "expected -inf:inf"),
    Mistake("two machines", "machines gantry dmu50", "machines: unexpected argument 'dmu50'", "expected NAME", "'ncomp machines --help'"),
)  # fmt: skip
