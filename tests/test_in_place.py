"""A program is replaced only on demand, and its backup is complete on disk before."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from kinematics.user_error import UserError
from postproc.commands.programs import in_place

TEXT = "G21 G90 G17 G54\nG0 X1.0 Y2.0 Z3.0\nG1 X20.0 F500\nM30\n"
JOB = ("--machine", "dmu50", "--set-up-zero", "--no-travel-check")


@pytest.fixture(autouse=True)
def program(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("a.nc").write_text(TEXT)
    Path("a.nc").chmod(0o640)


def corrected(command):
    assert command("a.nc", *JOB, "-o", "expected").status == 0
    text = Path("expected").read_text()
    Path("expected").unlink()
    return text


def spelt_otherwise():
    return "folder/../a.nc"


def through_a_symbolic_link():
    Path("link.nc").symlink_to("a.nc")
    return "link.nc"


def through_a_hard_link():
    Path("hard.nc").hardlink_to("a.nc")
    return "hard.nc"


def absolute():
    return str(Path("a.nc").absolute())


OTHER_NAMES = (spelt_otherwise, through_a_symbolic_link, through_a_hard_link, absolute, lambda: "a.nc")


@pytest.mark.parametrize("name", OTHER_NAMES)
def test_the_input_is_no_output_without_the_option(name, command):
    Path("folder").mkdir()
    output = name()
    done = command("a.nc", *JOB, "-o", output)
    assert done.status == 2
    assert f"--output {output} is the input a.nc: --in-place replaces it and keeps a backup" in done.err
    done = command(output, *JOB, "-o", "a.nc")
    assert done.status == 2
    assert Path("a.nc").read_text() == TEXT
    assert not list(Path().glob("*.orig*"))


@pytest.mark.parametrize("more", [(), ("-o", "a.nc")])
def test_in_place_keeps_a_backup(more, command):
    expected = corrected(command)
    assert command("a.nc", *JOB, *more, "--in-place").status == 0
    assert Path("a.nc").read_text() == expected
    assert Path("a.nc.orig").read_text() == TEXT
    assert Path("a.nc.orig").stat().st_mode & 0o777 == 0o640
    assert sorted(path.name for path in Path().iterdir()) == ["a.nc", "a.nc.orig"]


def test_through_a_symbolic_link_its_target_is_replaced(command):
    expected, link = corrected(command), through_a_symbolic_link()
    assert command(link, *JOB, "--in-place").status == 0
    assert Path(link).is_symlink()
    assert Path("a.nc").read_text() == expected
    assert Path("a.nc.orig").read_text() == TEXT


def test_an_earlier_backup_stays(command):
    Path("a.nc.orig").write_text("the first")
    Path("a.nc.orig1").symlink_to("nowhere")
    assert command("a.nc", *JOB, "--in-place").status == 0
    assert Path("a.nc.orig").read_text() == "the first"
    assert Path("a.nc.orig1").is_symlink()
    assert Path("a.nc.orig2").read_text() == TEXT


@pytest.mark.parametrize("arguments", [("--in-place", "-o", "b.nc"), ("--in-place", "-o", "-")])
def test_in_place_and_another_output(arguments, command):
    done = command("a.nc", *JOB, *arguments)
    assert done.status == 2
    assert "--in-place replaces the input a.nc, and --output names" in done.err


def test_standard_input_can_not_be_replaced(command):
    done = command("-", *JOB, "--in-place", stdin=TEXT.encode())
    assert done.status == 2
    assert "--in-place: standard input is not a file" in done.err


def test_a_refused_program_leaves_no_backup(command):
    Path("a.nc").write_text("G31 X1.\n" + TEXT)
    before = Path("a.nc").read_bytes()
    assert command("a.nc", *JOB, "--in-place").status == 2
    assert Path("a.nc").read_bytes() == before
    assert sorted(path.name for path in Path().iterdir()) == ["a.nc"]


def test_a_program_that_changed_meanwhile_is_not_replaced():
    with pytest.raises(UserError, match=r"a\.nc was changed while it was read"), in_place.backup_of("a.nc", "0" * 12):
        pytest.fail("no backup of another program")
    assert sorted(path.name for path in Path().iterdir()) == ["a.nc"]


def test_without_hard_links(command, monkeypatch):
    def refuse(*_):
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "hardlink_to", refuse)
    assert command("a.nc", *JOB, "--in-place").status == 0
    assert Path("a.nc.orig").read_text() == TEXT


def test_a_folder_that_can_not_be_written(command):
    if os.getuid() == 0:
        pytest.skip("root writes everywhere")
    Path().chmod(0o500)
    done = command("a.nc", *JOB, "--in-place")
    Path().chmod(0o700)
    assert done.status == 2
    assert "cannot write" in done.err


@pytest.mark.parametrize("at", ["replace", "rename"])
def test_killed_when_the_input_is_replaced(at):
    """The process dies by SIGKILL at the very replacement: the input is whole, and so is its backup."""
    script = (
        "import os, signal, sys, pathlib\n"
        "from postproc import cli\n"
        f"pathlib.Path.{at} = lambda *_: os.kill(os.getpid(), signal.SIGKILL)\n"
        f"sys.argv = ['ncomp', 'a.nc', *{JOB!r}, '--in-place']\n"
        "cli.run()\n"
    )
    folder = str(Path(in_place.__file__).parents[3])
    done = subprocess.run(
        [sys.executable, "-c", script], env={**os.environ, "PYTHONPATH": folder}, capture_output=True, check=False
    )
    if at == "replace":
        assert done.returncode == -signal.SIGKILL
        assert Path("a.nc").read_text() == TEXT
    assert Path("a.nc.orig").read_text() == TEXT
    shutil.rmtree("__pycache__", ignore_errors=True)
