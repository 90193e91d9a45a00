"""Outputs are whole or absent."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from kinematics.files import changed_since_read, fingerprint, read_input, whole_file, write_whole
from kinematics.files.inputs import run_with_inputs
from kinematics.user_error import UserError

NOBODY = 65534


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """An output that exists already."""
    path = tmp_path / "out.nc"
    path.write_bytes(b"old")
    return path


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_written_whole(tmp_path):
    with whole_file(tmp_path / "out.nc") as out:
        out.write(b"G1 X1\r\n")
        assert not (tmp_path / "out.nc").exists()
        out.write(b"\xff")
    assert contents(tmp_path) == {"out.nc": b"G1 X1\r\n\xff"}


def test_takes_the_place_of_the_old_at_the_end(file):
    with whole_file(file) as out:
        out.write(b"new")
        out.flush()
        assert file.read_bytes() == b"old"
    assert contents(file.parent) == {"out.nc": b"new"}


@pytest.mark.parametrize("fault", [ValueError, KeyboardInterrupt, UserError, SystemExit])
@pytest.mark.parametrize("existing", [True, False])
def test_a_failure_leaves_the_old_and_no_trace(tmp_path, fault, existing):
    path = tmp_path / "out.nc"
    if existing:
        path.write_bytes(b"old")

    def half_way() -> None:
        with whole_file(path) as out:
            out.write(b"half")
            raise fault("half-way")

    with pytest.raises(fault, match="half-way"):
        half_way()
    assert contents(tmp_path) == ({"out.nc": b"old"} if existing else {})


@pytest.mark.parametrize("step", ["fsync", "replace", "chmod"])
@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (OSError(28, "No space left"), "No space left: make room on the disk, or name a file on another one"),
        (OSError("odd"), "odd"),
    ],
)
def test_a_full_disk_leaves_the_old_and_no_trace(file, monkeypatch, step, fault, reason):
    def fails(*_: object) -> None:
        raise fault

    monkeypatch.setattr(*((os, "fsync") if step == "fsync" else (Path, step)), fails)
    with pytest.raises(UserError) as refusal:
        write_whole(file, b"new")
    assert str(refusal.value) == f"cannot write {file}: {reason}"
    assert contents(file.parent) == {"out.nc": b"old"}


def test_a_folder_that_is_missing_or_none_is_refused(file):
    for path, reason in {
        file.parent / "missing" / "out.nc": "No such file or directory",
        file / "out.nc": "Not a directory: a part of the path is a file; name a folder",
    }.items():
        with pytest.raises(UserError) as refusal:
            write_whole(path, b"new")
        assert str(refusal.value) == f"cannot write {path}: {reason}"
    assert contents(file.parent) == {"out.nc": b"old"}


def test_a_folder_as_output_is_refused(tmp_path):
    (tmp_path / "out").mkdir()
    with pytest.raises(UserError, match=r"cannot write .*/out: Is a directory: give the name of a file$"):
        write_whole(tmp_path / "out", b"new")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_folder_without_permission_is_refused(file):
    user = os.geteuid()
    file.parent.chmod(0o500)
    if user == 0:  # who may write everywhere
        os.seteuid(NOBODY)
    try:
        with pytest.raises(UserError) as refusal:
            write_whole(file, b"new")
    finally:
        os.seteuid(user)
        file.parent.chmod(0o700)
    assert str(refusal.value) == f"cannot write {file}: Permission denied: change its permissions, or name another file"
    assert contents(file.parent) == {"out.nc": b"old"}


@pytest.mark.parametrize("permissions", [0o600, 0o644, 0o664, 0o755])
def test_permissions_are_kept(file, permissions):
    file.chmod(permissions)
    write_whole(file, b"new")
    assert mode(file) == permissions


@pytest.mark.parametrize(("mask", "permissions"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_a_new_file_has_the_permissions_of_the_umask(tmp_path, mask, permissions):
    before = os.umask(mask)
    try:
        write_whole(tmp_path / "out.nc", b"new")
        assert os.umask(mask) == mask
    finally:
        os.umask(before)
    assert mode(tmp_path / "out.nc") == permissions


def test_reading(file, tmp_path):
    assert read_input(file, "program") == b"old"
    with pytest.raises(UserError) as refusal:
        read_input(tmp_path / "none.nc", "program")
    near = f" (did you mean '{file.name}'?)"
    assert str(refusal.value) == f"program {tmp_path / 'none.nc'}: No such file or directory{near}"
    with pytest.raises(UserError, match=r"^program .*: Is a directory: give the name of a file$"):
        read_input(tmp_path, "program")


def test_fingerprint():
    assert fingerprint(b"") == "e3b0c44298fc"  # SHA-256 of nothing
    assert fingerprint(b"G1") != fingerprint(b"G0")


DRAFT = """
import signal, sys
from pathlib import Path
from kinematics.running import child_process
from kinematics.files import Draft
draft = Draft(Path("out.nc"))
assert len(list(Path(".").iterdir())) == 1
"""
TOLD_TO_END_AND_DOES_NOT = """
signal.signal(signal.SIGTERM, signal.SIG_IGN)
child_process.GRACE_S = 0.01
child_process.end_in_the_midst()
"""


@pytest.mark.parametrize(("end", "status"), [("sys.exit(3)", 3), ("1 / 0", 1), (TOLD_TO_END_AND_DOES_NOT, 143)])
def test_a_process_that_ends_before_it_publishes_leaves_no_draft(tmp_path, end, status):
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    words = [sys.executable, "-c", DRAFT + end]
    assert subprocess.run(words, check=False, cwd=tmp_path, env=environment, capture_output=True).returncode == status
    assert not list(tmp_path.iterdir())


def test_inputs_that_changed_during_a_run_are_known(tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    one.write_text("a")
    other.write_text("a")
    with run_with_inputs():
        read_input(one, "file")
        read_input(other, "file")
        assert changed_since_read([one, other]) == []
        other.write_text("b")
        assert changed_since_read([one, other]) == [other]
        other.unlink()
        assert changed_since_read([one, other]) == [other]
    assert changed_since_read([one, other]) == []
