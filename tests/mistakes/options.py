"""Mistakes in the command line: names, values, and files of another kind."""

from __future__ import annotations

from tests.mistakes.mistake import Mistake

HEAD = "in.nc --machine gantry -c cal.json"
TAIL = f"{HEAD} --set-up-zero -o out.nc"
HELP = "'ncomp correct --help' lists its options"


def option(made: str, command: str, place: str, cause: str, cure: str) -> Mistake:
    """A mistake without a file."""
    return Mistake(made, command, place, cause, cure)


MISTAKES = (
    option("machine misspelled", "in.nc --machine gantri -o out.nc", "machine 'gantri'", "unknown machine", "did you mean 'gantry'?"),
    option("command misspelled", "verfy in.nc in.nc --machine gantry", "'verfy'", "neither a command nor a file", "did you mean 'verify'?"),
    option("option misspelled", f"{HEAD} --tolerence-um 2 -o out.nc", "--tolerence-um", "unknown option", "did you mean '--tolerance-um'?"),
    option("one dash in place of two", "in.nc -machine gantry -o out.nc", "-machine", "unknown option", "did you mean '--machine'?"),
    option("dash of a word processor", "in.nc \u2013machine gantry -o out.nc", "'\u2013machine'", "unexpected argument", "did you mean '--machine'?"),
    option("machine forgotten", "in.nc -o out.nc", "--machine NAME", "is missing", "name of a machine, or path"),
    option("value forgotten", "in.nc --machine -o out.nc", "--machine", "needs a value", "name of a machine, or path"),
    option("machine given twice", f"{TAIL} --machine dmu50", "--machine", "is given twice", "give it once"),
    option("no calibration", "in.nc --machine gantry -o out.nc", "machine gantry", "has no calibration of its own", "--calibration CAL.json"),
    option("calibration of another machine", "in.nc --machine cframe -c cal.json -o out.nc", "calibration cal.json", "of machine gantry", "give the machine of the calibration"),
    option("measurement as calibration", "in.nc --machine gantry -c data.csv -o out.nc", "calibration data.csv", "this is a measurement file", "ncomp fit and ncomp diagnose read it"),
    option("machine file as calibration", "in.nc --machine gantry -c mill.toml -o out.nc", "calibration mill.toml", "this is a machine file", "(--machine)"),
    option("calibration as machine", "in.nc --machine cal.json -o out.nc", "machine file cal.json", "this is a calibration", "(--calibration)"),
    option("folder that does not exist", f"programs/{TAIL}", "program programs/in.nc", "No such file", "the folder programs does not exist"),
    option("program misspelled", f"inn.nc {TAIL[6:]}", "program inn.nc", "No such file", "did you mean 'in.nc'?"),
    option("calibration misspelled", "in.nc --machine gantry -c call.json -o out.nc", "calibration call.json", "No such file", "did you mean 'cal.json'?"),
    option("work offset with semicolons", f"{HEAD} --work-offset 'G54=1;2;3' -o out.nc", "--work-offset G54=1;2;3", "'1;2;3' is no number", "separate numbers by ','"),
    option("work offset with decimal commas", f"{HEAD} --work-offset G54=1,5,2,5,3,5 -o out.nc", "--work-offset G54=1,5,2,5,3,5", "no axis for the fourth value", "'.' as the decimal point"),
    option("work offset without its name", f"{HEAD} --work-offset 1,2,3 -o out.nc", "--work-offset 1,2,3", "expected", "G54=x,y,z"),
    option("tool length with its unit", f"{HEAD} --tool-length T1=80mm -o out.nc", "--tool-length T1=80mm", "'80mm' is no number", "without its unit"),
    option("tool length without its number", f"{HEAD} --tool-length 80 -o out.nc", "--tool-length 80", "expected", "T1=mm"),
    option("negative tool", f"{HEAD} --tool-length T-1=80 -o out.nc", "--tool-length T-1=80", "the number of a tool", "is not negative"),
    option("tolerance with a comma", f"{TAIL} --tolerance-um 0,5", "--tolerance-um 0,5", "expected a number (um)", "decimal point as '.'"),
    option("negative tolerance", f"{TAIL} --tolerance-um -1", "--tolerance-um -1", "expected", "0 or more"),
    option("output onto the input", f"{HEAD} --set-up-zero -o in.nc", "--output in.nc", "is the input in.nc", "--in-place replaces it"),
    option("folder of the output misspelled", f"{HEAD} --set-up-zero -o corected/out.nc", "corected/out.nc", "the folder corected does not exist", "make the folder"),
    option("output onto the calibration", f"{HEAD} --set-up-zero -o cal.json", "cal.json", "is an input and would be overwritten", "name another file"),
    option("two outputs in one file", f"{TAIL} --report out.nc", "--output and --report", "both name out.nc", "name two files"),
    option("temperature without its sensor", f"{TAIL} --temperature 31.5", "--temperature 31.5", "expected SENSOR=degC", "for example spindle=31.5"),
    option("temperature with a comma", f"{TAIL} --temperature spindle=31,5", "--temperature spindle=31,5", "'31,5' is no number", "decimal point as '.'"),
    option("program as a log", f"{TAIL} --log in.nc", "log in.nc:1", "expected one column time_s", "the columns of a log are"),
    option("control in place of the dialect", f"{TAIL} --dialect klartext", "--dialect 'klartext'", "is none of", "auto, iso, siemens, heidenhain"),
    option("unknown acceptance", f"{TAIL} --accept stal", "--accept stal", "'stal' is unknown", "did you mean 'stale'?"),
    option("class misspelled", f"{TAIL} --classes L-VOLL", "--classes L-VOLL", "is none of", "did you mean 'L-VOL'?"),
    option("datum misspelled", f"{TAIL} --datum G54=probd", "--datum G54=probd", "expected", "probed, true, or probed@X.."),
    option("measurement as tool table", f"{TAIL} --tool-table data.csv", "tool table data.csv:", "is not a tool entry", "expected T1 P1 Z120.5"),
    option("programs of verify exchanged", f"verify done.nc {HEAD} --set-up-zero", "in.nc has no mark of ncomp", "done.nc has one", "give the original first"),
    option("programs that do not belong together", f"verify in.nc other.nc {HEAD[6:]} --set-up-zero", "the two programs", "do not make the same moves", "is the second one a correction"),
    option("folder without programs", f"batch empty out {HEAD[6:]}", "folder empty", "has no program", "--glob PATTERN chooses others"),
    option("file in place of the folder", f"batch in.nc out {HEAD[6:]}", "folder in.nc", "it is a file", "'ncomp correct' corrects one program"),
    option("folder into itself", f"batch empty empty {HEAD[6:]}", "the output folder empty", "is the input", "name another one"),
    option("several programs without a folder", f"in.nc done.nc {HEAD[6:]}", "2 programs", "are given", "name a folder for their outputs"),
    option("format of tables forgotten", f"export {HEAD[6:]} -o tables", "--format FORMAT", "is missing", "format of the tables"),
    option("format of tables misspelled", f"export {HEAD[6:]} --format linuxnc -o tables", "--format linuxnc", "expected one of", "did you mean 'linuxcnc'?"),
    option("strategy misspelled", "plan --machine gantry --strategy plans -o new.csv", "strategy 'plans'", "is none of", "did you mean 'planes'?"),
    option("effect misspelled", "fit data.csv --machine gantry --effect backlas:axis=X -o new.json", "--effect backlas:axis=X", "no effect 'backlas'", "did you mean 'backlash'?"),
    option("basis misspelled", "fit data.csv --machine gantry --basis legend:5 -o new.json", "basis 'legend:5'", "is none of", "legendre:N"),
    option("tool length in inches", f"{HEAD} --tool-length T1=4in -o out.nc", "--tool-length T1=4in", "'4in' is no number", "write mm, without the unit: 101.6"),
    Mistake("spreadsheet as a tool table", f"{HEAD} --tool-table a.xls -o out.nc", "tool table a.xls", "a binary file", "export it as text", (("a.xls", b"\xd0\xcf\x11\xe0" + bytes(100)),)),
    Mistake("log with names of its own", f"{TAIL} --log log.csv", "log log.csv:1", "expected one column time_s", "give a column map", (("log.csv", "Datum;Temperatur\n0;20\n"),)),
    Mistake("study in an old encoding", "study s.toml -o results.csv", "study s.toml", "not UTF-8 text", "save it as UTF-8", (("s.toml", 'machine = "gantry" # Prüfung\n'.encode("latin-1")),)),
    option("folder in place of the machine file", "in.nc --machine empty -o out.nc", "machine", "empty", "path of a .toml file"),
    option("uncertainty without its unit", "simulate --machine gantry --strategy grid --points 60 -u u_range=0.5 -o d.csv", "--uncertainty u_range=0.5", "laser-tracker has", "u_range_um"),
    option("position of two numbers", "simulate --machine gantry --strategy grid --points 60 --tracker=1,2 -o d.csv", "--tracker 1,2", "is not 3 numbers", "with ',' between them"),
    option("page as a PDF", f"{TAIL} --report report.pdf", "--report report.pdf", "a page is HTML", "ncomp report report.html --pdf report.pdf"),
    option("program as the folder of the output", f"{HEAD} --set-up-zero -o in.nc/out.nc", "in.nc/out.nc", "in.nc is a file", "name a folder"),
    option("name that is too long", f"{HEAD} --set-up-zero -o {'a' * 300}.nc", "aaa.nc", "File name too long", "choose a shorter name"),
    option("work offset given twice", f"{HEAD} --work-offset G54=1,2,3 --work-offset G54=4,5,6 -o out.nc", "--work-offset G54", "is given twice", "give it once"),
    option("version misspelled", "--verson", "--verson", "unknown option", "did you mean '--version'?"),
    option("measurement from a pipe", "fit - --machine gantry -o new.json", "measurement file -", "is not read from standard input", "name the file"),
    option("basis beyond its limits", "fit data.csv --machine gantry --basis legendre:100000 -o new.json", "basis 'legendre:100000'", "out of range", "expected 0 to 50"),
    option("range the wrong way round", "plan --machine gantry --strategy grid --points 60 --range X=900:100 -o p.csv", "axis X", "nothing is left between 900 and 100", "write the lower end first"),
    option("range beyond the travel", "plan --machine gantry --strategy grid --points 60 --range X=9000:9100 -o p.csv", "range X=9000:9100", "is not inside its travel", "choose a range within it"),
    option("margin beyond the travel", "plan --machine gantry --strategy grid --points 60 --margin 99999 -o p.csv", "axis X", "nothing is left", "choose a smaller margin"),
    option("spacing in metres", "plan --machine gantry --strategy grid --spacing 0.001 -o p.csv", "a spacing that makes", "more than the limit", "choose a larger spacing"),
    option("plan misspelled", "simulate --machine gantry --strategy pln.csv -o d.csv", "--strategy pln.csv", "there is no such file", "did you mean 'plan.csv'?"),
    option("plan onto its own program", "plan --machine gantry --strategy grid --points 60 --nc p.csv -o p.csv", "--output and --nc", "both name p.csv", "name two files"),
    option("program in place of tables", "import in.nc --machine gantry --format linuxcnc -o old.json", "in.nc", "expected one file *.ini", "name the folder"),
    option("folder of the tutorial within a missing one", "tutorial no/such", "cannot write no/such", "the folder no does not exist", "make the folder"),
    option("tutorial onto a file", "tutorial in.nc", "cannot write in.nc", "it is no folder", "name a new folder"),
    option("job onto a file", "init job.toml --machine gantry", "cannot write job.toml", "File exists", "name another one"),
    option("seed that is no whole number", "simulate --machine gantry --strategy plan.csv --seed 1.5 -o d.csv", "--seed 1.5", "expected a whole number", "'ncomp simulate --help'"),
)  # fmt: skip
