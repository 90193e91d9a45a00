"""Compensation classes of ISO/TR 16907, and the correction of the functional orientation."""

import io

import msgspec
import numpy as np
import pytest
from support.effect_examples import EXAMPLES
from support.programs import correct, load, model_of, random_model

import machines
from kinematics.basis import Polynomial
from kinematics.correction import POLE_DAMPING_RAD, correct_orientation, correct_position
from kinematics.effects import Cyclic, ErrorMotion, LocationJump
from kinematics.error_model.classes import CLASSES, ELEMENTARY, class_of, parse_classes, select
from kinematics.error_model.model import ErrorModel, read_model, write_model
from kinematics.forward import forward, tool_point
from kinematics.state import State
from kinematics.user_error import UserError
from postproc.control.setup import make_setup
from postproc.correct.classes import ClassTable
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.motion.motions import merged
from postproc.text.source import Source
from postproc.verification.verify import read_motions

FIVE_AXES = ("dmu50", "trunnion_bc", "trunnion_ac", "head_head", "head_table")
DMU50 = machines.load("dmu50")
DEMONSTRATION = read_model(machines.default_calibration(DMU50), DMU50)
ISO = find_dialect("iso", "a.nc", "")
PROGRAM = "G90 G21\nG0 X0 Y0 Z300 B0 C0\n" + "".join(
    f"G1 X{x} Y{-x / 2} Z{250 + x} B{30 + x} C{40 + 2 * x} F500\nX{x + 1}\n" for x in range(0, 60, 7)
)


def poses(machine, n, seed=3):
    """Random poses inside travel, unlimited axes within a turn, and a mask of those well off a pole."""
    travel = np.where(machine.rotary, np.clip(machine.travel, -2 * np.pi, 2 * np.pi), machine.travel)
    q = np.random.default_rng(seed).uniform(*travel, (n, len(machine.axes)))
    lines = [machine.axes[i].unit_direction for i in np.flatnonzero(machine.rotary)]
    second = np.flatnonzero(machine.rotary)[1]
    axis = forward(machine, q).rotation[:, :, 2]
    tilt = np.linalg.norm(np.cross(axis, lines[0]), axis=1)
    far = np.abs(np.sin(q[:, second])) > 0.3  # and off the fold, where both solutions meet
    return q, (tilt > 0.3) & far


def test_every_effect_has_an_elementary_class():
    assert {class_of(example.effect) for example in EXAMPLES} <= set(ELEMENTARY)
    assert {class_of(effect) for effect in DEMONSTRATION.effects} == set(ELEMENTARY) - {"SPEC"}


@pytest.mark.parametrize(
    ("name", "expected"),
    [("E_XX", "L-POS"), ("E_YX", "L-STR"), ("E_C0Y", "L-SQU"), ("E_AZ", "L-ANG"), ("E_BB", "R-POS"),
     ("E_CC", "R-POS"), ("E_XC", "R-RAX"), ("E_ZC", "R-RAX"), ("E_A0B", "R-POR"), ("E_X0C", "R-POR"),
     ("E_AC", "R-ANG"), ("E_CB", "R-ANG")],
)  # fmt: skip
def test_class_of_an_error_motion(name, expected):
    assert next(class_of(effect) for effect in DEMONSTRATION.effects if effect.name == name) == expected


def test_a_second_axis_along_x_errs_along_itself_in_x():
    along = ErrorMotion("X", "U", Polynomial((0.0, 50.0), 0), (1.0,))
    assert class_of(along) == "L-POS"
    assert class_of(msgspec.structs.replace(along, component="Y")) == "L-STR"


def test_names_of_classes():
    assert parse_classes("l-vol, R-POS") == {"L-POS", "L-STR", "L-SQU", "L-ANG", "R-POS"}
    assert parse_classes("R-VOL+") == {"R-POS", "R-RAX", "R-POR", "R-ANG", "FOR"}
    assert parse_classes("THESIS") == {"L-POS", "L-STR", "L-SQU", "R-ANG"}
    with pytest.raises(UserError, match=r"^--classes L-VOL,X: 'X' is none of L-POS, "):
        parse_classes("L-VOL,X")


def test_selection_takes_its_part_of_the_covariance():
    n = len(DEMONSTRATION.parameters)
    covariance = np.diag(np.arange(1.0, n + 1))
    model = msgspec.structs.replace(DEMONSTRATION, covariance=tuple(map(tuple, covariance.tolist())))
    part = select(model, parse_classes("R-POR"))
    rows = [i for i, name in enumerate(names(model)) if "0" in name and name[-1] in "BC"]
    assert np.diag(part.covariance).tolist() == (np.array(rows) + 1.0).tolist()
    everything = [select(model, {name}) for name in ELEMENTARY]
    assert sum(len(each.effects) for each in everything) == len(model.effects)


def names(model: ErrorModel) -> list[str]:
    return [effect.name for effect in model.effects for _ in effect.parameters]


@pytest.mark.parametrize("name", FIVE_AXES)
def test_orientation_is_corrected_off_the_poles(name):
    machine = machines.load(name)
    model = random_model(machine, 5)
    q, far = poses(machine, 400)
    movable = np.ones_like(q, bool)
    tool = np.tile([0.0, 0.0, -110.0], (len(q), 1))

    def errors(at):
        return model.errors(machine, State(at))

    turned = correct_orientation(machine, errors, q, movable)
    corrected = correct_position(machine, errors, q, tool, movable, turned)
    nominal = forward(machine, q).rotation[:, :, 2]
    before = np.linalg.norm(forward(machine, q, errors(q)).rotation[:, :, 2] - nominal, axis=1)
    after = np.linalg.norm(forward(machine, corrected, errors(corrected)).rotation[:, :, 2] - nominal, axis=1)
    assert before.max() > 30e-6
    assert after[far].max() < 0.01 * before.max()
    assert (after <= before * (1 + 1e-3)).all()
    assert np.abs(turned - q).max() <= 1.01 * before.max() / (2 * POLE_DAMPING_RAD) + 1e-6
    reached = tool_point(machine, corrected, tool, errors(corrected))
    assert np.abs(reached - tool_point(machine, q, tool)).max() < 1e-8


def test_on_the_pole_no_rotary_axis_runs_away():
    q = np.tile([1.0, 0.0, 10.0, 20.0, 200.0], (3, 1))
    q[1:, 1] = 1e-6, 1e-3
    turned = correct_orientation(DMU50, lambda at: DEMONSTRATION.errors(DMU50, State(at)), q, np.ones_like(q, bool))
    assert np.abs(turned - q).max() < 0.01


def test_axes_that_may_not_move_stay():
    q, _ = poses(DMU50, 20)
    movable = np.ones_like(q, bool)
    movable[:, DMU50.index("C")] = False
    turned = correct_orientation(DMU50, lambda at: DEMONSTRATION.errors(DMU50, State(at)), q, movable)
    assert (turned[:, DMU50.index("C")] == q[:, DMU50.index("C")]).all()
    assert (turned[:, 2:] == q[:, 2:]).all()


def corrected(text, classes):
    source = Source("a.nc", text, text.encode())
    out = io.BytesIO()
    chosen = None if classes is None else parse_classes(classes)
    report = Pipeline(Job(source, ISO, DMU50, DEMONSTRATION, make_setup(DMU50, zero=True), classes=chosen)).run(
        out, lambda _: None
    )
    return report, out.getvalue().decode()


def test_rotary_words_change_only_for_the_orientation():
    plain, text = corrected(PROGRAM, None)
    assert "B37 C54" in text
    assert plain.tilt_after.largest > 20
    turned, text = corrected(PROGRAM, "L-VOL+,R-VOL+")
    assert "B37 C54" not in text
    assert turned.tilt_before.largest == plain.tilt_before.largest
    # one row stands on the pole; four decimals of a degree are 0.9 urad
    assert turned.tilt_after.rms < 0.35 * plain.tilt_after.rms
    assert turned.after.largest < 0.2
    assert set(turned.rotary_correction) == {"B", "C"}


def test_errors_between_ends_contain_those_of_other_classes():
    """A wave of X that is not corrected, in moves of whole periods: it is zero at their ends."""
    wave = Cyclic("X", "X", 10.0, (0.8,), (0.0,))
    straightness = ErrorMotion("Y", "X", Polynomial((-200.0, 200.0), 1), (6.0, 6.0))
    text = "G90 G21 G17 G54\nG0 X0 Y0 Z300 B0 C0\n" + "".join(f"G1 X{10 * i} F500\n" for i in range(1, 12))
    done = correct(text, DMU50, model_of(DMU50, wave, straightness), classes=frozenset(("L-STR",)))
    assert done.report.between_ends.largest == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("name", ["dmu50", "head_table", "trunnion_bc"])
@pytest.mark.parametrize("distances", ["G90", "G91"])
def test_linear_axes_fit_the_rounded_rotary_words(name, distances):
    """Axis positions: 0.1 mdeg of a rotary axis would be 0.3 um at the tool."""
    machine, rng = load(name), np.random.default_rng(3)
    rotary = [axis.name for axis in machine.axes if axis.rotary]
    lines = ["G21 G90 G94 G54", "G43 H1", "G0 X0 Y0 Z20 " + " ".join(f"{axis}40" for axis in rotary), distances]
    for sign in [1, -1] * 20:
        size = rng.uniform(5, 40, 3 + len(rotary)) * (sign if distances == "G91" else 1)
        words = [f"{axis}{value:.3f}" for axis, value in zip((*"XYZ", *rotary), size, strict=True)]
        lines.append(f"G1 {' '.join(words)} F500")
    done = correct(
        "\n".join([*lines, "M30", ""]),
        machine,
        random_model(machine, 5),
        offsets=["G54=0,0,200"],
        tools=["T1=80"],
        datums=["G54=true"],
        classes=parse_classes("FOR,L-VOL+,R-VOL"),
        travel_check=False,
        tolerance_um=1e3,
    )
    assert done.report.after.largest < 1e3 * machine.rounding_mm + 1e-3
    assert done.report.tilt_after.largest < 0.3 * done.report.tilt_before.largest


def test_classes_leave_what_they_do_not_hold():
    left = {c: corrected(PROGRAM, c)[0].after.rms for c in ("L-POS", "L-VOL", "R-VOL", "L-VOL,R-VOL", "THESIS")}
    assert left["L-VOL,R-VOL"] < 0.1
    assert min(left["L-POS"], left["L-VOL"], left["R-VOL"], left["THESIS"]) > 5


@pytest.mark.parametrize(("jump", "name"), [("C0Y", "L-SQU"), ("X0C", "R-POR"), ("X0X", "L-POS")])
def test_a_jump_of_an_axis_line_is_of_the_class_of_the_line(command, tmp_path, jump, name):
    """A diagnosis writes a squareness that a collision has changed as a jump; L-SQU corrects it as any squareness."""
    component, _, axis = jump
    write_model(model_of(DMU50, LocationJump(component, axis, 200.0)), tmp_path / "cal.json")
    (tmp_path / "in.nc").write_text(PROGRAM)
    corrected_by = {}
    for classes in (name, "L-VOL,R-VOL"):
        command(
            "in.nc",
            "--machine",
            "dmu50",
            "--calibration",
            "cal.json",
            "--set-up-zero",
            "--classes",
            classes,
            "-o",
            "out.nc",
            "--force",
        )
        lines = (tmp_path / "out.nc").read_text().splitlines()
        corrected_by[classes] = [line for line in lines if not line.startswith(("(", ";"))]
    assert corrected_by[name] == corrected_by["L-VOL,R-VOL"] != PROGRAM.splitlines()


def test_class_table():
    source = Source("a.nc", PROGRAM, PROGRAM.encode())
    table = ClassTable(DMU50, DEMONSTRATION)
    table.add(merged(read_motions(source, ISO, DMU50, make_setup(DMU50, zero=True))))
    by_choice = {row.choice: row for row in table.rows}
    assert list(by_choice) == ["none", *CLASSES, "L-VOL,R-VOL", "L-VOL+,R-VOL+"]
    assert by_choice["L-VOL,R-VOL"].position.largest < 1e-5
    assert by_choice["L-VOL,R-VOL"].tilt.rms == pytest.approx(by_choice["none"].tilt.rms, rel=0.01)
    assert by_choice["L-VOL+,R-VOL+"].tilt.rms < 0.35 * by_choice["none"].tilt.rms
    assert by_choice["none"].rotary_correction.largest == 0


def test_no_rotary_axes_no_rotary_classes():
    gantry = machines.load("gantry")
    rows = ClassTable(gantry, random_model(gantry, 1)).rows
    assert rows
    assert not [row for row in rows if row.choice.startswith(("R-", "FOR"))]
