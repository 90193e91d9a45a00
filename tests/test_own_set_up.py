"""The set-up of one program: its entry in a job file, the file beside it, and hooks and watched folders with these."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.tiers import quick

import ncomp as api

PROGRAM = "G21 G90 G54\nT1 M6\nG0 X100 Y100\nG0 G43 H1 Z100\nG1 X200 F500\nM30\n"
HEAD = 'machine = "gantry"\ncalibration = "cal.json"\n'
OFFSET = "G54 = { X = %d, Y = 2, Z = 3 }\n"


@pytest.fixture
def shop(ncomp):
    """Two programs in a folder, and what the main command makes of each with its own set-up."""
    Path("posted").mkdir()
    for name, x, length in (("a.nc", 1, 100), ("b.nc", 50, 120)):
        Path("posted", name).write_text(PROGRAM.replace("X200", f"X20{x % 9}"))
        given = ("--work-offset", f"G54={x},2,3", "--tool-length", f"T1={length}")
        done = ncomp(f"posted/{name}", "-m", "gantry", "-c", "cal.json", *given, "-o", f"expected_{name}")
        assert done.status == 0, done.shown
    return ncomp


def beside():
    """Write the set-up of each program beside it."""
    Path("posted/a.nc.toml").write_text(f"[work_offsets]\n{OFFSET % 1}[tools]\n1 = 100\n")
    Path("posted/b.nc.toml").write_text(f"[work_offsets]\n{OFFSET % 50}[tools]\n1 = 120\n")


def job(results=""):
    """Write a job file that has the set-up of each program in its entry."""
    entry = '[programs."posted/%s.nc"]\noutput = "out/%s.nc"\nwork_offsets.' + OFFSET + "tools.1 = %d\n"
    Path("job.toml").write_text(HEAD + results + entry % ("a", "a", 1, 100) + entry % ("b", "b", 50, 120))


def same(folder="out"):
    for name in ("a.nc", "b.nc"):
        assert Path(folder, name).read_bytes() == Path(f"expected_{name}").read_bytes()


def test_the_file_beside_a_program_has_its_set_up(shop):
    beside()
    options = ("--machine", "gantry", "--calibration", "cal.json")
    assert shop("batch", "posted", "out", *options, "--jobs", "1").status == 0
    same()
    assert shop("posted/a.nc", "posted/b.nc", *options, "-o", "several").status == 0
    same("several")
    assert shop("posted/b.nc", *options, "-o", "b.nc").status == 0
    assert Path("b.nc").read_bytes() == Path("expected_b.nc").read_bytes()
    assert shop("check", "posted/b.nc", "--machine", "gantry").status == 0
    assert shop("verify", "posted/b.nc", "b.nc", *options).status == 0


def test_the_entry_of_a_job_file_has_its_set_up(shop):
    job()
    assert shop("job.toml", "--check").status == 0
    assert shop("job.toml", "--jobs", "1").status == 0
    same()


def test_a_hook_takes_machine_and_set_up_from_a_job_file(shop):
    """The name of a program as a CAM posts it: another folder, and often another suffix."""
    job()
    Path("b.posted").write_bytes(Path("posted/b.nc").read_bytes())
    assert shop("b.posted", "--job", "job.toml", "-o", "b.nc").status == 0
    expected = Path("expected_b.nc").read_text().splitlines()
    assert Path("b.nc").read_text().splitlines() == expected
    done = shop("b.posted", "--job", "job.toml", "--machine", "gantry", "-o", "b.nc")
    assert (done.status, "--machine is an entry of the job file job.toml" in done.err) == (2, True)
    done = shop("b.posted", "-o", "b.nc")
    assert (done.status, "--machine NAME is missing" in done.err) == (2, True)
    done = shop("b.posted", "--job", "job.toml", "-o", "job.toml")
    assert (done.status, "job.toml is an input" in done.err) == (2, True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[work_offsets]\nG54 = { X = 1, Q = 2 }\n", "a.nc.toml:2: work_offsets.G54.Q: machine gantry"),
        ("[tools]\n1 = 'long'\n", "a.nc.toml:2: tools.1"),
        ("machine = 'gantry'\n", "a.nc.toml:1: machine"),
        (f"[work_offsets]\n{OFFSET % 7}[tools]\n1 = 100\n", "posted/a.nc.toml gives G54 too, and differs from"),
        (
            f"[work_offsets]\n{OFFSET.replace('54', '55') % 1}[tools]\n1 = 100\n",
            "work offset G55 was given and is not used",
        ),
        ("[tools]\n7 = 5\n", "tool length T7 was given and is not used"),
    ],
)
def test_a_set_up_that_cannot_be_used(shop, text, said):
    Path("posted/a.nc.toml").write_text(text)
    Path("posted/b.nc").unlink()
    options = ("--machine", "gantry", "--calibration", "cal.json")
    options = options if "not used" in said else (*options, "--work-offset", "G54=1,2,3")
    for words in (("posted/a.nc", "-o", "out.nc"), ("batch", "posted", "out", "--jobs", "1")):
        done = shop(*words, *options)
        assert done.status == 2, done.shown
        assert said in " ".join(done.shown.split())
        assert not Path("out.nc").exists()
        assert not Path("out/a.nc").exists()


@pytest.mark.parametrize("way", quick(["job", "beside", "option"], ["beside"]))
def test_watched_programs_have_their_set_ups_and_results(shop, way):
    if way == "beside":
        beside()
    else:
        job()
    source = {
        "job": ("job.toml",),
        "beside": ("posted", "out", "--machine", "gantry", "-c", "cal.json"),
        "option": ("posted", "out", "--job", "job.toml"),
    }[way]
    results = ("--json", "results", "--report", "pages", "--settle", "0.1", "--idle", "0.2")
    if way == "option":  # the set-up of all programs of the folder
        Path("job.toml").write_text(
            f"{HEAD}[work_offsets]\n{OFFSET % 1}[tools]\n1 = 100\n[programs]\n'x.nc' = 'y.nc'\n"
        )
        Path("posted/b.nc").unlink()
        Path("expected_b.nc").unlink()
    done = shop("watch", *source, *results)
    assert done.status == 0, done.shown
    for expected in Path().glob("expected_*.nc"):
        name = expected.name.removeprefix("expected_")
        assert Path("out", name).read_bytes() == expected.read_bytes(), done.shown
        below = Path("posted") / name if way == "job" else Path(name)
        assert json.loads(Path("results", f"{below}.json").read_text())["program"]["name"].endswith(name)
        assert "<html" in Path("pages", f"{below}.html").read_text()


@pytest.mark.usefixtures("shop")
def test_a_changed_set_up_corrects_its_program_again():
    beside()
    right = Path("posted/b.nc.toml").read_text()
    Path("posted/b.nc.toml").write_text(right.replace("120", "100"))
    words = ["watch", "posted", "out", "-m", "gantry", "-c", "cal.json", "--settle", "0.1"]
    code = "from postproc.cli import run; run()"
    with Path("log").open("w") as log, subprocess.Popen([sys.executable, "-c", code, *words], stderr=log) as process:
        try:
            for number in (1, 2):
                end = time.monotonic() + 60
                while Path("log").read_text().count("unchanged: out/b.nc") < number:
                    assert time.monotonic() < end, Path("log").read_text()
                    time.sleep(0.05)
                Path("posted/b.nc.toml").write_text(right)
            process.send_signal(signal.SIGTERM)
            assert process.wait(30) == 0
        finally:
            process.kill()
    same()


@pytest.mark.usefixtures("shop")
def test_python_reads_the_file_beside_a_program():
    beside()
    for name in ("a.nc", "b.nc"):
        done = api.correct(f"posted/{name}", "gantry", "cal.json")
        assert done.text == Path(f"expected_{name}").read_text()
        assert not api.check(Path("posted", name), "gantry").refused
        assert api.verify(f"posted/{name}", f"expected_{name}", "gantry", "cal.json").verdicts[""].after.largest < 0.2
    assert not api.batch("posted", "out", "gantry", "cal.json").counts["refused"]
    same()
    assert "SETUP" in Path("expected_a.nc").read_text()
    given = api.set_up("gantry", work_offset="G54=50,2,3", tool_length="T1=120")
    assert api.correct("posted/b.nc", "gantry", "cal.json", setup=given).text == Path("expected_b.nc").read_text()


def test_the_set_up_of_another_machine_is_refused():
    """The axes of both have the same names, and another order."""
    other = api.set_up("bzt_pfu", work_offset="G54=10,20,100", tool_length="T1=80")
    for use in (api.correct, api.check, api.verify):
        programs = (PROGRAM, PROGRAM) if use is api.verify else (PROGRAM,)
        calibration = () if use is api.check else ("none",)
        with pytest.raises(api.UserError, match="the set-up is of machine bzt_pfu"):
            use(*programs, "gantry", *calibration, setup=other)
