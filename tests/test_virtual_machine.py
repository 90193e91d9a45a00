"""The virtual machine of the exam and ncomp, each written without the other, check one another."""

import ast
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
import virtual_machine
from virtual_machine import designs, observe, sheet, truth
from virtual_machine import instrument_causes as instrument
from virtual_machine import machine_causes as machine
from virtual_machine.cause import UM, Cause
from virtual_machine.chain import load, nominal_points, tool_points
from virtual_machine.observe import Laser, Setup
from virtual_machine.session import Session

import machines
from calibration.measurement.file import read_measurement
from calibration.measurement.measurement import Measurement
from calibration.registration.registration import Registration
from kinematics.basis import Fourier
from kinematics.deviation import exact_deviation
from kinematics.effects import (
    AirScale,
    AngleHarmonic,
    Backlash,
    CrossAxis,
    Cyclic,
    Effect,
    ErrorMotion,
    FollowingError,
    GrowthWithSensor,
    GrowthWithTime,
    LocationError,
    Outliers,
    QuantisedCompensation,
    RangeOffset,
    Settling,
    StationShift,
    ThermalDrift,
    TrackerDrift,
)
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.forward import tool_point
from kinematics.state import State
from kinematics.transforms import Pose

EXAMINED = ("gantry", "cframe", "dmu50")
FOLDER = Path(virtual_machine.__file__).parent
ON_A_LINE = 1e-9
"""mm: what two exact ways may differ by."""


def rng(seed: int = 3) -> np.random.Generator:
    return np.random.default_rng(seed)


def setup_of(name: str, session: Session, *causes: Cause) -> Setup:
    chain = load(name)
    return Setup(session, truth.none(chain), designs.PLACES[name].tracker, designs.stands(chain, rng()), causes)


def read(setup: Setup, folder: Path) -> Measurement:
    """As ncomp reads what the virtual tracker writes."""
    file = folder / "data.csv"
    points = observe.observed(setup, rng())
    file.write_text(sheet.tracker_sheet(setup.session, setup.tracker, points), encoding="utf-8")
    return read_measurement(file, machines.load(setup.session.chain.name))


def model_of(name: str, *effects: Effect) -> ErrorModel:
    return msgspec.structs.replace(no_errors(machines.load(name)), effects=effects)


def names_imported(file: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            found.add(str(node.module).partition(".")[0])
        elif isinstance(node, ast.Name):
            assert node.id not in ("__import__", "exec", "eval"), file
    return found


@pytest.mark.parametrize("file", sorted(FOLDER.glob("*.py")), ids=lambda file: file.name)
def test_the_virtual_machine_imports_nothing_of_ncomp(file):
    assert names_imported(file) <= {*sys.stdlib_module_names, "numpy", "virtual_machine"}
    assert "importlib" not in names_imported(file)


@pytest.mark.parametrize("name", [path.stem for path in sorted((FOLDER.parents[1] / "machines").glob("*.toml"))])
def test_chains_with_errors_agree(name):
    chain, known, random = load(name), machines.load(name), rng()
    assert tuple(chain.names) == known.names
    travel = np.clip(known.travel, -5000.0, 5000.0)
    q = random.uniform(*travel, (200, len(chain.axes)))
    errors, tool = random.normal(size=(200, len(chain.axes), 6)) * 1e-2, random.normal(size=(200, 6)) * 1e-2
    targets = random.normal(size=(200, 3)) * 200.0
    together = np.concatenate([errors, tool[:, None]], axis=1)
    np.testing.assert_allclose(
        tool_points(chain, q, errors, tool, targets), tool_point(known, q, targets, together), rtol=0, atol=ON_A_LINE
    )
    np.testing.assert_allclose(nominal_points(chain, q, targets), tool_point(known, q, targets), rtol=0, atol=ON_A_LINE)


def test_the_gantry_of_table_1_is_that_of_ncomp():
    chain, known = load("gantry"), machines.load("gantry")
    curves = truth.table_1(chain, rng())
    positions = rng(4).uniform(*known.travel, (100, 3))
    effects = []
    for axis in chain.axes:
        for k, letter in enumerate("XYZABC"):
            n = tuple(truth.TABLE_1[f"{letter}{axis.name}"][i] for i in (2, 5))
            effects.append(
                ErrorMotion(letter, axis.name, Fourier(axis.travel, n), tuple(curves.coefficients[axis.name][k]))
            )
    wanted = model_of("gantry", *effects).errors(known, State(positions))
    np.testing.assert_allclose(curves.errors(chain, positions), wanted[:, :3], rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", EXAMINED)
def test_smooth_curves_are_as_large_as_said(name):
    chain = load(name)
    ladder = np.stack([np.linspace(*axis.travel, 101) for axis in chain.axes], axis=1)
    largest = np.abs(truth.smooth(chain, rng()).errors(chain, ladder)).max(axis=0) / truth.MICRO
    least, most = np.array(truth.SIZE) * [1 - truth.WAVE, 1 + truth.WAVE]
    assert np.all((largest >= least - 1e-9) & (largest <= most + 1e-9))


MACHINE_CAUSES = [
    ("gantry", machine.Backlash("X", 12.0), Backlash("X", 12.0)),
    ("dmu50", machine.Backlash("B", 30.0), Backlash("B", 30.0)),
    ("cframe", machine.Settling("Y", 30.0), Settling("Y", 30.0)),
    ("dmu50", machine.Settling("C", 30.0), Settling("C", 30.0)),
    (
        "gantry",
        machine.Cyclic("Y", 20.0, (0.4, 1.3), (4.0, 1.5)),
        Cyclic("Y", "Y", 20.0, (4 * np.cos(0.4), 1.5 * np.cos(1.3)), (4 * np.sin(0.4), 1.5 * np.sin(1.3))),
    ),
    ("dmu50", machine.Cyclic("C", 9.0, (0.0, 0.0), (4.0, 1.5)), Cyclic("C", "C", 9.0, (4.0, 1.5), (0.0, 0.0))),
    ("cframe", machine.Ripple("Y", 4.5, 0.4, 4.0), Cyclic("Y", "Y", 100.0, (4 * np.cos(0.4),), (4 * np.sin(0.4),))),
    ("cframe", machine.Steps("X", 47.0, 13.0, 6.0), QuantisedCompensation("X", 6.0, 47.0, 13.0)),
    ("gantry", machine.Lag("Y", 0.2), FollowingError("Y", 0.2)),
    ("cframe", machine.Tilt("Y", "C", 20.0), LocationError("C", "Y", 20.0)),
    ("gantry", machine.Tilt("Z", "B", 20.0), LocationError("B", "Z", 20.0)),
    ("dmu50", machine.Tilt("Z", "A", 20.0), LocationError("A", "Z", 20.0)),
    ("dmu50", machine.Tilt("C", "X", 20.0), LocationError("X", "C", 20.0)),
    ("dmu50", machine.Tilt("B", "A", 20.0), LocationError("A", "B", 20.0)),
    ("gantry", machine.Drift("Z", None, -9.0), ThermalDrift(component="Z", rate=-9.0)),
    (
        "dmu50",
        machine.Drift("X", 900.0, 9.0),
        ThermalDrift(component="X", amplitudes=(9.0,), time_constants_s=(900.0,)),
    ),
    ("gantry", machine.Growth("X", None, 3.0), GrowthWithTime(axis="X", rate=3.0)),
    ("dmu50", machine.Growth("Y", "scale", 8.0), GrowthWithSensor(axis="Y", sensor="scale", coefficient=8.0)),
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "mine", "theirs"), MACHINE_CAUSES, ids=lambda v: type(v).__name__ if isinstance(v, Cause) else ""
)
def test_causes_in_the_machine_agree(name, mine, theirs, tmp_path):
    chain, known = load(name), machines.load(name)
    session = designs.in_motion(chain, rng()) if isinstance(mine, machine.Lag) else designs.scattered(chain, rng())
    state = read(setup_of(name, session), tmp_path).state
    if session.feed is not None:
        np.testing.assert_allclose(
            state.velocity.T, [session.velocity(axis) for axis in chain.names], rtol=0, atol=1e-9
        )
    np.testing.assert_allclose(state.positions, chain.to_radians(session.positions), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(state.approach, np.sign([session.last_move(a) for a in chain.names]).T)
    errors = model_of(name, theirs).observation(known, state).errors
    q, targets = chain.to_radians(session.positions), session.reflectors()
    moved = tool_points(chain, q, mine.errors(session), mine.tool(session), targets) - nominal_points(chain, q, targets)
    assert np.abs(moved).max() > 1e-4
    wanted = exact_deviation(known, q, errors, targets).position
    np.testing.assert_allclose(moved, wanted, rtol=0, atol=ON_A_LINE)


@pytest.mark.parametrize("name", EXAMINED)
def test_a_sag_agrees(name):
    chain, known, mine = load(name), machines.load(name), machine.Sag("X", "Y", 9.0)
    session = designs.scattered(chain, rng())
    (size,) = mine.answer().sizes["coefficient of P2 X"]
    # coefficients P0 P1, P1 P1, P2 P1
    product = CrossAxis("Z", "X", "Y", chain.axis("X").travel, chain.axis("Y").travel, 2, 1, (0.0, 0.0, size))
    theirs = model_of(name, product).errors(known, State(chain.to_radians(session.positions)))
    np.testing.assert_allclose(mine.errors(session), theirs[:, : len(chain.axes)], rtol=0, atol=1e-15)


def test_the_cause_outside_the_table_is_a_smooth_function_of_x_z_and_time():
    session = designs.scattered(load("gantry"), rng())
    u, v, t = session.place("X") / 5000, session.place("Z") / 1500, session.clock / session.clock[-1]
    wanted = 8.0 * UM * np.exp(-8 * (u - 0.45) ** 2) * (2 * v - 1) * np.sin(3 * np.pi * t)
    np.testing.assert_allclose(machine.Unknown("Y", 8.0).tool(session)[:, 1], wanted, rtol=0, atol=1e-15)


SIX = (5.0, -3.0, 8.0), (2.0, 1.0, -4.0)
INSTRUMENT_CAUSES = [
    (instrument.StationShift("s2", 0, *SIX), StationShift("s2", *SIX)),
    (instrument.TrackerDrift(*SIX), TrackerDrift(*SIX)),
    (instrument.RangeOffset(7.0), RangeOffset(7.0)),
    (instrument.AirScale(3.0), AirScale(3.0)),
    (instrument.AngleHarmonic("azimuth", 1, 6.0, -3.0), AngleHarmonic("azimuth", 1, 6.0, -3.0)),
    (instrument.AngleHarmonic("elevation", 2, 6.0, -3.0), AngleHarmonic("elevation", 2, 6.0, -3.0)),
    (instrument.Outliers((7, 100), (60.0, 0.0, -20.0, 5.0, 9.0, 80.0)), Outliers((7, 100), (60.0, 0.0, -20.0, 5.0, 9.0, 80.0))),
]  # fmt: skip


@pytest.mark.parametrize(("mine", "theirs"), INSTRUMENT_CAUSES, ids=lambda v: type(v).__name__)
@pytest.mark.parametrize("name", EXAMINED)
def test_causes_in_the_instrument_agree(name, mine, theirs, tmp_path):
    session = designs.scattered(load(name), rng(), passes=2, stations=2)
    state = read(setup_of(name, session), tmp_path).state
    small = 1e-3  # where the second order, which ncomp leaves out, is below what numbers hold
    theirs = theirs.with_parameters([small * value for value in theirs.parameters])
    moved = mine.scaled(small).seen(session, state.observed) - state.observed
    wanted = model_of(name, theirs).observation(machines.load(name), state).shift
    assert np.abs(wanted).max() > 1e-7
    np.testing.assert_allclose(moved, wanted, rtol=0, atol=1e-6 * np.abs(wanted).max() + 2e-12)


@pytest.mark.parametrize("mine", [mine for mine, _ in INSTRUMENT_CAUSES], ids=lambda v: type(v).__name__)
def test_the_second_order_of_a_cause_in_the_instrument_is_a_nanometre(mine):
    session = designs.scattered(load("gantry"), rng(), passes=2, stations=2)
    points = rng().normal(size=(len(session), 3)) * 2000.0
    small = 1e-3
    whole = mine.seen(session, points) - points
    assert np.abs(whole - (mine.scaled(small).seen(session, points) - points) / small).max() < 2e-6


@pytest.mark.parametrize("name", EXAMINED)
def test_the_whole_way_from_truth_to_readings_agrees(name, tmp_path):
    """All at once, by ncomp's own observation equations, with references on the table and two stations."""
    chain, known = load(name), machines.load(name)
    session = designs.scattered(chain, rng(), passes=2, stations=2, with_references=True)
    causes = (machine.Backlash("X", 12.0), machine.Drift("Z", None, 9.0), instrument.RangeOffset(4.0))
    effects = (Backlash("X", 12.0), ThermalDrift(component="Z", rate=9.0), RangeOffset(4.0))
    setup = setup_of(name, session, *causes)
    measurement = read(setup, tmp_path)
    readings = observe.without_noise(setup)
    poses = {}
    for station, stand in setup.stands.items():
        turn = observe.rotations(stand.turn[None]).swapaxes(1, 2)
        poses[station] = Pose(turn, -(turn @ stand.origin))
    targets = {key: np.array(t.position) for key, t in measurement.targets.items() if not t.known}
    exact = replace(measurement, state=replace(measurement.state, observed=readings))
    seen = exact.instrument.expected(
        exact, Registration(poses, targets=targets), model_of(name, *effects).observation(known, exact.state)
    )
    np.testing.assert_allclose(seen, readings, rtol=0, atol=1e-8)  # the beam of a range offset is 4 nm off


def test_noise_has_the_covariance_that_the_header_states(tmp_path):
    session = designs.scattered(load("gantry"), rng(), passes=1, positions=4000)
    setup = setup_of("gantry", session)
    readings = observe.observed(setup, rng(9))
    exact = observe.without_noise(setup)
    measurement = read(setup, tmp_path)
    whitened = np.linalg.solve(
        np.linalg.cholesky(replace(measurement, observed=exact).covariances), (readings - exact)[:, :, None]
    )
    products = whitened[:, :, 0].T @ whitened[:, :, 0] / len(session)
    np.testing.assert_allclose(products, np.eye(3), atol=0.08)


def test_a_cause_has_the_size_that_is_asked_for():
    session = designs.scattered(load("cframe"), rng(), passes=3)
    setup = setup_of("cframe", session)
    mine = observe.scale_to(setup, machine.Backlash("Y"), 5.0)
    moved = observe.displacement(setup, mine)
    points = observe.without_noise(setup)
    length = np.linalg.norm(points, axis=1) * 1e-3
    place = designs.PLACES["cframe"].tracker
    along, across = (
        place.u_range_um + place.u_range_um_per_m * length,
        place.u_angle_um + place.u_angle_um_per_m * length,
    )
    mean = np.sqrt(np.mean((along**2 + 2 * across**2) / 3 / 3))  # three visits, three components
    assert np.sqrt(np.mean(np.sum(moved**2, axis=1))) == pytest.approx(5.0 * mean * 1e-3, rel=1e-4)


def test_an_interferometer_sees_the_axis_and_its_abbe_arm(tmp_path):
    chain, known = load("dmu50"), machines.load("dmu50")
    session = designs.along_one(chain, rng(), "Y")
    setup = Setup(
        session, truth.smooth(chain, rng()), designs.PLACES["dmu50"].tracker, {}, (machine.Backlash("Y", 8.0),)
    )
    laser = Laser(1e-9, 0.0)
    readings = observe.along_axis(setup, "Y", laser, rng(5))
    file = tmp_path / "laser.csv"
    file.write_text(sheet.laser_sheet(session, "Y", laser, readings), encoding="utf-8")
    measurement = read_measurement(file, known)
    curves = setup.curves.errors(chain, session.positions)
    together = np.concatenate([curves, np.zeros((len(session), 1, 6))], axis=1)
    together += model_of("dmu50", Backlash("Y", 8.0)).observation(known, measurement.state).errors
    wanted = exact_deviation(known, measurement.state.positions, together, measurement.tool).position[:, 1]
    for run in np.unique(session.run):
        rows = session.run == run
        left = measurement.observed[rows, 0] - wanted[rows]
        np.testing.assert_allclose(left, left[0], rtol=0, atol=2e-7)  # 0.1 nm in the file; a zero of its own


@pytest.mark.parametrize("name", EXAMINED)
def test_designs_are_what_they_say(name):
    chain = load(name)
    retaken = designs.scattered(chain, rng(), passes=4, stations=2, with_references=True)
    assert set(retaken.visits()[retaken.on_tool]) == {4.0}
    assert set(retaken.stations) == {"s1", "s2"}
    assert np.all(np.diff(retaken.clock) >= 0)
    moving = designs.in_motion(chain, rng())
    for axis in chain.linear:
        fast = moving.velocity(axis)
        assert fast.max() > 1.0
        assert fast.min() < -1.0
    assert moving.feed is not None
    assert np.all(moving.velocity("X")[moving.feed == 0] == 0.0)
    for axis in (axis for axis in chain.axes if axis.rotary):
        assert np.all(np.diff(moving.place(axis.name))[moving.feed[1:] > 0] == 0.0)


def test_a_sweep_goes_in_equal_steps_along_one_axis_at_a_time():
    steps = np.diff(designs.swept(load("cframe"), rng(), (5, 6, 7)).positions, axis=0)
    assert np.all(np.sum(steps != 0, axis=1) == 1)
    for column in steps.T:
        assert len(np.unique(np.round(np.abs(column[column != 0]), 6))) == 1


def test_alignment_leaves_nothing_of_a_rigid_motion():
    points = rng().normal(size=(40, 3)) * 800.0
    groups = np.repeat(["a", "b"], 20)
    moved = np.cross([1e-5, 2e-5, -3e-5], points) + np.array([0.1, 0.0, 0.2])
    moved[20:] += 0.5
    assert np.abs(observe.aligned(moved, points, groups)).max() < 1e-12
    moved[3, 0] += 1.0
    assert np.abs(observe.aligned(moved, points, groups)).max() > 0.5
