"""Machines of a user's folder, drawings, init and doctor."""

import json
import os
import pty
import re
import shutil
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

import machines
import ncomp
from kinematics.forward import forward
from postproc.commands.show.chain import drawn_pose, shapes

MILL = (machines.FOLDER / "gantry.toml").read_text().replace('"gantry"', '"mill"')
RUN = [sys.executable, "-c", "from postproc.cli import run; run()"]


@pytest.fixture(autouse=True)
def _own_folders(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("NCOMP_MACHINES", str(tmp_path / "shop"))
    (tmp_path / "shop").mkdir()
    (tmp_path / "config/ncomp/machines").mkdir(parents=True)


# ---- a folder of machines


def test_machines_of_the_users_folders_are_found_by_name(command, tmp_path):
    (tmp_path / "shop/mill.toml").write_text(MILL)
    (tmp_path / "config/ncomp/machines/old.toml").write_text(MILL.replace('"mill"', '"old"'))
    (tmp_path / "config/ncomp/machines/mill.toml").write_text("a second one of this name")
    (tmp_path / "shop/broken.toml").write_text("name = mill\n")
    (tmp_path / "shop/dmu50.toml").write_text(MILL)
    listed = command("machines")
    assert listed.status == 0
    lines = {line.split()[0]: line for line in reversed(listed.out.decode().splitlines())}
    assert str(tmp_path / "shop/mill.toml") in lines["mill"]
    assert "old.toml" in lines["old"]
    assert "cannot be used: machine file" in lines["broken"]
    assert "the shipped machine of this name is used in its place" in listed.out.decode()
    assert ncomp.load_machine("mill").name == "mill"
    refused = command("machines", "mil")
    assert "unknown machine 'mil' (did you mean 'mill'?)" in refused.err
    assert "yours are broken, dmu50, mill, old" in refused.err


def test_a_calibration_beside_the_machines_is_its_own(tmp_path):
    from kinematics.error_model.model import no_errors, write_model

    (tmp_path / "shop/mill.toml").write_text(MILL)
    mill = ncomp.load_machine("mill")
    assert machines.default_calibration(mill) is None
    (tmp_path / "shop/calibrations").mkdir()
    write_model(no_errors(mill), tmp_path / "shop/calibrations/mill.json")
    assert machines.default_calibration(mill) == tmp_path / "shop/calibrations/mill.json"


# ---- drawings


@pytest.mark.parametrize("name", machines.names())
def test_the_arrows_are_the_motion_of_the_tool_relative_to_the_workpiece(name):
    """Of each axis by the exact kinematics: the tool's point in the workpiece moves along the arrow."""
    machine = machines.load(name)
    drawn = drawn_pose(machine)
    for shape in shapes(machine):
        if shape.kind not in ("axis", "turn"):
            continue
        i = machine.names.index(shape.axis)
        a, b = (shape.points[0], shape.points[-1]) if shape.kind == "axis" else shape.points[:2]
        step = np.where(np.arange(len(drawn)) == i, 1e-4, 0.0)
        here, there = (forward(machine, q) for q in (drawn, drawn + step))
        held = here.rotation[0].T @ (a - here.translation[0])  # the same point, in the tool
        moved = there.rotation[0] @ held + there.translation[0] - a
        assert np.dot(moved, b - a) > 0.9 * np.linalg.norm(moved) * np.linalg.norm(b - a)


@pytest.mark.parametrize("name", machines.names())
def test_the_tool_is_drawn_off_the_workpiece_by_its_travel(name):
    """Each where the exact kinematics put the tool: above the workpiece, which lies within the travel."""
    machine = machines.load(name)
    parts = {shape.label: shape.points for shape in shapes(machine) if shape.kind == "part"}
    nose, workpiece = parts["tool t"][0], parts["workpiece w"][:-1].mean(axis=0)
    lifted, lowered = (drawn_pose(machine, lowered=low) for low in (False, True))
    np.testing.assert_allclose(nose, forward(machine, lifted).translation[0], atol=1e-9)
    np.testing.assert_allclose(workpiece, forward(machine, lowered).translation[0], atol=1e-9)
    travel = next(axis.travel for axis in machine.axes if axis.name == "Z")
    assert nose[2] - workpiece[2] == pytest.approx(travel[1] - travel[0])
    for q in (lifted, lowered):
        assert np.all((machine.travel[0] <= q) & (q <= machine.travel[1]) | machine.rotary)


def test_a_picture_of_the_chain(command):
    shown = command("machines", "dmu50", "--draw", "dmu50.svg")
    assert shown.status == 0
    root = ET.parse("dmu50.svg").getroot()
    texts = {"".join(each.itertext()) for each in root.iter("{http://www.w3.org/2000/svg}text")}
    assert {"+X", "+Y", "+Z", "+B", "+C", "B (0, 0, 154.996)", "C (0, 0, 154.996)", "workpiece", "bed", "tool"} <= texts
    assert "the workpiece turns against the arrow" in texts


def test_a_page_that_turns(command):
    assert command("machines", "head_head", "--draw", "head.html").status == 0
    page = Path("head.html").read_text()
    assert '"scatter3d"' in page
    assert '"cone"' in page
    assert "the tool turns along the arrow" in page
    assert 'class="made gap"' not in page
    assert 'class="command gap"' not in page
    assert "http://" not in re.sub(r"http://www\.w3\.org\S*", "", page[: page.index("<script")])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("machines", "dmu50", "--draw", "a.pdf"), "--draw a.pdf: expected a name that ends in .svg or .html"),
        (("machines", "--draw", "a.svg"), "name the machine to draw"),
        (("machines", "dmu50", "--draw", "no/a.svg"), "the folder no does not exist"),
    ],
)
def test_what_is_not_drawn(command, arguments, message):
    done = command(*arguments)
    assert (done.status, done.out) == (2, b"")
    assert message in done.err
    assert not list(Path().glob("a.*"))


# ---- init

AXES = ("--travel", "X=0:800", "--travel", "Y=0:500", "--travel", "Z=-400:0")
NEW = ("init", "made", "--name", "hall3", "--chain", "w b X Y Z t", *AXES, "--work-offset", "G54=100.123456,80,-300")


def test_init_writes_files_that_work_as_printed(command):
    done = command(*NEW, "--tool-length", "T1=95", "--program", "part.nc")
    assert done.status == 0, done.err
    assert ncomp.load_machine("made/hall3.toml").chain == "w b X Y Z t"
    assert "X = 100.123456," in Path("made/job.toml").read_text()
    ET.parse("made/hall3.svg")
    Path("made/part.nc").write_text("G21 G90 G54\nT1 M6\nG0 X1. Y1. Z100.\nM30\n")
    printed = re.search("next: ncomp (.*)", done.err)
    assert printed
    words = printed[1].split()
    assert command(*words).status == 0
    assert not Path("made/corrected").exists()
    assert command(*words[:-1]).status == 0
    assert Path("made/corrected/part.nc").read_bytes() == Path("made/part.nc").read_bytes()
    assert "# G54 = " not in Path("made/job.toml").read_text()
    again = command(*NEW)
    assert again.status == 2
    assert "exists: name another folder, or replace it by --force" in again.err
    assert command(*NEW, "--force").status == 0


def test_init_with_a_machine_that_is_there(command):
    assert (
        command("init", "job", "-m", "dmu50", "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80").status == 0
    )
    assert [path.name for path in Path("job").iterdir()] == ["job.toml"]
    assert "calibration" not in Path("job/job.toml").read_text()  # the machine has one of its own


def test_a_job_and_its_machine_move_together(command):
    machine = (Path(__file__).parents[1] / "machines" / "gantry.toml").read_text().replace('"gantry"', '"mill"', 1)
    Path("hall").mkdir()
    Path("hall/mill.toml").write_text(machine)
    given = ("--work-offset", "G54=0,0,0", "--tool-length", "T1=80", "--calibration", "none")
    assert command("init", "hall/job", "-m", "hall/mill.toml", *given).status == 0
    assert Path("hall/job/job.toml").read_text().startswith('machine = "../mill.toml"')
    Path("hall/job/part.nc").write_text("G21 G90 G54\nT1 M6\nG0 X10. Y10.\nG43 H1 Z500.\nM30\n")
    shutil.move("hall", "moved")
    done = command("moved/job/job.toml")
    assert done.status == 0, done.shown


def test_init_shows_the_form_of_a_set_up_that_is_not_known(command):
    assert command("init", "job", "-m", "gantry").status == 0
    text = Path("job/job.toml").read_text()
    Path("job/job.toml").write_text(text.replace("# G54", "G54").replace("# 1 =", "1 ="))
    Path("job/part.nc").write_text("G21 G90 G54\nT1 M6\nG0 X10. Y10. Z500.\nM30\n")
    assert command("job/job.toml").status == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("init", "new"), "--name is missing"),
        (("init", "new", "--name", "gantry"), "--name gantry: 'gantry' is a shipped machine"),
        (("init", "new", "--name", "a b"), "--name a b: 'a b': expected a name of letters"),
        (("init", "new", "--name", "a", "--chain", "X Y Z"), "--chain X Y Z: chain 'X Y Z' is not of the form"),
        ((*NEW[:6], *AXES[:4]), "--travel Z= is missing"),
        ((*NEW, "--travel", "A=0:5"), "--travel A=0:5: the chain has no axis A"),
        ((*NEW[:6], "--travel", "X=5:1"), "travel 5:1: expected the lower end first"),
        (
            (*NEW, "--calibration", "G54=1,2,3"),
            "--calibration G54=1,2,3: 'G54=1,2,3': expected the .json file of a cal",
        ),
        ((*NEW, "--tool-length", "80"), "--tool-length 80: expected T1=mm"),
        ((*NEW[:6], *AXES, "--work-offset", "G54=1,2"), "expected G54=x,y,z, got 2 of 3"),
    ],
)
def test_answers_that_cannot_be_used(command, arguments, message):
    done = command(*arguments)
    assert done.status == 2
    assert message in done.err
    assert not Path("new").exists()
    assert not Path("made").exists()


TABLE = ("init", "made", "--name", "trunnion", "--chain", "w C A X Y b Z t", "--travel", "X=0:500", "--travel", "Y=-400:0",
         "--travel", "Z=-300:0", "--travel", "A=-120:30", "--travel", "C=-inf:inf", "--program", "../part.nc")  # fmt: skip


@pytest.mark.parametrize(
    ("c", "places"),
    [("250,-200,-410", "X 250, Y -200; if not"), ("0,10,-410", "X 0, Y 10 (outside the travel of Y); if not")],
)
def test_init_names_positions_that_show_a_wrong_point(command, c, places):
    """A table on a cross table: with all axes at 0 its middle is seldom below the spindle."""
    done = command(*TABLE, "--point", f"C={c}", "--point", "A=250,-200,-400")
    assert done.status == 0, done.err
    shown = " ".join(done.err.split())
    assert f"the line of C is below the spindle at {places}, correct point in made/trunnion.toml" in shown
    assert "the line of A is below the spindle at Y -200; if not" in shown
    found = machines.load("made/trunnion.toml")
    q = found.scale * [{"X": 250.0, "Y": -200.0}.get(name, 0.0) for name in found.names]
    nose = forward(found, q).translation[0]
    assert nose[:2] == pytest.approx((250.0, -200.0))  # in the workpiece frame, where the point is given


def test_init_names_a_program_that_is_not_there(command):
    assert command(*NEW, "--program", "part.nc").status == 0
    Path("part.nc").write_text("G21 G90 G54\nG0 X1. Y1. Z1.\nM30\n")
    done = command(*NEW, "--force", "--program", "part.nc")
    assert "first: put the program at made/part.nc\n" in done.err
    Path("made/part.nc").write_text(Path("part.nc").read_text())
    assert "put the program" not in command(*NEW, "--force", "--program", "part.nc").err


@pytest.mark.statistical
def test_init_asks_on_a_terminal(tmp_path):
    """Every question, with wrong answers that are asked again; the answers are given as a person does."""
    leader, follower = pty.openpty()
    process = subprocess.Popen([*RUN, "init", "made"], cwd=tmp_path, stdin=follower, stdout=follower, stderr=follower)
    os.close(follower)
    answers = ["", "gantry", "hall3", "Mill in hall 3", "9", "3", "okuma", "fanuc", "0:360", "1,2", "0,0,150", "-110..110",
               "0,0,150", "-250:250", "-225:225", "0:400", "", "1,2,3", "G54=1,2,3", "", "part.nc"]  # fmt: skip
    shown = b""
    os.set_blocking(leader, False)
    end = time.monotonic() + 60
    while process.poll() is None and time.monotonic() < end:
        try:
            shown += os.read(leader, 4096)
        except BlockingIOError:
            time.sleep(0.05)
        except OSError:
            break
        if answers and re.search(rb"[:\]]:? $", shown.replace(b"\r", b"")) and not shown.endswith(b"\n"):
            os.write(leader, answers.pop(0).encode() + b"\n")
            shown += b"\n"
    assert process.wait(10) == 0, shown.decode()
    assert answers == []
    mill = machines.load(str(tmp_path / "made/hall3.toml"))
    assert (mill.chain, mill.control.family) == ("w C B b X Y Z t", "fanuc")
    assert mill.axes[1].point == (0.0, 0.0, 150.0)
    assert b"an answer is needed" in shown
    assert b"is a shipped machine" in shown
    assert 'calibration = "none"    # a file of ncomp fit' in (tmp_path / "made/job.toml").read_text()
    assert "G54 = { X = 1, Y = 2, Z = 3 }" in (tmp_path / "made/job.toml").read_text()


def test_a_machine_has_its_file_and_its_drawing_is_named(command):
    done = command("machines", "cframe", "--draw", "cframe.svg")
    file = re.search(r"^file +(.*)$", done.out.decode(), re.MULTILINE)
    assert machines.load(file[1]).name == "cframe"
    assert "written: cframe.svg" in done.err
    Path("own.toml").write_text(Path(file[1]).read_text())
    assert "\nfile " not in command("machines", "own.toml").out.decode()


# ---- doctor


def test_doctor(command, tmp_path):
    done = command("doctor", "--json", "found.json")
    assert done.status == 0, done.shown
    found = {each["check"]: each for each in json.loads(Path("found.json").read_text())["checks"]}
    assert {"Python", "libraries", "BLAS", "grammars", "correction", "machines", "folders"} <= found.keys()
    assert all(each["state"] in ("good", "absent") for each in found.values())
    (tmp_path / "shop/broken.toml").write_text("name = mill\n")
    done = command("doctor")
    assert done.status == 2
    assert "broken.toml:1" in "".join(done.out.decode().split())


def test_doctor_finds_a_damaged_installation(command, monkeypatch):
    monkeypatch.setattr("grammars.FOLDER", Path("nowhere"))
    monkeypatch.setattr(
        "kinematics.running.installed.requirements", lambda: iter([("numpy", "99.0", "1.0"), ("lark", "1", None)])
    )
    done = command("doctor")
    assert done.status == 2
    text = " ".join(done.out.decode().split())
    assert "numpy 1.0 is older than 99.0" in text
    assert "lark is missing" in text


def test_versions(command):
    found = json.loads(command("--version", "--json").out)
    assert found["ncomp"] == command("--version").out.decode().split()[1]
    assert found["numpy"] == np.__version__


# ---- more and less


def test_quiet_and_verbose(command):
    options = ("--machine", "gantry", "--strategy", "grid", "--points", "64", "--seed", "1", "-o", "data.csv")
    assert "note:" in command("simulate", *options).shown
    assert "note:" not in command("simulate", *options, "--quiet").shown
    fit = ("fit", "data.csv", "--machine", "gantry", "--basis", "legendre:1", "--force", "-o", "cal.json")
    usual, quiet = command(*fit), command(*fit, "--quiet")
    assert (usual.status, quiet.status) == (0, 0)
    assert 0 < len(quiet.out) < len(usual.out) / 3
    assert quiet.err == ""
    steps = re.findall(r"^ *\d+\.\d s  (.*)$", command("--verbose", *fit).err, re.MULTILINE)
    assert steps[0] == "reading"
    assert re.fullmatch(r"3 of 3: held-out residuals: (\d+) of \1 blocks", steps[-1])
    both = command(*fit, "--quiet", "--verbose")
    assert both.status == 2
    assert "--quiet and --verbose exclude each other" in both.err
    assert command("fit", "--help", "--quiet").status == 0
