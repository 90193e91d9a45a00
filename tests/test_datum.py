"""The datum: a work offset that was touched off on the machine holds its error, and the part is cut from there."""

import json
import re
from itertools import cycle
from pathlib import Path

import msgspec
import numpy as np
import pytest
from support.programs import FIVE_AXES, THREE_AXES, centred, correct, load, model_of, random_model, shifted, source_of
from support.tiers import quick
from virtual_machine.calibrated import read_calibration
from virtual_machine.chain import load as chain_of
from virtual_machine.part import Shop, TouchedOff

import machines
from kinematics.basis import Legendre
from kinematics.effects import Backlash, ErrorMotion, LocationError
from kinematics.error_model.model import no_errors, write_model
from kinematics.forward import tool_point
from kinematics.touch_off import Datum, read_datum, touch_off
from kinematics.user_error import UserError
from postproc import execution as execution_module
from postproc.compensation.conditions import Conditions
from postproc.compensation.datum import deviations, poses
from postproc.control.setup import make_setup
from postproc.dialects import find_dialect
from postproc.motion.motions import merged
from postproc.verification.verify import read_motions

ROOT = Path(__file__).parents[1]
BOX = (ROOT / "examples" / "box.nc").read_text()
FLAT = BOX.split("(begin operation: Pocket)")[0] + "M2\n"
"""Without the pocket and the part of the program that turns the table."""
DEMONSTRATION = machines.FOLDER / "calibrations" / "dmu50.json"


class Case(msgspec.Struct):
    """A machine with errors, its datum, and how that was touched off."""

    machine: str
    calibration: Path
    program: str
    place: dict[str, float]
    probe: float = 80.0
    rotary: dict[str, float] = {}
    option: str = "G54=probed"
    tolerance_um: float = 0.25


def case(name: str, folder: Path) -> Case:
    if name == "demo":
        return Case("dmu50", DEMONSTRATION, BOX, {"X": -30.0, "Y": -20.0, "Z": 150.0}, tolerance_um=1.0)
    machine = "gantry" if name == "gantry" else "dmu50"
    write_model(random_model(machines.load(machine), 11, 30.0), folder / "cal.json")
    if name == "gantry":
        return Case(machine, folder / "cal.json", FLAT, {"X": 3000.0, "Y": 900.0, "Z": 500.0})
    at = {"X": -30.0, "Y": -20.0, "Z": 150.0}
    if name == "long probe":
        return Case(machine, folder / "cal.json", BOX, at, 165.5, {}, "G54=probed@probe=165.5")
    turned = FLAT.replace("G43 H1", "G0 B30 C90\nG43 H1")
    return Case(machine, folder / "cal.json", turned, at, 80.0, {"B": 30.0, "C": 90.0}, "G54=probed@B30,C90")


@pytest.mark.parametrize("name", quick(["demo", "gantry", "long probe", "turned table"], ["demo", "turned table"]))
def test_the_part_is_right_from_its_datum(command, tmp_path, name):
    """The independent machine touches off its datum and cuts the part, corrected by true and by probed offsets."""
    this = case(name, tmp_path)
    shop = Shop(chain_of(this.machine), read_calibration(this.calibration).errors, 80.0)
    touched = shop.touched_off(this.place, this.probe, **this.rotary)
    moved = 1e3 * np.linalg.norm(touched.datum - touched.believed)
    assert moved > 10.0, "the case is no test"
    written = ",".join(f"{touched.offset[axis]:.6f}" for axis in "XYZ")
    setup = ("-m", this.machine, "-c", this.calibration, "--work-offset", f"G54={written}", "--tool-length", "T1=80")
    Path("part.nc").write_text(this.program)
    options = (*setup, "--tolerance-um", this.tolerance_um)
    for option in ("G54=true", this.option):
        done = command("part.nc", *options, "--datum", option, "-o", "out.nc", "--json", "-")
        assert done.status == 0, done.err
        ends, along = shop.cut(Path("out.nc").read_text(), this.program, touched)
        if option == "G54=true":
            assert along == pytest.approx(moved, abs=1.0)
            continue
        assert max(ends.max(), along.max()) <= 0.3
        (told,) = json.loads(done.out)["datum"]
        assert told["true_datum_minus_offset_um"] == pytest.approx((touched.datum - touched.believed) * 1e3, abs=1e-3)
    before, _ = shop.cut(this.program, this.program, touched)
    judged = command("verify", "part.nc", "out.nc", *setup, "--datum", this.option, "--json", "-")
    verdict = json.loads(judged.out)
    assert verdict["block_ends_um"]["before"]["max"] == pytest.approx(before.max(), abs=1e-3)
    assert verdict["block_ends_um"]["after"]["max"] == pytest.approx(ends.max(), abs=1e-3)


def test_the_offset_that_the_page_tells_cuts_the_same_part(command):
    """By hand: another offset on the control, whether the program is corrected for it or was for the old one."""
    shop = Shop(chain_of("dmu50"), read_calibration(DEMONSTRATION).errors, 80.0)
    touched = shop.touched_off({"X": -30.0, "Y": -20.0, "Z": 150.0}, 80.0)
    Path("part.nc").write_text(FLAT)
    common = ("-m", "dmu50", "--tool-length", "T1=80", "--json", "-")
    old = ",".join(f"{touched.offset[axis]:.6f}" for axis in "XYZ")
    done = command("part.nc", *common, "--work-offset", f"G54={old}", "-o", "probed.nc")
    (told,) = json.loads(done.out)["datum"]
    instead = told["true_offset_mm"]
    assert f"with --datum G54=true, enter X {instead['X']:.4f}, Y {instead['Y']:.4f}, Z {instead['Z']:.4f}" in done.err
    new = ",".join(f"{instead[axis]:.4f}" for axis in "XYZ")
    for offset in (old, new):
        command("part.nc", *common, "--work-offset", f"G54={offset}", "--datum", "G54=true", "-o", "true.nc")
        run = TouchedOff({axis: round(instead[axis], 4) for axis in "XYZ"}, touched.datum, touched.believed)
        ends, _ = shop.cut(Path("true.nc").read_text(), FLAT, run, wanted=touched.offset)
        assert ends.max() <= 0.3


# ---- properties of every machine


def constant(machine, *um):
    """A model whose deviation is the same everywhere: of the machine's axes, in the head of the chain."""
    return shifted(machine, **dict(zip("XYZ", um, strict=True)))


@pytest.mark.parametrize("name", THREE_AXES)
def test_a_constant_error_is_in_the_offset_already(name):
    machine = load(name)
    text = "G21 G90 G54\nG0 X10. Y20. Z30.\nG1 X15. F100\nG2 X25. I5. J0.\n"
    offset = centred(machine)
    moved = correct(text, machine, constant(machine, 12.0, -7.0, 5.0), [offset], datums=["G54=true"])
    kept = correct(text, machine, constant(machine, 12.0, -7.0, 5.0), [offset], datums=["G54=probed"])
    assert "X9.9880" in moved.text
    assert kept.text.partition("\n")[2] == text or text in kept.text
    assert kept.report.before.largest == pytest.approx(0.0, abs=1e-9)
    assert kept.report.absolute_before.largest == pytest.approx(np.sqrt(12.0**2 + 7.0**2 + 5.0**2))


PROGRAMS = {
    "iso": "G21 G90 T1 M6\nG54 G43 H1\nG0 X10. Y20. Z30.\nG1 X15. F100\nG2 X25. I5. J0.\nG1 Y45. Z20.\nM30\n",
    "siemens": "T1 D1\nM6\nG54 G71 G90 G17\nG0 X10. Y20. Z30.\nG1 X15. F100\nG2 X25. I5. J0.\nG1 Y45. Z20.\nM30\n",
    "heidenhain": "BEGIN PGM A MM\nTOOL CALL 1 Z S100\nL X+10 Y+20 Z+30 R0 FMAX\nL X+15 F100\nCC X+20 Y+20\n"
    "C X+25 Y+20 DR-\nL Y+45 Z+20\nEND PGM A MM\n",
}
NAMES = {"iso": "G54", "siemens": "G54", "heidenhain": "0"}


EACH = [(name, dialect) for name in (*THREE_AXES, *FIVE_AXES) for dialect in PROGRAMS]


@pytest.mark.parametrize(
    ("name", "dialect"), quick(EACH, [*zip((*THREE_AXES, *FIVE_AXES), cycle(PROGRAMS), strict=False)][::2])
)
def test_relative_errors_are_within_the_tolerance(command, name, dialect):
    """And probed at W is true at W + e(W), by the command and by `verify`."""
    machine = load(name)
    write_model(random_model(machine, 3, 30.0), Path("cal.json"))
    Path("part.nc").write_text(PROGRAMS[dialect])
    _, values = centred(machine).split("=")
    setup = ("-m", name, "-c", "cal.json", "--dialect", dialect, "--tool-length", "T1=80")
    setup += ("--work-offset", f"{NAMES[dialect]}={values}")
    done = command("part.nc", *setup, "-o", "out.nc", "--json", "-")
    assert done.status == 0, done.err
    told = json.loads(done.out)
    assert told["errors_relative_to"] == "datum"
    assert told["predicted_error_um"]["after"]["max"] < 0.2
    assert told["predicted_error_um"]["between_block_ends_after"]["max"] <= 1.0
    (datum,) = told["datum"]
    assert datum["probe_mm"] == 80.0
    size = np.linalg.norm(datum["true_datum_minus_offset_um"])
    assert size > 5.0
    assert told["predicted_absolute_error_um"]["after"]["max"] == pytest.approx(size, abs=0.2)
    assert f"{NAMES[dialect]}: probed (default) at X " in done.err
    verdict = json.loads(command("verify", "part.nc", "out.nc", *setup, "--json", "-").out)
    assert verdict["block_ends_um"]["after"]["max"] < 0.2
    assert verdict["along_feed_moves_um"]["after"]["max"] <= 1.0
    assert verdict["absolute_block_ends_um"]["after"]["max"] == pytest.approx(size, abs=0.2)


# ---- the mathematics


def test_the_pose_of_a_touch_off():
    machine = load("dmu50")
    there = touch_off("G54", Datum(at={"C": 90.0}, probe=120.0), (0.0, 0.0, 10.0, 20.0, 30.0), machine)
    q, tool = poses(machine, [there])
    assert q[0] == pytest.approx([np.pi / 2, 0.0, 10.0, 20.0, 150.0])
    assert tool[0] == pytest.approx([0.0, 0.0, -120.0])
    at = touch_off("G54", Datum(at={"X": 5.0}, probe=120.0), (30.0, 0.0, 10.0, 20.0, 30.0), machine)
    assert at.position == (30.0, 0.0, 5.0, 20.0, 30.0), "an offset of a rotary axis is where the part is aligned"


def test_a_head_that_is_swung_holds_the_tip_where_it_is_said():
    machine = load("head_head")
    there = touch_off("G54", Datum(at={"B": 90.0}, probe=100.0), (1000.0, 500.0, 300.0, 0.0, 0.0), machine)
    q, tool = poses(machine, [there])
    assert tool_point(machine, q, tool)[0] == pytest.approx([1000.0, 500.0, 300.0])


def test_the_deviation_at_a_touch_off_by_hand():
    """E_XX of 5 um in the middle, and E_BZ of 100 urad with a probe of 120 mm below the carriage."""
    machine = load("gantry")
    rising = ErrorMotion("X", "X", Legendre((0.0, 5000.0), 1), (5.0, 5.0))
    tilting = ErrorMotion("B", "Z", Legendre((0.0, 1500.0), 0), (100.0,))
    model = model_of(machine, rising, tilting, Backlash("X", 20.0))
    there = touch_off("G54", Datum(probe=120.0), (2500.0, 100.0, 200.0), machine)
    found = deviations(machine, model, [there], Conditions())
    assert found[0] * 1e3 == pytest.approx([5.0 - 12.0, 0.0, 0.0], abs=0.01), "play: in the middle"


def test_the_uncertainty_is_that_of_the_difference(command):
    """What both errors share is certain: a constant error has no uncertainty relative to its datum."""
    machine = load("gantry")
    effects = (LocationError("X", "X", 30.0, u=(9.0,)), LocationError("C", "Y", -40.0, u=(2.0,)))
    write_model(model_of(machine, *effects), Path("cal.json"))
    Path("part.nc").write_text("G21 G90 G54\nG0 X0. Y500. Z0.\n")
    setup = ("-m", "gantry", "-c", "cal.json", "--work-offset", "G54=100,100,100", "-o", "out.nc", "--json", "-")
    u = {}
    for kind in ("probed", "true"):
        done = command("part.nc", *setup, "--datum", f"G54={kind}")
        u[kind] = json.loads(done.out)["predicted_error_um"]["standard_uncertainty_of_prediction"]["max"]
    assert u["probed"] == pytest.approx(2.0 * 0.5, abs=1e-4)
    assert u["true"] == pytest.approx(np.hypot(9.0, 2.0 * 0.6), abs=1e-4)


# ---- how it is given


def test_reading_a_datum():
    axes = ("C", "B", "X", "Y", "Z")
    assert read_datum("true", axes, "") == Datum(probed=False)
    assert read_datum(" Probed ", axes, "") == Datum()
    assert read_datum("probed@X10.5,Y-3,C90,probe=120.25", axes, "") == Datum(
        at={"X": 10.5, "Y": -3.0, "C": 90.0}, probe=120.25
    )
    assert read_datum("probed@ c = 90", axes, "") == Datum(at={"C": 90.0})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("guessed", "expected probed, true"),
        ("", "expected probed, true"),
        ("true@C90", "expected probed, true"),
        ("probed@", "expected probed, true"),
        ("probed@A90", "no axis A"),
        ("probed@C90,C80", "C is given twice"),
        ("probed@C", "neither an axis"),
        ("probed@Cnan", "neither an axis"),
        ("probed@C1.2.3", "neither an axis"),
        ("probed@probe=-5", "a probe of -5 mm"),
        ("probed@probe120", "neither an axis"),
    ],
)
def test_a_datum_that_is_none(text, words):
    with pytest.raises(UserError, match=re.escape(words)):
        read_datum(text, ("C", "B", "X", "Y", "Z"), "G54")


def test_the_command_refuses_what_is_no_datum(command):
    Path("part.nc").write_text("G21 G90 G54\nG0 X0. Y0. Z0.\n")
    for option, words in (
        ("G54", "expected e.g. G54=probed"),
        ("G54=guess", "--datum G54=guess: expected probed"),
        ("=true", "expected e.g. G54=probed"),
    ):
        for line in (("part.nc", "-o", "out.nc"), ("verify", "part.nc", "part.nc")):
            done = command(*line, "-m", "dmu50", "--datum", option)
            assert done.status == 2
            assert words in done.err
            assert not Path("out.nc").exists()
    twice = command("part.nc", "-m", "dmu50", "--datum", "G54=true", "--datum", "g54=probed", "-o", "out.nc")
    assert twice.status == 2
    unused = command("part.nc", "-m", "dmu50", "--datum", "G55=true", "-o", "out.nc")
    assert "the datum of G55 was given and is not used" in unused.err


def test_the_machine_file_says_it(command):
    text = (machines.FOLDER / "dmu50.toml").read_text()
    Path("part.nc").write_text("G21 G90 G54 T1 M6\nG0 X0. Y0. Z0.\nG55 X1. Y1. Z1.\n")
    for entry, kinds in (
        ('G54 = "probed@C90,probe=120"', ["probed", "probed"]),
        ('default = "true"', ["true", "true"]),
        ('default = "true"\nG55 = "probed"', ["probed", "true"]),
    ):
        Path("mine.toml").write_text(f"{text}\n[datum]\n{entry}\n")
        options = (
            "-m",
            "mine.toml",
            "-c",
            DEMONSTRATION,
            "--work-offset",
            "G54=0,0,100",
            "--work-offset",
            "G55=9,0,100",
        )
        done = command("part.nc", *options, "--tool-length", "T1=80", "-o", "out.nc", "--json", "-")
        assert done.status == 0, done.err
        told = json.loads(done.out)["datum"]
        assert [each["obtained"] for each in told] == kinds
        if "C90" in entry:
            assert (told[0]["position"]["C"], told[0]["probe_mm"], told[0]["probe_given"]) == (90.0, 120.0, True)
            assert (told[1]["position"]["C"], told[1]["probe_mm"], told[1]["probe_given"]) == (0.0, 80.0, False)
    Path("mine.toml").write_text(f'{text}\n[datum]\nG54 = "maybe"\n')
    refused = command("machines", "mine.toml")
    assert refused.status == 2
    assert "datum.G54: expected probed" in refused.err


def test_a_work_offset_that_is_used_with_the_table_turned(command):
    """The position of the touch-off is an option: the default is home."""
    head = "G21 G90 G54 T1 M6\nG43 H1\n"
    options = ("-m", "dmu50", "--work-offset", "G54=0,0,100", "--tool-length", "T1=80", "-o", "out.nc")
    note = (
        "G54 is first used at B30,C90, and its touch-off is assumed elsewhere: if it was touched off there, give --datum "
        "G54=probed@B30,C90"
    )
    for line, extra, expected in (
        ("G0 X0. Y0. Z0. B30. C90.\n", (), True),
        ("G0 X0. Y0. Z0. B30. C90.\n", ("--datum", "G54=probed@B30,C90"), False),
        ("G0 X0. Y0. Z0. B30. C90.\n", ("--datum", "G54=true"), False),
        ("G0 X0. Y0. Z0. B0. C0.\nB30. C90.\n", (), False),
    ):
        Path("part.nc").write_text(head + line)
        done = command("part.nc", *options, *extra)
        assert done.status == 0, done.err
        assert (note in done.err.replace("C90,B30", "B30,C90")) is expected


def test_judged_by_a_second_calibration_as_truth(command):
    """Aligned at the datum that is touched off on the true machine."""
    machine = machines.load("dmu50")
    write_model(random_model(machine, 4, 10.0), Path("true.json"))
    Path("part.nc").write_text(FLAT)
    setup = ("-m", "dmu50", "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80")
    assert command("part.nc", *setup, "-o", "out.nc").status == 0
    both = json.loads(command("verify", "part.nc", "out.nc", *setup, "--align", "true.json", "--json", "-").out)
    assert both["by_calibration"]["block_ends_um"]["after"]["max"] < 0.2
    assert both["block_ends_um"]["after"]["max"] > 1.0
    shop = Shop(chain_of("dmu50"), read_calibration(Path("true.json")).errors, 80.0)
    offset = {"X": -30.0, "Y": -20.0, "Z": 150.0}
    q = np.array([[{**offset, "Z": 230.0}.get(name, 0.0) for name in chain_of("dmu50").names]])
    touched = TouchedOff(offset, shop.actual(q, 80.0)[0], shop.nominal(q, 80.0)[0])
    for text, when in ((FLAT, "before"), (Path("out.nc").read_text(), "after")):
        ends, _ = shop.cut(text, FLAT, touched)
        assert both["block_ends_um"][when]["max"] == pytest.approx(ends.max(), abs=1e-3)
        best = both["best_fit_along_feed_moves_um"][when]
        assert 0.0 < best["rms"] < both["along_feed_moves_um"][when]["rms"]
    shown = command("verify", "part.nc", "out.nc", *setup, "--align", "true.json")
    assert "best fit, along" in shown.out.decode()
    refused = command("verify", "part.nc", "out.nc", *setup, "--align", "no.json")
    assert refused.status == 2
    assert "no.json: No such file" in refused.err


def test_best_fit_takes_off_what_a_measuring_machine_aligns(command):
    """A squareness is half a turn and half a shear; a table that lies askew is a turn alone."""
    machine = machines.load("gantry")
    Path("part.nc").write_text("G21 G90 G54 T1 M6\nG43 H1\nG1 X0. Y0. Z0. F900\nX400.\nY400.\nX0.\nY0.\nX400. Y400.\n")
    setup = ("-m", "gantry", "--work-offset", "G54=100,100,-300", "--tool-length", "T1=80", "-c", "none")
    found = {}
    for name, effects in {
        "turned": (
            LocationError(component="C", axis="X", value=50.0),
            LocationError(component="C", axis="Y", value=50.0),
        ),
        "sheared": (
            LocationError(component="C", axis="X", value=50.0),
            LocationError(component="C", axis="Y", value=-50.0),
        ),
    }.items():
        write_model(msgspec.structs.replace(no_errors(machine), effects=effects), Path("true.json"))
        done = command("verify", "part.nc", "part.nc", *setup, "--align", "true.json", "--json", "-")
        assert done.status == 0, done.err
        found[name] = json.loads(done.out)
        assert found[name]["along_feed_moves_um"]["before"]["max"] > 10.0
    turned, sheared = (found[name]["best_fit_along_feed_moves_um"]["before"] for name in ("turned", "sheared"))
    assert turned["rms"] < 1e-3
    assert turned["turn_urad"] == pytest.approx([0.0, 0.0, 50.0], abs=1e-2)
    # at (200, 200) from the middle of a square a shear of 50 urad in each direction moves by 10 um along both axes
    assert sheared["turn_urad"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-2)
    assert sheared["rms"] > 5.0


def test_a_touch_off_that_can_not_have_been(command):
    Path("part.nc").write_text("G21 G90 G54 T1 M6\nG43 H1\nG0 X0. Y0. Z0.\n")
    options = ("-m", "dmu50", "--work-offset", "G54=0,0,100", "--tool-length", "T1=80", "-o", "out.nc")
    for datum, words in (
        ("probed@X300", "takes X to 300 mm, outside its travel -250..250 mm"),
        ("probed@probe=350", "takes Z to 450 mm, outside its travel 0..400 mm"),
    ):
        for line in (("part.nc", *options), ("verify", "part.nc", "out.nc", *options[:-2])):
            done = command(*line, "--datum", f"G54={datum}")
            assert done.status == 0, done.err
            assert words in done.err
    assert "beyond its calibrated range" in command("part.nc", *options, "--datum", "G54=probed@X300").err


# ---- which datum a move has


def touch_offs(text, machine, dialect="iso", **setup):
    """The touch-off of every move of a program."""
    source = source_of(text, {"iso": "a.nc", "siemens": "a.mpf", "heidenhain": "a.h"}[dialect])
    motions = merged(
        read_motions(source, find_dialect(dialect, source.name, ""), machine, make_setup(machine, **setup))
    )
    return [motions.frames[index].touch_off for index in motions.frame.tolist()]


def test_shifts_keep_the_datum_of_their_work_offset():
    machine = load("gantry")
    setup = {"work_offsets": ["G54=100,200,300", "G55=1,2,3"], "tool_lengths": ["T1=80", "T2=50"], "probed": True}
    text = (
        "G21 G90 G17 G54 T1 M6\nG43 H1\nG0 X1. Y1. Z1.\nG52 X5.\nX2.\nG52 X0\nX3.\nG92 X9.\nX1.\nG92.1\n"
        "G55\nX1. Y1. Z1.\nT2 M6\nG43 H2\nG54\nX1. Y1. Z1.\n"
    )
    found = touch_offs(text, machine, **setup)
    assert {(there.name, there.position, there.probe) for there in found} == {
        ("G54", (100.0, 200.0, 300.0), 80.0),
        ("G55", (1.0, 2.0, 3.0), 80.0),
    }


@pytest.mark.parametrize(
    ("dialect", "text", "positions"),
    [
        ("iso", "G21 G90 G54\nG0 X0. Y0. Z1.\nG10 L2 P1 X7. Y8. Z9.\nG0 X0. Y0. Z1.\n", [(1, 2, 3), (7, 8, 9)]),
        ("siemens", "G71 G90 G54\nG0 X0 Y0 Z1\n$P_UIFR[1,X,TR]=7\nG54\nG0 X0 Y0 Z1\n", [(1, 2, 3), (7, 2, 3)]),
        ("siemens", "G71 G90 G500\nG0 X0 Y0 Z1\nSUPA G0 X5 Y5 Z5\n", [None, None]),
    ],
)
def test_an_offset_that_the_program_sets_is_touched_off_where_it_is_set(dialect, text, positions):
    machine = load("gantry")
    setup = {"work_offsets": ["G54=1,2,3"], "probed": True, "zero": True}
    found = [there and there.position for there in touch_offs(text, machine, dialect, **setup)]
    assert list(dict.fromkeys(found)) == list(dict.fromkeys(positions))


def test_the_probe_is_as_long_as_the_first_tool_wherever_a_chunk_ends(monkeypatch):
    """Moves before any tool has a length are on their own; no later tool changes them."""
    machine = load("gantry")
    lines = ["G21 G90 G54", "G0 X1. Y1.", "G43 H1 Z5.", "G1 X2. F100", "G0 X3.", "G43 H2 Z5.", "G1 X4."]
    setup = {"work_offsets": ["G54=1,2,3"], "tool_lengths": ["T1=80", "T2=50"], "probed": True}
    whole = [there.probe for there in touch_offs("\n".join(lines) + "\n", machine, **setup)]
    assert whole == [None, 80.0, 80.0, 80.0, 80.0, 80.0]
    for size in (1, 2, 3):
        monkeypatch.setattr(execution_module, "CHUNK_BLOCKS", size)
        assert [there.probe for there in touch_offs("\n".join(lines) + "\n", machine, **setup)] == whole
