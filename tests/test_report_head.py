"""The head of a report: entries of the machine file, of a file of its own, and lines to write on."""

import re
from pathlib import Path

import pytest

import machines
from kinematics.files.report_head import ReportHead, read_head
from kinematics.user_error import UserError

DEMO = ("--machine", "mill.toml", "--set-up-zero", "-c", "none", "-o", "out.nc", "--report", "out.html")
MILL = (Path(machines.__file__).parent / "gantry.toml").read_text()


def entries(page):
    """The head of a page by the names of its entries."""
    head = page.split('<dl class="head">')[1].split("</dl>")[0]
    return dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", head))


@pytest.fixture
def ncomp(command, tmp_path):
    """The command line, in a folder with a program and a machine whose file has the head of its reports."""
    (tmp_path / "in.nc").write_text("G21 G90\nG0 X100.0 Y100.0 Z100.0\n")
    (tmp_path / "mill.toml").write_text(MILL + '\n[report]\nserial_number = "4711"\noperator = "A. Müller"\n')
    return command


def test_entries_of_the_machine_file_and_gaps(ncomp):
    assert ncomp("in.nc", *DEMO).status == 0
    head = entries(Path("out.html").read_text())
    assert (head["serial number"], head["operator"], head["place"]) == ("4711", "A. Müller", "")


def test_entries_of_a_file_come_first(ncomp):
    Path("head.toml").write_text(
        'machine = "m"\n[report]\noperator = "B. Meier"\ntemperature = 20.4\nmeasured = 2026-11-03\n'
    )
    assert ncomp("in.nc", *DEMO, "--report-head", "head.toml").status == 0
    head = entries(Path("out.html").read_text())
    assert (head["operator"], head["serial number"]) == ("B. Meier", "4711")
    assert (head["temperature"], head["measured"]) == ("20.4 °C", "2026-11-03")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[report]\noperater = "x"\n', "report.operater is not known (did you mean 'operator'?)"),
        ("[report]\noperator = [1]\n", "report.operator: expected a text, a number or a date"),
        ("[report]\noperator = true\n", "report.operator: expected a text, a number or a date"),
        ('[report]\ncommand = "x"\n', "report.command is not known"),
        ('operator = "x"\n', "the file has no table [report]"),
        ("report = 1\n", "the file has no table [report]"),
        ("[report\n", "report head head.toml:1: "),
        (None, "report head head.toml: No such file or directory"),
    ],
)
def test_refused_files_leave_no_output(ncomp, text, message):
    if text is not None:
        Path("head.toml").write_text(text)
    done = ncomp("in.nc", *DEMO, "--report-head", "head.toml")
    assert (done.status, done.out) == (2, b"")
    assert message in done.err
    assert not Path("out.nc").exists()


def test_a_wrong_entry_of_a_machine_file_is_refused(ncomp):
    Path("mill.toml").write_text(MILL + '\n[report]\nserial = "4711"\n')
    done = ncomp("in.nc", *DEMO)
    assert done.status == 2
    assert ": report.serial is not known (did you mean 'serial_number'?)" in done.err


def test_a_head_below_another_fills_its_gaps(tmp_path):
    (tmp_path / "a.toml").write_text('[report]\nplace = "hall 3"\n')
    head = read_head(tmp_path / "a.toml")
    assert ReportHead(place="hall 1", operator="x").under(head) == ReportHead(place="hall 3", operator="x")
    assert head.filled(place="y", order="z") == ReportHead(place="hall 3", order="z")
    with pytest.raises(UserError, match="No such file"):
        read_head(tmp_path / "b.toml")
