"""Full disks, folders that vanish, processes that are killed, inputs that change: a result is whole or it is absent."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.forked import run_forked, start_forked
from support.programs import load, shifted
from support.tiers import quick

from kinematics.error_model.model import write_model

PROGRAM = "G21 G90 G54\nG0 X100. Y100. Z100.\nG1 X200. F500\nY300.\nM30\n"
GANTRY = ("--machine", "gantry", "--calibration", "cal.json", "--set-up-zero")
RUN = "from postproc.cli import run; run()"
OLD = b"old\n"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    """A folder with a program, a calibration and outputs of a run before."""
    write_model(shifted(load("gantry"), X=-10.0), tmp_path / "cal.json")
    (tmp_path / "in.nc").write_text(PROGRAM)
    for name in ("out.nc", "out.json", "out.html"):
        (tmp_path / name).write_bytes(OLD)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))
    return tmp_path


def shell(command: str) -> subprocess.CompletedProcess[bytes]:
    """A shell command in which `ncomp` runs this code."""
    ncomp = f"{sys.executable} -c '{RUN}'"
    return subprocess.run(["bash", "-c", command.replace("ncomp", ncomp)], capture_output=True, check=False, timeout=60)


def started(*arguments: str, **options) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", RUN, *arguments], stderr=subprocess.PIPE, **options)


def names() -> set[str]:
    return {path.name for path in Path().iterdir()}


def check_refused(done: subprocess.CompletedProcess[bytes], words: str) -> None:
    """One clear message, exit status 2, and the outputs of the run before are still there, alone."""
    assert done.returncode == 2, done.stderr
    message = done.stderr.decode()
    assert words in message
    assert message.count("\n") == 1
    assert "Traceback" not in message
    assert {Path(name).read_bytes() for name in ("out.nc", "out.json", "out.html")} == {OLD}
    assert not {name for name in names() if name.startswith(".")}


OUTPUTS = {
    "-o /dev/full": "cannot write /dev/full: No space left on device",
    "-o out.nc --json /dev/full": "cannot write /dev/full: No space left on device",
    "-o out.nc --json out.json --report /dev/full": "cannot write /dev/full: No space left on device",
    "> /dev/full": "cannot write standard output: No space left on device",
    "--json out.json > /dev/full": "cannot write standard output: No space left on device",
    "-o out.nc --json - > /dev/full": "cannot write standard output: No space left on device",
    ">&-": "cannot write standard output: it is closed",
}


@pytest.mark.parametrize(
    "where", quick(OUTPUTS, ["-o out.nc --json out.json --report /dev/full", "> /dev/full", ">&-"])
)
def test_a_device_without_space_leaves_no_result_at_all(where):
    if ">" in where:
        done = shell(f"ncomp in.nc {' '.join(GANTRY)} {where}")
    else:
        done = run_forked("in.nc", *GANTRY, *where.split())
    check_refused(done, OUTPUTS[where])


@pytest.mark.statistical
@pytest.mark.parametrize(
    "command",
    ["ncomp verify in.nc in.nc --machine gantry --calibration cal.json", "ncomp machines", "ncomp --help",
     "ncomp check in.nc --machine gantry", "ncomp predict --help"],
)  # fmt: skip
def test_tables_for_people_on_a_full_disk(command):
    done = shell(f"{command} > /dev/full")
    assert done.returncode == 2
    full = "No space left on device: make room on the disk, or name a file on another one"
    assert done.stderr.decode().splitlines()[-1] == f"ncomp: cannot use standard output: {full}"
    assert b"Traceback" not in done.stderr


@pytest.mark.statistical
@pytest.mark.parametrize(
    "command",
    ["plan --machine gantry --strategy grid --points 3 -o {}", "plan --machine gantry --strategy grid -o out.nc --nc {}",
     "simulate --machine gantry --strategy grid --points 3 --instrument laser-tracker -o {}",
     "predict points.csv --machine gantry --calibration cal.json -o {}"],
)  # fmt: skip
def test_other_commands_on_a_full_disk(folder, command):
    (folder / "points.csv").write_text("X,Y,Z\n1,2,3\n")
    done = shell(f"ncomp {command.format('/dev/full')}")
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr.decode()
    assert (folder / "out.nc").read_bytes() == OLD


def test_a_quota_in_the_midst_of_a_result():
    """A file may not grow beyond 4 kB: the program fits, and the page with its figures does not."""
    quota = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))"
    done = run_forked("in.nc", *GANTRY, "-o", "out.nc", "--report", "out.html", before=quota)
    check_refused(done, "cannot write out.html: File too large")


POWERLESS = """
import ctypes
assert not ctypes.CDLL(None).capset(ctypes.byref((ctypes.c_uint32 * 2)(0x20080522, 0)), (ctypes.c_uint32 * 6)())
"""
"""Permissions count for root as well."""
FORBIDDEN = {
    ("in.nc", 0o000): ("-o new.nc", "program in.nc: Permission denied: change its permissions, or name another file"),
    ("cal.json", 0o000): ("-o new.nc", "calibration cal.json: Permission denied: change its permissions"),
    ("locked", 0o555): ("-o locked/new.nc", "cannot write locked/new.nc: Permission denied: change its permissions"),
    ("closed", 0o000): ("-o closed/new.nc", "closed/new.nc: Permission denied: change its permissions"),
    ("hidden", 0o000): (
        "-o new.nc --log hidden/log.csv",
        "log hidden/log.csv: Permission denied: change its permissions",
    ),
}


@pytest.mark.skipif(sys.platform != "linux", reason="capabilities are of Linux")
@pytest.mark.parametrize(("name", "mode"), FORBIDDEN)
def test_what_may_not_be_read_or_written(folder, name, mode):
    options, message = FORBIDDEN[name, mode]
    if not (folder / name).exists():
        (folder / name).mkdir()
    (folder / name).chmod(mode)
    try:
        check_refused(run_forked("in.nc", *GANTRY, *options.split(), before=POWERLESS), message)
    finally:
        (folder / name).chmod(0o755)


def test_a_small_disk_that_fills_up(folder):
    disk = folder / "disk"
    disk.mkdir()
    if (
        os.geteuid() != 0
        or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=16k", "none", disk], check=False).returncode
    ):
        pytest.skip("no permission to mount a small disk")
    try:
        (folder / "in.nc").write_text(PROGRAM.replace("M30", "X100.\nX200.\n" * 1_500 + "M30"))
        (disk / "out.nc").write_bytes(OLD)
        done = run_forked("in.nc", *GANTRY, "-o", "disk/out.nc")
        assert (disk / "out.nc").read_bytes() == OLD
        assert [path.name for path in disk.iterdir()] == ["out.nc"]
        check_refused(done, "cannot write disk/out.nc: No space left on device")
    finally:
        subprocess.run(["umount", disk], check=True)


def test_a_folder_that_vanishes_during_the_run(folder):
    (folder / "gone").mkdir()
    vanish = 'import os, shutil; os.fsync = lambda _: shutil.rmtree("gone")'
    done = run_forked("in.nc", *GANTRY, "-o", "gone/out.nc", before=vanish)
    check_refused(done, "cannot write gone/out.nc: No such file or directory")


# ---- killed


DIE = "import os\ndef die(*_): os.kill(os.getpid(), 9)\n"
MOMENTS = {
    "is written": "import kinematics.files; kinematics.files._NamedFile.write = die",
    "is safe on the disk": "os.fsync = die",
    "has its permissions": "import pathlib; pathlib.Path.chmod = die",
    "takes its place": "import pathlib; pathlib.Path.replace = die",
    "shows its summary": "import postproc.commands.show.terminal; postproc.commands.show.terminal.show = die",
}


@pytest.mark.parametrize("moment", quick(MOMENTS, ["is written", "takes its place", "shows its summary"]))
def test_killed_when_the_result(moment):
    """The file holds the old result or the new one, and remaining files do not disturb the next run."""
    done = run_forked("in.nc", *GANTRY, "-o", "out.nc", before=DIE + MOMENTS[moment])
    assert done.returncode == -signal.SIGKILL, done.stderr
    written = moment == "shows its summary"
    assert (Path("out.nc").read_bytes() != OLD) == written
    left = {name for name in names() if name.startswith(".")}
    assert run_forked("in.nc", *GANTRY, "-o", "out.nc").returncode == 0
    check_whole(Path("out.nc").read_text())
    assert {name for name in names() if name.startswith(".")} == left


@pytest.mark.parametrize("moment", ["is safe on the disk", "takes its place", "shows its summary"])
def test_killed_in_place_when_the_result(folder, moment):
    """The program exists, unchanged or corrected; if it is corrected, a backup of the input exists."""
    done = run_forked("in.nc", *GANTRY, "--in-place", before=DIE + MOMENTS[moment])
    assert done.returncode == -signal.SIGKILL, done.stderr
    text = (folder / "in.nc").read_text()
    if text != PROGRAM:
        check_whole(text)
        assert (folder / "in.nc.orig").read_text() == PROGRAM
    assert (text != PROGRAM) == (moment == "shows its summary")


def check_whole(text: str) -> None:
    assert text.startswith("(NCOMP ")
    assert text.endswith("M30\n")


@pytest.mark.statistical
@pytest.mark.parametrize("stop", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_stopped_at_some_moment(folder, stop):
    (folder / "in.nc").write_text(PROGRAM.replace("M30", "X100.\nX200.\n" * 20_000 + "M30"))
    for _ in range(3):
        with started("in.nc", *GANTRY, "-o", "out.nc", cwd=folder) as process:
            time.sleep(random.uniform(0.3, 2.5))
            process.send_signal(stop)
            status = process.wait(60)
            assert process.stderr is not None
            assert b"internal fault" not in process.stderr.read()
        text = Path("out.nc").read_bytes()
        assert text == OLD or (text.startswith(b"(NCOMP ") and text.endswith(b"M30\n"))
        if stop != signal.SIGKILL and status != -stop:  # it came before Python was ready for it
            assert status in (0, 1, 128 + stop)
            assert not {name for name in names() if name.startswith(".")}


@pytest.mark.statistical
def test_a_reader_that_goes(folder):
    (folder / "in.nc").write_text(PROGRAM.replace("M30", "X100.\nX200.\n" * 20_000 + "M30"))
    done = shell(f"ncomp in.nc {' '.join(GANTRY)} --json out.json | head -1; exit ${{PIPESTATUS[0]}}")
    assert done.returncode == 1
    assert done.stdout.startswith(b"(NCOMP ")
    assert done.stderr == b""
    assert Path("out.json").read_bytes() == OLD


def test_two_runs_at_once(folder):
    (folder / "in.nc").write_text(PROGRAM.replace("M30", "X100.\nX200.\n" * 500 + "M30"))
    processes = [start_forked("in.nc", *GANTRY, "-o", "out.nc", "--json", "out.json") for _ in range(2)]
    for process in processes:
        process.join(60)
        assert process.exitcode == 0
    check_whole(Path("out.nc").read_text())
    assert not {name for name in names() if name.startswith(".")}


# ---- outputs and inputs that are no plain files


def test_a_link_stays_and_its_target_is_replaced(folder):
    (folder / "real").mkdir()
    (folder / "real" / "prog.nc").write_bytes(OLD)
    Path("link.nc").symlink_to("real/prog.nc")
    assert run_forked("in.nc", *GANTRY, "-o", "link.nc").returncode == 0
    assert Path("link.nc").is_symlink()
    check_whole(Path("real/prog.nc").read_text())
    Path("dangling.nc").symlink_to("nowhere/prog.nc")
    check_refused(run_forked("in.nc", *GANTRY, "-o", "dangling.nc"), "cannot write dangling.nc")


def test_standard_output_by_its_name_is_not_replaced():
    done = shell(f"ncomp in.nc {' '.join(GANTRY)} -o /dev/stdout > made.nc; ls -l /dev/stdout")
    assert b"-> /proc/self/fd/1" in done.stdout
    check_whole(Path("made.nc").read_text())


def test_an_input_that_changes_while_it_is_read():
    change = """
import pathlib, postproc.correct.pipeline as p
def run(self, *rest, old=p.Pipeline.run):
    path = pathlib.Path("in.nc"); path.write_text(path.read_text() + "G0 X1.")
    return old(self, *rest)
p.Pipeline.run = run
"""
    done = run_forked("in.nc", *GANTRY, "-o", "out.nc", before=change)
    check_refused(done, "program in.nc was changed while it was read")


def test_an_input_that_vanishes_while_it_is_read():
    change = """
import pathlib, postproc.correct.pipeline as p
def run(self, *rest, old=p.Pipeline.run):
    pathlib.Path("in.nc").unlink()
    return old(self, *rest)
p.Pipeline.run = run
"""
    done = run_forked("in.nc", *GANTRY, "-o", "out.nc", before=change)
    check_refused(done, "program in.nc: No such file or directory")


ODD = {
    "empty": (b"", "is empty"),
    "blank": (b" \n" * 50, "is empty"),
    "NULs": (b"\0" * 100_000, "no NC text"),
    "binary": (bytes(range(256)) * 10, "binary file"),
    "UTF-16": (PROGRAM.encode("utf-16"), "UTF-16"),
    "UTF-16 without a mark": (PROGRAM.encode("utf-16-le"), "binary file"),
    "a NUL far behind": (
        PROGRAM[:-4].encode() + b"(" + b"a" * 30_000 + b")\nG1 X\0005.\n",
        "in.nc:6: '\\x00' is no character of an NC program",
    ),
    "an escape far behind": (PROGRAM[:-4].encode() + b"X1.\n" * 9_000 + b"\x1bX2.\n", "in.nc:9005: '\\x1b'"),
    "a long line": (b"G1 X1.\n" + b"X1." * 700_000, "a line of more than 1000000 characters"),
    "a long comment": (b"(" + b"a" * 2_000_000 + b")\n", "a line of more than 1000000 characters"),
}


@pytest.mark.parametrize("name", ODD)
def test_inputs_that_are_no_program(folder, command, name):
    data, words = ODD[name]
    (folder / "in.nc").write_bytes(data)
    done = command("in.nc", *GANTRY, "-o", "out.nc")
    check_refused(subprocess.CompletedProcess([], done.status, done.out, done.err.encode()), words)


def test_an_endless_input_is_refused():
    """Also by its size in memory."""
    limited = "import resource; resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))"
    done = run_forked("/dev/zero", *GANTRY, "-o", "out.nc", before=limited)
    check_refused(done, "no NC text")


def test_an_input_from_a_pipe():
    os.mkfifo("pipe.nc")
    with subprocess.Popen(["bash", "-c", "cat in.nc > pipe.nc"]):
        done = run_forked("pipe.nc", *GANTRY, "-o", "made.nc")
    assert done.returncode == 0, done.stderr
    check_whole(Path("made.nc").read_text())
