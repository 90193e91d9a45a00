"""Programs that call others: corrected as files, and judged by LinuxCNC, or by positions that are worked out by hand."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from support.programs import model_of

import ncomp
from kinematics.basis import Polynomial
from kinematics.effects import ErrorMotion
from kinematics.user_error import UserError
from machines import load

GANTRY = load("gantry")
MODEL = model_of(
    GANTRY,
    ErrorMotion("X", "X", Polynomial((0.0, 5000.0), 1), (20.0, 500.0)),
    ErrorMotion("Y", "X", Polynomial((0.0, 5000.0), 1), (-30.0, 250.0)),
    ErrorMotion("Z", "Y", Polynomial((0.0, 3000.0), 1), (0.0, -150.0)),
)
SETUP = ncomp.set_up("gantry", zero=True, datum=["G54=true"])


def tool_points(axes):
    """Where the gantry of MODEL has its tool, mm, at axis positions `(n, 3)`: its errors, um, are slopes in mm."""
    x, y, z = np.asarray(axes, float).T
    return np.column_stack([x + 0.020 + 1e-4 * x, y - 0.030 + 5e-5 * x, z - 5e-5 * y])


def written(folder, files):
    """Files of programs by name; returns the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def corrected(program, into, **options):
    """A program corrected with its called files, which are written into a folder."""
    options = {"setup": SETUP, "travel_check": False, "accept": "outside,insignificant", "beside": True, **options}
    done = ncomp.correct(program, GANTRY, MODEL, **options)
    files = {Path(program).name: done.text, **{each.name: each.data.decode() for each in done.called}}
    written(into, files)
    return done


MOVE = re.compile(r"STRAIGHT_(?:FEED|TRAVERSE)\(([^,]*),([^,]*),([^,]*),")


def linuxcnc(program):
    """The ends of the moves of a program, mm, by LinuxCNC's interpreter, which finds called files in its folder."""
    command = ["rs274", "-g", program.name]
    done = subprocess.run(command, cwd=program.parent, capture_output=True, text=True, timeout=30, check=True)
    return np.array([[float(value) for value in match] for match in MOVE.findall(done.stdout)])


LINUXCNC = {
    "main.ngc": """\
G21 G90 G54 G17
G0 X100 Y100 Z50
o<pocket> call [200] [300]
o<pocket> call [1200] [700]
o100 call
G0 Z50
M2
""",
    "pocket.ngc": """\
o<pocket> sub
G0 X300 Y200 Z40
o100 call
o<pocket> endsub
M2
""",
    "100.ngc": """\
o100 sub
G1 X500 Y250 Z-5 F300
G1 X900 Y400
G1 Z10
o100 endsub
M2
""",
}


@pytest.mark.parametrize("line", ["G0 X300 Y200 Z40", "G0 X#1 Y#2 Z40"], ids=["alike", "different"])
def test_linuxcnc_cuts_the_programmed_path_with_the_corrected_files(tmp_path, line):
    files = {name: text.replace("G0 X300 Y200 Z40", line) for name, text in LINUXCNC.items()}
    folder = written(tmp_path / "in", files)
    done = corrected(folder / "main.ngc", tmp_path / "out")
    nominal, commanded = linuxcnc(folder / "main.ngc"), linuxcnc(tmp_path / "out" / "main.ngc")
    assert len(nominal) == 13
    assert np.abs(tool_points(nominal) - nominal).max() > 0.05
    assert np.abs(tool_points(commanded) - nominal).max() < 0.0003
    as_files = line == "G0 X300 Y200 Z40"
    assert sorted(each.name for each in done.called) == (["100.ngc", "pocket.ngc"] if as_files else [])
    assert ("o<pocket> call" in done.text) == as_files
    assert (folder / "main.ngc").read_text() == files["main.ngc"]


FANUC = {
    "O0001.nc": "%\nO0001 (MAIN)\nG21 G90 G54 G17\nG0 X100. Y100. Z50.\nM98 P1000 L2\nM98 P0003\nG65 P9001 A450. B650.\nM30\n%\n",
    "O1000.nc": "%\nO1000\nG1 X300. Y200. Z0. F500\nX700.\nM98 P3\nM99\n%\n",
    "3": "O3\nG0 X700. Y300. Z50.\nM99\n",
    "o9001.NC": "%\nO9001 (MACRO)\nG1 X#1 Y#2 Z-1. F200\nM99\n%\n",
}
FANUC_PATH = np.array(
    [(100, 100, 50), *[(300, 200, 0), (700, 200, 0), (700, 300, 50)] * 2, (700, 300, 50), (450, 650, -1)], float
)


def test_a_set_of_fanuc_is_corrected_in_its_files(tmp_path):
    folder = written(tmp_path / "in", FANUC)
    done = corrected(folder / "O0001.nc", tmp_path / "out")
    assert sorted(each.name for each in done.called) == ["3", "O1000.nc", "o9001.NC"]
    out = {name: (tmp_path / "out" / name).read_text() for name in FANUC}
    assert "M98 P1000 L2" in out["O0001.nc"]
    assert "G65 P9001 A450. B650." in out["O0001.nc"]
    x, y, z = re.search(r"G1 X\[#1([-+][\d.]+)\] Y\[#2([-+][\d.]+)\] Z(\S+)", out["o9001.NC"]).groups()
    for words, point in (
        (re.search(r"X(\S+) Y(\S+) Z(\S+) F500", out["O1000.nc"]).groups(), (300, 200, 0)),
        (re.search(r"X(\S+) Y(\S+) Z(\S+)\nM99", out["3"]).groups(), (700, 300, 50)),
        ((450 + float(x), 650 + float(y), z), (450, 650, -1)),
    ):
        assert np.abs(tool_points([list(map(float, words))]) - point).max() < 0.0003
    verdict = ncomp.verify(folder / "O0001.nc", tmp_path / "out" / "O0001.nc", GANTRY, MODEL, setup=SETUP)
    assert verdict.verdict.before.largest > 50.0
    assert verdict.verdict.after.largest < 0.3


def test_the_programs_of_a_set_make_the_moves_of_its_calls(tmp_path):
    folder = written(tmp_path / "in", FANUC)
    done = ncomp.correct(folder / "O0001.nc", GANTRY, "none", setup=SETUP, travel_check=False)
    assert done.report.notes[0].startswith("the calls of O1000.nc, 3, o9001.NC are written out")
    assert np.allclose(done.moves.machine_target, FANUC_PATH)


def changed(name, old, new):
    return {**FANUC, name: FANUC[name].replace(old, new)}


REFUSED = {
    "missing": (
        {name: text for name, text in FANUC.items() if name != "3"},
        r"in/O1000\.nc:5: 'M98 P3': .*no subprogram O3, and no file of it is in \S*/in: .*subprograms",
    ),
    "recursion": (changed("O1000.nc", "P3", "P1000"), r"O1000\.nc:5: .*calls itself"),
    "recursion of two files": (changed("3", "M99", "M98 P1000\nM99"), r"in/3:3: .*calls itself"),
    "main program": (changed("3", "M99", "M98 P1\nM99"), r"O0001\.nc:5: .*calls itself"),
    "without an end": (changed("3", "M99\n", ""), r"in/3:2: .*no end: write M99"),
    "another program inside": (changed("3", "O3", "O4"), r"in/3 has no subprogram O3"),
    "twice": ({**FANUC, "o1000.NC": FANUC["O1000.nc"]}, r"O0001\.nc:5: .*O1000\.nc and o1000\.NC .*both named O1000"),
    "marked": (
        changed("O1000.nc", "O1000\n", "O1000\n(NCOMP 0.1.0 MACHINE GANTRY CALIBRATION 0123456789AB)\n"),
        r"in/O1000\.nc:3: .*already corrected",
    ),
    "Siemens": (
        {**FANUC, "O1000.nc": "G1 X=R1\nM17\n"},
        r"O0001\.nc:5: .*O1000\.nc is Siemens because of line 1.*program of one dialect",
    ),
    "not understood": (changed("3", "G0", "G31"), r"in/3:2: .*G31"),
    "empty": ({**FANUC, "3": ""}, r"in/3 is empty"),
}


@pytest.mark.parametrize(("files", "message"), REFUSED.values(), ids=REFUSED)
def test_a_set_that_cannot_be_used_is_refused_with_its_place(tmp_path, files, message):
    folder = written(tmp_path / "in", files)
    with pytest.raises(UserError, match=message):
        corrected(folder / "O0001.nc", tmp_path / "out")


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    folder = written(tmp_path / "in", {name: text for name, text in FANUC.items() if name != "3"})
    written(tmp_path, {"elsewhere.nc": FANUC["3"]})
    (folder / "3").symlink_to(tmp_path / "elsewhere.nc")
    with pytest.raises(UserError, match=r"O1000\.nc:5: .*is a link to .*outside of its folder"):
        corrected(folder / "O0001.nc", tmp_path / "out")


def test_subprograms_of_another_folder_are_found_when_it_is_named(tmp_path):
    folder = written(tmp_path / "in", {"O0001.nc": FANUC["O0001.nc"]})
    library = written(tmp_path / "library", {name: text for name, text in FANUC.items() if name != "O0001.nc"})
    setup = ncomp.set_up("gantry", zero=True, datum=["G54=true"], subprograms=[library])
    done = corrected(folder / "O0001.nc", tmp_path / "out", setup=setup)
    assert sorted(each.name for each in done.called) == ["3", "O1000.nc", "o9001.NC"]
