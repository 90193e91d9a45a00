"""Mistakes in writing a measurement down: each is found and named, and none where there is none."""

import re
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from support.tiers import STATISTICAL, quick
from support.virtual_measurements import MONTAVON, ONE, THREE, measured, positions, truth

import machines
from calibration.instruments import Interferometer
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.measurement.readers import read_any
from calibration.plausibility.chain_order import other_chains
from calibration.plausibility.checks import sanity
from calibration.plausibility.finding import Finding
from calibration.simulation.simulate import Faults, observe, spoil
from kinematics.effects import Backlash, FollowingError
from kinematics.error_model.model import no_errors
from kinematics.machine import split_chain
from kinematics.state import State

MACHINES = {name: machines.load(name) for name in machines.names()} | {"montavon": MONTAVON}
GANTRY, DMU50 = MACHINES["gantry"], MACHINES["dmu50"]


def virtual(machine, n=300, seed=1, targets=THREE, size=50.0, stations=1):
    rng = np.random.default_rng(seed)
    return measured(machine, positions(machine, n, rng), targets, truth(machine, rng, size), rng, stations=stations)


def the_only(findings: list[Finding]) -> Finding:
    assert len(findings) == 1, findings
    return findings[0]


def moved(m: Measurement, q) -> Measurement:
    return replace(m, state=replace(m.state, positions=q))


# ---- nothing


@pytest.mark.parametrize("name", quick(MACHINES, ["gantry", "dmu50", "head_head", "trunnion_ac"]))
def test_nothing_wrong(name):
    """Errors of 100 um and urad, outliers, three targets: a machine like others."""
    m = virtual(MACHINES[name], size=100.0)
    assert sanity(m) == []
    spoiled, _ = spoil(m, Faults(outliers=0.05), np.random.default_rng(3))
    assert sanity(spoiled) == []


def test_nothing_wrong_with_one_target_and_two_stations():
    assert sanity(virtual(GANTRY, targets=ONE, stations=2)) == []


def test_nothing_wrong_with_an_interferometer():
    assert sanity(laser()) == []


def test_nothing_fatal_with_real_plates(plates):
    cframe = machines.load("cframe")
    files = sorted(path for path in plates.rglob("*") if path.is_file())
    assert files
    for path in files:
        m = read_any(path, cframe, "cmm", header={"u_um": "2.3", "part_offset": "350 350 100", "target.t": "0 0 -80"})
        assert sanity(m) == [], path


def test_nothing_wrong_with_the_real_slit_axis(slit_log):
    single = machines.load(str(Path(__file__).parents[1] / "examples" / "single_axis.toml"))
    names = {"command": "IOC_TEST:Axis1-PosAct", "observed": "IOC_TEST:ec0-s4-EL7211-Enc-PosAct"}
    assert sanity(read_any(slit_log, single, header={**names, "axis": "X", "u_um": "0.5"})) == []


# ---- the chain of the machine's file


def in_the_file(m: Measurement, chain: str) -> Measurement:
    """The measurement as read with a machine's file of another chain."""
    machine, places = m.machine, split_chain(chain)
    other = replace(machine, axes=tuple(replace(machine.axes[machine.index(name)], side=side) for name, side in places))
    positions = m.state.positions[:, [machine.index(name) for name in other.names]]
    return replace(m, machine=other, state=State(positions, target=m.state.target, observed=m.observed))


@pytest.mark.parametrize(
    ("name", "chain", "found"),
    [
        ("trunnion_ac", "w A C b X Y Z t", "w C A b X Y Z t"),
        ("head_head", "w b X Y Z B C t", "w b X Y Z C B t"),
        ("dmu50", "w C b X Y Z B t", "w C B b X Y Z t"),
        ("head_table", "w b X Y Z B C t", "w C b X Y Z B t"),
    ],
)
def test_a_wrong_order_of_the_axes_is_found(name, chain, found):
    m = in_the_file(virtual(MACHINES[name], n=120), chain)
    finding = the_only(sanity(m))
    assert (finding.check, finding.fatal) == ("chain", True)
    expected = f"with the axes in the order {found} (the machine's file has {chain}: check it against the machine)"
    assert finding.message.endswith(expected)


def test_orders_with_the_same_nominal_points_are_tried_once():
    """Linear axes, rotary axes that stand still, C beside Z, and the bed where nothing on it is observed."""
    q = positions(DMU50, 20, np.random.default_rng(1))
    m = moved(virtual(DMU50, n=20), np.where(np.array(DMU50.names) == "C", 0.0, q))
    chains = [other.machine.chain for _, other in other_chains(m)]
    assert chains == ["w C b X B Y Z t", "w C b X Y B Z t", "w C b X Y Z B t"]
    assert not list(other_chains(virtual(GANTRY, n=20)))
    assert len(list(other_chains(replace(m, stands_on="bed")))) > len(chains)


# ---- mistakes of points


def spoiled_units(m):
    return replace(m, observed=m.observed / 25.4)


def spoiled_metres(m):
    return replace(m, observed=m.observed / 1000)


def spoiled_scale(m):
    return replace(m, observed=m.observed * 1.03)


def spoiled_commands(m):
    return moved(m, m.state.positions / np.where(m.machine.rotary, 1.0, 25.4))


def spoiled_frame(m):
    return replace(m, observed=m.observed * (1, -1, 1))


def exchanged(one, other):
    def spoil(m):
        i, j = m.machine.index(one), m.machine.index(other)
        order = np.arange(len(m.machine.axes))
        order[[i, j]] = j, i
        return moved(m, m.state.positions[:, order])

    return spoil


def scaled(axis, factor):
    def spoil(m):
        return moved(m, m.state.positions * np.where(np.array(m.machine.names) == axis, factor, 1.0))

    return spoil


def exchanged_targets(m):
    return replace(m, targets={**m.targets, "1": m.targets["2"], "2": m.targets["1"]})


def reversed_target(m):
    x, y, z = m.targets["2"].position
    return replace(m, targets={**m.targets, "2": Target((-x, -y, -z))})


def reversed_length(m):
    x, y, z = m.targets["3"].position
    return replace(m, targets={**m.targets, "3": Target((x, y, -z))})


@pytest.mark.parametrize("noise_of_machine", quick([5.0, 50.0], [50.0]))
@pytest.mark.parametrize(
    ("machine", "spoiled", "what", "words"),
    [
        (GANTRY, spoiled_units, "units", "with the points divided by 0.0393701 (inch and mm mixed up)"),
        (GANTRY, spoiled_metres, "units", "with the points divided by 0.001 (m, mm or um mixed up)"),
        (GANTRY, spoiled_scale, "units", "(a scale +3 % off)"),
        (DMU50, spoiled_commands, "units", "with the commands of linear axes multiplied by 25.4 (inch and mm mixed up)"),
        (GANTRY, spoiled_frame, "mirrored", "with the points' frame mirrored"),
        pytest.param(DMU50, spoiled_frame, "mirrored", "with the points' frame mirrored", marks=STATISTICAL),
        (GANTRY, exchanged("X", "Y"), "axes", "with columns X and Y exchanged"),
        (DMU50, exchanged("B", "C"), "axes", "with columns C and B exchanged"),
        (GANTRY, scaled("Z", -1.0), "sign", "with the sign of Z reversed"),
        (DMU50, scaled("C", -1.0), "sign", "with the sign of C reversed"),
        pytest.param(DMU50, scaled("B", -1.0), "sign", "with the sign of B reversed", marks=STATISTICAL),
        (DMU50, scaled("C", np.pi / 180), "degrees", "with C read as rad"),
        pytest.param(DMU50, scaled("B", np.pi / 180), "degrees", "with B read as rad", marks=STATISTICAL),
        (GANTRY, exchanged_targets, "targets", "with targets 1 and 2 exchanged"),
        (GANTRY, reversed_target, "targets", "with the sign of target 2 reversed"),
        (GANTRY, reversed_length, "targets", "with the sign of z of target 3 reversed"),
        pytest.param(DMU50, reversed_length, "targets", "with the sign of z of target 3 reversed", marks=STATISTICAL),
    ],
)  # fmt: skip
def test_mistakes(machine, spoiled, what, words, noise_of_machine):
    found = the_only(sanity(spoiled(virtual(machine, 150, size=noise_of_machine))))
    assert found.fatal
    assert found.check == what
    assert words in found.message
    assert "do not show" not in found.message


@pytest.mark.parametrize("share", [0.7, 0.3])
def test_targets_that_are_exchanged_at_a_moment(share):
    """The exchanged part may be the smaller or the larger one; which of them is right, the points do not show."""
    m = virtual(GANTRY, 150)
    late = np.arange(150) >= 150 * share
    names = np.where(m.state.target == "1", "2", np.where(m.state.target == "2", "1", m.state.target))
    spoiled = replace(m, state=replace(m.state, target=np.where(late, names, m.state.target)))
    spoiled = replace(spoiled, lines=np.arange(150) + 8, source="m.csv")
    found = the_only(sanity(spoiled))
    assert found.fatal
    assert found.check == "targets"
    where = re.search(r"with targets 1 and 2 exchanged (up to|behind) m.csv:(\d+)", found.message)
    assert where
    assert int(where[2]) == pytest.approx(150 * share + 8, abs=6)


def test_what_can_not_be_told_apart_is_told_so():
    """With one target on three linear axes, a mirrored frame and a reversed axis are the same."""
    found = the_only(sanity(spoiled_frame(virtual(GANTRY, targets=ONE))))
    assert "frame mirrored" in found.message
    assert "with the sign of X reversed" in found.message
    assert found.message.endswith("; these data do not show which of them")


def test_a_part_measured_from_its_back(plates):
    """A real plate whose x runs the other way."""
    path = sorted(path for path in plates.rglob("*") if path.is_file())[0]
    m = read_any(path, machines.load("cframe"), "cmm", header={"u_um": "2.3", "part_offset": "350 350 100"})
    found = the_only(sanity(replace(m, observed=m.observed * (-1, 1))))
    assert found.fatal
    assert "with the points' frame mirrored" in found.message


def test_a_target_that_is_rarely_used():
    m = virtual(GANTRY, n=400)
    rare = (m.state.target != "2") | (np.arange(400) % 12 == 0)
    found = the_only(sanity(reversed_target(m.rows(np.flatnonzero(rare)))))
    assert "with the sign of target 2 reversed" in found.message


def test_points_of_something_else():
    m = virtual(GANTRY)
    found = the_only(sanity(replace(m, observed=m.observed[np.random.default_rng(0).permutation(300)])))
    assert (found.check, found.fatal) == ("unexplained", True)


def test_station_that_does_not_fit():
    m = virtual(GANTRY, 180, stations=3)
    mine = m.groups == "s2"
    observed = m.observed.copy()
    observed[mine] += np.linspace(0, 8.0, mine.sum())[np.random.default_rng(0).permutation(mine.sum()), None]
    found = the_only(sanity(replace(m, observed=observed)))
    assert (found.check, found.fatal) == ("station", False)
    assert "points of station s2 differ" in found.message


def test_copies():
    m, notes = spoil(virtual(GANTRY), Faults(duplicates=0.1), np.random.default_rng(1))
    assert notes == ("30 doubled rows",)
    found = the_only(sanity(m))
    assert (found.check, found.fatal) == ("copies", False)
    assert found.message.startswith("30 of 330 rows are copies")


# ---- an interferometer


PLAY = (Backlash("X", 12.0),)


def laser(effects=PLAY, runs=4, feeds=None, seed=1):
    """Runs along X of a gantry, there and back, at feeds, mm/min."""
    there = np.linspace(0.0, 2000.0, 21)
    one, way = np.concatenate([there, there[::-1]]), np.repeat([1.0, -1.0], 21)
    q = np.zeros((42 * runs, 3))
    q[:, GANTRY.index("X")] = np.tile(one, runs)
    approach = np.zeros(q.shape)
    approach[:, GANTRY.index("X")] = np.tile(way, runs)
    cycle = np.repeat(np.arange(float(runs)), 42)
    speed = np.zeros(q.shape) if feeds is None else approach * np.repeat(feeds, 42)[:, None] / 60.0
    model = msgspec.structs.replace(no_errors(GANTRY), effects=effects)
    state = State(q, approach=approach, velocity=speed, cycle=cycle)
    names = (cycle + 1).astype(int).astype(str)
    return observe(
        GANTRY,
        model,
        state,
        Interferometer(u_um=0.5),
        np.random.default_rng(seed),
        axis=np.full(len(q), "X"),
        run=names,
    )


def test_readings_instead_of_deviations():
    m = laser()
    x = m.state.positions[:, [GANTRY.index("X")]]
    found = the_only(sanity(replace(m, observed=m.observed + x)))
    assert (found.check, found.fatal) == ("units", True)
    assert found.message.startswith("the deviations of X grow by 1000 um/mm along the travel")


def test_first_cycle():
    found = the_only(sanity(first_run_off()))
    assert (found.check, found.fatal) == ("first cycle", False)
    assert "at 42 positions" in found.message


def test_zeros_of_runs_are_no_first_cycle():
    m = laser(runs=5)
    assert sanity(replace(m, observed=m.observed + 0.05 * (m.state.cycle == 0)[:, None])) == []


def first_run_off():
    """A first run with 6 um more backlash, which no zero of a run takes up."""
    m = laser(runs=5)
    more = 0.003 * np.where(m.state.cycle == 0, -m.state.approach[:, GANTRY.index("X")], 0.0)
    return replace(m, observed=m.observed + more[:, None])


def test_clock():
    m = laser((FollowingError("X", lag_ms=3.0),), feeds=[3000.0, 6000.0, 3000.0, 6000.0])
    found = the_only(sanity(m))
    assert (found.check, found.fatal) == ("clock", False)
    assert found.message.startswith("rows in motion were observed 3 ms earlier than their positions were noted")
    assert found.message.endswith("(two clocks, or following error)")


def test_one_speed_does_not_tell_a_lag_from_play():
    m = laser((FollowingError("X", lag_ms=3.0),), feeds=[3000.0] * 4)
    assert the_only(sanity(m)).message.endswith("(two clocks, following error or backlash)")


def test_play_is_no_lag():
    assert sanity(laser(feeds=[500.0, 8000.0, 500.0, 8000.0])) == []


def test_clock_far_off():
    m = laser((FollowingError("X", lag_ms=-50.0),), feeds=[3000.0, 6000.0, 3000.0, 6000.0])
    found = the_only(sanity(m))
    assert (found.check, found.fatal) == ("clock", True)
    assert "50 ms later" in found.message


# ---- read-back


def test_machine_that_did_not_stand_where_it_was_told():
    """Short by 40 ppm of the last move; the read-back knows it."""
    rng = np.random.default_rng(5)
    q = positions(GANTRY, 300, rng)
    state = with_moves(State(q))
    m = measured(GANTRY, q, ONE, no_errors(GANTRY), rng)
    actual = q - 40e-6 * state.last_move
    stood = measured(GANTRY, actual, ONE, no_errors(GANTRY), np.random.default_rng(6))
    m = replace(m, observed=stood.observed, actual=actual)
    found = sanity(m)
    assert [f.check for f in found] == ["read-back"] * 3
    assert not any(f.fatal for f in found)
    for f in found:
        assert "the observed deviation follows with slope 1.0" in f.message or "slope 0.9" in f.message
        assert "by -40 ppm of the last move: the axis had not settled" in f.message


def test_read_back_that_agrees():
    m = virtual(GANTRY)
    assert sanity(replace(m, actual=m.state.positions + 1e-4)) == []


@pytest.mark.parametrize(("apart", "axes"), [(5e-6, []), (2e-4, ["B", "C"])])
def test_read_back_of_rotary_axes_has_a_bound_of_its_own(apart, axes):
    """A step of 0.001 deg in the file is rounding; 0.2 mrad, 60 um at 300 mm, is not."""
    m = virtual(DMU50)
    turned = np.where(DMU50.rotary, np.random.default_rng(2).normal(0.0, apart, m.state.positions.shape), 0.0)
    found = sanity(replace(m, actual=m.state.positions + turned))
    assert sorted(finding.message.split()[4] for finding in found) == axes
    assert all(finding.message.startswith("read-back and command of") for finding in found)


def test_rows_in_no_order_of_time_and_kelvin_are_refused():
    measurement = virtual(MACHINES["cframe"], n=60)
    assert not [finding for finding in sanity(measurement) if finding.fatal]
    shuffled = measurement.rows(np.random.default_rng(2).permutation(60))
    assert [finding.check for finding in sanity(shuffled) if finding.fatal] == ["order"]
    once = np.r_[30:60, 0:30]
    assert not [finding for finding in sanity(measurement.rows(once)) if finding.fatal]
    for kelvin, fatal in ((5.0, []), (40.0, []), (274.0, ["units"])):
        state = replace(measurement.state, temperatures={"spindle": np.full(60, kelvin)})
        found = sanity(replace(measurement, state=state))
        assert [finding.check for finding in found if finding.fatal] == fatal
