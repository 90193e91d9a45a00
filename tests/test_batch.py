"""Folders of programs: each output as that of its own run, whole or absent, whatever becomes of the others."""

import json
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.child_processes import children
from support.ending_task import square
from support.programs import load, model_of
from support.real_programs import SHORT
from support.tiers import quick

from kinematics.effects import LocationError
from kinematics.error_model.model import write_model
from kinematics.running.workers import ATTEMPTS, workers
from postproc.commands.options.declared import Signature
from postproc.commands.table import command as command_of

PROGRAM = "G21 G90 G54\nG0 X100. Y100. Z100.\nG1 X200. F500\nY300.\nM30\n"
KLARTEXT = "0 BEGIN PGM A MM\n1 L X+100 Y+100 Z+100 R0 FMAX\n2 L X+200 F500\n3 END PGM A MM\n"
SIEMENS = "G71 G90 G54\nG0 X=100 Y100 Z100\nG1 X200 F500\nM30\n"
REFUSED = "G21 G90 G54\nG0 X1. Y1. Z1.\nG31 X5.\nM30\n"
LONG = PROGRAM.replace("M30", "X100.\nX200.\n" * 160_000 + "M30")
GANTRY = ("--machine", "gantry", "--calibration", "cal.json", "--set-up-zero")
# a process that a shell started in the background ignores SIGINT, and so do its children
RUN = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from postproc.cli import run; run()"
FOLDER = {"a.nc": PROGRAM, "sub/b.h": KLARTEXT, "sub/deep/C.MPF": SIEMENS, "sub/bad.nc": REFUSED, "notes.txt": "x"}


@pytest.fixture(name="ncomp")
def _ncomp(command, tmp_path):
    """The command line in a folder with a calibration and a folder of programs, `in`."""
    write_model(model_of(load("gantry"), LocationError("C", "Y", 100.0)), tmp_path / "cal.json")
    write({f"in/{name}": text for name, text in FOLDER.items()})
    return command


def write(files: dict[str, str]) -> None:
    for name, text in files.items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(text)


def files(folder: str) -> dict[str, bytes]:
    """Everything in a folder, also hidden files, by name."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(Path(folder).rglob("*")) if p.is_file()}


def states(path: str = "summary.json") -> dict[str, str]:
    return {each["name"]: each["state"] for each in json.loads(Path(path).read_text())["programs"]}


def check_each_as_by_its_own_run(ncomp, folder: str = "out", *options: str) -> None:
    for name, text in files(folder).items():
        alone = ncomp("correct", f"in/{name}", *(options or GANTRY), "-o", "alone.nc")
        assert alone.status == 0, alone.err
        assert Path("alone.nc").read_bytes() == text


def test_a_folder(ncomp):
    done = ncomp("batch", "in", "out", *GANTRY, "--jobs", 1, "--json", "summary.json", "--report", "page.html")
    assert done.status == 2
    assert set(files("out")) == {"a.nc", "sub/b.h", "sub/deep/C.MPF"}
    check_each_as_by_its_own_run(ncomp)
    assert "in/sub/bad.nc:3: 'G31 X5.': G31 is a probing move" in done.shown
    assert "4 programs in" in done.shown
    assert "3 corrected, 1 refused." in done.shown
    summary = json.loads(Path("summary.json").read_text())
    assert summary["counts"] == {"corrected": 3, "refused": 1}
    first, *_, last = summary["programs"]
    assert (first["name"], first["output"], first["result"]["moves"]["read"]) == ("a.nc", "out/a.nc", 3)
    assert last["name"] == "sub/deep/C.MPF"
    refused = next(each for each in summary["programs"] if each["state"] == "refused")
    assert (refused["output"], refused["result"], refused["earlier_output"]) == (None, None, False)
    assert "bad.nc" in Path("page.html").read_text()


def test_all_is_well(ncomp):
    Path("in/sub/bad.nc").unlink()
    assert ncomp("batch", "in", "out", *GANTRY, "-j", 1).status == 0


def test_without_errors_all_is_unchanged(ncomp):
    done = ncomp(
        "batch", "in", "out", "--machine", "gantry", "-c", "none", "--set-up-zero", "-j", 1, "--json", "summary.json"
    )
    assert done.status == 2
    assert states() == {
        "a.nc": "unchanged",
        "sub/b.h": "unchanged",
        "sub/bad.nc": "refused",
        "sub/deep/C.MPF": "unchanged",
    }
    assert all(Path(f"in/{name}").read_bytes() == text for name, text in files("out").items())


def test_corrected_programs_are_recognised(ncomp):
    Path("in/sub/bad.nc").unlink()
    assert ncomp("batch", "in", "out", *GANTRY, "-j", 1).status == 0
    again = ncomp("batch", "out", "twice", *GANTRY, "-j", 1, "--json", "summary.json")
    assert again.status == 2
    assert set(states().values()) == {"already corrected"}
    assert "out/a.nc:1: " in again.shown
    assert not Path("twice").exists()
    assert ncomp("batch", "out", "twice", *GANTRY, "-j", 1, "--force").status == 0


def test_an_output_inside_the_input_is_no_input(ncomp):
    for _ in range(2):
        ncomp("batch", "in", "in/corrected", *GANTRY, "-j", 1, "--json", "summary.json")
        assert set(states()) == {"a.nc", "sub/b.h", "sub/bad.nc", "sub/deep/C.MPF"}


def test_the_output_of_an_earlier_run_is_named(ncomp):
    write({"out/sub/bad.nc": "old"})
    done = ncomp("batch", "in", "out", *GANTRY, "-j", 1, "--json", "summary.json")
    assert "out/sub/bad.nc is the output of an earlier run" in done.shown
    assert [each["earlier_output"] for each in json.loads(Path("summary.json").read_text())["programs"]].count(
        True
    ) == 1


@pytest.mark.parametrize(
    ("patterns", "found"),
    [
        (["*.txt"], {"notes.txt"}),
        (["b.*", "sub/*.nc"], {"sub/b.h", "sub/bad.nc"}),
        (["deep/*"], {"sub/deep/C.MPF"}),
    ],
)  # fmt: skip
def test_patterns(ncomp, patterns, found):
    write({"in/.hidden.nc": PROGRAM, "in/.git/x.nc": PROGRAM})
    glob = [word for pattern in patterns for word in ("--glob", pattern)]
    ncomp("batch", "in", "out", *GANTRY, "-j", 1, *glob, "--json", "summary.json")
    assert set(states()) == found


def test_hidden_files_are_no_programs(ncomp):
    write({"in/.hidden.nc": PROGRAM, "in/.git/x.nc": PROGRAM})
    ncomp("batch", "in", "out", *GANTRY, "-j", 1, "--json", "summary.json")
    assert set(states()) == {"a.nc", "sub/b.h", "sub/bad.nc", "sub/deep/C.MPF"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["no", "out"], "folder no: No such file or directory"),
        (["in/a.nc", "out"], "folder in/a.nc: it is a file: 'ncomp correct' corrects one program"),
        (["in", "in"], "the output folder in is the input"),
        (["in", "./sub/../in"], "the output folder sub/../in is the input"),
        (["in", "cal.json"], "cal.json is an input and would be overwritten"),
        (["in", "links"], "links/a.nc is an input and would be overwritten; name another output folder"),
        (["in", "out", "--glob", ""], "--glob '': expected a pattern of names, such as *.nc or roughing/*.nc"),
        (["in", "out", "--glob", "*.nc", "--glob", "."], "--glob .: expected a pattern of names, such as *.nc"),
        (["in", "out", "--glob", "*.eps"], "folder in has no program: expected *.eps; --glob PATTERN chooses others"),
        (["in", "out", "--json", "in/a.nc"], "in/a.nc is an input and would be overwritten"),
        (["in", "out", "--dask", "tcp://x:1", "--jobs", "3"], "--jobs and --dask tcp://x:1 exclude each other"),
        (["in", "out", "--work-offset", "G54=1"], "G54=1: expected G54=x,y,z"),
    ],
)  # fmt: skip
def test_what_cannot_be_used(ncomp, words, said):
    Path("sub").mkdir()
    Path("links").mkdir()
    Path("links/a.nc").symlink_to("../in/a.nc")
    before = files(".")
    done = ncomp("batch", *words[:2], *GANTRY, *words[2:])
    assert done.status == 2
    assert said in done.err
    assert files(".") == before
    assert not Path("out").exists()


def test_an_internal_fault_is_that_of_one_program(ncomp, monkeypatch):
    from postproc.iso.interpreter import IsoInterpreter

    def broken(*_):
        raise ZeroDivisionError("a fault")

    monkeypatch.setattr(IsoInterpreter, "_read_all", broken)
    done = ncomp("batch", "in", "out", *GANTRY, "-j", 1, "--json", "summary.json")
    assert done.status == 1
    assert states()["a.nc"] == "failed"
    assert states()["sub/b.h"] == "corrected"
    assert "internal fault: ZeroDivisionError('a fault'); please report it" in done.shown
    assert set(files("out")) == {"sub/b.h", "sub/deep/C.MPF"}


def test_the_options_are_those_of_the_correction():
    options = {name: {each.name for each in Signature(command_of(name)[0]).declared} for name in ("correct", "batch")}
    assert options["correct"] - options["batch"] == {"programs", "in_place"}
    assert options["batch"] - options["correct"] == {"folder", "glob", "dask"}


# ---- over processes, and over Dask


def test_processes_give_the_same(ncomp):
    done = ncomp("batch", "in", "out", *GANTRY, "--jobs", 2, "--json", "summary.json")
    assert done.status == 2
    assert set(files("out")) == {"a.nc", "sub/b.h", "sub/deep/C.MPF"}
    check_each_as_by_its_own_run(ncomp)


@pytest.mark.statistical
def test_real_programs_over_processes(ncomp, nc_data):
    options = ("--machine", "dmu50", "--set-up-zero", "--no-travel-check", "--accept", "outside")
    for path in (nc_data / "iso" / "easy_gcode_plot").iterdir():
        if path.name in SHORT | {"TEST_G91.NC"}:
            write({f"in/{path.name}": path.read_text("latin-1")})
    ncomp("batch", "in", "out", *options, "--jobs", 2, "--json", "summary.json", "--glob", "*.NC")
    found = states()
    assert found.pop("TEST_G91.NC") == "refused"
    assert set(found.values()) == {"corrected"}
    assert len(found) > 4
    check_each_as_by_its_own_run(ncomp, "out", *options)


@pytest.mark.statistical
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("address", ["local", "tcp"])
def test_a_cluster_gives_the_same(ncomp, address):
    from distributed import LocalCluster

    if address == "local":
        done = ncomp("batch", "in", "out", *GANTRY, "--jobs", 2, "--dask", "local", "--json", "summary.json")
    else:
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
            done = ncomp("batch", "in", "out", *GANTRY, "--dask", local.scheduler_address, "--json", "summary.json")
    assert done.status == 2, done.shown
    assert "in/sub/bad.nc:3: 'G31 X5.': G31 is a probing move" in done.shown
    assert set(files("out")) == {"a.nc", "sub/b.h", "sub/deep/C.MPF"}
    check_each_as_by_its_own_run(ncomp)


def test_a_task_that_ends_its_worker_is_lost_alone(tmp_path):
    attempts = tmp_path / "attempts"
    with workers(2, None, ()) as team:
        tasks = [(number, str(attempts)) for number in range(8)]
        found = {task[0]: result for task, result in team.results(square, tasks, lambda task: -task[0])}
    assert found == {number: -3 if number == 3 else number * number for number in range(8)}
    assert len(attempts.read_text().splitlines()) == 1 + ATTEMPTS


def test_a_task_that_cannot_be_sent_is_refused_and_its_worker_goes_on(tmp_path):
    with workers(2, None, ()) as team:
        with pytest.raises((AttributeError, pickle.PicklingError), match="lambda"):
            list(team.results(square, [(lambda: 3, "")], lambda _: -1))
        tasks = [(number, str(tmp_path / "none")) for number in (1, 2)]
        assert sorted(result for _, result in team.results(square, tasks, lambda _: -1)) == [1, 4]


# ---- killed


def wait_until(holds, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are found in /proc")
@pytest.mark.parametrize("stop", quick([signal.SIGKILL, signal.SIGTERM, signal.SIGINT], [signal.SIGKILL]))
@pytest.mark.usefixtures("ncomp")
def test_stopped_in_the_midst(monkeypatch, stop):
    """The workers end too, and nothing but whole outputs is left."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))
    write({"in/long.nc": LONG, "in/sub/long.nc": LONG})
    words = [sys.executable, "-c", RUN, "batch", "in", "out", *GANTRY, "--jobs", "2", "--json", "summary.json"]
    with subprocess.Popen(words, stderr=subprocess.PIPE) as process:
        wait_until(lambda: sum(name.endswith(".tmp") for name in (files("out") if Path("out").exists() else ())) == 2)
        started = children(process.pid)
        assert len(started) >= 2
        process.send_signal(stop)
        status = process.wait(60)
        assert process.stderr is not None
        said = process.stderr.read()
    assert status == (-stop if stop == signal.SIGKILL else 128 + stop)
    assert b"Traceback" not in said
    wait_until(lambda: not any(map(alive, started)))
    assert {name for name in files(".") if name.endswith(".tmp") and not name.startswith(".summary")} == set()
    assert set(files("out") if Path("out").exists() else ()) <= {"a.nc", "sub/b.h", "sub/deep/C.MPF"}
    assert not Path("summary.json").exists()
