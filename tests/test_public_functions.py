"""Every command has its function in `ncomp`."""

from __future__ import annotations

import ast
import importlib
import inspect
import itertools
import json
import re
import textwrap
from pathlib import Path

import pytest

import ncomp
from kinematics.running.arguments import GENERIC
from postproc.commands.table import COMMANDS
from postproc.commands.tree import command_tree

DOCS = Path(__file__).parents[1] / "docs"
OTHER_NAMES = {"history": "machine_history", "import": "import_tables", "machines": "load_machine"}
"""Functions whose name is not that of their command: `import` is a word of Python, `machines` shows one machine, and
`ncomp.history` is a package of the wheel."""
ONLY_COMMANDS = {
    "certificate": "it writes a document for people, from files of other commands",
    "doctor": "it looks at the installation, and shows what it finds",
    "hook": "it writes files for a CAM, which calls the command",
    "init": "it asks, and writes a job file",
    "measure": "it asks for readings",
    "serve": "it is a page for people",
    "tutorial": "it writes the files of the tutorial",
}
"""Commands without a function, and the reason."""


def test_every_command_has_its_function():
    commands = command_tree().list_commands(None)
    assert sorted(commands) == sorted({name.partition(" ")[0] for name in COMMANDS})
    names = {name: OTHER_NAMES.get(name, name.replace("-", "_")) for name in commands if name not in ONLY_COMMANDS}
    assert [name for name, function in names.items() if function not in ncomp.__all__] == []
    assert all(callable(getattr(ncomp, name)) for name in names.values())
    assert ONLY_COMMANDS.keys() <= set(commands)


def test_the_page_of_functions_names_the_commands_without_one():
    page = (DOCS / "api.md").read_text()
    assert [name for name in ONLY_COMMANDS if f"`{name}`" not in page] == []


def documented():
    """The classes on the page of functions, by name."""
    page = (DOCS / "api.md").read_text()
    for module, name in re.findall(r"^::: (\S+)\.(\w+)$", page, re.MULTILINE):
        yield name, getattr(importlib.import_module(module), name)


def test_the_page_has_the_classes_of_all_results_and_arguments():
    annotations = [str(each) for name in ncomp.__all__ for each in annotations_of(getattr(ncomp, name))]
    named = {word for text in annotations for word in re.findall(r"\b[A-Z]\w+", text)}
    plain = {
        "Path",
        "None",
        "Literal",
        "Sequence",
        "Iterable",
        "Mapping",
        "Callable",
        "Annotated",
        "Any",
        "True",
        "False",
    }
    parts = {"Texts", "Array", "BinaryIO", "Progress", "Effect", "Source", "Points"}
    assert named - plain - parts - dict(documented()).keys() == set()


@pytest.mark.parametrize("name", [name for name in ncomp.__all__ if inspect.isfunction(getattr(ncomp, name))])
def test_the_kind_of_each_argument_is_checked(name):
    for argument, kind in inspect.signature(getattr(ncomp, name)).parameters.items():
        if kind.kind is inspect.Parameter.VAR_KEYWORD:
            continue
        for node in ast.walk(ast.parse(str(kind.annotation), mode="eval")):
            if isinstance(node, ast.Subscript) and ast.unparse(node.value) not in GENERIC:
                pytest.fail(f"{argument}: {kind.annotation}: kinematics/running/arguments.py does not know this kind")


def annotations_of(function):
    return getattr(function, "__annotations__", {}).values() if inspect.isfunction(function) else ()


@pytest.mark.parametrize("name", dict(documented()))
def test_each_attribute_of_a_result_says_what_it_is(name):
    found = dict(documented())[name]
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(found))).body
    without = []
    for one, following in itertools.pairwise([*tree.body, ast.Pass()]):
        if isinstance(one, ast.AnnAssign) and not one.target.id.startswith("_"):
            text = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
            without += [] if text else [one.target.id]
        if isinstance(one, ast.FunctionDef) and not one.name.startswith("_") and not ast.get_docstring(one):
            without.append(one.name)
    assert without == []


def test_a_folder_is_corrected_as_by_the_command(command, tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.nc").write_text("G21 G90 G54\nT1 M6\nG0 X10 Y0 Z0\nG1 X60 F500\nM30\n")
    (tmp_path / "in" / "b.nc").write_text("G21 G90 G54\nG234\nG1 X60 F500\nM30\n")
    assert command("batch", "in", "out", "-m", "dmu50", "--tolerance-um", "2", "--jobs", "1").status == 2
    done = ncomp.batch("in", "again", "dmu50", tolerance_um=2.0)
    assert {program.name: end.state for program, end in done.outcomes.items()} == {
        "a.nc": "corrected",
        "b.nc": "refused",
    }
    assert (tmp_path / "again" / "a.nc").read_bytes() == (tmp_path / "out" / "a.nc").read_bytes()
    assert not (tmp_path / "again" / "b.nc").exists()
    assert repr(done) == "<Summary: dmu50, 1 corrected, 1 refused>"
    assert "<table>" in done._repr_html_()


PROGRAM = "G21 G90 G54\nT1 M6\nG0 X10 Y0 Z0 B0 C0\nG1 X60 F500\nM30\n"
JOB = """machine = "dmu50"
conditions.elapsed_s = 60
correction.tolerance_um = 0.5
correction.accept = ["outside"]
work_offsets.G54 = { X = -30, Y = -20, Z = 150 }
tools.1 = 80
results.json = "results.json"
[programs]
"in" = "out"
[programs."own.nc"]
output = "out/own.nc"
work_offsets.G54 = { X = -40, Y = -20, Z = 150, datum = "true" }
"""


@pytest.fixture
def shop(tmp_path, monkeypatch):
    """A job file with a folder of two programs, one of which is refused, and a program with its own set-up."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.nc").write_text(PROGRAM)
    (tmp_path / "in" / "b.nc").write_text(PROGRAM.replace("G1", "G234\nG1"))
    (tmp_path / "own.nc").write_text(PROGRAM)
    (tmp_path / "job.toml").write_text(JOB)
    return tmp_path


def outputs(folder):
    """The files in a folder; they are removed."""
    found = {path.name: path.read_bytes() for path in folder.iterdir()}
    for name in found:
        (folder / name).unlink()
    return found


def test_the_programs_of_a_job_file_are_corrected_as_by_the_command(command, shop):
    assert command("job.toml", "--jobs", "1").status == 2
    written, results = outputs(shop / "out"), json.loads((shop / "results.json").read_text())
    (shop / "results.json").unlink()
    sizes: list[int] = []
    done = ncomp.job("job.toml", progress=sizes.append)
    assert outputs(shop / "out") == written
    assert written.keys() == {"a.nc", "own.nc"}
    assert written["a.nc"] != written["own.nc"]
    assert not (shop / "results.json").exists()
    found = done.json()["programs"]
    for each in ("name", "output", "state", "result"):
        assert [program[each] for program in found] == [program[each] for program in results["programs"]]
    (reason,) = [program["reason"] for program in found if program["reason"]]
    assert 'pass_through="G234"' in reason
    assert len(sizes) == 3
    assert (repr(done), done.status) == ("<Summary: dmu50, 2 corrected, 1 refused>", 2)


def test_the_programs_of_a_job_file_are_checked_as_by_the_command(command, shop):
    shown = command("job.toml", "--check", "--quiet")
    found = ncomp.job("job.toml", check=True)
    assert not (shop / "out").exists()
    assert (shown.status, found.status) == (2, 2)
    assert repr(found) == "<Checked: dmu50, 2 accepted, 1 refused>"
    assert found._repr_html_().count("<h3>") == 3
    refused = {program.name: [line for line, *_ in each.refused] for program, each in found.findings.items()}
    assert refused == {"b.nc": [4], "a.nc": [], "own.nc": []}
    corrected = {program.name: each.corrected for program, each in found.findings.items()}
    assert corrected["a.nc"] == corrected["own.nc"] == [3, 4]
    (shop / "in" / "b.nc").unlink()
    assert (command("job.toml", "--check").status, ncomp.job("job.toml", check=True).status) == (0, 0)


def test_the_one_program_of_a_job_file_must_use_its_set_up(command, shop):
    head = 'machine = "dmu50"\nset_up_zero = true\ncorrection.travel_check = false\nwork_offsets.G55.X = 1\n'
    (shop / "job.toml").write_text(f'{head}[programs]\n"in/a.nc" = "out.nc"\n')
    refused = command("job.toml")
    (end,) = ncomp.job("job.toml").outcomes.values()
    assert (refused.status, end.state) == (2, "refused")
    assert "work offset G55 was given and is not used" in refused.err
    assert "work offset G55 was given and is not used" in end.reason
    assert not (shop / "out.nc").exists()


WATCHED = {
    "options": (
        ("in", "out", "-m", "dmu50", "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80", "--elapsed", "60"),
        {
            "folder": "in",
            "output": "out",
            "machine": "dmu50",
            "set_up": {"work_offset": {"G54": (-30, -20, 150)}, "tool_length": {"T1": 80}},
            "conditions": {"elapsed": 60},
        },
    ),
    "job file": (("job.toml",), {"folder": Path("job.toml")}),
    "folder with a job file": (
        ("in", "out", "--job", "job.toml"),
        {"folder": "in", "output": "out", "job": "job.toml"},
    ),
}


@pytest.mark.parametrize("way", WATCHED)
def test_a_folder_is_watched_as_by_the_command(command, shop, way):
    options, arguments = WATCHED[way]
    assert command("watch", *options, "--settle", "0.1", "--idle", "0.1").status == 0
    written = outputs(shop / "out")
    ends, lines = {}, []
    counts = ncomp.watch(
        **arguments,
        settle=0.1,
        idle=0.1,
        progress=lambda program, end: ends.update({program.path.name: end}),
        say=lines.append,
    )
    assert outputs(shop / "out") == written
    names = {"a.nc", "b.nc", "own.nc"} if way == "job file" else {"a.nc", "b.nc"}
    assert (ends.keys(), written.keys()) == (names, names - {"b.nc"})
    assert counts == {"corrected": len(names) - 1, "refused": 1}
    assert ends["a.nc"].result["moves"]["read"] == 2
    assert "in/b.nc:4: 'G234'" in ends["b.nc"].reason
    assert lines[0].startswith("watching ")
    assert lines[-1].startswith("ended: ")


def test_ctrl_c_ends_the_watching_of_a_folder(shop):
    def interrupt(*_):
        raise KeyboardInterrupt

    assert ncomp.watch("in", "out", job="job.toml", settle=0.1, progress=interrupt) == {"corrected": 1}
    assert {path.name for path in (shop / "out").iterdir()} == {"a.nc"}


STUDY = """machine = "gantry"
draws = 3
[fit]
basis = "legendre:1"
[[case]]
name = "a"
strategy = "random"
points = 30
tracker = [-1500.0, 1500.0, 300.0]
"""


def test_a_study_is_that_of_the_command(command, tmp_path):
    (tmp_path / "s.toml").write_text(STUDY)
    (tmp_path / "part.nc").write_text("G21 G90 G54\nG0 X10 Y0 Z0\nG1 X60 F500\nM30\n")
    options = ("--program", "part.nc", "--set-up-zero", "--workers", "1")
    done = command("study", "s.toml", "-o", "r.csv", "--json", "r.json", *options)
    assert done.status == 0, done.shown
    found = ncomp.study("s.toml", program="part.nc", setup=ncomp.set_up("gantry", zero=True), keep_beside="again.csv")
    assert found.json()["cases"] == json.loads((tmp_path / "r.json").read_text())["cases"]
    assert repr(found) == "<Studied: 1 cases on gantry>"
    assert "<table>" in found._repr_html_()
    assert (tmp_path / "again.csv.chunks").is_dir()
    found.save("again.csv")
    assert (tmp_path / "again.csv").read_bytes() == (tmp_path / "r.csv").read_bytes()
    assert not (tmp_path / "again.csv.chunks").exists()


def test_the_moves_of_a_corrected_program_are_those_of_its_text(tmp_path):
    setup = ncomp.set_up("gantry", zero=True)
    (tmp_path / "one_line.nc").write_text("G21 G90 G54 G0 X10 Y20 Z0")
    done = ncomp.correct(tmp_path / "one_line.nc", "gantry", "none", setup=setup)
    assert done.moves.machine_target.tolist() == [[10.0, 20.0, 0.0]]
    with (tmp_path / "out.nc").open("wb") as file:
        written = ncomp.correct(tmp_path / "one_line.nc", "gantry", "none", setup=setup, output=file)
    with pytest.raises(ncomp.UserError, match="the program was written to output: correct it without output"):
        _ = written.moves
