"""Tables and kinematic parameters in the unit of the control: every format, mm and inch, written and read back."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from support.kinematic_controls import trunnion
from support.programs import load, model_of
from support.table_cases import CASES, motions
from support.tiers import quick

import machines
import ncomp
from kinematics.effects import LocationError
from kinematics.error_model.model import read_model, write_model
from kinematics.state import State
from kinematics.user_error import UserError
from postproc.control_data.formats import formats_of
from postproc.control_data.parameters.parameter_format import ParameterFormat
from postproc.control_data.sheet import sheet

PARAMETERS = formats_of(ParameterFormat)

INCH = 25.4
HEAD_5AXIS = 'name = "head"\nchain = "w b X Y Z C B t"\n' + "".join(
    f"[axes.{axis}]\ntravel = [-{reach}, {reach}]\n{more}"
    for axis, reach, more in (
        ("X", 500, ""), ("Y", 400, ""), ("Z", 300, ""), ("C", 200, "point = [0, 0, 250]\n"),
        ("B", 100, "point = [0, 0, 250]\ndirection = [0, -1, 0]\n"),
    )
)  # fmt: skip
OF_CONTROL = {
    "linuxcnc", "linuxcnc-calibxyz", "siemens-eec", "siemens-cec", "linuxcnc-kinematics", "siemens-trafo5",
    "siemens-tcarr",
}  # fmt: skip
"""Formats whose numbers are in the unit of the control."""
OF_MACHINE = {"fanuc", "mitsubishi", "fanuc-kinematics"}
"""Formats in the unit of the machine, which is refused where it is not known."""
FINEST = {"linuxcnc": 1e-7, "siemens-eec": 1e-6, "siemens-cec": 1e-6, "grbl": 600.0 * 2.0**-25}
"""Resolution of the formats, in their unit; of grbl half a bit of steps per mm in single precision, over 600 mm."""
TABLES = list({case.format: case for case in reversed(CASES)}.values())
GANTRY = ("joints=XYYZ",)


def in_unit(machine, unit):
    return dataclasses.replace(machine, control=dataclasses.replace(machine.control, unit=unit))


def written(folder, files):
    folder.mkdir()
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def corrections(machine, effects, n=400):
    """Own errors of each axis `(n, axes)`, mm and rad, that the effects are at random positions."""
    rng = np.random.default_rng(8)
    low, high = np.where(np.isfinite(machine.travel), machine.travel, [[0.0], [2 * np.pi]])
    q = rng.uniform(low, high, (n, len(low)))
    approach = rng.choice([-1.0, 1.0], q.shape)
    return model_of(machine, *effects).errors(machine, State(q, approach))


@pytest.mark.parametrize("case", quick(TABLES, TABLES[::2]), ids=lambda case: case.format)
def test_tables_are_in_the_unit_of_the_control(case, tmp_path):
    """The same machine with a control in mm and in inches: the files hold the same corrections."""
    settings = case.settings + (GANTRY if case.format == "linuxcnc" else ())
    sign = case.sign
    read = {}
    for unit in ("mm", "inch"):
        machine = in_unit(load(case.machine), unit)
        model = model_of(machine, *motions(machine, "XX YY ZZ"), LocationError("C", "Y", 40.0))
        if unit == "inch" and case.format in OF_MACHINE:
            with pytest.raises(UserError, match="machine_unit=mm"):
                ncomp.export(machine, case.format, model, sign=sign, settings=settings)
            settings = (*settings, "machine_unit=mm")
        if unit == "inch" and case.format == "siemens-cec":
            with pytest.raises(UserError, match="scaling=metric"):
                ncomp.export(machine, case.format, model, sign=sign, settings=settings)
            settings = (*settings, "scaling=inch")
        exported = ncomp.export(machine, case.format, model, sign=sign, settings=settings)
        assert exported.unit == ("inch" if unit == "inch" and case.format in OF_CONTROL else "mm")
        folder = written(tmp_path / unit, exported.files)
        found = ncomp.import_tables(folder, machine, case.format, sign=sign, settings=settings).effects
        read[unit] = corrections(machine, found)
        own = corrections(machine, exported.taken.effects)
        assert np.abs(read[unit] - own).max() <= FINEST.get(case.format, 2e-7) * (
            INCH if exported.unit == "inch" else 1
        ), unit
    assert np.abs(read["mm"]).max() > 5e-3
    resolution = {"fanuc": 2e-3, "mitsubishi": 2e-3, "reprap": 1e-3}.get(case.format, 2e-4)
    assert np.abs(read["mm"] - read["inch"]).max() <= resolution


@pytest.mark.parametrize("case", TABLES, ids=lambda case: case.format)
def test_a_file_without_a_table_is_refused(case, tmp_path):
    """Given by name, it was meant as a table; in a folder it may be anything that no reader takes for one."""
    machine = load(case.machine)
    model = model_of(machine, *motions(machine, "XX"), LocationError("C", "Y", 40.0))
    exported = ncomp.export(machine, case.format, model, sign=case.sign, settings=case.settings)
    folder = written(tmp_path / "tables", exported.files)
    files = sorted(folder.iterdir())
    given = {"sign": case.sign, "settings": case.settings}
    assert ncomp.import_tables(files, machine, case.format, **given).effects
    (folder / "notes.cfg").write_text("# notes\n")
    with pytest.raises(UserError, match=r"notes\.cfg"):
        ncomp.import_tables([*files, folder / "notes.cfg"], machine, case.format, **given)


def test_what_linuxcnc_reads_in_inches(tmp_path, command):
    """The files of the command with their numbers worked out here; the import by LINEAR_UNITS of the INI file alone."""
    machine = load("cframe")
    model = model_of(machine, *motions(machine, "XX YY ZZ"))
    write_model(model, tmp_path / "cal.json")
    text = (Path(machines.__file__).parent / "cframe.toml").read_text()
    (tmp_path / "mm.toml").write_text(text)
    (tmp_path / "inch.toml").write_text(text + '\n[control]\nunit = "inch"\n')
    for unit in ("mm", "inch"):
        done = command(
            "export",
            "--machine",
            f"{unit}.toml",
            "-c",
            "cal.json",
            "--format",
            "linuxcnc",
            "--set",
            "joints=XYYZ",
            "-o",
            unit,
        )
        assert done.status == 0, done.err
    tables = {u: {n: np.loadtxt(tmp_path / u / f"comp_{n}.txt") for n in "xyz"} for u in ("mm", "inch")}
    for name in "xyz":
        (x, up, _), (x_mm, up_mm, _) = tables["inch"][name].T * INCH, tables["mm"][name].T
        at = np.linspace(x_mm[0], x_mm[-1], 300)
        assert np.abs(np.interp(at, x, up) - np.interp(at, x_mm, up_mm)).max() <= 5e-6
        assert x[-1] == pytest.approx(x_mm[-1], abs=2e-6)
    ini = (tmp_path / "inch" / "linuxcnc.ini").read_text()
    assert re.findall(r"\[JOINT_(\d)\]\nCOMP_FILE = comp_(\w)", ini) == [("0", "x"), ("1", "y"), ("2", "y"), ("3", "z")]
    sheet = (tmp_path / "inch" / "sheet.md").read_text()
    assert "Lengths in the files are in inches, angles in degrees. Lengths on this page are in mm" in sheet
    assert "LINEAR_UNITS in inches and ANGULAR_UNITS = degree" in sheet
    for name in ("mm", "inch"):  # the INI file states inches: the machine file need not, and must not contradict
        (tmp_path / f"{name}.toml").write_text(text)
    done = command(
        "import",
        "inch",
        "--machine",
        "mm.toml",
        "--format",
        "linuxcnc",
        "--set",
        "joints=XYYZ",
        "-o",
        "in_control.json",
    )
    assert done.status == 0, done.err
    found = corrections(machine, read_model(tmp_path / "in_control.json", machine).effects)
    assert np.abs(found - corrections(machine, ncomp.export(machine, "linuxcnc", model).taken.effects)).max() <= 5e-6
    (tmp_path / "mm.toml").write_text(text + '\n[control]\nunit = "mm"\n')
    done = command(
        "import", "inch", "--machine", "mm.toml", "--format", "linuxcnc", "--set", "joints=XYYZ", "-o", "o.json"
    )
    assert done.status == 2
    assert "linuxcnc.ini:3: 'LINEAR_UNITS = inch': the machine file states unit = \"mm\" under [control]" in done.err


@pytest.mark.parametrize("form", sorted(PARAMETERS))
def test_kinematic_parameters_are_in_the_unit_of_the_control(form, tmp_path):
    base = trunnion("A") if form == "linuxcnc-kinematics" else load("trunnion_ac")
    errors = [LocationError(c, axis, v) for c, axis, v in (("X", "C", 31.0), ("Y", "C", -22.0), ("Y", "A", 26.0))]
    sign = None if PARAMETERS[form].sign else "correction"
    read, texts, settings = {}, {}, ()
    for unit in ("mm", "inch"):
        machine = in_unit(base, unit)
        model = model_of(machine, *errors)
        if unit == "inch" and form in OF_MACHINE:
            with pytest.raises(UserError, match="machine_unit=mm"):
                ncomp.export_parameters(machine, form, model, sign=sign)
            settings = ("machine_unit=mm",)
        exported = ncomp.export_parameters(machine, form, model, sign=sign, settings=settings)
        texts[unit] = [float(number.text) for number in exported.numbers[1] if number.unit == exported.unit]
        assert exported.unit == ("inch" if unit == "inch" and form in OF_CONTROL else "mm")
        name = PARAMETERS[form].file
        file = written(tmp_path / unit, {name: exported.files[name]}) / name
        found = ncomp.import_tables(file, machine, form, sign=sign, settings=settings).effects
        read[unit] = corrections(machine, found)
    factor = INCH if form in OF_CONTROL else 1.0
    assert np.array(texts["mm"]) == pytest.approx(factor * np.array(texts["inch"]), abs=2e-4 if factor == 1.0 else 4e-5)
    assert np.abs(read["mm"]).max() > 1e-2
    assert np.abs(read["mm"] - read["inch"]).max() <= 2e-4


def test_hal_file_with_its_ini_file(tmp_path):
    """The unit, and a value that the HAL file takes from the INI file."""
    machine = trunnion("A")
    model = model_of(machine, LocationError("Y", "A", 26.0))
    exported = ncomp.export_parameters(in_unit(machine, "inch"), "linuxcnc-kinematics", model)
    hal = exported.files["kinematics.hal"]
    value = re.search(r"setp xyzac-trt-kins.z-offset (\S+)", hal)[1]
    ini = f"[TRAJ]\nLINEAR_UNITS = inch\n  ANGULAR_UNITS = degree\n[TRUNNION]\n  Z_OFFSET = {value}\n"
    folder = written(tmp_path / "config", {"mill.hal": hal.replace(value, "[TRUNNION]Z_OFFSET"), "mill.ini": ini})
    found = ncomp.import_tables(folder, machine, "linuxcnc-kinematics").effects
    assert {each.name: each.parameters for each in found}["E_Y0A"] == pytest.approx((26.0,), abs=0.1)
    (folder / "mill.ini").write_text(ini.replace("degree", "radian"))
    with pytest.raises(UserError, match=re.escape("mill.ini:3: 'ANGULAR_UNITS = radian': the kinematics of LinuxCNC")):
        ncomp.import_tables(folder, machine, "linuxcnc-kinematics")
    (folder / "mill.ini").unlink()
    with pytest.raises(UserError, match="give this file as well"):
        ncomp.import_tables(folder, machine, "linuxcnc-kinematics")


@pytest.mark.parametrize(("machine", "said", "not_said"), [
    (machines.parse(HEAD_5AXIS, "head"), "the exported number plus the length of the active tool", "tool-offset"),
    (trunnion("A"), "The pin tool-offset stays connected to the tool length", "sum2"),
], ids=["5axiskins", "xyzac-trt-kins"])  # fmt: skip
def test_where_the_tool_belongs(machine, said, not_said):
    model = model_of(machine, LocationError("X", "B" if "B" in machine.names else "C", 26.0))
    exported = ncomp.export_parameters(machine, "linuxcnc-kinematics", model, tool_mm=100.0)
    page = " ".join(sheet(exported, exported.left, exported.errors_in_the_volume()).split())
    assert said in page
    assert not_said not in page


@pytest.mark.parametrize(("form", "size"), [("linuxcnc", 0.0007874), ("siemens-eec", 0.000787)])
def test_a_probe_in_inches(form, size, tmp_path, command):
    """0.02 mm are 0.0007874 inch."""
    text = (Path(machines.__file__).parent / "cframe.toml").read_text()
    (tmp_path / "inch.toml").write_text(text + '\n[control]\nunit = "inch"\n')
    done = command("export", "--machine", "inch.toml", "--format", form, "--probe", "X", "-o", "probe")
    assert done.status == 0, done.err
    numbers = re.findall(r"0\.000787\d*", "".join(path.read_text() for path in (tmp_path / "probe").iterdir()))
    assert {float(number) for number in numbers} == {size}
    assert "inches" in (tmp_path / "probe" / "probe.md").read_text()


def test_a_file_that_klipper_includes_is_needed(tmp_path):
    machine = load("bzt_pfu")
    files = ncomp.export(machine, "klipper", model_of(machine, LocationError("C", "Y", 40.0))).files
    folder = written(tmp_path / "klipper", {"printer.cfg": "[include mesh/*.cfg]\n" + files["ncomp.cfg"]})
    with pytest.raises(
        UserError, match=re.escape("printer.cfg: [include mesh/*.cfg]: the file is not among the files")
    ):
        ncomp.import_tables(folder, machine, "klipper")
    (folder / "printer.cfg").write_text("[include mesh/*.cfg]\n")
    (folder / "mesh.cfg").write_text(files["ncomp.cfg"] + "; the end\n")
    assert ncomp.import_tables(folder, machine, "klipper").not_read == ("printer.cfg",)
