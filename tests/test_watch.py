"""ncomp watch: complete programs are corrected, bad ones survived, and SIGTERM ends it."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.file_examples import PROGRAM
from support.programs import load, shifted

from kinematics.error_model.model import write_model

SETTLE = 0.4


@pytest.fixture
def watching(tmp_path):
    """A watched folder: the folder, the process, and a function that waits until its output contains a text."""
    write_model(shifted(load("gantry"), X=-10.0), tmp_path / "cal.json")
    (tmp_path / "in").mkdir()
    (tmp_path / "in/there.nc").write_text(PROGRAM)
    options = ("--machine", "gantry", "-c", "cal.json", "--datum", "G54=true", "--set-up-zero", "--settle", str(SETTLE))
    code = "from postproc.cli import run; run()"
    with (
        (tmp_path / "log").open("w") as log,
        subprocess.Popen(
            [sys.executable, "-c", code, "watch", "in", "out", *options], cwd=tmp_path, stderr=log
        ) as process,
    ):

        def shows(text: str) -> str:
            end = time.monotonic() + 60
            while text not in (shown := (tmp_path / "log").read_text()):
                assert time.monotonic() < end, shown
                assert process.poll() is None, shown
                time.sleep(0.05)
            return shown

        yield tmp_path, process, shows
        process.kill()


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
