"""No output of any command replaces an input or another output, whatever the names by which both are given."""

import itertools
import os
import re
import shutil
from pathlib import Path
from typing import get_args

import pytest
from support.command import run_command

from postproc.commands.options.declared import REQUIRED, Signature
from postproc.commands.table import COMMANDS, command

FILE_WORD = re.compile(r"\.(nc|csv|json|toml|html|svg|pdf|txt|tbl)\b|FILE|FOLDER|DIR\b")
"""In the word that stands for the value of an option, where this is a file or folder."""
FILE_NAMES = ("machine", "calibration", "program", "output")
"""Names of options whose values are files in every command."""
RELATIVE_TO_THE_FOLDER = {("init", "calibration"), ("init", "program")}
"""Files of the job that is made: they need not exist, and `test_files_of_a_new_job_stay` has them."""
SPELLINGS = ("plain", "absolute", "dotted", "symbolic link", "hard link")
CONTENT = b"what the user has measured for a night\n"


def declared(name):
    return Signature(command(name)[0]).declared


def names_a_file(each):
    """True for an option whose type, word or name says that its value is a file."""
    kinds = {each.kind, each.item, *get_args(each.kind)}
    word = each.field.metadata.get("metavar") or ""
    return Path in kinds or (str in kinds and bool(FILE_WORD.search(word) or each.name in FILE_NAMES))


def inputs_with_outputs():
    """Every input of every command with every output of it."""
    found = []
    for name in COMMANDS:
        inputs = [each for each in declared(name) if each.field.metadata.get("reads")]
        outputs = [each for each in declared(name) if each.writes]
        for read, written in itertools.product(inputs, outputs):
            if read.name != written.field.metadata.get("may_replace"):
                found.append(pytest.param(name, read, written, id=f"{name} {read.label} {written.label}"))
    return found


def two_outputs():
    """Every two outputs of every command."""
    return [
        pytest.param(name, one, other, id=f"{name} {one.label} {other.label}")
        for name in COMMANDS
        for one, other in itertools.combinations([each for each in declared(name) if each.writes], 2)
    ]


def line(name, given):
    """The words of a command with these values by the names of the options; what else is required is made up."""
    words = name.split()
    for each in declared(name):
        value = given.get(each.name)
        if value is None and each.field.default is REQUIRED:
            value = "1" if float in (each.kind, each.item) else f"other-{each.name}"
        if value is not None:
            words += [*each.names[:1], value]
    return words


def spelled(spelling, path):
    """Another name of a file."""
    match spelling:
        case "plain":
            return str(path)
        case "absolute":
            return str(path.absolute())
        case "dotted":
            return f"sub/../{path}"
    made = Path(f"{spelling.split()[0]}{path.suffix}")
    made.symlink_to(path) if spelling == "symbolic link" else made.hardlink_to(path)
    return str(made)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_that_names_a_file_says_so(name):
    unsaid = [
        each.label
        for each in declared(name)
        if names_a_file(each)
        and not each.field.metadata.get("reads")
        and not each.writes
        and (name, each.name) not in RELATIVE_TO_THE_FOLDER
    ]
    assert unsaid == [], "declare what it is: option(..., reads=True) or option(..., writes='file')"


@pytest.mark.parametrize(("name", "read", "written"), inputs_with_outputs())
def test_no_output_replaces_an_input(tmp_path, monkeypatch, name, read, written):
    monkeypatch.chdir(tmp_path)
    Path("sub").mkdir()
    given = Path("given.toml")
    for spelling in SPELLINGS:
        given.write_bytes(CONTENT)
        done = run_command(*line(name, {read.name: str(given), written.name: spelled(spelling, given)}))
        assert done.status == 2, spelling
        assert "is an input and would be overwritten; name another file" in done.err, spelling
        assert given.read_bytes() == CONTENT


@pytest.mark.parametrize(("name", "one", "other"), two_outputs())
def test_two_outputs_are_two_files(tmp_path, monkeypatch, name, one, other):
    monkeypatch.chdir(tmp_path)
    Path("sub").mkdir()
    for spelling in SPELLINGS:
        first = Path("first.out")
        first.write_bytes(CONTENT)
        done = run_command(*line(name, {one.name: str(first), other.name: spelled(spelling, first)}))
        assert done.status == 2, spelling
        assert "name two files" in done.err, spelling
        assert first.read_bytes() == CONTENT


@pytest.fixture
def shop(ncomp, tmp_path, monkeypatch):
    """A folder with a user's own machine, found by its name, with its calibration; and all that a job reads."""
    place = tmp_path / "own"
    (place / "calibrations").mkdir(parents=True)
    text = (Path(__file__).parents[1] / "machines" / "gantry.toml").read_text()
    (place / "mill.toml").write_text(text.replace('name = "gantry"', 'name = "mill"'))
    (place / "calibrations" / "mill.json").write_text(Path("cal.json").read_text().replace('"gantry"', '"mill"'))
    monkeypatch.setenv("NCOMP_MACHINES", str(place))
    shutil.copy(place / "mill.toml", "mill.toml")
    shutil.copy(place / "calibrations" / "mill.json", "mill.json")
    Path("tools.tbl").write_text("T1 P1 Z100\n")
    Path("log.csv").write_text("time_s,temp_air\n0,20\n")
    Path("head.toml").write_text('[report]\noperator = "Berg"\n')
    Path("posted").mkdir()
    shutil.copy("in.nc", "posted/a.nc")
    return ncomp


REAL = [
    "plan --machine mill.toml --strategy random --points 30 -o mill.toml",
    "simulate --machine mill.toml --strategy random --points 30 -o mill.toml",
    "export --machine mill.toml -c mill.json --format csv -o tables --rest mill.toml",
    "in.nc --machine mill.toml -c mill.json -o mill.toml",
    "in.nc --machine mill.toml -c mill.json -o out.nc --json in.nc",
    "in.nc --machine mill.toml -c mill.json --in-place --json in.nc",
    "in.nc --machine mill --set-up-zero -o own/mill.toml",
    "in.nc --machine mill --set-up-zero -o own/calibrations/mill.json",
    "in.nc --machine mill --set-up-zero -o out.nc --json own/calibrations/mill.json",
    "in.nc posted/a.nc --machine mill.toml -c mill.json -o out --json posted/a.nc",
    "in.nc posted/a.nc --machine mill.toml -c mill.json -o out --json mill.toml",
    "in.nc posted/a.nc --machine mill.toml -c mill.json -o posted",
    "batch posted out --machine mill.toml -c mill.json --json posted/a.nc",
    "batch posted out --machine mill --json own/calibrations/mill.json",
    "machines mill --draw own/mill.toml",
    "import own --machine gantry --format linuxcnc -o own/mill.toml",
]


@pytest.mark.parametrize("words", REAL)
def test_commands_leave_every_file_as_it_was(shop, words):
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    done = shop(*words.split())
    assert done.status == 2, done.shown
    assert {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("entry", ["job.toml", "mill.toml", "mill.json", "tools.tbl", "log.csv", "in.nc", "link.nc"])
@pytest.mark.parametrize("output", ["program", "json", "report"])
def test_a_job_leaves_its_files(shop, entry, output):
    os.link("in.nc", "link.nc")
    outputs = {"program": "out.nc", "json": "out.json", "report": "out.html"} | {output: entry}
    Path("job.toml").write_text(
        f'machine = "mill.toml"\ncalibration = "mill.json"\ntool_tables = ["tools.tbl"]\n'
        f'[conditions]\nlog = "log.csv"\n[programs]\n"in.nc" = "{outputs["program"]}"\n'
        f'[results]\njson = "{outputs["json"]}"\nreport = "{outputs["report"]}"\n'
    )
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    done = shop("job.toml")
    assert done.status == 2, done.shown
    assert f"{entry}" in done.err
    assert {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()} == before


def test_files_that_a_study_names_stay(shop):
    assert shop("plan", "--machine", "gantry", "--strategy", "random", "--points", 30, "-o", "plan.csv").status == 0
    Path("study.toml").write_text(
        'machine = "gantry"\ndraws = 2\nseed = 1\n[[case]]\nname = "a"\nstrategy = "plan.csv"\n'
        "tracker = [-1500, 1500, 300]\n"
    )
    before = Path("plan.csv").read_bytes()
    done = shop("study", "study.toml", "-o", "plan.csv")
    assert (done.status, Path("plan.csv").read_bytes()) == (2, before), done.shown
    assert "plan.csv is an input and would be overwritten" in done.err


def test_an_output_of_a_folder_is_not_replaced_by_its_summary(shop):
    done = shop("batch", "posted", "out", "--machine", "mill.toml", "-c", "mill.json", "--json", "out/a.nc")
    assert done.status == 2
    assert not Path("out").exists()


def test_files_of_a_new_job_stay(shop):
    Path("new").mkdir()
    shutil.copy("mill.toml", "new/job.toml")
    before = Path("new/job.toml").read_bytes()
    done = shop("init", "new", "--machine", "new/job.toml", "--calibration", "none", "--program", "in.nc", "--force")
    assert (done.status, Path("new/job.toml").read_bytes()) == (2, before), done.shown


def test_an_input_is_replaced_on_demand(shop):
    done = shop("in.nc", "--machine", "mill.toml", "-c", "mill.json", "--set-up-zero", "--in-place")
    assert done.status == 0, done.shown
    assert Path("in.nc.orig").is_file()
    assert Path("in.nc").read_bytes() != Path("in.nc.orig").read_bytes()
