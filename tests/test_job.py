"""Job files: the outputs are those of the options, and a wrong entry is refused with its line."""

import json
import re
from pathlib import Path

import pytest
from support.file_examples import PROGRAM

from kinematics.files.mistaken import kind_of_file
from kinematics.files.toml_entries import line_of

JOB = """\
machine = "gantry"
calibration = "cal.json"

[work_offsets]
G54 = { X = 10, Y = 20.5, Z = -3, datum = "probed@X11,Y21,Z-3,probe=80" }

[tools]
1 = 80.0

[conditions]
elapsed_s = 60

[correction]
tolerance_um = 0.5

[results]
json = "results.json"
report = "page.html"

[report]
operator = "M. Smith"

[programs]
"in.nc" = "made/out.nc"
"""
OPTIONS = (
    *("--machine", "gantry", "--calibration", "cal.json", "--tool-length", "T1=80"),
    *("--work-offset", "G54=10,20.5,-3", "--datum", "G54=probed@X11,Y21,Z-3,probe=80"),
    *("--elapsed", "60", "--tolerance-um", "0.5"),
)


def test_the_output_is_that_of_the_options(ncomp, tmp_path, monkeypatch):
    Path("job.toml").write_text(JOB)
    assert ncomp("in.nc", *OPTIONS, "-o", "expected.nc").status == 0
    monkeypatch.chdir("/")
    result = ncomp(tmp_path / "job.toml")
    assert result.status == 0, result.err
    assert (tmp_path / "made/out.nc").read_bytes() == (tmp_path / "expected.nc").read_bytes()
    assert json.loads((tmp_path / "results.json").read_text())["moves"]["read"] == 3
    assert "M. Smith" in (tmp_path / "page.html").read_text()


def test_check_of_a_job_uses_its_set_up_and_writes_nothing(ncomp, tmp_path):
    Path("job.toml").write_text(JOB)
    before = sorted(tmp_path.rglob("*"))
    done = ncomp("job.toml", "--check")
    assert (done.status, done.err) == (0, "")
    assert done.out == ncomp("check", "in.nc", *OPTIONS[:2], *OPTIONS[4:8]).out
    assert b"in.nc: Accepted." in done.out
    Path("in.nc").write_text(f"G234\nG4711\n{PROGRAM}")
    refused = ncomp("job.toml", "--check")
    assert refused.status == 2
    assert b"in.nc: Refused: 2 blocks. The later ones may follow from the first." in refused.out
    assert sorted(tmp_path.rglob("*")) == before


def test_check_of_several_programs_accepts_a_set_up_that_one_of_them_uses(ncomp):
    Path("other.nc").write_text(PROGRAM.replace("G21", "G55 G21"))
    Path("job.toml").write_text(
        'machine = "gantry"\ncalibration = "cal.json"\nset_up_zero = true\n[work_offsets]\n'
        'G55 = { X = 1, Y = 2, Z = 0 }\n[programs]\n"in.nc" = "a.nc"\n"other.nc" = "b.nc"\n'
    )
    assert ncomp("job.toml", "--check").status == 0
    quiet = ncomp("job.toml", "--check", "--quiet")
    assert quiet.out.decode().split() == ["in.nc:", "Accepted.", "other.nc:", "Accepted."]
    Path("job.toml").write_text(Path("job.toml").read_text().replace("G55", "G45"))
    done = ncomp("job.toml", "--check")
    assert done.status == 2
    assert "NOT USED BY ANY PROGRAM: work offset G45" in done.err


def test_patterns_of_programs(ncomp):
    for name in ("posted/a.MPF", "posted/b.MPF", "posted/deep/c.MPF", "posted/notes.txt", "posted/.hidden.MPF"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(PROGRAM)
    head = 'machine = "gantry"\ncalibration = "none"\nset_up_zero = true\ndialect = "iso"\n[programs]\n'
    Path("job.toml").write_text(f'{head}"posted/*.MPF" = "corrected"\n')
    done = ncomp("job.toml", "--jobs", "1")
    assert done.status == 0, done.shown
    assert sorted(path.name for path in Path("corrected").rglob("*")) == ["a.MPF", "b.MPF"]
    Path("job.toml").write_text(f'{head}"posted/**/*.MPF" = "posted/all"\n')
    for _ in range(2):  # the outputs of the first run lie in the folder of the pattern
        assert ncomp("job.toml", "--jobs", "1").status == 0
        assert sorted(map(str, Path("posted/all").rglob("*.MPF"))) == [
            "posted/all/a.MPF", "posted/all/b.MPF", "posted/all/deep/c.MPF"
        ]  # fmt: skip
    Path("job.toml").write_text(f'{head}"posted/*.H" = "corrected"\n')
    done = ncomp("job.toml", "--jobs", "1")
    assert done.status == 2
    assert 'job.toml:6: programs."posted/*.H": no file has a name of this pattern' in done.err
    Path("job.toml").write_text(f'{head}"posted/*.MPF" = "posted"\n')
    assert "no file has a name of this pattern outside the output folder" in ncomp("job.toml", "--jobs", "1").err


def test_programs_and_folders(ncomp):
    for name in ("one/a.nc", "one/deep/b.nc", "two.nc"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(PROGRAM)
    Path("refused.nc").write_text("G31 X5\n")
    text = JOB.replace('"in.nc" = "made/out.nc"', '"one" = "made"\n"two.nc" = "."\n"refused.nc" = "never.nc"')
    text = text.replace('"."', '"done/two.nc"').replace('"probed@X11,Y21,Z-3,probe=80"', '"true"')
    Path("job.toml").write_text(text)
    result = ncomp("job.toml", "--jobs", "1")
    assert result.status == 2
    assert "refused.nc:1: 'G31 X5'" in result.out.decode()
    counts = json.loads(Path("results.json").read_text())["counts"]
    assert counts == {"corrected": 3, "refused": 1}
    assert Path("made/deep/b.nc").read_bytes() == Path("done/two.nc").read_bytes()
    assert not Path("never.nc").exists()


WRONG = {
    "unknown key": (("machine =", "machin ="), "job.toml:1: machin is not known (did you mean 'machine'?)"),
    "unknown table": (("[tools]", "[tool]"), "job.toml:7: tool is not known (did you mean 'tools'?)"),
    "unknown key in a table": (("tolerance_um", "tolerance"), "job.toml:14: correction.tolerance is not known (did you mean 'tolerance_um'?)"),
    "unknown head": (("operator", "operater"), "job.toml:21: report.operater is not known (did you mean 'operator'?)"),
    "unknown machine": (('"gantry"', '"gantri"'), "job.toml:1: machine: unknown machine 'gantri' (did you mean 'gantry'?)"),
    "missing machine file": (('"gantry"', '"mill.toml"'), "job.toml:1: machine: machine file mill.toml: No such file"),
    "missing calibration": (("cal.json", "call.json"), "job.toml:2: calibration: call.json: No such file"),
    "missing program": (('"in.nc"', '"inn.nc"'), 'job.toml:24: programs."inn.nc": inn.nc: No such file or folder'),
    "program onto itself": (('"made/out.nc"', '"in.nc"'), 'job.toml:24: programs."in.nc": the output is the program itself'),
    "program that is none": (('"made/out.nc"', "5"), "job.toml:24: programs.\"in.nc\": expected a text in quotes"),
    "no programs": (('"in.nc" = "made/out.nc"', ""), "job.toml:23: programs: expected"),
    "no table of programs": (('[programs]\n"in.nc" = "made/out.nc"\n', ""), "job.toml: programs is missing"),
    "axis": (("Y = 20.5", "B = 20.5"), "job.toml:5: work_offsets.G54.B: machine gantry (w b X Y Z t) has no axis B"),
    "offset": (("Y = 20.5", 'Y = "20.5"'), "job.toml:5: work_offsets.G54.Y: expected a number, not '20.5'"),
    "endless": (("Y = 20.5", "Y = inf"), "job.toml:5: work_offsets.G54.Y: inf is not finite"),
    "datum": (('"probed@X11', '"proved@X11'), "job.toml:5: work_offsets.G54.datum: expected probed"),
    "tool": (("1 = 80.0", '1 = "80"'), "job.toml:8: tools.1: expected a number, not a text in quotes"),
    "negative": (("elapsed_s = 60", "elapsed_s = -1"), "job.toml:11: conditions.elapsed_s: expected a number >= 0"),
    "comma": (("tolerance_um = 0.5", "tolerance_um = 0,5"), "job.toml:14: 'tolerance_um = 0,5': column 17:"),
    "no quotes": (('machine = "gantry"', "machine = gantry"), "job.toml:1: 'machine = gantry': column 11:"),
    "rotary feed": (("tolerance_um = 0.5", 'rotary_feed = "x"'), "job.toml:14: correction.rotary_feed: expected 'leave', 'inverse-time' or 'scaled', not 'x'"),
    "switch": (('machine = "gantry"', 'machine = "gantry"\nblock_skip = "x"'), "job.toml:2: block_skip: expected 'on' or 'off', not 'x'"),
    "log": (("elapsed_s = 60", 'log = "log.csv"'), "job.toml:11: conditions.log: log.csv: No such file"),
    "a machine file": ((JOB, 'name = "x"\nchain = "w b X Y Z t"\n'), "job.toml: this is a machine file (--machine)"),
    "a program": ((JOB, "%\nO1\nG0 X1\n"), "job.toml: this is an NC program"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_wrong_entries_are_refused_with_their_line(ncomp, tmp_path, name):
    change, message = WRONG[name]
    assert change[0] in JOB
    Path("job.toml").write_text(JOB.replace(*change))
    before = sorted(tmp_path.rglob("*"))
    result = ncomp("job.toml")
    assert (result.status, result.out) == (2, b"")
    assert result.err.startswith(f"ncomp: job file {message}"), result.err
    assert result.err.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_a_job_file_is_known_by_its_beginning():
    assert kind_of_file(JOB.encode()) == "a job file (ncomp JOB.toml)"
    assert kind_of_file(b'machine = "a"\n[[case]]\n').startswith("a study")


@pytest.mark.parametrize(
    ("path", "line"),
    [("machine", 1), ("tools.1", 8), ('programs."in.nc"', 24), ("correction", 13), ("correction.other", 13), ("x", None)],
)  # fmt: skip
def test_lines_of_entries(path, line):
    assert line_of(JOB, path) == line


def test_lines_of_tables_of_an_array():
    text = '[[case]]\nname = "a"\n[[case]]\n# name\nname = "b"\n"x y".z = 1\n'
    assert [line_of(text, path) for path in ("case[0].name", "case[1].name", "case[1]", 'case[1]."x y".z')] == [2, 5, 3, 6]  # fmt: skip


def test_the_page_shows_a_job_that_is_valid(ncomp):
    """The example of docs/job.md is read, with the machine and the programs that it names."""
    page = (Path(__file__).parents[1] / "docs" / "job.md").read_text()
    example = next(block for block in re.findall(r"(?:^    .*\n|^\n)+", page, re.MULTILINE) if "[programs]" in block)
    Path("job.toml").write_text(re.sub(r"^    ", "", example, flags=re.MULTILINE))
    for name in ("roughing.nc", "posted/a.nc"):
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text("G21 G90 G17 G54\nT1 M6\nG0 X1. Y1. Z1. B0 C0\nM30\n")
    result = ncomp("job.toml", "--jobs", "1")
    assert result.status == 0, result.shown
    assert Path("corrected/roughing.nc").is_file()
    assert Path("corrected/posted/a.nc").is_file()


def test_a_job_file_with_the_mark_of_windows_editors_is_read(ncomp, tmp_path):
    (tmp_path / "job.toml").write_text(
        '\ufeffmachine = "gantry"\r\ncalibration = "none"\r\nset_up_zero = true\r\n[programs]\r\n"in.nc" = "out.nc"\r\n',
        encoding="utf-8",
    )
    done = ncomp("job.toml")
    assert done.status == 0, done.err
    assert (tmp_path / "out.nc").read_bytes() == (tmp_path / "in.nc").read_bytes()
