"""Links that lead nowhere or in a circle, packed files, spreadsheets, and files without a content."""

from __future__ import annotations

import gzip
import io
import zipfile

from tests.mistakes.measurements import CORRECT, data
from tests.mistakes.mistake import PROGRAM, Mistake
from tests.mistakes.programs import TAIL, file

GIVEN = "--machine gantry -c cal.json --set-up-zero"
HEAD = f"in.nc {TAIL} --report page.html --report-head h.toml"
PACKED = gzip.compress(b"# machine: gantry\n", mtime=0)


def _workbook() -> bytes:
    """A spreadsheet with nothing in it."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("xl/workbook.xml", "<workbook/>")
    return stream.getvalue()


SHEET = _workbook()


def link(made: str, command: str, place: str, cause: str, cure: str, *links: tuple[str, str]) -> Mistake:
    """A mistake in a link."""
    return Mistake(made, command, place, cause, cure, links=links)


CIRCLE, ITSELF = "Too many levels of symbolic links", "the link points to itself; name the file"
MISTAKES = (
    link("program in a circle of links", f"loop.nc {TAIL}", "program loop.nc", CIRCLE, ITSELF, ("loop.nc", "loop.nc")),
    link("program behind a dead link", f"gone.nc {TAIL}", "program gone.nc", "No such file", "it is a link to nowhere.nc", ("gone.nc", "nowhere.nc")),
    link("calibration in a circle of links", "in.nc --machine gantry -c loop.json --set-up-zero -o out.nc", "calibration loop.json", CIRCLE, ITSELF, ("loop.json", "other.json"), ("other.json", "loop.json")),
    link("machine in a circle of links", "in.nc --machine loop.toml -o out.nc", "machine file loop.toml", CIRCLE, ITSELF, ("loop.toml", "loop.toml")),
    link("output in a circle of links", f"in.nc {GIVEN} -o loop.nc", "cannot write loop.nc", CIRCLE, ITSELF, ("loop.nc", "loop.nc")),
    link("page in a circle of links", f"in.nc {GIVEN} -o out.nc --report loop.html", "cannot write loop.html", CIRCLE, ITSELF, ("loop.html", "loop.html")),
    link("output behind a link to the input", f"in.nc {GIVEN} -o link.nc", "--output link.nc", "is the input in.nc", "--in-place replaces it", ("link.nc", "in.nc")),
    link("output behind a link into a missing folder", f"in.nc {GIVEN} -o link.nc", "cannot write link.nc", "No such file or directory", "it is a link to no/where.nc", ("link.nc", "no/where.nc")),
    link("output behind a link to a folder", f"in.nc {GIVEN} -o link.nc", "cannot write link.nc", "Is a directory", "give the name of a file", ("link.nc", "empty")),
    link("folder in a circle of links", f"batch loop out {GIVEN}", "folder loop", "No such file or directory", "it is a link to loop", ("loop", "loop")),
    link("data behind a link to the output", "fit data.csv --machine gantry -o link.json", "link.json", "is an input and would be overwritten", "name another file", ("link.json", "data.csv")),
    link("job in a circle of links", "loop.toml", "job file loop.toml", CIRCLE, ITSELF, ("loop.toml", "loop.toml")),
    Mistake("name in capitals", f"IN.NC {TAIL}", "program IN.NC", "No such file", "did you mean 'in.nc'?"),
    Mistake("machine in capitals", "in.nc --machine GANTRY -c cal.json -o out.nc", "machine 'GANTRY'", "unknown machine", "did you mean 'gantry'?"),
    Mistake("command in capitals", "FIT data.csv --machine gantry -o new.json", "'FIT'", "neither a command nor a file", "did you mean 'fit'?"),
    Mistake("option in capitals", f"in.nc --Machine gantry {TAIL[17:]}", "--Machine", "unknown option", "did you mean '--machine'?"),
    Mistake("page onto its head", f"in.nc {TAIL} --report h.toml --report-head h.toml", "h.toml", "is an input and would be overwritten", "name another file", (("h.toml", "[report]\n"),)),
    Mistake("results onto the head of the page", f"{HEAD} --json h.toml", "h.toml", "is an input and would be overwritten", "name another file", (("h.toml", "[report]\n"),)),
    Mistake("packed head of the page", HEAD, "report head h.toml", "this is a packed archive", "unpack it", (("h.toml", PACKED),)),
    Mistake("table in the head of the page", HEAD, "report head h.toml:2: report.operator", "expected", "a text, a number or a date", (("h.toml", "[report]\noperator = { first = 1 }\n"),)),
    Mistake("entry twice in the head of the page", HEAD, "report head h.toml:3", "Cannot overwrite a value", "expected name = value", (("h.toml", "[report]\nplace = 'a'\nplace = 'b'\n"),)),
    Mistake("packed machine file", "machines mill.toml", "machine file mill.toml", "this is a packed archive", "unpack it", (("mill.toml", PACKED),)),
    Mistake("spreadsheet as a job file", "job.toml", "job file job.toml", "this is a ZIP archive or a spreadsheet", "export the sheet as text", (("job.toml", SHEET),)),
    Mistake("packed calibration", CORRECT, "calibration cal.json", "this is a packed archive, no calibration", "give a file of ncomp fit", (("cal.json", PACKED),)),
    Mistake("list as a calibration", CORRECT, "calibration cal.json", "expected a table, not a list", "make the calibration anew", (("cal.json", "[]"),)),
    Mistake("calibration of single quotes", CORRECT, "calibration cal.json", "JSON is malformed", "take an unchanged copy", (("cal.json", lambda text: text.replace('"', "'")),)),
    Mistake("comma behind the last entry", CORRECT, "calibration cal.json", "trailing comma", "take an unchanged copy", (("cal.json", lambda text: f"{text.rstrip()[:-1]},}}"),)),
    Mistake("packed log", f"in.nc {TAIL} --log log.csv", "log log.csv", "this is a packed archive", "unpack it", (("log.csv", PACKED),)),
    Mistake("packed tool table", f"in.nc {TAIL} --tool-table t.tbl", "tool table t.tbl", "a binary file", "export it as text", (("t.tbl", PACKED),)),
    data("workbook in place of text", "data.csv", "this is a ZIP archive or a spreadsheet", "give the data of an instrument", ("data.csv", SHEET)),
    data("page of an error in place of data", "data.csv", "this is a web page", "give the data of an instrument", ("data.csv", "<html><body>404</body></html>")),
    Mistake("spreadsheet of points", "predict p.xlsx --machine gantry -c cal.json -o p.csv", "p.xlsx:1", "this is a ZIP archive or a spreadsheet", "export the sheet as text", (("p.xlsx", SHEET),)),
    Mistake("points with semicolons", "predict p.csv --machine gantry -c cal.json -o p_out.csv", "p.csv:1", "separate cells by commas", "a decimal point", (("p.csv", "X;Y;Z\n1,5;0;0\n"),)),
    Mistake("spreadsheet as a column map", "fit a.txt --machine gantry --columns m.toml -o n.json", "column map m.toml", "this is a ZIP archive or a spreadsheet", "export the sheet as text", (("a.txt", "1 2 3\n"), ("m.toml", SHEET))),
    Mistake("column map misspelled", "fit a.txt --machine gantry --columns spatialanalyser -o n.json", "--columns 'spatialanalyser'", "is none of", "did you mean 'spatialanalyzer'?", (("a.txt", "1 2 3\n"),)),
    Mistake("packed tables", "import t.gz --machine gantry --format linuxcnc -o old.json", "tables t.gz", "expected a text file, found a packed archive", "give the files of the control", (("t.gz", PACKED),)),
    Mistake("packed page", "report p.html --pdf p.pdf", "report p.html", "found a packed archive", "expected a page written by --report", (("p.html", PACKED),)),
    file("XML of a CAM system", "in.nc", "<?xml version='1.0'?>\n<job/>\n", "this is an XML file", "the file that the CAM has posted"),
    file("page of ncomp in place of the program", "in.nc", '<!doctype html><meta name="generator" content="ncomp">', "this is a web page", "the file that the CAM has posted"),
    file("byte order mark alone", "in.nc", b"\xef\xbb\xbf\r\n", "is empty", "write it again from the CAM"),
    file("line without an end", "in.nc", PROGRAM.replace("X200.", f"X200.{' ' * 1_100_000}"), "a line of more than 1000000 characters", "this is no NC program", "in.nc:9: "),
    file("label twice", "in.nc", PROGRAM.replace("N70 X200. Y150.", "N70 GOTO 60\nN60 X1."), "2 blocks have the label 60", "write it once", "in.nc:9: "),
)  # fmt: skip
