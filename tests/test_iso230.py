"""ISO 230-2: every value against the standard's formulas written out once more, as loops over plain numbers."""

import json
import math
import re
import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.pages import figures
from support.virtual_measurements import written

import machines
from calibration.instruments import Interferometer
from calibration.measurement.file import read_measurement
from calibration.measurement.measurement import Measurement, with_moves
from calibration.registration.registration import Registration
from calibration.single_axis.cells import BACKWARD, FORWARD
from calibration.single_axis.iso230 import AxisTest, evaluate
from calibration.single_axis.other_standards import with_others
from kinematics.basis import BSpline
from kinematics.effects import Backlash, ErrorMotion
from kinematics.error_model.model import ErrorModel, Observation, no_errors
from kinematics.error_model.provenance import Provenance, reference
from kinematics.state import State
from kinematics.user_error import UserError

GANTRY, DMU50 = machines.load("gantry"), machines.load("dmu50")

READINGS = {
    # target mm: (forward runs, backward runs), um
    0.0: ([0.0, 0.4, -0.4, 0.2, -0.2], [-2.0, -2.4, -1.6, -2.0, -2.0]),
    250.0: ([3.0, 3.6, 2.7, 3.3, 2.4], [0.5, 0.9, 0.1, 0.7, 0.3]),
    500.0: ([7.1, 7.9, 6.8, 7.5, 6.7], [3.0, 3.4, 2.4, 3.2, 3.0]),
    750.0: ([5.0, 5.4, 4.2, 5.1, 4.8], [2.4, 2.9, 1.7, 2.6, 2.4]),
    1000.0: ([9.9, 10.8, 9.3, 10.2, 9.8], [6.0, 6.9, 5.3, 6.2, 5.6]),
}


def measured(readings, machine=GANTRY, axis="X", u=0.3, u_per_m=0.5) -> Measurement:
    """Interferometer data, run by run up and down; None in place of a reading is a missing one."""
    i = machine.index(axis)
    size = 1e-6 if machine.axes[i].rotary else 1e-3
    rows = []
    runs = max(len(way) for ways in readings.values() for way in ways)
    for run in range(runs):
        for way, sign in ((FORWARD, 1), (BACKWARD, -1)):
            for target in sorted(readings, reverse=way == BACKWARD):
                values = readings[target][way]
                if run < len(values) and values[run] is not None:
                    rows.append((target, sign, str(run + 1), values[run]))
    positions = np.tile([a.home for a in machine.axes], (len(rows), 1)) * machine.scale
    positions[:, i] = [row[0] * machine.scale[i] for row in rows]
    state = with_moves(State(positions, target=np.full(len(rows), "1")))
    state.approach[:, i] = [row[1] for row in rows]
    return Measurement(
        machine,
        Interferometer(u, u_per_m),
        state,
        np.array([[row[3] * size] for row in rows]),
        axis=np.full(len(rows), axis),
        run=np.array([row[2] for row in rows]),
        source="laser.csv",
    )


def values_of(test: AxisTest) -> dict[str, float]:
    return {value.symbol: value.value for value in test.values}


def uncertainties_of(test: AxisTest) -> dict[str, float]:
    return {value.symbol: value.U for value in test.values}


def by_the_standard(readings) -> dict[str, float]:
    """ISO 230-2:2014, 2.10 to 2.22 and 8.3, target by target."""
    up = {p: statistics.fmean(ways[0]) for p, ways in readings.items()}
    down = {p: statistics.fmean(ways[1]) for p, ways in readings.items()}
    s_up = {p: statistics.stdev(ways[0]) for p, ways in readings.items()}
    s_down = {p: statistics.stdev(ways[1]) for p, ways in readings.items()}
    reversal = {p: up[p] - down[p] for p in readings}
    middle = [(up[p] + down[p]) / 2 for p in readings]
    return {
        "B": max(abs(b) for b in reversal.values()),
        "mean B": sum(reversal.values()) / len(reversal),
        "E forward": max(up.values()) - min(up.values()),
        "E backward": max(down.values()) - min(down.values()),
        "E": max(*up.values(), *down.values()) - min(*up.values(), *down.values()),
        "M": max(middle) - min(middle),
        "R forward": max(4 * s for s in s_up.values()),
        "R backward": max(4 * s for s in s_down.values()),
        "R": max(max(2 * s_up[p] + 2 * s_down[p] + abs(reversal[p]), 4 * s_up[p], 4 * s_down[p]) for p in readings),
        "A forward": max(up[p] + 2 * s_up[p] for p in up) - min(up[p] - 2 * s_up[p] for p in up),
        "A backward": max(down[p] + 2 * s_down[p] for p in up) - min(down[p] - 2 * s_down[p] for p in up),
        "A": max(max(up[p] + 2 * s_up[p], down[p] + 2 * s_down[p]) for p in up)
        - min(min(up[p] - 2 * s_up[p], down[p] - 2 * s_down[p]) for p in up),
    }


# ---- the values


def test_older_standards_by_hand():
    """As below: two targets, means 1 and 12 forward, -1 and 10 backward, s of 2 ** 0.5 times 1 and 2, 0 and 2."""
    (test,) = evaluate(
        measured({0.0: ([0.0, 2.0], [-1.0, -1.0]), 100.0: ([10.0, 14.0], [8.0, 12.0])}, u=1.0, u_per_m=20.0)
    )
    root2, scale = math.sqrt(2.0), 20.0 * 0.1
    of_1988, vdi = (
        {value.symbol: (value.value, value.U) for value in values} for values in with_others(test).others.values()
    )
    assert {symbol: value for symbol, (value, _) in of_1988.items()} == pytest.approx(
        {
            "B": 2.0, "R forward": 12 * root2, "R backward": 12 * root2, "R": 12 * root2 + 2.0,
            "A forward": 11 + 9 * root2, "A backward": 11 + 6 * root2, "A": 11 + 9 * root2,
        }
    )  # fmt: skip
    assert {symbol: value for symbol, (value, _) in vdi.items()} == pytest.approx(
        {
            "U max": 2.0, "U mean": 2.0, "Ps max": 12 * root2, "Ps mean": 7.5 * root2, "Pa": 11.0,
            "P": (11 + 1 + 6 * root2) - (0 - 1 - 1.5 * root2),
        }
    )  # fmt: skip
    assert of_1988["A"][1] == pytest.approx(2 * math.hypot(math.sqrt(1 + 9 + 9), scale))
    assert vdi["P"][1] == pytest.approx(2 * math.hypot(math.sqrt(1 + 4 * 1.5**2), scale))
    assert vdi["U mean"][1] == pytest.approx(2 * math.sqrt(4 * 0.25 / 2)), "the scale cancels"


def test_older_standards_need_both_directions_and_repeated_runs():
    (one_way,) = evaluate(measured({0.0: ([0.0, 2.0], []), 100.0: ([10.0, 14.0], [])}))
    assert [value.symbol for value in with_others(one_way).others["ISO 230-2:1988"]] == ["R forward", "A forward"]
    assert with_others(one_way).others["VDI/DGQ 3441:1977"] == ()


def test_values_of_the_standard():
    (test,) = evaluate(measured(READINGS))
    assert values_of(test) == pytest.approx(by_the_standard(READINGS), abs=1e-9)
    assert list(values_of(test)) == [
        "B", "mean B", "E forward", "E backward", "E", "M", "R forward", "R backward", "R", "A forward", "A backward", "A",
    ]  # fmt: skip
    assert (test.axis, test.unit, test.position_unit, test.notes) == ("X", "um", "mm", ())


def test_by_hand():
    """Small enough for a pencil: two targets, readings 0 2 and 10 14 forward, -1 -1 and 8 12 backward."""
    (test,) = evaluate(
        measured({0.0: ([0.0, 2.0], [-1.0, -1.0]), 100.0: ([10.0, 14.0], [8.0, 12.0])}, u=1.0, u_per_m=20.0)
    )
    root2 = math.sqrt(2.0)
    np.testing.assert_allclose(test.mean, [[1, 12], [-1, 10]], atol=1e-12)
    np.testing.assert_allclose(test.spread, [[root2, 2 * root2], [0, 2 * root2]], atol=1e-12)
    assert values_of(test) == pytest.approx(
        {
            "B": 2.0, "mean B": 2.0, "E forward": 11.0, "E backward": 11.0, "E": 13.0, "M": 11.0,
            "R forward": 8 * root2, "R backward": 8 * root2, "R": 8 * root2 + 2.0,
            "A forward": 11.0 + 6 * root2, "A backward": 11.0 + 4 * root2, "A": 11.0 + 6 * root2,
        },
        abs=1e-12,
    )  # fmt: skip
    scale = 20.0 * 0.1  # um per m over 0.1 m
    assert uncertainties_of(test) == pytest.approx(
        {
            "B": 2 * 1.0, "mean B": 2 * math.sqrt(4 * 0.25 / 2),
            "E forward": 2 * math.hypot(1.0, scale), "E backward": 2 * math.hypot(1.0, scale),
            "E": 2 * math.hypot(1.0, scale), "M": 2 * math.hypot(math.sqrt(0.5), scale),
            "R forward": 8.0, "R backward": 8.0, "R": 2 * math.sqrt(4 + 4 + 1),
            "A forward": 2 * math.hypot(math.sqrt(1 + 8), scale), "A backward": 2 * math.hypot(math.sqrt(1 + 8), scale),
            "A": 2 * math.hypot(math.sqrt(1 + 8), scale),
        }
    )  # fmt: skip


def test_equal_readings_are_not_known_exactly():
    """Also a reversal of none, and a range of none, is a difference of two means that have their noise."""
    from calibration.reports.iso230 import number

    for backward in (1.0, 3.0, -2.0):
        (test,) = evaluate(measured({p: ([1.0] * 4, [backward] * 4) for p in (0.0, 100.0, 200.0)}, u=0.5, u_per_m=0.0))
        values, U = values_of(test), uncertainties_of(test)
        assert values["B"] == abs(1.0 - backward)
        assert U["B"] == pytest.approx(2 * 0.5 * math.sqrt(2 / 4))
        assert U["E forward"] == pytest.approx(U["B"])
        assert U["M"] == pytest.approx(2 * 0.5 * math.sqrt(0.25))
        assert U["R"] >= U["B"]
        assert min(U.values()) > 0.0
        assert not any(math.copysign(1.0, value) < 0 for value in values.values() if value == 0.0)
    assert (number(-0.001), number(-0.0), number(-0.02)) == ("0.00", "0.00", "-0.02")


reading = st.floats(-50, 50).map(lambda value: round(value, 2))
cells = st.integers(2, 6).flatmap(lambda n: st.tuples(*[st.lists(reading, min_size=n, max_size=n)] * 2))


@given(st.dictionaries(st.integers(0, 4000).map(float), cells, min_size=1, max_size=6))
def test_values_of_any_readings(readings):
    (test,) = evaluate(measured(readings))
    assert values_of(test) == pytest.approx(by_the_standard(readings), abs=1e-9)
    assert all(value.U >= 0 for value in test.values)


@pytest.mark.statistical
def test_uncertainty_by_simulation():
    """U of every value against the scatter that noise of the instrument makes of it."""
    rng = np.random.default_rng(5)
    seen = []
    for _ in range(1500):
        scale = rng.normal(0.0, 2.0) * 1e-3
        noisy = {
            p: tuple(
                [r + scale * p + noise for r, noise in zip(way, rng.normal(0.0, 0.02, 5), strict=True)] for way in ways
            )
            for p, ways in READINGS.items()
        }
        (test,) = evaluate(measured(noisy, u=0.02, u_per_m=2.0))
        seen.append(list(values_of(test).values()))
    (test,) = evaluate(measured(READINGS, u=0.02, u_per_m=2.0))
    np.testing.assert_allclose(2.0 * np.std(seen, axis=0), list(uncertainties_of(test).values()), rtol=0.1)


def test_rotary_axis():
    readings = {p / 4: ways for p, ways in READINGS.items()}
    (test,) = evaluate(measured(readings, DMU50, "C"))
    assert values_of(test) == pytest.approx(by_the_standard(readings), abs=1e-7)
    assert (test.unit, test.position_unit, test.u_per_m) == ("urad", "deg", 0.0)
    assert test.positions.tolist() == [0, 62.5, 125, 187.5, 250]


# ---- data that is not complete


def test_missing_readings():
    readings = {p: ([*ways[0]], [*ways[1]]) for p, ways in READINGS.items()}
    readings[250.0][0][2] = None
    (test,) = evaluate(measured(readings))
    kept = {p: tuple([r for r in way if r is not None] for way in ways) for p, ways in readings.items()}
    assert values_of(test) == pytest.approx(by_the_standard(kept), abs=1e-9)
    assert test.count[FORWARD].tolist() == [5, 4, 5, 5, 5]
    assert "X: fewer than 5 forward readings at 250 mm" in test.notes
    assert (
        "X: 5 targets, 4 to 5 readings each: ISO 230-2 requires at least 5 targets and 5 runs in each direction"
        in test.notes
    )


def test_target_without_one_direction():
    """Values of both directions take the targets that have both; those of one direction take all of theirs."""
    readings = {**READINGS, 1250.0: ([99.0, 99.5, 98.5, 99.0, 99.0], [])}
    (test,) = evaluate(measured(readings))
    whole = by_the_standard(READINGS)
    found = values_of(test)
    for symbol in ("B", "mean B", "M", "E", "R", "A", "E backward"):
        assert found[symbol] == pytest.approx(whole[symbol])
    assert found["E forward"] == pytest.approx(99.0)
    assert "X: no backward reading at 1250 mm" in test.notes
    motion, backlash = test.effects(GANTRY)
    assert motion.basis.nodes == tuple(READINGS)
    assert backlash.width == pytest.approx(-whole["mean B"])


def test_one_direction():
    (test,) = evaluate(measured({p: (ways[0], []) for p, ways in READINGS.items()}))
    assert list(values_of(test)) == ["E forward", "R forward", "A forward"]
    assert test.notes == ("X: forward runs only: the reversal value and all bidirectional values are missing",)
    (motion,) = test.effects(GANTRY)
    assert motion.parameters == pytest.approx([statistics.fmean(ways[0]) for ways in READINGS.values()])
    assert test.table(BACKWARD) == ()


def test_one_run():
    (test,) = evaluate(measured({p: (ways[0][:1], ways[1][:1]) for p, ways in READINGS.items()}))
    assert list(values_of(test)) == ["B", "mean B", "E forward", "E backward", "E", "M"]
    assert test.notes == ("X: one run only: the repeatability is unknown (no s, R and A)",)
    assert test.json()["targets"][0]["forward"] == {"mean_um": 0.0, "s_um": None, "runs": 1}


def test_several_axes_in_one_file(tmp_path):
    path = tmp_path / "laser.csv"
    path.write_text(
        "# machine: dmu50\n# instrument: interferometer\n# u_um: 0.3\n"
        "axis,run,direction,target_mm,target_deg,deviation_um,deviation_urad\n"
        "Z,1,+,0,,1,\nZ,1,+,100,,2,\nB,1,+,,0,,10\nB,1,+,,90,,30\nB,1,-,,90,,20\n"
    )
    tests = evaluate(read_measurement(path, DMU50))
    assert [test.axis for test in tests] == ["B", "Z"]
    assert tests[0].mean[FORWARD].tolist() == pytest.approx([10, 30])
    assert tests[0].reversal[1] == pytest.approx(10)


def test_refused(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("# instrument: laser-tracker\n# u_range_um: 1\n# u_angle_um: 1\nX,x,y,z\n0,1,2,3\n")
    with pytest.raises(UserError, match="needs data of an interferometer"):
        evaluate(read_measurement(path, GANTRY))
    still = measured({0.0: ([1.0], []), 10.0: ([1.0], [])})
    still.state.approach[0] = 0.0
    with pytest.raises(UserError, match=r"laser\.csv: the direction of approach of X to its target is unknown"):
        evaluate(still)
    (test,) = evaluate(measured({0.0: ([1.0], [2.0])}))
    with pytest.raises(UserError, match="axis X: an error table needs at least two targets"):
        test.effects(GANTRY)


# ---- tables and effects


def test_tables():
    (test,) = evaluate(measured(READINGS, u=0.3, u_per_m=0.5))
    pooled = math.sqrt(statistics.fmean(statistics.variance(way) for ways in READINGS.values() for way in ways))
    for way in (FORWARD, BACKWARD):
        for row, (position, ways) in zip(test.table(way), READINGS.items(), strict=True):
            u = math.sqrt((pooled**2 + 0.3**2) / 5 + (0.5 * position / 1000) ** 2)
            assert row == pytest.approx((position, statistics.fmean(ways[way]), u, 5))


BACKWARD_X = machines.parse(
    (machines.FOLDER / "gantry.toml").read_text().replace("[axes.X]", "[axes.X]\ndirection = [-1, 0, 0]"), "m"
)


@pytest.mark.parametrize(
    ("machine", "axis"), [(GANTRY, "X"), (BACKWARD_X, "X"), (DMU50, "B"), (DMU50, "C"), (DMU50, "Z")]
)
def test_effects_give_the_readings_back(machine, axis):
    """A machine with the effects found is measured as the data say, also on an axis that runs against its letter."""
    scale = 0.1 if axis in "BCZ" else 1.0
    readings = {p * scale: ([up[0]] * 2, [up[0] - 3.0] * 2) for p, (up, _) in READINGS.items()}
    data = measured(readings, machine, axis)
    (test,) = evaluate(data)
    effects = test.effects(machine)
    made = Provenance("test", no_errors(machine).provenance.made_at)
    model = ErrorModel(machine=reference(machine), provenance=made, effects=effects)
    zeros = Registration(zeros=dict.fromkeys(np.unique(data.groups).tolist(), 0.0))
    errors = model.observation(machine, data.state)
    np.testing.assert_allclose(
        data.instrument.expected(data, zeros, Observation(errors.errors, errors.shift)), data.observed, atol=1e-9
    )
    assert effects[1].width == pytest.approx(-3.0)


def test_effects_of_known_errors():
    """A table and a backlash put into readings come out again, with u that cover the noise."""
    rng = np.random.default_rng(3)
    nodes = tuple(np.linspace(0, 1000, 11).tolist())
    truth = ErrorMotion(
        component="X", axis="X", basis=BSpline(nodes, 1), parameters=tuple(rng.normal(0, 10, 11)), u=(0.0,) * 11
    )
    pulls = []
    for _ in range(60):
        readings = {
            p: tuple((truth.parameters[i] + sign * 4.0 + rng.normal(0, 0.8, 5)).tolist() for sign in (-1, 1))
            for i, p in enumerate(nodes)
        }
        (test,) = evaluate(measured(readings, u=0.05, u_per_m=0.0))
        motion, backlash = test.effects(GANTRY)
        assert isinstance(backlash, Backlash)
        pulls.append([
            *(np.array(motion.parameters) - truth.parameters) / np.array(motion.u),
            (backlash.width - 8.0) / backlash.u[0],
        ])  # fmt: skip
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.1)


def test_json_is_plain():
    (test,) = evaluate(measured(READINGS))
    data = json.loads(json.dumps(test.json()))
    assert data["values"]["B"].keys() == {"value_um", "U_um"}
    assert data["targets"][1]["position_mm"] == 250


def test_a_small_uncertainty_is_not_shown_as_zero(command, tmp_path):
    written(measured(READINGS, u=0.002, u_per_m=0.0), tmp_path / "laser.csv")
    done = command("iso230", "laser.csv", "--machine", "gantry")
    shown = done.out.decode()
    assert "± 0.00" in shown
    assert not re.search(r"± 0\.0+(?![0-9])", shown)
    table = shown.partition("U (k=2")[2]
    assert not re.search(r"  0\.0+ *$", table.partition("deviations in")[0], re.MULTILINE)


def test_the_page_has_the_chart_of_each_axis(command, tmp_path):
    written(measured(READINGS), tmp_path / "laser.csv")
    done = command("iso230", "laser.csv", "--machine", "gantry", "--report", "laser.html")
    assert done.status == 0
    page = (tmp_path / "laser.html").read_text()
    assert "Axis X: chart" in page
    assert "ncomp iso230 laser.csv --machine gantry" in page
    assert len(figures(page)) == 1
