"""`ncomp check --control-kinematics --cam-kinematics`: pivots and signs of machine file, measurement, control and CAM."""

import json
import math
from pathlib import Path

import pytest
from support import linuxcnc_trunnion as trunnion


def compared(ncomp, *options, machine="mill.toml"):
    done = ncomp("check", "--machine", machine, *options, "--json", "-")
    assert done.status == 0, done.err
    found = json.loads(done.out)
    return found["agree"], {(each["axis"], each["first"], each["second"]): each for each in found["differences"]}


@pytest.fixture
def mill(ncomp):  # noqa: ARG001 - its folder
    Path("mill.toml").write_text(trunnion.machine_file("A"))


@pytest.mark.usefixtures("mill")
def test_the_lines_of_a_hal_file(ncomp):
    Path("right.hal").write_text("\n".join(trunnion.pins("A", trunnion.POINT, trunnion.TILT["A"])) + "\n")
    Path("wrong.hal").write_text("\n".join(trunnion.real("A")) + "\n")
    assert compared(ncomp, "--control-kinematics", "right.hal")[0]
    agree, found = compared(ncomp, "--control-kinematics", "wrong.hal")
    assert not agree
    # C is 42 and -31 um beside its place: half a turn doubles it, and the part shows it the other way round
    c = found["C", "machine file", "control"]
    assert c["shift_mm"] == pytest.approx([0.042, -0.031, 0.0], abs=1e-6)
    assert (c["turn_deg"], c["same_sense"]) == (180.0, True)
    assert c["part_mm"] == pytest.approx([-0.084, 0.062, 0.0], abs=1e-5)
    # A is 4 and 36 um beside it, and a quarter turn shows sqrt(2) of that; its travel has no half turn
    a = found["A", "machine file", "control"]
    assert a["shift_mm"] == pytest.approx([0.0, -0.004, -0.036], abs=1e-6)
    assert abs(a["turn_deg"]) == 90.0
    assert math.hypot(*a["part_mm"]) == pytest.approx(math.sqrt(2.0) * math.hypot(0.004, 0.036), abs=1e-5)
    shown = ncomp("check", "--machine", "mill.toml", "--control-kinematics", "wrong.hal").out.decode()
    assert "features cut at C 0 and at C 180 are 0.1044 mm apart on the part" in shown


@pytest.mark.usefixtures("mill")
def test_an_axis_of_the_cam_system_that_turns_the_other_way(ncomp):
    turned = trunnion.machine_file("A").replace("direction = [-1, 0, 0]", "direction = [1, 0, 0]")
    Path("cam.toml").write_text(turned.replace('"mill"', '"cam"'))
    Path("right.hal").write_text("\n".join(trunnion.pins("A", trunnion.POINT, trunnion.TILT["A"])) + "\n")
    agree, found = compared(ncomp, "--cam-kinematics", "cam.toml", "--control-kinematics", "right.hal")
    assert not agree
    wrong = [key for key, each in found.items() if not each["same_sense"]]
    assert wrong == [("A", "machine file", "CAM"), ("A", "control", "CAM")]
    shown = ncomp("check", "--machine", "mill.toml", "--cam-kinematics", "cam.toml").out.decode()
    assert "A TURNS THE OTHER WAY by CAM than by machine file" in shown


@pytest.mark.usefixtures("mill")
def test_linuxcnc_with_conventional_directions(ncomp):
    pins = trunnion.pins("A", trunnion.POINT, trunnion.TILT["A"])
    Path("iso.hal").write_text("\n".join([*pins, "setp xyzac-trt-kins.conventional-directions 1"]) + "\n")
    _, found = compared(ncomp, "--control-kinematics", "iso.hal")
    assert [each["same_sense"] for each in found.values()] == [False, False]


FORMATS = ("siemens-trafo5", "siemens-tcarr", "heidenhain-transformations", "fanuc-kinematics")


@pytest.mark.usefixtures("few_positions")
@pytest.mark.parametrize("form", FORMATS)
def test_parameters_of_other_controls(ncomp, form):
    """Those of the machine file agree with it; those by a calibration agree with the measured lines."""
    done = ncomp("export", "-m", "dmu50", "--format", form, "--sign", "correction", "-o", "out")
    assert done.status == 0, done.err
    before, after = sorted(Path("out").glob("*_before.*")), sorted(Path("out").glob("[kp]*[!e].*"))
    (after,) = [path for path in after if path not in before and path.suffix != ".md"]
    assert compared(ncomp, "--control-kinematics", str(before[0]), machine="dmu50")[0]
    calibration = Path(__file__).parents[1] / "machines" / "calibrations" / "dmu50.json"
    agree, found = compared(
        ncomp, "--control-kinematics", str(after), "--calibration", str(calibration), machine="dmu50"
    )
    assert not agree  # both differ from the machine file
    for axis in "CB":
        each = found[axis, "measured", "control"]
        assert math.hypot(*each["shift_mm"]) < 1e-3
        assert math.hypot(*found[axis, "machine file", "control"]["shift_mm"]) > 0.01


@pytest.mark.usefixtures("mill")
def test_a_folder_with_the_values_before_and_after_an_export_is_refused(ncomp):
    """Both belong to one control at different times, and the older ones hid the newer ones."""
    Path("pins").mkdir()
    Path("pins/pivots.hal").write_text("\n".join(trunnion.real("A")) + "\n")
    assert not compared(ncomp, "--control-kinematics", "pins")[0]
    Path("pins/pivots_before.hal").write_text("\n".join(trunnion.pins("A", trunnion.POINT, trunnion.TILT["A"])) + "\n")
    done = ncomp("check", "--machine", "mill.toml", "--control-kinematics", "pins")
    assert done.status == 2
    assert "pivots_before.hal and pivots.hal: give the file whose values are in the control" in done.err
    assert compared(ncomp, "--control-kinematics", "pins/pivots_before.hal")[0]


REFUSED = {
    "program and kinematics": (("part.nc", "--cam-kinematics", "cam.toml"), "leave out the program, to compare"),
    "program and calibration": (("part.nc", "-c", "now.json"), "the check of a program needs no calibration"),
    "nothing": ((), "give a program"),
    "another chain": (("--cam-kinematics", "other.toml"), "with the same axes in the same order"),
    "no kinematics": (("--control-kinematics", "part.nc"), "no kinematics that ncomp reads"),
}


@pytest.mark.usefixtures("mill")
@pytest.mark.parametrize("name", REFUSED)
def test_refused(ncomp, name):
    options, words = REFUSED[name]
    Path("cam.toml").write_text(trunnion.machine_file("A"))
    Path("other.toml").write_text(trunnion.machine_file("B"))
    Path("part.nc").write_text("G21 G90\nM30\n")
    done = ncomp("check", "--machine", "mill.toml", *options)
    assert done.status == 2
    assert words in done.err
