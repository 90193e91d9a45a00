"""ErrorModel: first order against exact, calibration files and their refusals, uncertainty, the shipped calibration."""

import json
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.linalg import block_diag
from support.tiers import EXAM, STATISTICAL, quick

import machines
from kinematics.basis import BSpline, Fourier, Legendre, Polynomial
from kinematics.deviation import exact_deviation
from kinematics.effects import (
    Backlash,
    CrossAxis,
    Cyclic,
    ErrorMotion,
    GrowthWithSensor,
    LateReadBack,
    LocationError,
    Outliers,
    RangeOffset,
    TargetOffset,
    ThermalDrift,
    Wobble,
)
from kinematics.error_model.decoding_faults import CURE
from kinematics.error_model.model import ErrorModel, decode_model, encode_model, no_errors, read_model, write_model
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.state import State
from kinematics.transforms import ROWS_OF_BLOCK, Array
from kinematics.user_error import UserError
from machines.calibrations.dmu50_demonstration import demonstration
from tests.support.first_order import first_order_deviation

DMU50 = machines.load("dmu50")
SHIPPED = Path(machines.__file__).parent / "calibrations" / "dmu50.json"
TOOL = np.array([5.0, -10.0, -120.0])

SMALL = msgspec.structs.replace(
    no_errors(DMU50),
    provenance=msgspec.structs.replace(no_errors(DMU50).provenance, made_by="ncomp 1.0"),
    effects=(
        ErrorMotion("X", "X", BSpline((-250.0, 0.0, 250.0), 1), (1.0, -2.0, 3.0), u=(1.0, 0.5, 2.0)),
        ErrorMotion("C", "Y", Legendre((-225.0, 225.0), 2), (4.0, 0.5, -1.0), u=(3.0, 2.0, 1.0)),
        ErrorMotion("A", "C", Fourier((0.0, 360.0), (2.0,)), (1.0, 0.0, 3.0, 4.0), u=(1.0, 2.0, 3.0, 4.0)),
        LocationError("C", "Y", 12.0, u=(2.0,)),
        LocationError("X", "B", -6.0, u=(1.5,)),
    ),
)


def positions(n: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(*DMU50.travel, (n, 5))


def correlated(n: int, seed: int) -> Array:
    """A covariance (n, n) with the variances of SMALL and strong correlations."""
    root = np.random.default_rng(seed).normal(size=(n, n + 1))
    u = np.array([u for effect in SMALL.effects for u in effect.uncertainties])
    covariance = root @ root.T
    size = np.sqrt(np.diag(covariance))
    return covariance / np.outer(size, size) * np.outer(u, u)


# --- what the errors do


def test_first_order_agrees_with_exact_to_second_order():
    q = positions(400, seed=1)
    errors = demonstration().errors(DMU50, State(q))
    gaps = []
    for size in (1.0, 0.5):
        first = first_order_deviation(DMU50, q, size * errors, TOOL)
        exact = exact_deviation(DMU50, q, size * errors, TOOL)
        assert np.linalg.norm(exact.position, axis=1).mean() > 0.02 * size
        gaps.append(np.linalg.norm(first.position - exact.position, axis=1).max())
    assert gaps[0] < 2e-5  # 20 nm of about 40 um
    assert gaps[0] / gaps[1] == pytest.approx(4.0, rel=0.01)


def test_design_times_parameters_is_the_transform_of_the_errors():
    q, model = positions(50, seed=2), demonstration()
    transform = error_transform_with_tool(DMU50, q, TOOL)
    errors = model.errors(DMU50, State(q))
    expected = np.einsum("nij,nj->ni", transform, errors.reshape(50, -1))
    assert model.design(DMU50, State(q), transform) @ model.parameters == pytest.approx(expected, abs=1e-13)


def test_the_machine_without_errors():
    model, q = no_errors(DMU50), positions(3, seed=3)
    transform = error_transform_with_tool(DMU50, q)
    assert not model.errors(DMU50, State(q)).any()
    assert model.design(DMU50, State(q), transform).shape == (3, 6, 0)
    assert not model.standard_uncertainty(DMU50, State(q), transform).any()
    assert model.outside(DMU50, State(q)) == {}
    assert decode_model(encode_model(model), "none") == model


@pytest.mark.parametrize(
    "covariance",
    [
        pytest.param(None, id="independent", marks=EXAM),
        pytest.param(correlated(12, seed=7), id="correlated", marks=STATISTICAL),
    ],
)
def test_standard_uncertainty_equals_monte_carlo_through_the_exact_kinematics(covariance):
    model = msgspec.structs.replace(SMALL, covariance=None if covariance is None else as_rows(covariance))
    u = np.array([u for effect in model.effects for u in effect.uncertainties])
    rng, q = np.random.default_rng(11), positions(4, seed=4)
    draws = rng.multivariate_normal(model.parameters, np.diag(u**2) if covariance is None else covariance, 4000)
    points = [tool_point(DMU50, q, TOOL, with_parameters(model, draw).errors(DMU50, State(q))) for draw in draws]
    expected = np.std(points, axis=0)
    found = model.standard_uncertainty(DMU50, State(q), error_transform_with_tool(DMU50, q, TOOL)[:, :3])
    assert found.shape == (4, 3)
    assert found == pytest.approx(expected, rel=0.05)  # 4000 draws: 1.1 %, k = 1


MANY = (
    Backlash("X", 18.0, 25.0, u=(3.0, 6.0)),
    Cyclic("Y", "X", 10.0, (4.0, 1.0), (-2.0, 0.5), u=(0.01, 0.4, 0.3, 0.5, 0.3)),
    ThermalDrift(component="Z", rate=-3.0, amplitudes=(-20.0,), time_constants_s=(1800.0,), u=(1.0, 2.0, 120.0)),
    ThermalDrift(component="A", amplitudes=(15.0,), time_constants_s=(3000.0,), u=(2.0, 200.0)),
    GrowthWithSensor(axis="Y", sensor="column", coefficient=11.0, lag_s=900.0, u=(1.0, 60.0)),
    Wobble("B", "tilt", 1, 1, 6.0, -3.0, u=(1.0, 1.5)),
    RangeOffset(8.0, u=(400.0,)),
    LateReadBack(1.0, u=(90.0,)),
    TargetOffset("t1", (1.0, 2.0, 3.0), u=(300.0, 300.0, 300.0)),
)
"""Effects of all places; of the instrument with uncertainties that would not go unseen."""


def many_states(n: int, seed: int) -> State:
    rng = np.random.default_rng(seed)
    return State(
        positions(n, seed),
        approach=rng.choice([-1.0, 1.0], (n, 5)),
        velocity=rng.normal(0.0, 30.0, (n, 5)),
        time=np.sort(rng.uniform(0.0, 9000.0, n)),
        temperatures={"column": rng.normal(4.0, 1.0, n)},
        target=rng.choice(["t1", "t2"], n),
        observed=rng.uniform(500.0, 3000.0, (n, 3)),
    )


@pytest.mark.parametrize("correlation", quick([0.0, 0.6], [], [0.6]), ids=["independent", "correlated"])
def test_standard_uncertainty_of_effects_of_all_places_equals_monte_carlo(correlation):
    """Shapes (period, time constant, lag) are linearised; the instrument's uncertainty is none of the prediction's."""
    u = np.array([u for effect in MANY for u in effect.uncertainties])
    covariance = np.outer(u, u) * (correlation + (1 - correlation) * np.eye(len(u)))
    model = msgspec.structs.replace(
        no_errors(DMU50), effects=MANY, covariance=as_rows(covariance) if correlation else None
    )
    rng, state = np.random.default_rng(12), many_states(6, seed=13)
    draws = rng.multivariate_normal(model.parameters, covariance, 4000)
    drawn = [
        exact_deviation(DMU50, state.positions, with_parameters(model, draw).errors(DMU50, state), TOOL)
        for draw in draws
    ]
    expected = np.std([np.concatenate(deviation, axis=1) for deviation in drawn], axis=0)
    found = model.standard_uncertainty(DMU50, state, error_transform_with_tool(DMU50, state.positions, TOOL))
    assert found == pytest.approx(expected, rel=0.06, abs=1e-9)  # 4000 draws: 1.1 %, k = 1
    assert found[:, :3].min() > 5e-4


def test_observation_design_is_the_derivative_of_the_observation():
    """Rows that mix everything: 0.3 of an observation's shift, and any combination of the error motions."""
    model, state = msgspec.structs.replace(no_errors(DMU50), effects=MANY), many_states(7, seed=14)
    transform = np.random.default_rng(15).normal(size=(7, 4, 39))

    def observed(parameters: Array) -> Array:
        errors, shift = with_parameters(model, parameters).observation(DMU50, state)
        return np.einsum("nrc,nc->nr", transform, np.concatenate([errors.reshape(7, -1), shift], axis=1))

    design, start = model.observation_design(DMU50, state, transform), model.parameters
    for k, step in enumerate(1e-4 * np.eye(len(start))):
        slope = (observed(start + step) - observed(start - step)) / 2e-4
        assert design[:, :, k] == pytest.approx(slope, rel=1e-5, abs=1e-9)
    of_machine = model.design(DMU50, state, transform[:, :, :36])
    own = np.repeat([effect.ACTS_ON != "instrument" for effect in MANY], [len(effect.parameters) for effect in MANY])
    assert (of_machine[:, :, own] == design[:, :, own]).all()
    assert not of_machine[:, :, ~own].any()


def test_a_transform_of_other_places_is_refused():
    q = positions(2, seed=1)
    for width in (30, 39):
        with pytest.raises(ValueError, match=f"^transform has {width} columns, dmu50 takes 36$"):
            SMALL.design(DMU50, State(q), np.zeros((2, 3, width)))
    with pytest.raises(ValueError, match="dmu50 takes 39"):
        SMALL.observation_design(DMU50, State(q), np.zeros((2, 3, 36)))


def test_long_tables_are_worked_through_in_blocks_but_memory_is_kept():
    state = many_states(ROWS_OF_BLOCK + 100, seed=16)
    outlier = Outliers((ROWS_OF_BLOCK + 50,), (1e3, 0.0, 0.0))
    model = msgspec.structs.replace(no_errors(DMU50), effects=(*MANY, outlier))
    errors, shift = model.observation(DMU50, state)
    assert shift[ROWS_OF_BLOCK + 50, 0] - shift[ROWS_OF_BLOCK + 49, 0] > 0.9
    rows = slice(ROWS_OF_BLOCK - 3, ROWS_OF_BLOCK + 3)
    memoryless = msgspec.structs.replace(model, effects=tuple(e for e in MANY if not e.HAS_MEMORY))
    some, whole = (memoryless.errors(DMU50, part) for part in (state.rows(rows), state))
    assert whole[rows] == pytest.approx(some, rel=1e-14)
    growth = model.effects[4]
    ((_, _, expected),) = growth.contributions(DMU50, state)
    assert (errors - memoryless.observation(DMU50, state).errors)[:, 3, 1] == pytest.approx(expected, abs=1e-15)


def test_a_singular_covariance_gives_no_uncertainty_where_there_is_none():
    """Three errors known to cancel: u is zero, not the root of a rounding error below zero."""
    q = positions(20, seed=5)
    errors = (ErrorMotion("X", "X", Polynomial((-250.0, 250.0), 0), (0.0,), u=(1.0,)),) * 3
    for a in range(1, 10):
        spread = np.array([a, 1.0, -a - 1.0]) / 7
        model = msgspec.structs.replace(SMALL, effects=errors, covariance=as_rows(np.outer(spread, spread)))
        u = model.standard_uncertainty(DMU50, State(q), error_transform_with_tool(DMU50, q, TOOL))
        assert np.abs(u).max() < 1e-9


def with_parameters(model: ErrorModel, parameters: Array) -> ErrorModel:
    effects, rest = [], parameters.tolist()
    for effect in model.effects:
        values, rest = rest[: len(effect.parameters)], rest[len(effect.parameters) :]
        effects.append(effect.with_parameters(values))
    return msgspec.structs.replace(model, effects=tuple(effects))


def as_rows(matrix: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, matrix.tolist()))


def test_outside_names_what_is_used_beyond_its_interval_and_by_how_much():
    x, y, c = np.array([-250.0, 260.0, -253.0]), np.array([0.0, 225.0, -225.0]), np.radians([0.0, 360.0, 365.0])
    q = np.column_stack([c, 0 * x, x, y, 0 * x])
    beyond = SMALL.outside(DMU50, State(q))
    assert beyond == {("E_XX", "mm"): 10.0}  # C turns fully: 365 degrees are 5
    assert SMALL.outside(DMU50, State(q[:1])) == {}
    assert SMALL.outside(DMU50, State(q[:0])) == {}


def test_outside_is_no_matter_of_rounding_to_rad_and_back():
    ends = np.arange(-360.0, 361.0)
    q = np.zeros((len(ends), 5))
    q[:, 0] = np.radians(ends)
    motions = [ErrorMotion("X", "C", Polynomial((e, e + 0.5), 0), (1.0,), u=(1.0,)) for e in ends]
    for motion, row in zip(motions, q, strict=True):
        model = msgspec.structs.replace(SMALL, effects=(motion,))
        assert model.outside(DMU50, State(row[None])) == {}


def test_outside_of_two_parts_of_one_error_motion_is_the_larger():
    parts = tuple(ErrorMotion("X", "X", Polynomial((0.0, high), 0), (1.0,), u=(1.0,)) for high in (10.0, 50.0))
    model = msgspec.structs.replace(SMALL, effects=parts)
    assert model.outside(DMU50, State(np.array([[0.0, 0, 60, 0, 0]]))) == {("E_XX", "mm"): 50.0}


def test_outside_speaks_of_both_axes_of_a_cross_term():
    sag = CrossAxis("Z", "X", "Y", (-250.0, 250.0), (-100.0, 100.0), 0, 1, (1.0,))
    model = msgspec.structs.replace(SMALL, effects=(sag,))
    assert model.outside(DMU50, State(np.array([[0.0, 0, 0, 130, 0]]))) == {("E_ZX(Y)", "mm"): 30.0}
    assert model.outside(DMU50, State(np.array([[0.0, 0, 251, 130, 0], [0.0, 0, 290, 0, 0]]))) == {
        ("E_ZX(Y)", "mm"): 40.0
    }


# --- files


@pytest.mark.parametrize("model", [SMALL, demonstration()], ids=["small", "demonstration"])
def test_round_trip_through_a_file(model, tmp_path):
    for covariance in (None, as_rows(np.eye(len(model.parameters)))):
        written = msgspec.structs.replace(model, covariance=covariance)
        write_model(written, tmp_path / "cal.json")
        read = read_model(tmp_path / "cal.json", DMU50)
        assert read == written
        assert read.id == written.id
        assert encode_model(read) == (tmp_path / "cal.json").read_bytes()


CHANGES: dict[str, Callable[[dict[str, Any]], object]] = {
    "parameter": lambda data: data["effects"][0]["parameters"].__setitem__(1, -2.000001),
    "uncertainty": lambda data: data["effects"][3].__setitem__("u", [2.1]),
    "order": lambda data: data["effects"].reverse(),
    "note": lambda data: data["effects"][3].__setitem__("note", "measured again"),
    "source": lambda data: data["provenance"].__setitem__("source", "elsewhere"),
    "time": lambda data: data["provenance"].__setitem__("made_at", "1970-01-01T00:00:01Z"),
    "demonstration": lambda data: data.__setitem__("demonstration", True),
    "covariance": lambda data: data.__setitem__("covariance", np.eye(12).tolist()),
}


def changed(change: Callable[[dict[str, Any]], object]) -> bytes:
    data = json.loads(encode_model(SMALL))
    change(data)
    return json.dumps(data).encode()


def test_a_file_says_first_what_it_is_and_each_effect_what_and_where():
    data = json.loads(encode_model(msgspec.structs.replace(no_errors(DMU50), effects=MANY)))
    order = ["ncomp_calibration", "machine", "provenance", "demonstration", "effects", "covariance"]
    assert list(data) == order
    assert data["effects"][0] == {
        "kind": "backlash", "axis": "X", "width": 18.0, "windup": 25.0, "units": {"width": "um", "windup": "um/m"},
        "u": [3.0, 6.0], "note": "",
    }  # fmt: skip
    assert [list(effect) for effect in data["effects"][:3]] == [
        ["kind", "axis", "width", "windup", "units", "u", "note"],
        ["kind", "component", "axis", "period", "sine", "cosine", "units", "u", "note"],
        ["kind", "component", "rate", "amplitudes", "time_constants_s", "units", "u", "note"],
    ]
    assert "rate" not in data["effects"][3]


def test_a_file_without_units_is_read():
    data = json.loads(encode_model(SMALL))
    for effect in data["effects"]:
        del effect["units"]
    assert decode_model(json.dumps(data).encode(), "") == SMALL


def test_the_id_is_that_of_the_content():
    ids = [decode_model(changed(change), "").id for change in CHANGES.values()]
    assert len({SMALL.id, *ids}) == len(ids) + 1
    compact = json.dumps(json.loads(encode_model(SMALL)), separators=(",", ":")).encode()
    assert decode_model(compact, "").id == SMALL.id


def test_age():
    made = SMALL.provenance.made_at
    assert SMALL.age_days(made + timedelta(hours=36)) == 1.5
    assert decode_model(changed(lambda data: data), "").provenance.made_at == made


REFUSED: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "not ncomp's": (
        lambda data: data.pop("ncomp_calibration"),
        "no ncomp calibration (it has no 'ncomp_calibration'): give a file of ncomp fit",
    ),
    "newer version": (
        lambda data: data.update(ncomp_calibration=2),
        "version 2 is not one this ncomp reads (1): use a newer ncomp",
    ),
    "version in words": (
        lambda data: data.update(ncomp_calibration="one"),
        "version one is not one this ncomp reads (1): use a newer ncomp",
    ),
    "no version": (
        lambda data: data.update(ncomp_calibration=0),
        "version 0 is not one this ncomp reads (1): use a newer ncomp",
    ),
    "time without zone": (
        lambda data: data["provenance"].update(made_at="2026-01-01T00:00:00"),
        "provenance.made_at: Expected datetime with a timezone component; expected e.g. 2026-01-31T12:00:00Z; " + CURE,
    ),
    "member missing": (lambda data: data.pop("effects"), "the entry is missing: effects; " + CURE),
    "unknown member": (lambda data: data.update(comment="x"), "there is no entry comment; " + CURE),
    "unknown kind": (
        lambda data: data["effects"][1].update(kind="gremlins"),
        "effects[1].kind: Invalid value 'gremlins'; if it is an effect of your own, name its file with --plugin FILE.py; "
        "otherwise " + CURE,
    ),
    "unknown direction": (
        lambda data: data["effects"][3].update(component="D"),
        "effects[3].component: Invalid enum value 'D'; " + CURE,
    ),
    "number of parameters": (
        lambda data: data["effects"][0]["parameters"].append(1.0),
        "effects[0]: E_XX: its basis takes 3 parameters with as many u, got 4 and 3; " + CURE,
    ),
    "number of u": (
        lambda data: data["effects"][1]["u"].pop(),
        "effects[1]: E_CY: its basis takes 3 parameters with as many u, got 3 and 2; " + CURE,
    ),
    "parameter no number": (
        lambda data: data["effects"][0]["parameters"].__setitem__(2, "3 um"),
        "effects[0].parameters[2]: expected a number, not a text in quotes; " + CURE,
    ),
    "bad basis": (
        lambda data: data["effects"][1]["basis"].update(interval=[1, -1]),
        "effects[1].basis: interval [1.0, -1.0] must go from a lower to a higher position; " + CURE,
    ),
    "another unit": (
        lambda data: data["effects"][3].update(units={"value": "arcsec"}),
        "E_C0Y has units {'value': 'arcsec'}, expected {'value': 'urad'}",
    ),
    "effects no list": (
        lambda data: data.update(effects={"kind": "location"}),
        "effects: expected a list in [ ], not a table; " + CURE,
    ),
    "effect no object": (
        lambda data: data["effects"].__setitem__(2, "backlash"),
        "effects[2]: expected a table, not a text in quotes; " + CURE,
    ),
    "no such axis": (
        lambda data: data["effects"][3].update(axis="A"),
        "E_C0A is of an axis that w C B b X Y Z t lacks: " + CURE,
    ),
    "bed as an axis": (
        lambda data: data["effects"][3].update(axis="b"),
        "E_C0b is of an axis that w C B b X Y Z t lacks: " + CURE,
    ),
    "negative u": (
        lambda data: data["effects"][0]["u"].__setitem__(2, -0.1),
        "E_XX has a negative standard uncertainty u: " + CURE,
    ),
    "negative u of a location": (
        lambda data: data["effects"][4].update(u=[-1]),
        "E_X0B has a negative standard uncertainty u: " + CURE,
    ),
    "covariance too small": (
        lambda data: data.update(covariance=np.eye(11).tolist()),
        "covariance is not 12 x 12, one row per parameter",
    ),
    "covariance ragged": (
        lambda data: data.update(covariance=[[1.0] * n for n in range(1, 13)]),
        "covariance is not 12 x 12, one row per parameter",
    ),
    "covariance no rows": (
        lambda data: data.update(covariance=[]),
        "covariance is not 12 x 12, one row per parameter",
    ),
    "covariance not symmetric": (
        lambda data: data.update(covariance=np.tri(12).tolist()),
        "covariance is not symmetric and positive",
    ),
    "negative variance of a small parameter": (
        lambda data: data.update(covariance=np.diag([1e6] * 11 + [-1e-6]).tolist()),
        "covariance is not symmetric and positive",
    ),
    "covariance without variance": (
        lambda data: data.update(covariance=(np.diag([1.0] * 10 + [0.0] * 2) + np.eye(12)[::-1] * 1e-3).tolist()),
        "covariance is not symmetric and positive",
    ),
    "correlation above one": (
        lambda data: data.update(covariance=block_diag(np.eye(10), [[1e-8, 1.1e-4], [1.1e-4, 1.0]]).tolist()),
        "covariance is not symmetric and positive",
    ),
    "negative variance": (
        lambda data: data.update(covariance=np.diag([1.0] * 11 + [-1.0]).tolist()),
        "covariance is not symmetric and positive",
    ),
}


@pytest.mark.parametrize(("change", "message"), REFUSED.values(), ids=REFUSED)
def test_refused(change, message, tmp_path):
    file = tmp_path / "cal.json"
    file.write_bytes(changed(change))
    with pytest.raises(UserError) as refusal:
        read_model(file, DMU50)
    assert str(refusal.value) == f"calibration {file}: {message}"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is incomplete; "),
        (b"G1 X10", "this is an NC program, no calibration"),
        (b'{"ncomp_calibration": 1, "effects": [', "the file is incomplete; "),
        (changed(lambda data: data["effects"][3].update(note="Fr")).replace(b"Fr", b"Fr\xe4"), "not UTF-8 text"),
        (b'{"\xff": 1}', "not UTF-8 text"),
        (b"[1, 2]", "expected a table, not a list in [ ]; "),
    ],
)
def test_refused_for_not_being_json(data, message):
    with pytest.raises(UserError) as refusal:
        decode_model(data, "cal.json")
    assert str(refusal.value).startswith(f"calibration cal.json: {message}")
    assert "\n" not in str(refusal.value)


def test_refused_for_being_another_machines(tmp_path):
    file = tmp_path / "cal.json"
    write_model(SMALL, file)
    with pytest.raises(UserError) as refusal:
        read_model(file, machines.load("trunnion_bc"))
    assert str(refusal.value) == (
        f"calibration {file} is of machine dmu50 (w C B b X Y Z t), "
        "not of trunnion_bc (w C B b X Y Z t) with this geometry: give the machine of the calibration, or a "
        "calibration of trunnion_bc"
    )


def test_a_calibration_that_can_not_be_read_is_refused(tmp_path):
    with pytest.raises(UserError) as refusal:
        read_model(tmp_path / "none.json", DMU50)
    assert str(refusal.value) == f"calibration {tmp_path / 'none.json'}: No such file or directory"


# --- the shipped demonstration calibration

# Ellingsdalen (NTNU 2021), Fig. 3.11: nominal X, and the compensated commands X, Y, Z (Y and Z are nominally 0)
PUBLISHED = np.array([
    (50, 49.9956, -0.000949353, -0.00156385),
    (100, 99.9937, -0.000753776, 0.000895042),
    (150, 149.993, -0.000362045, -0.00238055),
    (200, 199.992, -0.000215857, -0.00110904),
    (250, 249.99, -0.000387325, 0.00149589),
    (300, 299.987, -0.000716486, 0.000389921),
    (350, 349.984, -0.000948794, -0.000920075),
    (400, 399.981, -0.000872622, 0.00182009),
    (450, 449.979, -0.000456766, 0.000298728),
    (500, 499.981, 1.20629e-05, -0.00292907),
])  # fmt: skip


def test_the_shipped_calibration_is_what_the_script_writes():
    assert SHIPPED.read_bytes() == encode_model(demonstration())
    assert machines.default_calibration(DMU50) == SHIPPED
    assert read_model(SHIPPED, DMU50).demonstration


def test_the_shipped_calibration_carries_the_published_errors_of_x():
    """What the thesis commands is nominal minus error; there X starts at 0, here the travel is centred."""
    nominal = np.zeros((11, 3))
    nominal[1:, 0] = PUBLISHED[:, 0]
    q = np.zeros((11, 5))
    q[:, DMU50.index("X")] = nominal[:, 0] - 250.0
    errors = read_model(SHIPPED, DMU50).errors(DMU50, State(q))[:, DMU50.index("X"), :3]
    assert not errors[0].any()
    assert (nominal - errors)[1:] == pytest.approx(PUBLISHED[:, 1:], abs=1e-9)


def test_the_shipped_calibration_says_which_numbers_are_published():
    model = read_model(SHIPPED, DMU50)
    published = [effect.name for effect in model.effects if effect.note.startswith("published: Ellingsdalen 2021")]
    assert published == ["E_XX", "E_YX", "E_ZX"]
    assert {effect.note for effect in model.effects if effect.name not in published} == {"simulated"}
    assert "all others simulated" in model.provenance.source


def test_the_shipped_calibration_has_the_magnitudes_of_the_thesis():
    """Section 4.1: peaks of 20.5 um for E_XX, 40.8 um for E_YY and 16.5 um for E_ZZ."""
    q = np.linspace(*DMU50.travel, 721)
    errors = read_model(SHIPPED, DMU50).errors(DMU50, State(q))
    peaks = [np.abs(errors[:, DMU50.index(axis), "XYZ".index(axis)]).max() * 1e3 for axis in "XYZ"]
    assert peaks == pytest.approx([20.5, 40.8, 16.5], abs=0.6)
