"""Virtual measurements: truth within its widths, observations by the exact product, noise by the instrument specification, files."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from support.command import succeed
from support.effect_examples import BACKWARD, DMU50, EXAMPLES, full_state

import machines
from calibration.instruments import Interferometer, LaserTracker, Part
from calibration.measurement.file import read_measurement
from calibration.measurement.measurement import Target
from calibration.measurement.plan import Choices
from calibration.observation.reach import Reach, in_reach
from calibration.planning.strategies import plan
from calibration.simulation.effect_text import KINDS, read_effects
from calibration.simulation.simulate import (
    Faults,
    at_stations,
    observe,
    read_out,
    spoil,
    tracker_pose,
    with_temperatures,
)
from calibration.simulation.true_model import (
    DEFAULT,
    ROTARY,
    TABLE_1,
    checked_half_widths,
    model_of,
    random_location_errors,
    random_true_model,
    read_half_widths,
)
from kinematics.deviation import exact_deviation
from kinematics.effects import Backlash, Cyclic, ErrorMotion, GrowthWithTime, LocationError, RangeOffset, ThermalDrift
from kinematics.error_model.model import decode_model, encode_model, no_errors
from kinematics.forward import tool_point
from kinematics.state import State
from kinematics.user_error import UserError
from kinematics.version import VERSION

GANTRY = machines.load("gantry")
TRACKER = LaserTracker(u_range_um_per_m=0.25, u_angle_um=10.0, u_angle_um_per_m=2.5)
TARGETS = {"t1": Target((0.0, 0.0, -120.0)), "t2": Target((90.0, 40.0, -180.0))}
AT = (-1500.0, 1500.0, 300.0)


def rng_of(seed=0):
    return np.random.default_rng(seed)


# ---- truth


def test_table_1_is_the_printed_one():
    """Virtual calibration paper, Table 1; E_EY and E_EZ by their sums and corners."""
    assert len(TABLE_1) == 18
    assert TABLE_1["E_XX"] == (0, 70, 0.5, 20, 20, 5, 10, 10)
    assert TABLE_1["E_ZZ"] == (0, 30, 0.5, 30, 30, 1, 3, 3)
    assert TABLE_1["E_YY"] == (0, 30, 0.5, 5, 5, 2, 3, 3)
    assert {row[5] for name, row in TABLE_1.items() if name.endswith("X")} == {5}
    assert {row[5] for name, row in TABLE_1.items() if name.endswith("Y")} == {2}
    assert {row[5] for name, row in TABLE_1.items() if name.endswith("Z")} == {1}
    assert len(ROTARY) == 18
    assert ROTARY["E_BB"] != ROTARY["E_AB"] == ROTARY["E_CB"]
    assert ROTARY["E_YB"] != ROTARY["E_XB"] == ROTARY["E_ZB"]


def test_draws_fill_their_half_widths():
    rng = rng_of()
    drawn: dict[str, list] = {}
    for _ in range(400):
        for effect in random_true_model(GANTRY, rng, TABLE_1).effects:
            drawn.setdefault(effect.name, []).append(effect.parameters)
    assert drawn.keys() == TABLE_1.keys()
    for name, row in TABLE_1.items():
        widths = np.array([row[0], row[1], *row[3:5], *row[6:8]])
        values = np.array(drawn[name])
        assert np.all(np.abs(values) <= widths)
        assert np.abs(values).max(axis=0) == pytest.approx(widths, rel=0.03)
        assert values.std(axis=0) == pytest.approx(widths / 3**0.5, rel=0.12)


def test_the_printed_formula():
    model = random_true_model(GANTRY, rng_of(4))
    e_xx = next(effect for effect in model.effects if effect.name == "E_XX")
    a0, a1, b1, c1, b2, c2 = e_xx.parameters
    x = np.array([0.0, 1234.0, 5000.0])
    state = State(np.stack([x, x / 4, x / 5], axis=1))
    u = x / 5000.0
    expected = a0 + a1 * u + b1 * np.sin(0.5 * np.pi * u) + c1 * np.cos(0.5 * np.pi * u)
    expected += b2 * np.sin(5 * np.pi * u) + c2 * np.cos(5 * np.pi * u)
    assert model.errors(GANTRY, state)[:, 0, 0] * 1e3 == pytest.approx(expected)


@pytest.mark.parametrize("name", ["trunnion_ac", "head_head", "dmu50"])
def test_any_machine(name):
    machine = machines.load(name)
    model = random_true_model(machine, rng_of(1))
    assert decode_model(encode_model(model), "truth") == model
    assert model.demonstration
    linear = [e for e in model.effects if isinstance(e, ErrorMotion)]
    rotary = [e for e in model.effects if isinstance(e, Cyclic)]
    assert len(linear) == 18
    assert len(rotary) == 2 * 6 * 2
    state = full_state(machine, 20)
    turned = State(state.positions + np.where(machine.rotary, 2 * np.pi, 0.0))
    assert model.errors(machine, turned) == pytest.approx(model.errors(machine, state), abs=1e-12)


def test_axes_are_known_by_their_letters():
    model = random_true_model(BACKWARD, rng_of(1))
    names = {effect.name for effect in model.effects if isinstance(effect, ErrorMotion)}
    assert {"E_XU", "E_YU", "E_AU", "E_XX", "E_ZZ"} <= names
    own = random_true_model(BACKWARD, rng_of(1), {"E_XU": (5.0, 0.0), "E_XX": (0.0, 7.0, 1.0, 2.0, 2.0)})
    u, x = sorted(own.effects, key=lambda effect: effect.name)
    assert abs(u.parameters[0]) <= 5
    assert u.parameters[1:] == (0.0,)
    assert x.basis.harmonics == (1.0,)
    assert no_errors(GANTRY).effects == random_true_model(GANTRY, rng_of(), {}).effects


def test_location_errors():
    effects = random_location_errors(machines.load("dmu50"), rng_of(), 20.0)
    names = {effect.name for effect in effects}
    assert names == {"E_C0Y", "E_B0Z", "E_A0Z", "E_X0C", "E_Y0C", "E_A0C", "E_B0C", "E_X0B", "E_Z0B", "E_A0B", "E_C0B"}
    assert all(isinstance(e, LocationError) and abs(e.value) <= 20 for e in effects)


def test_half_widths_from_files(tmp_path):
    (tmp_path / "w.toml").write_text("E_XX = [0, 70, 0.5, 20, 20, 5, 10, 10]\nEYX = [1, 2]\n")
    assert read_half_widths(tmp_path / "w.toml") == {"E_XX": TABLE_1["E_XX"], "E_YX": (1.0, 2.0)}
    (tmp_path / "w.json").write_text('{"E_AC": [0, 0, 1, 5, 5]}')
    assert read_half_widths(tmp_path / "w.json") == {"E_AC": (0.0, 0.0, 1.0, 5.0, 5.0)}
    for rows, words in (
        ({"E_XQ": [0, 1]}, "no error motion"),
        ({"E_XX": [0, 1, 2]}, "expected a0, a1"),
        ({"E_XX": [0]}, "a0"),
    ):
        with pytest.raises(UserError, match=words):
            checked_half_widths(rows, "w")
    (tmp_path / "bad.toml").write_text("E_XX = 5\n")
    with pytest.raises(UserError, match=r"bad\.toml"):
        read_half_widths(tmp_path / "bad.toml")
    with pytest.raises(UserError, match="no slope"):
        random_true_model(DMU50, rng_of(), {"E_AC": (0.0, 3.0)})


# ---- effects by name


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_every_effect_is_switched_in_by_name(example, tmp_path):
    effect = example.effect
    fields = {k: v for k, v in msgspec.to_builtins(effect).items() if v is not None}
    kind = fields.pop("kind")
    text = f"{kind}:" + ",".join(f"{name}={json.dumps(value)}" for name, value in fields.items())
    assert read_effects([text], example.machine) == [effect]
    assert read_effects([json.dumps({"kind": kind, **fields})], example.machine) == [effect]
    (tmp_path / "effects.json").write_text(json.dumps([{"kind": kind, **fields}]))
    assert read_effects([str(tmp_path / "effects.json")], example.machine) == [effect]
    (tmp_path / "cal.json").write_bytes(encode_model(model_of(example.machine, [effect])))
    assert read_effects([str(tmp_path / "cal.json")], example.machine) == [effect]


def as_planned(state: State) -> State:
    """The state as a plan gives it: without velocities and observed points."""
    return replace(state, velocity=None, acceleration=None, observed=None)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_every_effect_is_in_the_data(example):
    machine, effect = example.machine, example.effect
    state = as_planned(full_state(machine, 40))
    poses = {name: tracker_pose((900.0, -2500.0, 100.0), rng_of(3)) for name in ("s1", "s2")}

    def seen(effects):
        return observe(
            machine, model_of(machine, effects), state, TRACKER, rng_of(1), poses, TARGETS, noise_scale=0.0
        ).observed

    touched = np.abs(seen([effect]) - seen([])).max() > 1e-9
    standing = {"following-error", "late-read-back", "servo-mismatch"}
    roll = example.touched == ""  # a tilt of a line about itself
    assert touched == (effect.kind not in standing and not roll)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("magic:axis=X", "no effect 'magic'; there are error-motion, location"),
        ("backlash:axis=Q,width=1", "has no axis Q"),
        ("backlash:axis=X", "the entry is missing: width.*backlash has axis, width, windup"),
        ("backlash:axis=X,width=wide", "width: expected a number, not a text"),
        ("backlash:axis=X,width=1,depth=2", "there is no entry depth"),
        ("backlash:axis", "'axis' is not of the form field=value"),
        ('{"kind": "backlash"', "effect"),
        ("no.json", "No such file"),
        ("cyclic:component=X,axis=X,period=1,sine=5,cosine=[0]", r"; lists are written sine=\[5\]$"),
        (
            "cyclic:component=X,axis=X,period=1,sine=1,2",
            r"'2' is not of the form field=value; lists are written sine=\[",
        ),
        ("cyclic:component=X,axis=X,period=-1,sine=[1],cosine=[0]", "period must be > 0"),
    ],
)
def test_effects_refused(text, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=words):
        read_effects([text], GANTRY)


def test_the_table_is_whole():
    assert len(KINDS) == len({example.effect.kind for example in EXAMPLES})


# ---- observations


def test_a_tracker_sees_the_matrix_product():
    """Against a product of 4 x 4 matrices written down here."""
    rng = rng_of(2)
    made = plan(DMU50, "random", 30, choices=Choices(rotary="random", targets=TARGETS))
    model = random_true_model(DMU50, rng)
    pose = tracker_pose((900.0, -2500.0, 100.0), rng)
    seen = observe(DMU50, model, made.state, TRACKER, rng, {"1": pose}, TARGETS, noise_scale=0.0)
    errors = model.errors(DMU50, made.state)
    for row in (0, 17, 59):
        place = np.eye(4)
        for i, axis in enumerate(DMU50.axes):
            place = place @ by_hand(axis, made.positions[row, i], errors[row, i])
        target = TARGETS[str(made.state.target[row])].position
        point = (place @ [*target, 1.0])[:3]
        assert seen.observed[row] == pytest.approx(pose.rotation[0] @ point + pose.translation[0], abs=1e-9)


def by_hand(axis, q, e):
    from scipy.spatial.transform import Rotation

    direction, point, frame = axis.unit_direction, np.array(axis.point), axis.error_frame
    motion, error = np.eye(4), np.eye(4)
    sign = 1.0 if axis.side == "tool" else -1.0
    if axis.rotary:
        motion[:3, :3] = Rotation.from_rotvec(q * direction).as_matrix()
        motion[:3, 3] = point - motion[:3, :3] @ point
        centre = point
    else:
        motion[:3, 3] = q * direction
        centre = point + sign * q * direction
    error[:3, :3] = Rotation.from_rotvec(frame @ e[3:]).as_matrix()
    error[:3, 3] = centre - error[:3, :3] @ centre + frame @ e[:3]
    return error @ motion if axis.side == "tool" else motion @ error


def test_the_instrument_errs_by_its_effects():
    made = plan(GANTRY, "random", 20)
    poses = {"1": tracker_pose(AT, rng_of(1))}
    plain, long = (
        observe(GANTRY, model_of(GANTRY, effects), made.state, TRACKER, rng_of(), poses, noise_scale=0.0).observed
        for effects in ([], [RangeOffset(7.0)])
    )
    ranges = [np.linalg.norm(points, axis=1) for points in (plain, long)]
    assert (ranges[1] - ranges[0]) * 1e3 == pytest.approx(7.0)
    assert ranges[0] == pytest.approx(np.linalg.norm(made.positions - AT, axis=1))


@pytest.mark.parametrize(
    "instrument",
    [TRACKER, LaserTracker(u_range_um=3.0, u_angle_um=8.0), Part(2.0, 1.0), Part(1.0, components=2)],
)
def test_noise_has_the_covariance_of_the_sheet(instrument):
    n = 20_000
    state = State(np.tile([4000.0, 2500.0, 1200.0], (n, 1)))
    poses = {"1": tracker_pose(AT, rng_of(3))} if isinstance(instrument, LaserTracker) else None
    exact, noisy = (
        observe(GANTRY, no_errors(GANTRY), state, instrument, rng_of(8), poses, noise_scale=scale).observed
        for scale in (0.0, 1.0)
    )
    noise = noisy - exact
    found = np.cov(noise.T)
    if isinstance(instrument, LaserTracker):
        expected = instrument.covariance(exact[:1])[0]
        beam = exact[0] / np.linalg.norm(exact[0])
        metres = np.linalg.norm(exact[0]) * 1e-3
        along = (instrument.u_range_um + instrument.u_range_um_per_m * metres) * 1e-3
        assert (noise @ beam).std() == pytest.approx(along, rel=0.02)
        across = (instrument.u_angle_um + instrument.u_angle_um_per_m * metres) * 1e-3
        sideways = np.cross(beam, [0, 0, 1])
        assert (noise @ sideways).std() / np.linalg.norm(sideways) == pytest.approx(across, rel=0.02)
    else:
        metres = np.linalg.norm(exact[0]) * 1e-3
        expected = np.eye(instrument.components) * ((instrument.u_um + instrument.u_um_per_m * metres) * 1e-3) ** 2
    assert np.abs(found - expected).max() < 0.04 * expected.max()
    assert np.abs(noise.mean(axis=0)).max() < 4 * np.sqrt(expected.max() / n)
    half = observe(GANTRY, no_errors(GANTRY), state, instrument, rng_of(8), poses, noise_scale=0.5).observed - exact
    assert half == pytest.approx(noise / 2, abs=1e-12)


def test_one_seed_one_measurement_whatever_is_worked_through_together(monkeypatch):
    made = plan(GANTRY, "random", 700, choices=Choices(targets=TARGETS))
    model = random_true_model(GANTRY, rng_of())

    def once():
        return observe(
            GANTRY, model, made.state, TRACKER, rng_of(5), {"1": tracker_pose(AT, rng_of())}, TARGETS
        ).observed

    first = once()
    assert np.array_equal(first, once())
    monkeypatch.setattr("calibration.simulation.simulate.ROWS_AT_A_TIME", 100)
    assert once() == pytest.approx(first, abs=1e-12)


def test_effects_with_memory_are_not_cut(monkeypatch):
    made = plan(GANTRY, "random", 300)
    state = with_temperatures(made.state, {"scale": (0.0, 6.0)})
    effects = read_effects(["thermal-scale-sensor:axis=X,sensor=scale,coefficient=11,lag_s=600"], GANTRY)

    def once():
        poses = {"1": tracker_pose(AT, rng_of())}
        return observe(GANTRY, model_of(GANTRY, effects), state, TRACKER, rng_of(5), poses).observed

    first = once()
    monkeypatch.setattr("calibration.simulation.simulate.ROWS_AT_A_TIME", 32)
    assert once() == pytest.approx(first, abs=1e-12)


def test_an_interferometer_reads_the_error_along_its_axis():
    made = plan(DMU50, "axes", choices=Choices(rotary="swept", runs=2))
    model = random_true_model(DMU50, rng_of(1))
    model = msgspec.structs.replace(model, effects=(*model.effects, Backlash("X", 12.0)))
    seen = observe(
        DMU50, model, made.state, Interferometer(0.2), rng_of(), axis=made.axis, run=made.run, noise_scale=0.0
    )
    rows = made.axis == "X"
    deviation = exact_deviation(DMU50, made.positions, model.errors(DMU50, made.state)).position[rows, 0]
    first = np.where(made.run[rows] == "1", deviation[0], deviation[made.run[rows] == "2"][0])
    assert seen.observed[rows, 0] == pytest.approx(deviation - first, abs=1e-12)
    there, back = seen.observed[rows, 0][:11], seen.observed[rows, 0][11:22][::-1]
    assert (there - back) * 1e3 == pytest.approx(-12.0, abs=0.01)
    with pytest.raises(UserError, match="one axis at a time"):
        observe(DMU50, model, made.state, Interferometer(0.2), rng_of())


def test_interferometer_noise_grows_from_the_start_of_the_run():
    made = plan(GANTRY, "axes", choices=Choices(runs=400))
    seen = observe(
        GANTRY, no_errors(GANTRY), made.state, Interferometer(0.5, 2.0), rng_of(), axis=made.axis, run=made.run
    ).observed[:, 0]
    rows = (made.axis == "X") & (made.names == "X.11")
    assert seen[rows].std() * 1e3 == pytest.approx(0.5 + 2.0 * 4.998, rel=0.06)


def test_a_part_lies_a_little_off():
    made = plan(GANTRY, "grid", 60, choices=Choices(ranges={"Z": (100.0, 100.0)}))
    for components in (2, 3):
        seen = observe(
            GANTRY, no_errors(GANTRY), made.state, Part(1.0, components=components), rng_of(), noise_scale=0.0
        )
        assert seen.observed.shape == (len(made), components)
        off = seen.observed - tool_point(GANTRY, made.positions)[:, :components]
        assert 1e-3 < np.abs(off).max() < 5.0
        distances = [np.linalg.norm(p[1:] - p[0], axis=1) for p in (seen.observed, made.positions)]
        assert distances[0] == pytest.approx(distances[1], abs=1e-9)


def test_stations():
    made = plan(GANTRY, "random", 30)
    state = at_stations(made.state, ["a", "b"], 600.0)
    poses = {"a": tracker_pose(AT, rng_of(1)), "b": tracker_pose((6000.0, 0.0, 500.0), rng_of(2))}
    seen = observe(GANTRY, no_errors(GANTRY), state, TRACKER, rng_of(), poses, noise_scale=0.0)
    assert seen.groups.tolist() == ["a"] * 30 + ["b"] * 30
    assert state.time[30] - state.time[29] == pytest.approx(600.0)
    assert np.linalg.norm(seen.observed[30:], axis=1) == pytest.approx(
        np.linalg.norm(made.positions - [6000.0, 0.0, 500.0], axis=1)
    )
    assert np.array_equal(state.approach[30:], made.state.approach)
    with pytest.raises(UserError, match="no pose of the instrument for b"):
        observe(GANTRY, no_errors(GANTRY), state, TRACKER, rng_of(), {"a": poses["a"]})


def test_drift_goes_with_time():
    made = plan(GANTRY, "random", 50, choices=Choices(order="retraced"))
    poses = {"1": tracker_pose(AT, rng_of())}
    effects = [ThermalDrift(component="Z", rate=-60.0), GrowthWithTime(axis="X", rate=30.0)]
    seen, still = (
        observe(GANTRY, model_of(GANTRY, e), made.state, TRACKER, rng_of(), poses, noise_scale=0.0).observed
        for e in (effects, [])
    )
    hours = made.state.time / 3600
    assert (seen - still)[:, 2] * 1e3 == pytest.approx(-60.0 * hours, abs=1e-6)


# ---- what is out of reach, and what goes wrong


def test_out_of_reach():
    made = plan(GANTRY, "grid", 400)
    measured = observe(
        GANTRY, no_errors(GANTRY), made.state, TRACKER, rng_of(), {"1": tracker_pose((2500.0, 1500.0, 0.0), rng_of())}
    )
    poses = {"1": tracker_pose((2500.0, 1500.0, 0.0), rng_of())}
    all_of_it = in_reach(measured, poses, Reach())
    assert all_of_it.rows.all()
    assert all_of_it.notes == ()
    seen = in_reach(measured, poses, Reach(elevation=(-59.0, 30.0), range_mm=2500.0))
    beam = made.positions - [2500.0, 1500.0, 0.0]
    elevation = np.degrees(np.arctan2(beam[:, 2], np.hypot(beam[:, 0], beam[:, 1])))
    expected = (elevation <= 30) & (np.linalg.norm(beam, axis=1) <= 2500)
    assert np.array_equal(seen.rows, expected)
    assert re.fullmatch(r"\d+ observations left out: elevation not within -59..30 deg", seen.notes[0])
    far = {"1": tracker_pose((-1e6, 1500.0, 750.0), rng_of())}
    assert in_reach(measured, far, Reach(incidence=1.0)).rows.all()
    assert not in_reach(measured, poses, Reach(incidence=60.0)).rows.all()


def test_faults():
    made = plan(GANTRY, "random", 1000)
    measured = observe(
        GANTRY, no_errors(GANTRY), made.state, TRACKER, rng_of(), {"1": tracker_pose(AT, rng_of())}, run=made.run
    )
    assert spoil(measured, Faults(), rng_of())[1] == ()
    spoiled, notes = spoil(measured, Faults(0.05, (0.05, 0.5), 0.02, 0.03), rng_of(1))
    assert notes == ("50 outliers", "20 doubled rows", "30 missing rows")
    assert 985 <= len(spoiled) <= 990
    with_outliers = spoil(measured, Faults(0.05), rng_of(1))[0]
    off = np.linalg.norm(with_outliers.observed - measured.observed, axis=1)
    assert np.count_nonzero(off) == 50
    assert off[off > 0].min() >= 0.05
    assert off.max() <= 0.5
    assert np.all(np.diff(spoiled.state.time) >= 0)


def test_digits_are_far_below_the_noise():
    made = plan(GANTRY, "random", 100)
    measured = observe(GANTRY, no_errors(GANTRY), made.state, TRACKER, rng_of(), {"1": tracker_pose(AT, rng_of())})
    assert np.abs(read_out(measured).observed - measured.observed).max() <= 5.1e-6


# ---- command line

CASES = {
    "tracker": ["--strategy", "hexahedron", "--points", "60", "--target", "t1=0,0,-100", "--target", "bed.r1=0,0,0"],
    "two stations": ["--strategy", "random", "--points", "20", "--tracker", "-1500,0,0", "--tracker", "0,-1500,0"],
    "interferometer": ["--strategy", "axes", "--instrument", "interferometer", "--runs", "2"],
    "part": ["--strategy", "grid", "--points", "30", "--range", "Z=100", "--instrument", "part", "--planar"],
    "spoilt": ["--strategy", "random", "--points", "99", "--outliers", "0.05", "--missing", "0.1", "--order", "shuffled"],
    "warm": ["--strategy", "random", "--points", "20", "--temperature", "scale=20:24.5",
             "--effect", "thermal-scale-sensor:axis=X,sensor=scale,coefficient=11"],
    "on the bed": ["--strategy", "random", "--points", "20", "--stands-on", "bed", "--elevation", "-59:79"],
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("machine", ["gantry", "cframe"])
def test_simulated_files_are_read(ncomp, name, machine):
    options = ["simulate", "--machine", machine, *CASES[name]]
    result = ncomp(*options, "-o", "data.csv", "--truth", "truth.json", "--seed", "3")
    assert (result.status, result.out) == (0, b""), result.err
    again = ncomp(*options, "-o", "-", "--seed", "3")
    assert again.out == Path("data.csv").read_bytes()
    assert ncomp(*options, "-o", "-", "--seed", "4").out != again.out
    measured = read_measurement(Path("data.csv"), machines.load(machine))
    assert f"{len(measured)} observations" in result.err
    truth = decode_model(Path("truth.json").read_bytes(), "truth")
    assert truth.demonstration
    same_machine = ncomp(
        "simulate", "--machine", machine, "--strategy", "grid", "-o", "o.csv", "--truth", "t.json", "--seed", "3"
    )
    assert same_machine.status == 0
    drawn = decode_model(Path("t.json").read_bytes(), "t").effects
    assert truth.effects[: len(drawn)] == drawn


def test_a_plan_of_all_options_is_simulated(ncomp):
    assert ncomp("plan", "--machine", "dmu50", "--strategy", "hexahedron", "--points", "40", "--rotary", "random",
                 "--approach", "positive", "--target", "t1=0,0,-120", "--target", "t2=90,40,-180", "-o", "plan.csv").status == 0  # fmt: skip
    result = ncomp("simulate", "--machine", "dmu50", "--strategy", "plan.csv", "--effect", "backlash:axis=X,width=12",
                   "--errors", "none", "--noise-scale", "0", "-o", "data.csv")  # fmt: skip
    assert result.status == 0, result.err
    measured = read_measurement(Path("data.csv"), DMU50)
    assert np.all(measured.state.approach == 1)
    assert len(measured) == 80
    assert "the tracker is 1.5 m in front of the middle of the volume" in result.err


def test_the_truth_predicts_what_is_observed(ncomp):
    """Plan, simulate without noise and predict: distances between points agree whatever the tracker's pose."""
    assert (
        ncomp("plan", "--machine", "gantry", "--strategy", "diagonals", "--points", "30", "-o", "plan.csv").status == 0
    )
    simulated = ncomp(
        "simulate",
        "--machine",
        "gantry",
        "--strategy",
        "plan.csv",
        "--noise-scale",
        "0",
        "-o",
        "d.csv",
        "--truth",
        "t.json",
    )
    predicted = ncomp("predict", "plan.csv", "--machine", "gantry", "-c", "t.json", "-o", "p.csv")
    assert (simulated.status, predicted.status) == (0, 0), predicted.err
    lines = [line for line in Path("p.csv").read_text().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    points = np.array([[float(row[k]) + float(row[f"d{k.lower()}_um"]) * 1e-3 for k in "XYZ"] for row in rows])
    observed = read_measurement(Path("d.csv"), GANTRY).observed
    for k in (0, 7):
        seen, told = (np.linalg.norm(each - each[k], axis=1) for each in (observed, points))
        assert seen == pytest.approx(told, abs=3e-5)


def test_calibrations_and_tables_as_truth(ncomp):
    Path("w.toml").write_text("E_XX = [0, 70]\n")
    result = ncomp("simulate", "--machine", "gantry", "--strategy", "grid", "-c", "cal.json", "--errors", "w.toml",
                   "--location", "10", "--effect", "backlash:axis=Y,width=5", "-o", "d.csv", "--truth", "t.json")  # fmt: skip
    assert result.status == 0, result.err
    names = [effect.name for effect in decode_model(Path("t.json").read_bytes(), "t").effects]
    assert names == ["E_X0X", "E_XX", "E_C0Y", "E_B0Z", "E_A0Z", "backlash Y"]


GRID = ["--strategy", "grid", "--points", "20"]
BAD = {
    "unknown strategy": (["--strategy", "spiral"], "strategy 'spiral' is none of planes"),
    "missing plan": (["--strategy", "no.csv"], "--strategy no.csv: there is no such file"),
    "unknown effect": ([*GRID, "--effect", "magic:x=1"], "no effect 'magic'; there are error-motion, location"),
    "unknown instrument": ([*GRID, "--instrument", "ruler"], "--instrument 'ruler' is none of laser-tracker"),
    "uncertainty": ([*GRID, "-u", "u_um=1"], "--uncertainty u_um=1: laser-tracker has u_range_um, u_range_um_per_m, u_angle_um, u_angle_um_per_m"),
    "uncertainty that is no number": ([*GRID, "-u", "u_angle_um=big"], "'big' is not a number"),
    "interferometer on a grid": ([*GRID, "--instrument", "interferometer"], "one axis at a time"),
    "tracker of a part": ([*GRID, "--instrument", "part", "--tracker", "1,2,3"], "--tracker is no option of"),
    "tracker": ([*GRID, "--tracker", "1,2"], "'1,2' is not 3 numbers"),
    "temperature": ([*GRID, "--temperature", "spindle"], "--temperature spindle: expected NAME=start:end"),
    "too cold": ([*GRID, "--temperature", "spindle=20:-300"], "below absolute zero"),
    "no range uncertainty": ([*GRID, "-u", "u_angle_um=5"], r"uncertainty \(k=1\) of the laser-tracker is missing: state u_range_um or"),
    "no angle uncertainty": ([*GRID, "-u", "u_range_um=5", "-u", "u_angle_um=0"], "missing: state u_angle_um or u_angle_um_per_m above zero"),
    "certain part": ([*GRID, "--instrument", "part", "-u", "u_um_per_m=1"], "of the part is missing: state u_um above zero"),
    "uncertainty twice": ([*GRID, "-u", "u_angle_um=5", "-u", "u_angle_um=6"], "--uncertainty u_angle_um is given twice"),
    "missing plan and points": (["--strategy", "no.csv", "--points", "9"], "there is no such file"),
    "inside the tracker": ([*GRID, "--range", "X=0:10", "--range", "Y=0:10", "--range", "Z=0:10", "--tracker", "0,0,0"],
                           "closer than 1 mm to the tracker at s1"),
    "no such target": ([*GRID, "--target", "t1=0,0,0", "--effect", "target-offset:target=no,offset_um=[1,2,3]"], "no target 'no'; known are t1"),
    "no such station": ([*GRID, "--effect", "station-shift:station=no"], "no station 'no'; known are s1"),
    "station of a part": ([*GRID, "--instrument", "part", "--effect", "station-shift:station=s1"], "no station 's1'; there is none"),
    "no temperature": ([*GRID, "--effect", "thermal-drift-sensor:component=Z,sensor=spindle,coefficient=2"], "needs the temperature"),
    "stands on": ([*GRID, "--stands-on", "moon"], "--stands-on moon"),
    "widths": ([*GRID, "--errors", "no.toml"], "no.toml: No such file"),
    "out of reach": ([*GRID, "--elevation", "80:81"], "observes none of the points"),
    "truth and data": ([*GRID, "--truth", "data.csv"], "both name data.csv"),
    "no size": ([*GRID, "--location", "inf"], "--location inf: expected a finite number"),
    "negative uncertainty": ([*GRID, "-u", "u_angle_um=-1"], "u_angle_um=-1: expected a number of zero or above"),
    "too many": ([*GRID, "--runs", "100000000"], "observations with all targets and runs are more than"),
    "backward range": ([*GRID, "--range", "X=5:1"], "axis X: nothing is left between 5 and 1"),
    "nothing left": ([*GRID, "--missing", "1"], "leaves no observation"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_options(ncomp, name):
    options, words = BAD[name]
    before = sorted(Path().iterdir())
    result = ncomp("simulate", "--machine", "gantry", *options, "-o", "data.csv")
    assert result.status == 2
    errors = [line for line in result.err.splitlines() if not line.startswith("note")]
    assert len(errors) == 1
    assert re.search(words, errors[0]), errors[0]
    assert sorted(Path().iterdir()) == before


def test_help(ncomp):
    for command in ("plan", "simulate"):
        shown = ncomp(command, "--help")
        assert shown.status == 0
        assert f"ncomp {command}" in shown.out.decode()
    assert len(DEFAULT) == 36


def test_simulated_data_are_marked_and_read_without_a_note(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plan = ("--machine", "cframe", "--strategy", "grid", "--points", 12, "-o")
    succeed("plan", *plan, "plan.csv")
    assert f"# made_by: ncomp {VERSION}\n" in Path("plan.csv").read_text()
    succeed("simulate", "--machine", "cframe", "--strategy", "plan.csv", "-o", "data.csv")
    assert Path("data.csv").read_text().count(f"# made_by: ncomp {VERSION}, simulated\n") == 1
    assert not [note for note in read_measurement(Path("data.csv"), machines.load("cframe")).notes if "made_by" in note]
