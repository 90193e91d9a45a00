"""Controller tables of every format: written, read back by other code, and tried on a virtual machine."""

import re

import msgspec
import numpy as np
import pytest
from support.effect_examples import BACKWARD
from support.programs import load, model_of
from support.table_cases import CASES, TOOL, Case
from support.tiers import one_of_each

from kinematics.basis import Polynomial
from kinematics.correction import correct_position
from kinematics.effects import UM, Backlash, ControlTable, ErrorMotion, LocationError
from kinematics.effects.base import COMPONENTS, own_component
from kinematics.error_model.model import no_errors
from kinematics.forward import forward, tool_point
from kinematics.state import State
from kinematics.user_error import UserError
from postproc.control_data.format import parse_settings, sign_of
from postproc.control_data.formats import formats_of
from postproc.control_data.remaining_error import volume_points
from postproc.control_data.tables.export_tables import export
from postproc.control_data.tables.table_format import TableFormat
from postproc.control_data.tables.table_probe import PROBED, probe

FORMATS = formats_of(TableFormat)

FIRST = {case.format: case.of_few_positions for case in reversed(CASES)}
EVERY = [*FIRST.values(), *CASES]
"""The first case of each format with few positions, and all cases."""
every_case = pytest.mark.parametrize(
    "case", one_of_each(EVERY, lambda case: case.format), ids=[case.id for case in EVERY]
)


def dense(machine, n=1500, beyond=0.1):
    """Positions `(n, axes)`, mm and rad, in the volume and beyond its ends; directions."""
    rng = np.random.default_rng(5)
    low, high = np.array([(0.0, 360.0) if not np.isfinite(a.travel).all() else a.travel for a in machine.axes]).T
    q = rng.uniform(low - beyond * (high - low), high + beyond * (high - low), (n, len(low)))
    return q * machine.scale, rng.choice([-1.0, 1.0], q.shape)


def read_back(case: Case, exported, sign=None):
    """The errors that the files take away, by the reader."""
    files = {name: text for name, text in exported.files.items() if not name.endswith(".md")}
    read = FORMATS[case.format].read_files(exported.machine, files, sign or exported.sign, case.settings)
    return msgspec.structs.replace(no_errors(exported.machine), effects=tuple(read.effects))


def commanded(exported, tables, q, approach):
    """Where a control that holds these tables sends the axes, worked out without the writers' code."""
    machine = exported.target.machine
    if exported.format.capabilities is None:
        tool, movable = np.tile(TOOL, (len(q), 1)), np.ones(q.shape, bool)
        return correct_position(machine, lambda p: tables.errors(machine, State(p, approach)), q, tool, movable)
    errors = tables.errors(machine, State(q, approach))
    moved = q.copy()
    for i, axis in enumerate(machine.axes):
        k = COMPONENTS.index(own_component(axis.name))
        along = axis.error_frame[:, k % 3] @ axis.unit_direction
        moved[:, i] -= errors[:, i, k] * along
    return moved


def missed_um(exported, motors, q, approach):
    """Deviation of the tool point `(n, 3)`, um, of the virtual machine whose motors stand there."""
    machine = exported.target.machine
    actual = forward(machine, motors, exported.whole.errors(machine, State(motors, approach))).apply(TOOL)
    return (actual - tool_point(machine, q, TOOL)) / UM


def rms(vectors):
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def test_every_format_has_a_reader_and_a_case():
    assert set(FORMATS) == {case.format for case in CASES}


@every_case
def test_the_reader_finds_what_was_written(case: Case):
    exported = case.exported()
    machine = exported.target.machine
    q, approach = dense(machine)
    state = State(q, approach)
    written, found = (model.errors(machine, state) for model in (exported.taken, read_back(case, exported)))
    assert np.abs(written - found).max() <= case.exact
    assert np.abs(found).max() > 10 * UM
    if exported.format.capabilities is not None:
        assert commanded(exported, exported.taken, q, approach) == pytest.approx(exported.moves(q, approach), abs=1e-12)


@every_case
@pytest.mark.usefixtures("few_positions")
def test_the_right_sign_leaves_what_was_predicted_and_the_wrong_one_doubles_it(case: Case):
    exported = case.exported()
    places = volume_points(exported.target)
    predicted = exported.errors_in_the_volume()["tool_point_um"]
    found = read_back(case, exported)
    right = commanded(exported, found, places.q, places.approach)
    other = {"error": "correction", "correction": "error"}[exported.content.sign]
    wrong = 2 * places.q - right
    if exported.format.sign is None:
        wrong = commanded(exported, read_back(case, exported, other), places.q, places.approach)
    machine = exported.target.machine
    shift = np.array([exported.datum.get(axis.name, 0.0) for axis in machine.axes]) * machine.scale
    right, wrong = right + shift, wrong - shift
    stage = "after_tables_and_datum_shift" if exported.datum else "after_tables"
    before, after, doubled = (missed_um(exported, m, places.q, places.approach) for m in (places.q, right, wrong))
    assert rms(before) == pytest.approx(predicted["before"]["rms"], abs=1e-3)
    assert rms(after) == pytest.approx(predicted[stage]["rms"], abs=max(2e-3, 1e3 * case.exact))
    assert np.linalg.norm(after, axis=1).max() == pytest.approx(
        predicted[stage]["max"], abs=max(5e-3, 2e3 * case.exact)
    )
    assert rms(after) <= case.leaves < 0.2 * rms(before)
    assert rms(doubled) == pytest.approx(2 * rms(before), rel=0.01)
    both = predicted["after_tables_and_nc_correction_of_the_rest"]
    assert both["rms"] <= predicted["after_tables"]["rms"] + 1e-3
    assert both["max"] <= 0.02


@every_case
def test_files_are_plain(case: Case):
    for name, text in case.exported().files.items():
        assert re.fullmatch(r"[\w.-]+", name)
        assert text.isascii()
        assert text.endswith("\n")
        assert "nan" not in text.lower().split()
        assert "-0.0000 " not in text


@every_case
def test_the_rest_is_the_calibration_less_the_tables(case: Case):
    exported = case.exported()
    machine = exported.target.machine
    state = State(*dense(machine, 500))
    whole, taken, rest = (m.errors(machine, state) for m in (exported.whole, exported.taken, exported.rest))
    assert rest == pytest.approx(whole - taken, abs=1e-12)


@pytest.mark.parametrize("name", FORMATS)
def test_a_sign_that_no_source_confirms_is_demanded(name):
    form = FORMATS[name]
    if form.sign is None:
        with pytest.raises(UserError, match="--probe"):
            sign_of(form, None)
        assert sign_of(form, "error") == "error"
    else:
        assert sign_of(form, None) == form.sign
        other = "error" if form.sign == "correction" else "correction"
        with pytest.raises(UserError, match="are known to mean"):
            sign_of(form, other)


@every_case
def test_the_probe_is_one_node(case: Case):
    """The node is in the axis' own table or its positioning error; the reader finds it with the stated size."""
    form, machine = FORMATS[case.format], load(case.machine)
    settings = parse_settings(form.settings, case.settings)
    limits = form.limits(settings)
    if form.capabilities is not None and (
        limits.degree is not None or (not form.capabilities(settings).own and form.sign is not None)
    ):
        with pytest.raises(UserError, match="no table that shows the sign of X"):
            probe(machine, "X", form, settings)
        return
    files = probe(machine, "X", form, settings)
    told = files.pop("probe.md")
    assert "--sign" in told
    if form.capabilities is None or form.capabilities(settings).own:
        peak, low, high = map(float, re.search(r"at X (\S+), and 0 from X (\S+) and X (\S+) on", told).groups())
        assert low < peak < high
    sign = form.sign or "correction"
    tables = form.read_files(machine, files, sign, case.settings).effects
    model = model_of(machine, *tables)
    i = machine.index("X")
    q = np.tile(np.mean([a.travel if np.isfinite(a.travel).all() else (0, 0) for a in machine.axes], axis=1), (2001, 1))
    over = machine.index("X" if form.capabilities is None or form.capabilities(settings).own else "Y")
    q[:, over] = np.linspace(*machine.axes[over].travel, 2001)
    errors = model.errors(machine, State(q * machine.scale, np.ones(q.shape)))[:, i, 0]
    assert np.abs(errors).max() == pytest.approx(PROBED, rel=0.06)
    assert np.mean(np.abs(errors) > 0.001 * PROBED) < 0.5


@pytest.mark.usefixtures("few_positions")
def test_axes_that_run_against_their_letters():
    """X and C against theirs, Y carrying the workpiece: every own table still goes the right way."""
    names = {"X": (0.0, 600.0), "Y": (0.0, 400.0), "Z": (0.0, 300.0), "C": (-180.0, 180.0)}
    effects = [ErrorMotion(a, a, Polynomial(ends, 1), (0.0, 30.0), u=(0.0, 0.0)) for a, ends in names.items()]
    effects += [Backlash("X", 20.0), Backlash("C", 60.0)]
    form = FORMATS["linuxcnc"]
    exported = export(BACKWARD, model_of(BACKWARD, *effects), form, parse_settings(form.settings, []), form.sign, TOOL)
    places = volume_points(exported.target)
    tables = msgspec.structs.replace(
        no_errors(BACKWARD),
        effects=tuple(form.read_files(BACKWARD, exported.files, "correction").effects),
    )
    motors = commanded(exported, tables, places.q, places.approach)
    before, after = (missed_um(exported, m, places.q, places.approach) for m in (places.q, motors))
    assert rms(before) > 10
    assert rms(after) < 0.01


@pytest.mark.usefixtures("few_positions")
def test_a_rotary_axis_whose_table_would_be_a_constant_is_in_the_datum():
    """The zero angle of A has no table where the value at the reference position must be 0, and shifts A's zero."""
    machine, form = load("trunnion_ac"), FORMATS["siemens-cec"]
    model = model_of(machine, LocationError("A", "A", 50.0), LocationError("C", "Y", 20.0))
    exported = export(machine, model, form, parse_settings(form.settings, []), "correction", TOOL)
    assert exported.datum["A"] == pytest.approx(-np.degrees(50e-6), rel=0.01)
    point = exported.errors_in_the_volume()["tool_point_um"]
    assert point["after_tables_and_datum_shift"]["rms"] < 0.1 * point["before"]["rms"]


def test_settings_are_checked():
    kind = FORMATS["linuxcnc"].settings
    assert parse_settings(kind, ["type=0", "points=20"]).points == 20
    for text, why in {
        "points=257": "<= 256",
        "points=x": "int",
        "type=2": "type",
        "speed=3": "expected NAME=VALUE",
        "points": "expected NAME=VALUE",
    }.items():
        with pytest.raises(UserError, match=why):
            parse_settings(kind, [text])
    with pytest.raises(UserError, match="given twice"):
        parse_settings(kind, ["type=0", "type=1"])


def test_taken_errors_are_tables():
    exported = FIRST["linuxcnc"].exported()
    assert all(isinstance(effect, ControlTable) for effect in exported.taken.effects)
