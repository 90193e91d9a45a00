"""`ncomp compare`: figures calculated by hand from calibrations with simple functions, and refusals."""

import json
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import numpy as np
import pytest
from support.pages import LINK, text_of
from support.tiers import quick
from support.virtual_measurements import truth

import machines
from calibration.fit.datum import gauge, to_datum, transformed
from calibration.observation.full_model import priors
from kinematics.basis import Harmonics, Legendre, Polynomial
from kinematics.effects import Backlash, ErrorMotion, GrowthWithTime, LocationError, RangeOffset, ThermalDrift, Wobble
from kinematics.error_model.model import ErrorModel, no_errors, write_model
from kinematics.error_model.provenance import Provenance, reference
from kinematics.machine import Machine

CFRAME, TABLE = machines.load("cframe"), machines.load("head_table")
MADE = Provenance("test", datetime(2026, 1, 1, tzinfo=UTC))


def motion(name, interval, *parameters, u=0.0):
    basis = Polynomial(interval, len(parameters) - 1)
    return ErrorMotion(component=name[0], axis=name[1:], basis=basis, parameters=parameters, u=(u,) * len(parameters))


def calibration(path: str, machine: Machine, *effects):
    write_model(ErrorModel(machine=reference(machine), provenance=MADE, effects=effects), Path(path))


def compared(command, *options):
    done = command("compare", "a.json", "b.json", "--json", "-", *options)
    assert done.status == 0, done.err
    found = json.loads(done.out)
    motions = {each["name"]: each for each in found["error_motions"]}
    figures = {each["name"]: each for each in found["figures"]}
    return found, motions, figures


def test_positioning_is_zero_at_the_reference(command):
    # A: 7 + 30 u um over 0..600; B: 1 + 60 u over 0..500, u from 0 to 1 over its interval
    calibration("a.json", CFRAME, motion("XX", (0.0, 600.0), 7.0, 30.0, u=2.0))
    calibration("b.json", CFRAME, motion("XX", (0.0, 500.0), 1.0, 60.0, u=1.0))
    found, motions, _ = compared(command, "--reference", "X=100")
    xx = motions["E_XX"]
    x = np.array(xx["curves"]["positions_mm"])
    assert (x[0], x[-1]) == (0.0, 500.0)
    np.testing.assert_allclose(xx["curves"]["a"], 0.05 * (x - 100.0), atol=1e-9)
    np.testing.assert_allclose(xx["curves"]["b"], 0.12 * (x - 100.0), atol=1e-9)
    assert xx["range"] == pytest.approx({"a": 25.0, "b": 60.0})
    assert xx["largest"]["difference"] == pytest.approx(28.0)
    assert xx["largest"]["position_mm"] == 500.0
    # constants drop out; slopes: u 2 um over 600 mm and 1 um over 500 mm, at 400 mm from the reference, k = 2
    assert xx["largest"]["U"] == pytest.approx(2.0 * np.hypot(2.0 * 400 / 600, 1.0 * 400 / 500))
    assert xx["significant"] is True
    assert found["reference"] == {"X": 100.0}


@pytest.mark.parametrize(("kind", "largest"), [("end-point", 6.0), ("least-squares", 4.0)])
def test_straightness_lies_about_its_line(command, kind, largest):
    # a parabola 24 u (1 - u) has 6 um in the middle above its end points, and 4 um at the ends below its mean line
    calibration("a.json", CFRAME, motion("YX", (0.0, 600.0), 3.0, 12.0))
    calibration("b.json", CFRAME, motion("YX", (0.0, 600.0), -4.0, 24.0, -24.0))
    _, motions, figures = compared(command, "--straightness", kind)
    yx = motions["E_YX"]
    assert yx["range"]["a"] == pytest.approx(0.0, abs=1e-9)
    assert yx["range"]["b"] == pytest.approx(6.0, abs=0.01)
    assert abs(yx["largest"]["difference"]) == pytest.approx(largest, abs=0.1)
    square = figures["E_C0Y - E_C0X"]
    # E_YX rises by 12 um over 600 mm: X leans to +y by 20 um/m, so Y to X is 20 um/m below
    assert square["a"] == pytest.approx(-20.0)
    assert square["b"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "value", "figure", "sign"),
    [
        ("CY", 20.0, "E_C0Y - E_C0X", 1.0),
        ("CX", 20.0, "E_C0Y - E_C0X", -1.0),
        ("BZ", 20.0, "E_B0Z - E_B0X", 1.0),
        ("BX", 20.0, "E_B0Z - E_B0X", -1.0),
        ("AZ", 20.0, "E_A0Z - E_A0Y", 1.0),
        ("AY", 20.0, "E_A0Z - E_A0Y", -1.0),
    ],
)
def test_squareness_has_the_signs_of_the_conventions(command, name, value, figure, sign):
    calibration("a.json", CFRAME, LocationError(component=name[0], axis=name[1], value=value, u=(3.0,)))
    calibration("b.json", CFRAME, LocationError(component=name[0], axis=name[1], value=value + 9.0, u=(4.0,)))
    _, motions, figures = compared(command)
    assert figures[figure]["a"] == pytest.approx(sign * value)
    assert figures[figure]["difference"] == pytest.approx(sign * 9.0)
    assert figures[figure]["U_difference"] == pytest.approx(10.0)
    assert all(each["rms_difference"] < 1e-9 for each in motions.values())


def test_an_axis_against_its_letter_leans_the_same_way(command):
    text = 'name = "against"\nchain = "w b Y X Z t"\n[axes.X]\ntravel = [0, 600]\ndirection = [-1, 0, 0]\n'
    Path("against.toml").write_text(text + "[axes.Y]\ntravel = [0, 400]\n[axes.Z]\ntravel = [0, 400]\n")
    machine = machines.load("against.toml")
    calibration("a.json", machine, LocationError(component="C", axis="X", value=20.0))
    calibration("b.json", machine)
    _, _, figures = compared(command, "--machine", "against.toml")
    assert figures["E_C0Y - E_C0X"]["a"] == pytest.approx(-20.0)
    refused = command("compare", "a.json", "b.json")
    assert refused.status == 2
    assert "--machine" in refused.err


@pytest.mark.parametrize(
    ("name", "kind"),
    quick(
        [(name, kind) for name in machines.names() for kind in ("end-point", "least-squares")],
        [("gantry", "end-point"), ("dmu50", "least-squares"), ("head_head", "end-point")],
    ),
)
def test_squareness_does_not_depend_on_which_axis_holds_a_constant_angle(command, name, kind):
    # the same machine described in another frame: no measurement on the workpiece shows a difference
    machine = machines.load(name)
    whole = truth(machine, np.random.default_rng(8), 30.0)
    model = msgspec.structs.replace(whole, covariance=np.eye(len(whole.parameters)).tolist())
    moved = transformed(model, model.effects, to_datum(machine, model, priors(model)))
    assert np.abs(moved.parameters - model.parameters).max() > 10.0
    calibration("a.json", machine, *model.effects)
    calibration("b.json", machine, *moved.effects)
    _, _, figures = compared(command, "--straightness", kind)
    square = [each for each in figures.values() if each["title"].startswith("squareness")]
    assert len(square) == 3
    assert max(abs(each["a"]) for each in square) > 5.0
    assert [each["b"] for each in square] == pytest.approx([each["a"] for each in square], abs=0.1)


@pytest.mark.parametrize("name", quick(machines.names(), ["gantry", "head_head"]))
def test_one_machine_written_in_two_frames_is_equal(command, name):
    machine, rng = machines.load(name), np.random.default_rng(9)
    bases = [Harmonics((0.0, 360.0), 3) if axis.turns_fully else Legendre(axis.travel, 4) for axis in machine.axes]
    effects = [
        ErrorMotion(letter, axis.name, basis, tuple(rng.uniform(-20, 20, basis.size).tolist()), u=(1.0,) * basis.size)
        for axis, basis in zip(machine.axes, bases, strict=True)
        for letter in "XYZABC"
    ]
    calibration("a.json", machine, *effects)
    model = msgspec.structs.replace(no_errors(machine), effects=tuple(effects))
    directions = gauge(machine, model, priors(model))
    other = model.with_parameters(model.parameters + 30.0 * directions @ rng.normal(size=directions.shape[1]), None)
    calibration("b.json", machine, *other.effects)
    assert np.abs(other.parameters - model.parameters).max() > 30.0
    _, motions, figures = compared(command)
    assert max(abs(each["largest"]["difference"]) for each in motions.values()) < 0.05
    assert max(abs(each["difference"]) for each in figures.values()) < 0.05
    assert min(each["range"]["a"] for each in motions.values()) > 1.0


def test_an_axis_leans_with_the_constant_angle_of_the_axis_that_carries_it(command):
    # Z hangs on Y: E_AY of 20 urad leans Z by 20 um/m and leaves the line of Y where it is
    calibration("a.json", machines.load("gantry"), motion("AY", (0.0, 500.0), 20.0))
    calibration("b.json", machines.load("gantry"))
    _, _, figures = compared(command)
    assert figures["E_A0Z - E_A0Y"]["a"] == pytest.approx(20.0)
    assert figures["E_A0Z - E_A0Y"]["b"] == 0.0


def test_rotary_axes_have_their_location_apart(command):
    wobble = (-100.0, 100.0)
    calibration("a.json", TABLE, motion("XC", wobble, 5.0, 8.0), motion("CC", wobble, 2.0, 10.0))
    calibration("b.json", TABLE, LocationError(component="X", axis="C", value=5.0, u=(1.0,)))
    _, motions, figures = compared(command)
    assert figures["E_X0C"]["a"] == pytest.approx(9.0)
    assert figures["E_X0C"]["b"] == pytest.approx(5.0)
    assert figures["E_X0C"]["U_difference"] == pytest.approx(2.0)
    assert motions["E_XC"]["range"] == pytest.approx({"a": 8.0, "b": 0.0}, abs=1e-9)
    assert motions["E_CC"]["in"] == ["a"]
    assert motions["E_CC"]["largest"]["difference"] == pytest.approx(
        5.0 * -motions["E_CC"]["largest"]["position_deg"] / 100
    )


def test_an_endless_axis_is_compared_over_one_turn(command):
    text = 'name = "endless"\nchain = "w C b X Y Z t"\n[axes.C]\ntravel = [-1e6, 1e6]\npoint = [0, 0, 0]\n'
    Path("endless.toml").write_text(text + "".join(f"[axes.{name}]\ntravel = [0, 600]\n" for name in "XYZ"))
    machine = machines.load("endless.toml")
    for path, size in (("a.json", 5.0), ("b.json", 7.0)):
        wobble = Wobble(axis="C", motion="tilt", harmonic=2, sense=1, cosine=size, sine=0.0, u=(0.2, 0.2))
        calibration(path, machine, LocationError(component="X", axis="C", value=size, u=(0.5,)), wobble)
    found, motions, figures = compared(command, "--machine", "endless.toml")
    positions = motions["E_AC"]["curves"]["positions_deg"]
    assert (min(positions), max(positions)) == (-180.0, pytest.approx(177.0, abs=0.1))
    assert motions["E_AC"]["largest"]["difference"] == pytest.approx(2.0, abs=0.01)
    assert figures["E_X0C"]["difference"] == pytest.approx(2.0)
    assert figures["E_A0C"]["a"] == pytest.approx(0.0, abs=1e-9)
    assert found["volume"]["bounds"]["C"] == [-180.0, 180.0]


def test_reversal_and_what_is_left_out(command):
    growth, drift = GrowthWithTime(axis="X", rate=3.0, u=(1.0,)), ThermalDrift(component="Z", rate=9.0, u=(1.0,))
    calibration("a.json", CFRAME, Backlash(axis="Y", width=8.0, u=(0.3,)), growth)
    calibration("b.json", CFRAME, Backlash(axis="Y", width=5.0, u=(0.4,)), drift, RangeOffset(4.0, u=(1.0,)))
    found, motions, figures = compared(command)
    assert figures["B Y"]["a"] == pytest.approx(-8.0)
    assert figures["B Y"]["difference"] == pytest.approx(3.0)
    assert figures["B Y"]["U_difference"] == pytest.approx(1.0)
    assert motions["E_YY"]["rms_difference"] == 0.0
    left = "\n".join(found["not_compared"])
    assert "thermal-scale X of A: depends on time" in left
    assert "of B: depends on time" in left
    assert "instrument" in left


def test_the_volume_is_that_of_both_and_aligned(command):
    # a pure squareness is a shear, which no alignment removes; a common turn of both axes is an alignment
    calibration("a.json", CFRAME, motion("XX", (0.0, 400.0), 0.0))
    both = (motion("YX", (0.0, 600.0), 0.0, 12.0), motion("XY", (0.0, 450.0), 0.0, -9.0))
    calibration("b.json", CFRAME, motion("XX", (0.0, 600.0), 0.0), *both)
    found, _, _ = compared(command)
    volume = found["volume"]
    assert volume["bounds"]["X"] == [0.0, 400.0]
    assert volume["difference_um"]["max"] > 7.0
    assert volume["aligned_um"]["max"] < 1e-6
    assert volume["u_rms_um"] == 0.0


def test_terminal_and_page(command):
    calibration("a.json", CFRAME, motion("XX", (0.0, 600.0), 7.0, 30.0, u=2.0), Backlash(axis="X", width=3.0))
    calibration("b.json", CFRAME, motion("XX", (0.0, 500.0), 1.0, 60.0, u=1.0), motion("YX", (0.0, 600.0), 0.0, 4.0))
    done = command("compare", "a.json", "b.json", "--report", "out.html")
    assert done.status == 0, done.err
    screen = done.out.decode()
    for text in ("E_XX", "significant", "in B only", "squareness of Y to X", "Reference", "aligned", "U (k=2)"):
        assert text in screen
    assert "backlash X (B)" in screen
    assert "B X" not in screen
    page = Path("out.html").read_text()
    for text in ('id="figures"', "E_YX", "squareness of Y to X", "B minus A", "Axis X", "not known"):
        assert text in page
    assert not LINK.search(text_of(page))


@pytest.mark.parametrize("name", quick(machines.names(), ["cframe", "head_table"]))
def test_equal_calibrations_of_every_shipped_machine_do_not_differ(command, name):
    machine = machines.load(name)
    effects = [
        motion(f"{letter}{axis.name}", (max(axis.travel[0], -90.0), min(axis.travel[1], 90.0)), 1.0, 5.0, -3.0, u=1.0)
        for axis in machine.axes
        for letter in "XYZABC"
    ]
    calibration("a.json", machine, *effects)
    calibration("b.json", machine, *effects)
    found, motions, figures = compared(command)
    assert len(motions) == 6 * len(machine.axes)
    assert not any(each["significant"] for each in motions.values())
    assert all(each["difference"] == 0.0 for each in figures.values())
    assert found["volume"]["difference_um"]["max"] == 0.0
    assert found["volume"]["u_rms_um"] > 0.0


def test_what_can_not_be_compared(command):
    calibration("a.json", CFRAME, motion("XX", (0.0, 200.0), 1.0, 2.0))
    calibration("b.json", CFRAME, motion("XX", (300.0, 500.0), 1.0, 2.0))
    found, motions, _ = compared(command)
    assert motions == {}
    assert found["not_compared"] == ["E_XX: the two calibrations have no common range"]
    calibration("g.json", machines.load("gantry"))
    Path("again.json").write_bytes(Path("a.json").read_bytes())
    Path("text.json").write_text("{}")
    for arguments, says in (
        (("a.json", "g.json"), "only calibrations of one machine"),
        (("a.json", "none.json"), "No such file"),
        (("a.json", "text.json"), "no ncomp calibration"),
        (("a.json", "b.json", "--machine", "gantry"), "not of gantry"),
        (("a.json", "b.json", "--straightness", "best"), "end-point or least-squares"),
        (("a.json", "b.json", "--reference", "X"), "expected AXIS=POSITION"),
        (("a.json", "b.json", "--reference", "Q=3"), "has no axis Q"),
        (("a.json", "b.json", "--reference", "X=nan"), "expected AXIS=POSITION"),
        (("a.json", "b.json", "--reference", "X=1", "--reference", "X=2"), "given twice"),
        (("a.json", "again.json", "--reference", "X=400"), "from 0 to 200 mm"),
        (("a.json", "b.json", "--report", "a.json"), "is an input and would be overwritten"),
    ):
        refused = command("compare", *arguments, *(() if "--report" in arguments else ("--json", "out.json")))
        assert refused.status == 2, arguments
        assert says in refused.err
        assert "Traceback" not in refused.err
        assert not Path("out.json").exists()
