"""The shipped demonstration calibration is announced on every run that uses it."""

import shutil
from pathlib import Path

import pytest
from support.command import run_command

BOX = Path(__file__).parents[1] / "examples" / "box.nc"
SET_UP = ("--machine", "dmu50", "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80")
SHIPPED = Path(__file__).parents[1] / "machines" / "calibrations" / "dmu50.json"
RUNS = {
    "correct": ("box.nc", *SET_UP, "-o", "out.nc"),
    "verify": ("verify", "box.nc", "corrected.nc", *SET_UP),
    "batch": ("batch", "posted", "corr", *SET_UP, "--jobs", "1"),
    "watch": ("watch", "posted", "watched", *SET_UP, "--idle", "0.2", "--settle", "0.1"),
    "predict": ("predict", "points.csv", "--machine", "dmu50", "-o", "predicted.csv"),
    "compare": ("compare", str(SHIPPED), "copy.json"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("demonstration")
    for name in ("box.nc", "posted/box.nc"):
        (made / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(BOX, made / name)
    shutil.copyfile(SHIPPED, made / "copy.json")
    (made / "points.csv").write_text("X,Y,Z,B,C\n0,0,100,0,0\n")
    run_command(BOX, *SET_UP, "-o", made / "corrected.nc")
    return made


@pytest.mark.parametrize("name", RUNS)
def test_it_is_announced(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    done = run_command(*RUNS[name])
    assert done.status == 0, done.shown
    assert "demonstration calibration" in done.shown.lower()
    assert "it describes no real machine" in done.shown
