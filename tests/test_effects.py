"""The contract of every effect, over the table of examples; what each means is in the tests beside this one."""

import re
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import get_args

import msgspec
import numpy as np
import pytest
from support.effect_examples import BACKWARD, DMU50, EXAMPLES, Example, full_state
from support.tiers import one_of_each

from kinematics.basis import Polynomial
from kinematics.effects import COMPONENTS, EFFECTS, INSTRUMENT, TOOL, CrossAxis, Effect, ErrorMotion, LocationError
from kinematics.effects.base import Remedy
from kinematics.effects.combined.thermal import DistortionWithTime, GrowthWithTime, ThermalDrift
from kinematics.effects.control import ControlTable, WorkpieceSurface
from kinematics.effects.describe import describe, markdown
from kinematics.effects.drive import Backlash, Cyclic
from kinematics.effects.friction import LateralPlay
from kinematics.effects.geometric import Racking, Wobble
from kinematics.effects.instrument import Outliers
from kinematics.effects.load import RamSag
from kinematics.effects.unnamed import Unnamed
from kinematics.error_model.decoding_faults import CURE
from kinematics.error_model.model import ErrorModel, decode_model, encode_model, no_errors
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

ROOT = Path(__file__).parents[1]
COLUMNS = {field.name for field in fields(State) if field.init}
UNITS = {
    "um", "urad", "um/m", "um/K", "um/m/K", "um/h", "um/m/h", "urad/rad", "urad/K", "urad/h", "mm", "deg", "s", "ms",
    "ms2", "ppm", "urad/m", "um/m3", "um/m/K2", "um/m/m", "um/krpm", "urad/krpm",
}  # fmt: skip

every_class = pytest.mark.parametrize("effect_class", EFFECTS, ids=[effect.__name__ for effect in EFFECTS])
every_example = pytest.mark.parametrize("example", EXAMPLES, ids=[example.name for example in EXAMPLES])

IN_ANY_ROW = [example for example in EXAMPLES if not isinstance(example.effect, Outliers)]
"""Without an effect of single rows."""
WITHOUT_MEMORY = [example for example in EXAMPLES if not example.effect.HAS_MEMORY]


def model_of(machine: Machine, *effects: Effect) -> ErrorModel:
    return msgspec.structs.replace(no_errors(machine), effects=effects)


def total(effect: Effect, machine: Machine, state: State) -> Array:
    """Its contributions `(n, axes + 2, 6)`."""
    values = np.zeros((len(state), len(machine.axes) + 2, 6))
    for place, component, contribution in effect.contributions(machine, state):
        assert contribution.shape == (len(state),)
        values[:, place, component] += contribution
    return values


def derivatives(effect: Effect, machine: Machine, state: State) -> Array:
    """Its columns `(n, axes + 2, 6, parameters)`."""
    values = np.zeros((len(state), len(machine.axes) + 2, 6, len(effect.parameters)))
    for place, component, columns in effect.columns(machine, state):
        values[:, place, component] += columns
    return values


def errors(effect: Effect, machine: Machine, state: State) -> list[tuple[int, int]]:
    return [(own.column, own.component) for own in effect.columns(machine, state)]


@pytest.mark.parametrize("example", IN_ANY_ROW, ids=[example.name for example in IN_ANY_ROW])
def test_which_errors_an_effect_has_is_the_same_in_all_rows(example):
    effect, machine = example.effect, example.machine
    state = full_state(machine, 12)
    state.positions[0] = np.array([axis.home for axis in machine.axes]) * machine.scale
    assert all(
        errors(effect, machine, state.rows(slice(row, row + 1))) == errors(effect, machine, state) for row in range(12)
    )


def test_a_ram_that_is_in_has_the_errors_of_one_that_is_out():
    inside, outside = (State(np.array([[0.0, 0.0, x, 0.0, 0.0]])) for x in (-100.0, 100.0))
    ram = RamSag("X", 30.0, 0.0)
    places = [errors(ram, DMU50, state) for state in (inside, outside)]
    assert places[0] == places[1]
    assert len(places[0]) == 2
    assert not total(ram, DMU50, inside).any()
    assert total(ram, DMU50, outside).any()


# --- classes


def test_every_kind_has_an_example():
    assert {type(example.effect) for example in EXAMPLES} == set(EFFECTS) == set(Effect.__args__)
    assert len({effect.__struct_config__.tag for effect in EFFECTS}) == len(EFFECTS)


@every_class
def test_class_facts_are_complete(effect_class):
    assert len(effect_class.TITLE) > 5
    assert not effect_class.TITLE.endswith(".")
    assert effect_class.__doc__
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", effect_class.__struct_config__.tag)
    assert effect_class.ACTS_ON in ("axis", "tool", "workpiece", "instrument")
    assert effect_class.REMEDY in get_args(Remedy)
    assert effect_class.ACTS_ON != "instrument" or effect_class.REMEDY == "none"
    assert set(effect_class.NEEDS) < COLUMNS - {"positions"}
    names = {field.name for field in msgspec.structs.fields(effect_class)}
    assert {quantity.name for quantity in effect_class.QUANTITIES} | set(effect_class.LABEL) < names
    for quantity in effect_class.QUANTITIES:
        assert set(quantity.unit.split(" or ")) <= UNITS
        assert quantity.typical > 0
        assert not (quantity.bound and quantity.linear)  # linear least squares keeps no bounds
        assert np.isfinite(quantity.typical) or effect_class is Outliers
        assert not quantity.share_of or quantity.share_of in names
    assert any(quantity.linear for quantity in effect_class.QUANTITIES)


def test_the_page_of_effects_is_current():
    command = [sys.executable, "-m", "kinematics.effects"]
    printed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True, encoding="utf-8").stdout
    assert printed == markdown() == (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")


def test_the_description_has_a_row_for_each_kind():
    rows = describe()
    assert [row.kind for row in rows] == [effect.__struct_config__.tag for effect in EFFECTS]
    backlash = next(row for row in rows if row.kind == "backlash")
    assert backlash[:5] == (
        "backlash", "backlash, constant and growing with position (wind-up)", "axis", ("direction of approach",),
        ("axis",),
    )  # fmt: skip
    assert [(q.name, q.unit, q.typical) for q in backlash.quantities] == [
        ("width", "um or urad", 20.0),
        ("windup", "um/m or urad/rad", 20.0),
    ]
    assert (backlash.optional, backlash.remedy) == ({"windup"}, "bidirectional table")


# --- parameters


@every_example
def test_names_and_units(example: Example):
    table = example.effect.parameter_table
    assert example.effect.name == example.name
    assert [parameter.unit for parameter in table] == example.units.split()
    assert len({parameter.name for parameter in table}) == len(table)
    assert all(parameter.typical > 0 and not parameter.share_of for parameter in table)
    assert len(table) == len(example.effect.parameters) == len(example.effect.uncertainties)
    assert example.effect.uncertainties == (example.effect.u or (0.0,) * len(table))


@every_example
def test_other_parameters(example: Example):
    effect, n = example.effect, len(example.effect.parameters)
    u = tuple(np.arange(1.0, n + 1))
    doubled = effect.with_parameters([2.0 * p for p in effect.parameters], u)
    assert type(doubled) is type(effect)
    assert doubled.parameters == tuple(2.0 * p for p in effect.parameters)
    assert doubled.uncertainties == u
    assert doubled.with_parameters(effect.parameters, effect.u) == effect
    for wrong in ([0.0] * (n + 1), [0.0] * (n - 1)):
        with pytest.raises(ValueError, match=f"{n} parameters"):
            effect.with_parameters(wrong)
        with pytest.raises(ValueError, match=f"{n} parameters"):
            effect.by_key(wrong)
    with pytest.raises(ValueError, match=r"takes|parameters with"):
        effect.with_parameters(effect.parameters, (1.0,) * (n + 1))


REFUSED = {
    "E_XX: its basis takes 2 parameters with as many u, got 3 and 3":
        lambda: ErrorMotion("X", "X", Polynomial((0.0, 1.0), 1), (1.0, 2.0, 3.0)),
    "E_ZX(Y): these degrees take 4 coefficients, got 3":
        lambda: CrossAxis("Z", "X", "Y", (0.0, 1.0), (0.0, 1.0), 1, 2, (1.0, 2.0, 3.0)),
    "interval [1.0, 1.0] must go from a lower to a higher position":
        lambda: CrossAxis("Z", "X", "Y", (0.0, 1.0), (1.0, 1.0), 0, 1, (1.0,)),
    "racking X: its basis takes 2 parameters, got 1":
        lambda: Racking("X", "Y", 100.0, Polynomial((0.0, 1.0), 1), (1.0,)),
    "wobble X radial 1 1: X is no rotary axis": lambda: Wobble("X", "radial", 1, 1, 0.0, 0.0),
    "cyclic E_XX: as many sine as cosine amplitudes, at least one": lambda: Cyclic("X", "X", 1.0, (1.0,), ()),
    "thermal-drift Z: up to two amplitudes, each with its time constant":
        lambda: ThermalDrift(component="Z", amplitudes=(1.0,)),
    "thermal-drift Z: neither a rate nor an amplitude": lambda: ThermalDrift(component="Z"),
    "thermal-drift Z: time_constants_s must be > 0, got 0":
        lambda: ThermalDrift(component="Z", amplitudes=(1.0,), time_constants_s=(0.0,)),
    "thermal-scale C: C has no length that could grow": lambda: GrowthWithTime(axis="C", rate=1.0),
    "lateral-play E_XX: along its own line the play of an axis is its backlash": lambda: LateralPlay("X", "X", 1.0),
    "interval [1.0, 0.0] must go from a lower to a higher position":
        lambda: DistortionWithTime(component="Y", axis="X", interval=(1.0, 0.0), degree=1, rate=1.0),
    "outliers: three numbers for each of its 2 rows": lambda: Outliers((1, 2), (0.0, 0.0, 0.0)),
    "control-table X(): a function of one axis or two, with nodes of each": lambda: ControlTable("X", (), (), ()),
    "control-table X(Y): nodes must be finite and ascending, at least one":
        lambda: ControlTable("X", ("Y",), ((1.0, 1.0),), (0.0, 0.0)),
    "surface Z(X,Y): a surface has at least two nodes along each of two axes":
        lambda: WorkpieceSurface("Z", ("X", "Y"), ((0.0, 1.0), (0.0,)), (0.0, 0.0)),
    "surface Z(X,Y): the nodes of a cubic surface are evenly spaced":
        lambda: WorkpieceSurface("Z", ("X", "Y"), ((0.0, 1.0, 3.0), (0.0, 1.0)), (0.0,) * 6, interpolation="cubic"),
    "control-table X(Y): its nodes take 2 values, got 3":
        lambda: ControlTable("X", ("Y",), ((0.0, 1.0),), (0.0, 0.0, 0.0)),
    "unnamed X(): a function of at least one variable, each named once":
        lambda: Unnamed("X", (), (), ((),), (1.0,)),
    "unnamed X(Y, time): 2 variables take as many ranges":
        lambda: Unnamed("X", ("Y", "time"), ((0.0, 1.0),), ((1, 1),), (1.0,)),
    "unnamed X(Y): at least one term, of as many degrees as there are variables":
        lambda: Unnamed("X", ("Y",), ((0.0, 1.0),), ((1, 1),), (1.0,)),
    "unnamed X(Y): terms differ, and their degrees are 0 to 24":
        lambda: Unnamed("X", ("Y",), ((0.0, 1.0),), ((1,), (25,)), (1.0, 1.0)),
    "unnamed X(Y): its terms take 2 coefficients, got 1":
        lambda: Unnamed("X", ("Y",), ((0.0, 1.0),), ((1,), (2,)), (1.0,)),
    "E_C0Y: 1 parameters with 2 u": lambda: LocationError("C", "Y", 1.0, u=(1.0, 1.0)),
}  # fmt: skip


BOUNDS = {
    "length": "> 0",
    "time_constant_s": "> 0",
    "period": "> 0",
    "pitch": "> 0",
    "time_constants_s": "> 0",
    "lag_s": ">= 0",
}
"""Bounds of every quantity that has one, by name."""


@every_example
def test_bounds(example: Example):
    """At a bound and below it, and what is no number, an effect refuses a parameter; above it does not."""
    effect, start = example.effect, list(example.effect.parameters)
    for k, parameter in enumerate(effect.parameter_table):
        name = parameter.name.partition("[")[0]
        assert parameter.bound == BOUNDS.get(name, "")
        at = parameter.lower
        inside = [at + 1e-6, 1e6] if parameter.bound else [-1e6, 0.0, 1e6]
        outside = [at - 1e-9, float("nan"), float("-inf")] if parameter.bound else []
        if parameter.bound:
            (inside if parameter.closed else outside).append(at)
        for value in inside:
            assert parameter.allows(value)
            changed = effect.with_parameters([*start[:k], value, *start[k + 1 :]])
            assert changed.parameters[k] == value
        for value in outside:
            assert not parameter.allows(value)
            with pytest.raises(ValueError, match="must be") as refusal:
                effect.with_parameters([*start[:k], value, *start[k + 1 :]])
            assert str(refusal.value) == f"{effect.name}: {name} must be {parameter.bound}, got {value:g}"


@every_example
def test_bounds_hold_in_files_too(example: Example):
    data = encode_model(model_of(example.machine, example.effect))
    for quantity in filter(lambda quantity: quantity.bound, example.effect.quantities()):
        content = msgspec.json.decode(data)
        row = content["effects"][0][quantity.name]
        content["effects"][0][quantity.name] = [-3.0] * len(row) if isinstance(row, list) else -3.0
        if row != []:
            with pytest.raises(UserError) as refusal:
                decode_model(msgspec.json.encode(content), "c.json")
            said = f"effects[0]: {example.effect.name}: {quantity.name} must be {quantity.bound}, got -3; {CURE}"
            assert str(refusal.value) == f"calibration c.json: {said}"


@every_example
def test_keys_carry_the_unit_once(example: Example):
    effect = example.effect
    values, u = effect.by_key(effect.parameters), effect.by_key(effect.uncertainties)
    assert list(values) == list(u) == example.keys.split()
    flat = [parameter.key.partition("[")[0] for parameter in effect.parameter_table]
    assert list(dict.fromkeys(flat)) == list(values)
    rows = [value if isinstance(value, tuple) else (value,) for value in values.values()]
    assert tuple(number for row in rows for number in row) == effect.parameters
    assert [key for key in values if "[" in key or "/" in key or " " in key] == []


def test_keys_of_scalars_and_rows():
    assert Backlash("X", 31.2, u=(0.8,)).by_key((0.8,)) == {"width_um": 0.8}
    cyclic = Cyclic("X", "X", 10.0, (2.0, 1.0), (-1.0, 0.0))
    assert cyclic.by_key(cyclic.parameters) == {"period_mm": 10.0, "sine_um": (2.0, 1.0), "cosine_um": (-1.0, 0.0)}
    assert [parameter.key for parameter in cyclic.parameter_table] == [
        "period_mm", "sine_um[0]", "sine_um[1]", "cosine_um[0]", "cosine_um[1]",
    ]  # fmt: skip


@pytest.mark.parametrize(("message", "make"), REFUSED.items(), ids=REFUSED)
def test_nonsense_is_refused(message, make):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        make()


# --- columns


@every_example
def test_places_components_and_shapes(example: Example):
    effect, machine = example.effect, example.machine
    names = {i: f"E_{{}}{axis}" for i, axis in enumerate(machine.names)} | {TOOL: "tool {}", INSTRUMENT: "seen {}"}
    for n in (7, 4):
        columns = list(effect.columns(machine, full_state(machine, n)))
        touched = {names[c.column].format(COMPONENTS[c.component]) for c in columns}
        assert touched == set(filter(None, example.touched.split(", ")))
        assert all(c.values.shape == (n, len(effect.parameters)) and np.isfinite(c.values).all() for c in columns)
        assert all(c.column != INSTRUMENT or c.component < 3 for c in columns)
        assert all(effect.ACTS_ON == "instrument" or (c.column == TOOL) == (effect.ACTS_ON == "tool") for c in columns)


@pytest.mark.parametrize(
    "example", one_of_each(EXAMPLES, lambda example: type(example.effect)), ids=[example.name for example in EXAMPLES]
)
def test_columns_are_the_derivatives(example: Example):
    effect, machine = example.effect, example.machine
    state, start = full_state(machine, 40), np.array(effect.parameters)
    columns = derivatives(effect, machine, state)
    for k, parameter in enumerate(effect.parameter_table):
        step = np.zeros(len(start))
        step[k] = 0.5 if parameter.linear else 1e-7 * max(abs(start[k]), 1.0)
        ahead, behind = (total(effect.with_parameters(start + s), machine, state) for s in (step, -step))
        slope = (ahead - behind) / (2 * step[k])
        assert slope == pytest.approx(columns[..., k], rel=1e-5, abs=1e-5 * np.abs(columns[..., k]).max() + 1e-15)


@every_example
def test_without_amplitudes_there_is_no_error(example: Example):
    effect = example.effect
    none = [
        0.0 if parameter.linear else p for parameter, p in zip(effect.parameter_table, effect.parameters, strict=True)
    ]
    assert not total(effect.with_parameters(none), example.machine, full_state(example.machine, 20)).any()


@every_example
def test_linear_in_its_amplitudes(example: Example):
    effect, state = example.effect, full_state(example.machine, 12)
    amplitudes = [p * parameter.linear for parameter, p in zip(effect.parameter_table, effect.parameters, strict=True)]
    expected = derivatives(effect, example.machine, state) @ amplitudes
    assert total(effect, example.machine, state) == pytest.approx(expected, abs=1e-15)
    assert not example.touched or np.abs(expected).max() > 1e-7


@pytest.mark.parametrize("example", WITHOUT_MEMORY, ids=[example.name for example in WITHOUT_MEMORY])
def test_each_row_for_itself(example: Example):
    state, order = full_state(example.machine, 30), np.random.default_rng(2).permutation(30)
    errors = total(example.effect, example.machine, state)
    for rows in (order, slice(0, 1), slice(29, 30), slice(0, 0)):
        some = total(example.effect, example.machine, state.rows(rows))
        assert some == pytest.approx(errors[rows], rel=1e-14, abs=1e-18)


@every_example
def test_what_it_needs_is_enough_and_each_missing_column_is_named(example: Example):
    effect, machine, state = example.effect, example.machine, full_state(example.machine, 5)
    assert set(effect.needs) <= set(effect.NEEDS)
    enough = State(state.positions, **{column: getattr(state, column) for column in effect.needs})
    assert (total(effect, machine, enough) == total(effect, machine, state)).all()
    assert np.isfinite(derivatives(effect, machine, enough)).all()
    for column in effect.needs:
        missing = replace(enough, **{column: {} if column == "temperatures" else None})
        with pytest.raises(UserError) as refusal:
            total(effect, machine, missing)
        what = f"the temperature {effect.sensors[0]!r}" if column == "temperatures" else column.replace("_", " ")
        assert str(refusal.value) == f"{effect.name} needs {what}, which these data do not give"


# --- in a model


@every_example
def test_round_trip_through_a_file(example: Example):
    model = model_of(example.machine, example.effect)
    data = encode_model(model)
    assert decode_model(data, "") == model
    (written,) = msgspec.json.decode(data)["effects"]
    order = list(written)
    assert order[0] == "kind"
    assert order[-len(written["units"]) - 3 :] == [*written["units"], "units", "u", "note"]
    assert list(written["units"].values()) == [quantity.unit for quantity in example.effect.quantities()]


def test_an_axis_that_the_machine_lacks_is_a_users_error():
    for example in EXAMPLES:
        if example.effect.axes and example.effect.ACTS_ON == "axis":
            lacking = BACKWARD if example.effect.axes[0] == "B" else DMU50
            if example.effect.axes[0] not in lacking.names:
                with pytest.raises(UserError, match="has no axis"):
                    model_of(lacking, example.effect).errors(lacking, full_state(lacking, 2))


@every_example
def test_the_instrument_has_no_part_in_the_machines_errors(example: Example):
    effect, machine, state = example.effect, example.machine, full_state(example.machine, 9)
    model = model_of(machine, effect)
    expected, errors, seen = total(effect, machine, state), *model.observation(machine, state)
    assert errors == pytest.approx(expected[:, :-1], abs=1e-18)
    assert seen == pytest.approx(expected[:, -1, :3], abs=1e-18)
    if effect.ACTS_ON == "instrument":
        assert not model.errors(machine, State(state.positions)).any()
        assert seen.any() or errors.any()
    else:
        assert (model.errors(machine, state) == errors).all()
        assert not seen.any()
