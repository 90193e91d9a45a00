"""LinuxCNC's INI file: read as LinuxCNC reads it, against its own `inivar`; and the tables that it names."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from support.machine_texts import machine_text

from kinematics.error_model.model import decode_model
from kinematics.user_error import UserError
from postproc.control.linuxcnc_ini import IniFile, joint_letters, length_unit_mm

EXAMPLES = Path("/usr/share/doc/linuxcnc/examples/sample-configs")
MACHINE = machine_text(travel=(0, 300), name="mini")
COMP = "0 0 0\n50 0.01 0.01\n100 0.02 0.02\n"
X = "[JOINT_0]\nTYPE = LINEAR\nCOMP_FILE = x.comp\nCOMP_FILE_TYPE = 1\n"


@pytest.fixture
def imported(tmp_path, command):
    """The tables of an INI file by axis, um at 50 forward; or the message of the refusal."""

    def run(ini, *options, machine=MACHINE, **files):
        texts = {
            "m.ini": ini,
            "x.comp": COMP,
            "y.comp": COMP,
            **{name.replace("_", "."): t for name, t in files.items()},
        }
        texts = {name: text for name, text in texts.items() if text is not None}
        for name, text in {**texts, "m.toml": machine}.items():
            (tmp_path / name).write_text(text)
        (tmp_path / "o.json").unlink(missing_ok=True)
        done = command("import", *texts, "--machine", "m.toml", "--format", "linuxcnc", "-o", "o.json", *options)
        if done.status:
            assert done.status == 2
            assert not (tmp_path / "o.json").exists()
            return done.err
        tables = decode_model((tmp_path / "o.json").read_bytes(), "o.json").effects
        return {table.axis: table for table in tables if table.way >= 0}

    return run


def um_at(table, k=1):
    return table.nodes[0][k], -table.values[k]


INDENTED = {
    "below another entry": "[JOINT_1]\nTYPE = LINEAR\n  COMP_FILE = y.comp\n  COMP_FILE_TYPE = 1\n",
    "below COMP_FILE": "[JOINT_1]\nCOMP_FILE = y.comp\n  COMP_FILE_TYPE = 1\n",
    "with tabs, and the section too": "\t[JOINT_1]\n\tCOMP_FILE\t=\ty.comp\n\tCOMP_FILE_TYPE=1\n",
    "on two lines": "[JOINT_1]\nCOMP_FILE = \\\n y.comp\nCOMP_FILE_TYPE = 1\n",
}


@pytest.mark.parametrize("joint", INDENTED.values(), ids=INDENTED)
def test_entries_may_be_indented(imported, joint):
    found = imported(X + joint)
    assert {axis: um_at(table) for axis, table in found.items()} == {"X": (50.0, 10.0), "Y": (50.0, 10.0)}


def test_included_files_are_read(imported):
    joint = "  [JOINT_1]\n  COMP_FILE = y.comp\n  COMP_FILE_TYPE = 1\n"
    assert set(imported(f"{X}#INCLUDE  parts/joint1.inc\n[JOINT_2]\n", joint1_inc=joint)) == {"X", "Y"}
    assert set(imported(f"{X}#INCLUDE parts/joint1.ini\n", joint1_ini=joint)) == {"X", "Y"}
    assert "m.ini:5: '#INCLUDE joint1.inc': the file joint1.inc is not among the files" in imported(
        f"{X}#INCLUDE joint1.inc\n"
    )


REFUSED = {
    "a second section": ("[JOINT_1]\nTYPE = LINEAR\n[JOINT_1]\nCOMP_FILE = y.comp\n", "m.ini:8: 'COMP_FILE = y.comp': LinuxCNC reads only the first section [JOINT_1]"),
    "small letters": ("[JOINT_1]\ncomp_file = y.comp\n", "m.ini:6: 'comp_file = y.comp': LinuxCNC does not read it as COMP_FILE = VALUE"),
    "a section in small letters": ("[joint_1]\nCOMP_FILE = y.comp\n", "m.ini:6: 'COMP_FILE = y.comp': [joint_1] is not one of the joints"),
    "a colon": ("[JOINT_1]\nCOMP_FILE: y.comp\n", "m.ini:6: 'COMP_FILE: y.comp': LinuxCNC does not read it as"),
    "a type with a colon": ("[JOINT_1]\nCOMP_FILE = y.comp\nCOMP_FILE_TYPE: 1\n", "m.ini:7: 'COMP_FILE_TYPE: 1'"),
    "an old section": ("[AXIS_1]\nCOMP_FILE = y.comp\n", "[AXIS_1] is not one of the joints"),
    "an entry twice": ("[JOINT_1]\nCOMP_FILE = y.comp\nCOMP_FILE_TYPE = 1\nCOMP_FILE_TYPE = 0\n", "m.ini:8: 'COMP_FILE_TYPE = 0': COMP_FILE_TYPE is given twice, and LinuxCNC reads line 7"),
    "a table that nothing names": ("[JOINT_1]\nTYPE = LINEAR\n", "y.comp: nothing of it belongs to the tables of format linuxcnc"),
    "the wrong type": ("[JOINT_1]\nCOMP_FILE = y.comp\nCOMP_FILE_TYPE = 0\n", "y.comp: with COMP_FILE_TYPE 0 of [JOINT_1] (0 where the entry is missing) its corrections reach 99.98, with the other type 0.02"),
    "no type": ("[JOINT_1]\nCOMP_FILE = y.comp\n", "y.comp: with COMP_FILE_TYPE 0"),
}  # fmt: skip


@pytest.mark.parametrize(("ini", "said"), REFUSED.values(), ids=REFUSED)
def test_what_linuxcnc_would_pass_over_is_refused(imported, ini, said):
    assert said in imported(X + ini)


def test_a_table_that_turns_its_axis_round_is_refused(imported):
    assert "the axis would go back" in imported(X, x_comp="0 0 0\n0.01 0.02 0.02\n0.02 0 0\n", y_comp=None)


def test_other_files_of_a_folder_are_named(command, tmp_path):
    (tmp_path / "m.toml").write_text(MACHINE)
    folder = tmp_path / "config"
    folder.mkdir()
    for name, text in {"m.ini": X, "x.comp": COMP, "mill.hal": "loadrt trivkins\n"}.items():
        (folder / name).write_text(text)
    done = command("import", "config", "--machine", "m.toml", "--format", "linuxcnc", "-o", "o.json")
    assert done.status == 0, done.err
    assert "not read: mill.hal" in done.err


PLACES = [("KINS", "KINEMATICS"), ("KINS", "JOINTS"), ("TRAJ", "LINEAR_UNITS"), ("TRAJ", "COORDINATES"),
          ("RS274NGC", "PARAMETER_FILE"), ("EMCIO", "TOOL_TABLE"), ("EMCIO", "RANDOM_TOOLCHANGER"),
          ("JOINT_0", "TYPE"), ("JOINT_1", "HOME"), ("AXIS_A", "WRAPPED_ROTARY"), ("JOINT_2", "BACKLASH")]  # fmt: skip


def expanded(path):
    """An INI file with its included files in their places, and those files by name."""
    text = path.read_text(encoding="latin-1")
    names = re.findall(r"^#INCLUDE\s+(\S+)", text, re.M)
    others = {Path(name).name: (path.parent / name).read_text(encoding="latin-1") for name in names}
    for name in names:
        text = re.sub(rf"^#INCLUDE\s+{re.escape(name)}.*$", lambda _, n=name: others[Path(n).name], text, count=1, flags=re.M)  # fmt: skip
    return text, others


@pytest.mark.skipif(not shutil.which("inivar") or not EXAMPLES.exists(), reason="LinuxCNC is not installed")
def test_shipped_files_as_inivar_reads_them(tmp_path):
    """Each place in the INI files that LinuxCNC ships: the same value, or a refusal of a second line for it."""
    paths = sorted(EXAMPLES.rglob("*.ini"))[::9]
    refused = 0
    for path in paths:
        try:
            text, others = expanded(path)
        except OSError:
            continue
        (tmp_path / "a.ini").write_text(text, encoding="latin-1")
        ini = IniFile(path.name, {path.name: path.read_text(encoding="latin-1"), **others})
        for section, entry in PLACES:
            done = subprocess.run(
                ["inivar", "-ini", tmp_path / "a.ini", "-sec", section, "-var", entry],
                capture_output=True, encoding="latin-1", check=False,
            )  # fmt: skip
            try:
                assert ini.value(section, entry) == (
                    done.stdout.removesuffix("\n") if done.returncode == 0 else None
                ), path
            except UserError:
                refused += 1
    assert len(paths) > 30
    assert refused < 0.01 * len(paths) * len(PLACES)


def test_odd_lines_as_inivar_reads_them():
    text = "[A] note\n  B = 1 # note\nC==c\nD=\n[A1]\nB = 7\n[B]\nE = one \\\n two\n"
    ini = IniFile("a", {"a": text})
    assert [ini.value(*place) for place in (("A", "B"), ("A", "C"), ("A", "D"), ("A1", "B"), ("B", "E"))] == [
        "1 # note", "=c", None, "7", "one  two"
    ]  # fmt: skip


@pytest.mark.parametrize(("entry", "letters"), [
    ("trivkins", "XYZABCUVW"), ("trivkins coordinates=XYYZ kinstype=BOTH", "XYYZ"), ("trivkins coordinates=xz", "XZ"),
    ("xyzac-trt-kins", "XYZAC"), ("xyzac-trt-kins sparm=identityfirst coordinates=XYZCA", "XYZCA"),
    ("5axiskins", "XYZBCW"),
])  # fmt: skip
def test_letters_of_the_joints(entry, letters):
    assert joint_letters(IniFile("a", {"a": f"[KINS]\nKINEMATICS = {entry}\n"})) == letters


def test_joints_that_are_no_axes_are_refused():
    with pytest.raises(UserError, match="which axes the joints of corexykins move"):
        joint_letters(IniFile("a", {"a": "[KINS]\nKINEMATICS = corexykins\n"}))


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("inch", 25.4), ("Inch", 25.4), ("1.0", 1.0), ("metric", 1.0)])
def test_units(unit, mm):
    assert length_unit_mm(IniFile("a", {"a": f"[TRAJ]\nLINEAR_UNITS = {unit}\n"})) == pytest.approx(mm)


@pytest.mark.parametrize("unit", ["grad", "gon", "0", "-1", "nan", "inf"])
def test_units_that_are_not_read(imported, unit):
    assert f"ANGULAR_UNITS {unit} is not read: expected degree or radian" in imported(
        f"[TRAJ]\nANGULAR_UNITS = {unit}\n{X}", y_comp=None
    )


GANTRY = "[KINS]\nKINEMATICS = trivkins coordinates=XYYZ kinstype=BOTH\nJOINTS = 4\n"


def of_joint(joint, file):
    return f"[JOINT_{joint}]\nCOMP_FILE = {file}\nCOMP_FILE_TYPE = 1\n"


def test_the_kinematics_name_the_axes_of_the_joints(imported):
    both = GANTRY + of_joint(1, "y.comp") + of_joint(2, "y.comp")
    assert set(imported(both, x_comp=None)) == {"Y"}
    assert set(imported(both, "--set", "joints=XYYZ", x_comp=None)) == {"Y"}
    assert set(imported(GANTRY + of_joint(3, "y.comp"), x_comp=None)) == {"Z"}
    assert "its joints are XYYZ, and --set joints=XYZ contradicts it" in imported(
        both, "--set", "joints=XYZ", x_comp=None
    )
    five = MACHINE.replace("X Y Z t", "X Y Z A C t") + "".join(
        f"[axes.{axis}]\ntravel = [0, 90]\npoint = [0, 0, 0]\n" for axis in "AC"
    )
    module = "[KINS]\nKINEMATICS = xyzac-trt-kins{}\n" + of_joint(3, "y.comp")
    assert set(imported(module.format(""), x_comp=None, machine=five)) == {"A"}
    assert set(imported(module.format(" coordinates=XYZCA"), x_comp=None, machine=five)) == {"C"}


def test_a_joint_of_another_axis_is_refused(imported):
    """trivkins without coordinates= moves A by joint 3, whatever COORDINATES says."""
    chain = MACHINE.replace("X Y Z t", "X Y Z C t") + "[axes.C]\ntravel = [0, 300]\npoint = [0, 0, 0]\n"
    ini = "[TRAJ]\nCOORDINATES = XYZC\n[KINS]\nKINEMATICS = trivkins\n" + of_joint(3, "x.comp")
    assert "[JOINT_3] moves A (the joints are XYZABCUVW), and the machine has no such axis" in imported(
        ini, machine=chain, y_comp=None
    )


def test_a_gantry_with_two_tables_is_refused(imported):
    other = {"other_comp": COMP.replace("0.01 0.01", "0.01 0.02"), "x_comp": None}
    assert "JOINT_1 moves Y as well, and has no table" in imported(GANTRY + of_joint(2, "y.comp"), x_comp=None)
    assert "another joint of Y has another table" in imported(
        GANTRY + of_joint(1, "y.comp") + of_joint(2, "other.comp"), **other
    )


@pytest.mark.parametrize(("units", "position", "um"), [
    ("LINEAR_UNITS = inch\nANGULAR_UNITS = degree\n", 50 * 25.4, 254.0), ("LINEAR_UNITS = mm\n", 50.0, 10.0), ("", 50.0, 10.0),
])  # fmt: skip
def test_tables_are_in_the_units_of_the_file(imported, units, position, um):
    long = MACHINE.replace("[0, 300]", "[0, 3000]")
    table = imported(f"[TRAJ]\n{units}{X}", y_comp=None, machine=long)["X"]
    assert um_at(table) == (pytest.approx(position), pytest.approx(um))


def test_angles_in_radians(imported):
    """LinuxCNC adds 0.001 rad at 1 rad."""
    chain = MACHINE.replace("X Y Z t", "X Y Z C t") + "[axes.C]\ntravel = [0, 300]\npoint = [0, 0, 0]\n"
    ini = "[TRAJ]\nANGULAR_UNITS = radian\n[KINS]\nKINEMATICS = trivkins coordinates=XYZC\n" + of_joint(3, "x.comp")
    table = imported(ini, machine=chain, x_comp="0 0 0\n1 0.001 0.001\n2 0.002 0.002\n", y_comp=None)["C"]
    assert um_at(table) == (pytest.approx(57.29577951), pytest.approx(1000.0))


@pytest.mark.parametrize(("ini", "control", "shown"), [
    ("", "", True), ("[TRAJ]\nLINEAR_UNITS = mm\n", "", False), ("", '[control]\nunit = "mm"\n', False),
])  # fmt: skip
def test_an_assumed_unit_is_shown(command, tmp_path, ini, control, shown):
    for name, text in {"m.ini": ini + X, "x.comp": COMP, "m.toml": MACHINE + control}.items():
        (tmp_path / name).write_text(text)
    done = command("import", "m.ini", "x.comp", "--machine", "m.toml", "--format", "linuxcnc", "-o", "o.json")
    assert done.status == 0
    assert ("the unit of the tables is assumed: mm" in done.err) == shown
