"""An electronic level: files, signs on tool and table, refusals, and a fit that finds pitch and roll of the machine."""

from pathlib import Path

import numpy as np
import pytest
from support.virtual_measurements import written

import machines
from calibration.fit.calibrate import calibrate
from calibration.instruments import Level
from calibration.instruments.level import pitch_and_roll
from calibration.measurement.file import read_measurement
from calibration.measurement.plan import Choices
from calibration.planning.strategies import plan
from calibration.simulation.measure_plan import Simulated, VirtualInstrument, measure_plan, streams
from calibration.single_axis.iso230 import evaluate
from kinematics.error_model.model import ErrorModel
from kinematics.forward import forward
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError
from ncomp import virtual_machine

CFRAME = machines.load("cframe")
HEAD = "# machine: cframe\n# instrument: level\n# u_angle_urad: 2\n# target.t: 0 0 -90\n"
COLUMNS = "axis,run,direction,target_mm,pitch_urad,roll_urad\n"
ROWS = "X,1,+,0,0,1\nX,1,+,100,-3.5,\nY,1,-,50,,2\n"


def file_of(folder: Path, text: str) -> Path:
    path = folder / "level.csv"
    path.write_text(text)
    return path


def simulated(model: ErrorModel, level: Level, seed: int = 0) -> Simulated:
    laid = plan(CFRAME, "axes", spacing_mm=40.0, choices=Choices(runs=3))
    return measure_plan(laid, model, VirtualInstrument(level), streams(seed, 4)[1:])


def angles(model: ErrorModel, axis: str, positions: Array) -> dict[str, Array]:
    """Angular error motions of an axis, urad, relative to their mean."""
    i = CFRAME.index(axis)
    q = np.tile([each.home for each in CFRAME.axes], (len(positions), 1)).astype(float)
    q[:, i] = positions
    errors = model.errors(CFRAME, State(q, approach=np.zeros_like(q)))[:, i, 3:] * 1e6
    return dict(zip("ABC", (errors - errors.mean(axis=0)).T, strict=True))


@pytest.mark.parametrize(("name", "sign"), [("cframe", -1.0), ("gantry", 1.0)])
def test_readings_become_error_motions_of_the_tool_relative_to_the_workpiece(
    tmp_path: Path, name: str, sign: float
) -> None:
    """The X and Y axes of the C-frame machine carry the table, those of the gantry the tool."""
    machine = machines.load(name)
    text = HEAD.replace("cframe", name) + COLUMNS + ROWS
    measurement = read_measurement(file_of(tmp_path, text), machine)
    assert measurement.component is not None
    assert measurement.component.tolist() == ["B", "A", "B", "B"]
    np.testing.assert_allclose(measurement.observed[:, 0] * 1e6, sign * np.array([0.0, 1.0, -3.5, 2.0]))
    assert measurement.angular.all()
    assert measurement.where(3).endswith(":8")


@pytest.mark.parametrize("name", ["cframe", "gantry"])
def test_a_tilt_of_the_carrier_is_its_rotation_against_the_bed(tmp_path: Path, name: str) -> None:
    """Independent of the error columns: the pose of the tool in the workpiece, by the exact product of the chain."""
    machine = machines.load(name)
    i, q = machine.index("X"), np.zeros((1, len(machine.axes)))
    errors = np.zeros((1, len(machine.axes) + 1, 6))
    errors[0, i, 4] = 3e-6
    turned = forward(machine, q, errors).rotation[0] @ forward(machine, q).rotation[0].T
    of_carrier = turned[0, 2] * (1.0 if machine.axes[i].side == "tool" else -1.0)
    text = f"{HEAD.replace('cframe', name)}{COLUMNS}X,1,+,0,{float(of_carrier) * 1e6!r},\n"
    measurement = read_measurement(file_of(tmp_path, text), machine)
    np.testing.assert_allclose(measurement.observed[0, 0], 3e-6, rtol=1e-5)


def test_millimetres_per_metre_are_read(tmp_path: Path) -> None:
    per_m = COLUMNS.replace("_urad", "_mm_per_m")
    measurement = read_measurement(file_of(tmp_path, f"{HEAD}{per_m}X,1,+,0,0.002,\nX,1,+,100,,-0.001\n"), CFRAME)
    np.testing.assert_allclose(measurement.observed[:, 0] * 1e6, [-2.0, 1.0])


def test_a_file_is_written_back(tmp_path: Path) -> None:
    measurement = read_measurement(file_of(tmp_path, HEAD + COLUMNS + ROWS), CFRAME)
    again = read_measurement(written(measurement, tmp_path / "again.csv"), CFRAME)
    np.testing.assert_array_equal(again.observed, measurement.observed)
    np.testing.assert_array_equal(again.component, measurement.component)
    np.testing.assert_array_equal(again.state.positions, measurement.state.positions)
    assert again.instrument == measurement.instrument


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            HEAD + COLUMNS + "Z,1,+,0,1,\n",
            "level.csv:6 column axis: a level measures horizontal linear axes, and Z is none",
        ),
        (HEAD + COLUMNS + "X,1,+,0,,\n", "no row has a reading"),
        (HEAD + COLUMNS.replace("pitch_urad,roll_urad", "yaw_urad") + "X,1,+,0,1\n", "columns of readings are missing"),
        (HEAD + COLUMNS.replace("roll_urad", "pitch_mm_per_m") + "X,1,+,0,1,1\n", "a reading has one unit"),
        (HEAD + COLUMNS.replace("roll_urad", "deviation_urad") + "X,1,+,0,1,1\n", "a level has pitch_urad"),
        (HEAD.replace("# u_angle_urad: 2\n", "") + COLUMNS + ROWS, "uncertainty (k=1) of the level is missing"),
        (HEAD + "# vertical: up\n" + COLUMNS + ROWS, "'up' is none of x, y and z"),
        (HEAD + "# vertical: x\n" + COLUMNS + ROWS, "X is none (vertical: x)"),
        (HEAD + COLUMNS.replace("run,", "") + "X,+,0,1,\n", "a level: column run missing"),
    ],
)
def test_what_a_level_does_not_measure_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(UserError) as error:
        read_measurement(file_of(tmp_path, text), CFRAME)
    assert message in str(error.value)


def test_pitch_and_roll_are_those_about_the_horizontal_directions() -> None:
    assert [pitch_and_roll(*case) for case in (("X", "z"), ("Y", "z"), ("Z", "y"), ("X", "y"))] == [
        ("B", "A"), ("A", "B"), ("A", "C"), ("C", "A"),
    ]  # fmt: skip


def test_a_fit_finds_pitch_and_roll_within_their_uncertainty() -> None:
    level, scaled = Level(u_angle_urad=1.0), []
    for seed in range(3):
        truth = virtual_machine("cframe", seed=seed)
        measurement = simulated(truth, level, seed).measurement
        assert sorted(set(measurement.axis.tolist() if measurement.axis is not None else [])) == ["X", "Y"]
        found = calibrate(measurement, hold_out=False)
        for axis in "XY":
            rows = np.flatnonzero(measurement.axis == axis)
            positions, counts = np.unique(measurement.axis_position[rows], return_counts=True)
            true, fitted = angles(truth, axis, positions), angles(found.model, axis, positions)
            for letter in pitch_and_roll(axis, "z"):
                u = level.u_angle_urad / np.sqrt(counts / 2.0)
                scaled.append((fitted[letter] - true[letter]) / u)
                assert np.std(true[letter]) > 1.0
            assert not fitted["C"].any()
    worst = np.concatenate(scaled)
    assert np.sqrt(np.mean(worst**2)) < 1.3
    assert np.abs(worst).max() < 4.5


def test_a_fit_names_what_a_level_never_sees() -> None:
    found = calibrate(simulated(virtual_machine("cframe", seed=1), Level(u_angle_urad=1.0)).measurement)
    assert any("sees pitch and roll of horizontal axes only: yaw" in each.message for each in found.findings)
    assert not any(motion.component not in "AB" for motion, _ in found.model.error_motions)


def test_the_tests_of_iso_230_2_need_positions() -> None:
    measurement = simulated(virtual_machine("cframe", seed=1), Level.typical()).measurement
    with pytest.raises(UserError, match="needs positioning deviations"):
        evaluate(measurement)


def test_a_plan_without_horizontal_axes_is_refused() -> None:
    laid = plan(CFRAME, "axes", spacing_mm=40.0, choices=Choices(ranges={"X": (0.0, 0.0), "Y": (0.0, 0.0)}))
    with pytest.raises(UserError, match="a level measures horizontal linear axes, and the plan moves none"):
        measure_plan(laid, virtual_machine("cframe", errors="none"), VirtualInstrument(Level.typical()), streams(0, 3))
