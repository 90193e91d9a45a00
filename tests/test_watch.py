"""ncomp watch: complete programs are corrected, bad ones survived, and SIGTERM ends it."""

import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.file_examples import PROGRAM
from support.programs import load, shifted

from kinematics.error_model.model import write_model

SETTLE = 0.4


@pytest.fixture
def watching(tmp_path):
    """A watched folder: the folder, the process, and a function that waits until its output contains a text."""
    options = ("--machine", "gantry", "-c", "cal.json", "--datum", "G54=true", "--set-up-zero")
    with watching_folder(tmp_path, *options) as (process, shows):
        yield tmp_path, process, shows


@contextmanager
def watching_folder(tmp_path, *options, program=PROGRAM):
    """The process that watches a folder, and a function that waits until its output contains a text."""
    write_model(shifted(load("gantry"), X=-10.0), tmp_path / "cal.json")
    (tmp_path / "in").mkdir()
    (tmp_path / "in/there.nc").write_text(program)
    code = "from postproc.cli import run; run()"
    with (
        (tmp_path / "log").open("w") as log,
        subprocess.Popen(
            [sys.executable, "-c", code, "watch", "in", "out", *options, "--settle", str(SETTLE)],
            cwd=tmp_path,
            stderr=log,
        ) as process,
    ):

        def shows(text: str) -> str:
            end = time.monotonic() + 60
            while text not in (shown := (tmp_path / "log").read_text()):
                assert time.monotonic() < end, shown
                assert process.poll() is None, shown
                time.sleep(0.05)
            return shown

        try:
            yield process, shows
        finally:
            process.kill()


@pytest.mark.statistical
def test_changed_files_are_read_anew_before_each_program(tmp_path):
    text = (Path(__file__).parents[1] / "machines" / "gantry.toml").read_text()
    (tmp_path / "mill.toml").write_text(text.replace("[work_offsets]", "[work_offsets]\nG54 = { X = 1, Y = 2, Z = 3 }"))
    (tmp_path / "tools.tbl").write_text("T1 P1 Z100\n")
    program = PROGRAM.replace("G21 G17 G90", "G21 G17 G90 G54\nT1 M6\nG0 G43 H1 Z100")
    options = ("--machine", "mill.toml", "-c", "cal.json", "--tool-table", "tools.tbl", "--datum", "G54=true")
    with watching_folder(tmp_path, *options, program=program) as (process, shows):
        shows("corrected: out/there.nc")
        write_model(shifted(load("gantry"), X=-20.0), tmp_path / "cal.json")
        (tmp_path / "in/b.nc").write_text(program)
        shown = shows("corrected: out/b.nc")
        assert "cal.json changed: machine gantry, calibration " in shown
        (tmp_path / "mill.toml").write_text((tmp_path / "mill.toml").read_text().replace("X = 1,", "X = 5,"))
        (tmp_path / "in/c.nc").write_text(program)
        assert "mill.toml changed: machine gantry" in shows("corrected: out/c.nc")
        (tmp_path / "tools.tbl").write_text("T1 P1 Z120\n")
        (tmp_path / "in/d.nc").write_text(program)
        assert "tools.tbl changed: machine gantry" in shows("corrected: out/d.nc")
        good = (tmp_path / "cal.json").read_bytes()
        (tmp_path / "cal.json").write_bytes(good[: len(good) // 2])
        (tmp_path / "in/e.nc").write_text(program)
        shown = shows("programs wait until it can be used")
        assert "cal.json" in shown.splitlines()[-1]
        assert not (tmp_path / "out/e.nc").exists()
        (tmp_path / "cal.json").write_bytes(good)
        shows("corrected: out/e.nc")
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0
    marks = [mark_in(tmp_path / "out" / f"{name}.nc") for name in ("there", "b", "c", "d", "e")]
    (first, set_up), second, third, *others = marks
    assert second[0] != first
    assert {calibration for calibration, _ in (third, *others)} == {second[0]}
    assert second[1] == set_up
    assert len({set_up, third[1], others[0][1]}) == 3
    assert others[0] == others[1]


def mark_in(path):
    """Calibration and set-up that the mark of a corrected program states."""
    words = path.read_text().split()
    return words[words.index("CALIBRATION") + 1], words[words.index("SETUP") + 1]


@pytest.mark.statistical
def test_a_folder_is_watched(watching):
    folder, process, shows = watching
    shows("corrected: out/there.nc")
    (folder / "in/deep").mkdir()
    with (folder / "in/deep/slow.nc").open("w") as file:  # a post that writes for longer than the file has to rest
        for line in PROGRAM.splitlines(keepends=True):
            file.write(line)
            file.flush()
            time.sleep(SETTLE / 2)
    (folder / "in/bad.nc").write_text("G31 X5\n")
    (folder / "in/binary.nc").write_bytes(bytes(range(256)))
    (folder / "in/notes.txt").write_text("no program")
    shows("corrected: out/deep/slow.nc")
    shows("refused: in/bad.nc:1: 'G31 X5'")
    shows("refused: program in/binary.nc")
    (folder / "in/there.nc").write_text("G31 X5\n")
    shown = shows("refused: in/there.nc:1: 'G31 X5'")
    assert "its earlier output is now out/there.nc.earlier" in shown
    process.send_signal(signal.SIGTERM)
    assert process.wait(30) == 0
    assert "ended: 2 corrected, 3 refused" in (folder / "log").read_text()
    assert (folder / "out/deep/slow.nc").read_text().count("\n") == PROGRAM.count("\n") + 1  # the mark
    left = {path.relative_to(folder / "out").as_posix() for path in (folder / "out").rglob("*") if path.is_file()}
    assert left == {"deep/slow.nc", "there.nc.earlier"}
    assert "Traceback" not in (folder / "log").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("inn", "out", "--machine", "gantry"), "folder inn: No such file or directory (did you mean 'in'?)"),
        (("in", "in", "--machine", "gantry"), "the output folder in is the input"),
        (("in", "out", "--machine", "gantry"), "gantry has no calibration of its own"),
        (("in", "out", "--machine", "gantry", "--settle", "0"), "--settle 0: expected 0.1 or more"),
    ],
)
def test_what_cannot_be_watched(command, arguments, message):
    Path("in").mkdir()
    done = command("watch", *arguments)
    assert done.status == 2
    assert message in done.err
