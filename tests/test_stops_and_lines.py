"""Stops, lines, cycles and held-out blocks of the designs that shops measure, from the order of the rows alone."""

import itertools

import numpy as np
import pytest

import machines
from calibration.instruments import Interferometer, LaserTracker
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.observation.stops_and_lines import cycles, held_out_blocks, lines
from kinematics.state import State

GANTRY = machines.load("gantry")
TRACKER = LaserTracker(u_range_um_per_m=0.25, u_angle_um=5.0, u_angle_um_per_m=1.0)
LENGTHS = np.array([5000.0, 3000.0, 1500.0])
TARGETS = {name: Target((30.0 * k, 0.0, -120.0)) for k, name in enumerate("abc")}


def tracked(shares, targets=None, **columns):
    """A tracker's rows at shares `(n, 3)` of the travel."""
    n = len(shares)
    names = np.resize(list("ab") if targets is None else targets, n)
    state = State(np.asarray(shares) * LENGTHS, target=names, station=columns.pop("station", None))
    return Measurement(GANTRY, TRACKER, with_moves(state), np.zeros((n, 3)), TARGETS, **columns)


def laser(positions, run=None, approach=None):
    """An interferometer's rows along X."""
    q = np.zeros((len(positions), 3))
    q[:, 0] = positions
    came = None if approach is None else np.stack([np.array(approach, float), *np.zeros((2, len(q)))], axis=1)
    state = with_moves(State(q), came)
    names = np.full(len(q), "1") if run is None else np.array(run).astype(str)
    return Measurement(GANTRY, Interferometer(u_um=0.3), state, np.zeros((len(q), 1)), axis=np.full(len(q), "X"),
                       run=names)  # fmt: skip


def out_and_back(levels=(0.0, 0.5, 1.0), number=9):
    """Lines along each axis, out and back with the turning point read twice, as in an ordinary run."""
    share = np.linspace(0.0, 1.0, number)
    rows, line = [], []
    for axis in range(3):
        for others in itertools.product(levels, levels):
            for at in (*share, *share[::-1]):
                rows.append(np.insert(others, axis, at))
                line.append(axis * len(levels) ** 2 + _number(others, levels))
    return np.array(rows), np.array(line)


def _number(others, levels):
    return levels.index(others[0]) * len(levels) + levels.index(others[1])


def serpentine(shape):
    """A grid, the last axis fastest, to and fro; and the line of each row."""
    path = [[]]
    for number in shape:
        at = np.linspace(0.0, 1.0, number)
        path = [[*head, x] for i, head in enumerate(path) for x in (at if i % 2 == 0 else at[::-1]).tolist()]
    return np.array(path), np.arange(len(path)) // shape[-1]


def same_partition(found, expected):
    """True where two labellings divide the rows alike."""
    pairs = set(zip(np.asarray(found).tolist(), np.asarray(expected).tolist(), strict=True))
    return len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


def scattered(number, seed=0):
    return np.random.default_rng(seed).uniform(size=(number, 3))


def test_rows_at_one_position_in_sequence_are_one_stop():
    shares = np.repeat(scattered(20), 3, axis=0)
    data = tracked(shares, targets=list("abc"))
    assert data.stops.tolist() == np.repeat(np.arange(20), 3).tolist()
    jitter = tracked(shares + np.random.default_rng(1).uniform(-4e-4, 4e-4, shares.shape) / LENGTHS)
    assert jitter.stops.tolist() == data.stops.tolist()


@pytest.mark.parametrize("column", ["run", "station"])
def test_a_stop_ends_with_its_run_and_its_station(column):
    data = tracked(np.tile(scattered(1), (6, 1)), **{column: np.array(["1"] * 2 + ["2"] * 4)})
    assert data.stops.tolist() == [0, 0, 1, 1, 1, 1]


def test_a_position_reached_from_the_other_side_is_another_stop():
    data = laser([0, 1, 2, 2, 1, 0], approach=[1, 1, 1, -1, -1, -1])
    assert data.stops.tolist() == [0, 1, 2, 3, 4, 5]


def test_lines_out_and_back_are_one_block_each():
    shares, line = out_and_back()
    found = lines(tracked(shares))
    assert same_partition(found, line)
    labels, name = held_out_blocks(tracked(shares))
    assert name == "lines"
    assert len(np.unique(labels)) == 24
    for number in range(27):
        assert len(np.unique(labels[line == number])) == 1


def test_lines_with_random_stops_are_lines_and_regions():
    shares, line = out_and_back()
    data = tracked(np.concatenate([shares, scattered(150)]))
    assert (lines(data)[len(line) :] == -1).mean() > 0.98
    labels, name = held_out_blocks(data)
    assert name == "lines and regions of stops"
    assert labels.min() == 0
    assert len(np.unique(labels)) == 24
    own = lines(data)
    for label in np.unique(labels):
        assert len(np.unique(own[labels == label] < 0)) == 1
    assert np.bincount(labels[len(line) :]).max() < 30


def test_the_two_passes_of_a_serpentine_grid_share_their_lines():
    there, line = serpentine((4, 3, 5))
    data = tracked(np.concatenate([there, there[::-1]]))
    assert same_partition(lines(data), np.concatenate([line, line[::-1]]))
    labels, name = held_out_blocks(data)
    assert name == "lines"
    assert len(np.unique(labels)) == 12


def test_lines_of_a_small_grid_have_three_positions():
    there, line = serpentine((3, 3, 3))
    assert same_partition(lines(tracked(there)), line)


def test_many_lines_are_grouped():
    there, line = serpentine((8, 8, 6))
    labels, _ = held_out_blocks(tracked(there))
    assert len(np.unique(labels)) == 24
    assert all(len(np.unique(labels[line == number])) == 1 for number in range(64))


def test_lines_in_one_direction_only():
    """Each line is approached from its start again: the way back is not measured."""
    share = np.linspace(0.0, 1.0, 7)
    rows = [np.insert(others, axis, at) for axis in range(3) for others in itertools.product((0.2, 0.8), repeat=2)
            for at in share]  # fmt: skip
    assert same_partition(lines(tracked(rows)), np.repeat(np.arange(12), 7))


def test_body_diagonals_are_lines():
    share = np.linspace(0.0, 1.0, 10)[:, None]
    corners = [((0, 0, 0), (1, 1, 1)), ((1, 0, 0), (0, 1, 1)), ((0, 1, 0), (1, 0, 1)), ((1, 1, 0), (0, 0, 1))]
    rows = np.concatenate([np.array(a) + share * (np.array(b) - np.array(a)) for a, b in corners])
    data = tracked(np.concatenate([rows, rows[::-1]]))
    assert same_partition(lines(data), np.concatenate([np.repeat(np.arange(4), 10), np.repeat(np.arange(4), 10)[::-1]]))
    labels, name = held_out_blocks(data)
    assert (len(np.unique(labels)), name) == (4, "lines")


def test_faces_are_held_out_by_line():
    """Six faces, each a serpentine grid; an edge that two faces cross belongs to one of the lines through it."""
    grid, line = serpentine((5, 6))
    faces = [np.insert(grid, axis, at, axis=1) for axis in range(3) for at in (0.0, 1.0)]
    data = tracked(np.concatenate(faces))
    labels, name = held_out_blocks(data)
    assert name == "lines"
    assert len(np.unique(labels)) == 24
    found = lines(data)
    for face, number in itertools.product(range(6), range(5)):
        rows = face * 30 + np.flatnonzero(line == number)
        assert len(np.unique(found[rows])) == 1


def test_random_stops_are_regions_with_all_targets_and_all_visits():
    where = np.repeat(scattered(60), 3, axis=0)
    order = np.random.default_rng(3).permutation(60)
    again = where.reshape(60, 3, 3)[order].reshape(-1, 3)
    data = tracked(np.concatenate([where, again]), targets=list("abc"), run=np.repeat(["1", "2"], 180))
    assert lines(data).max() == -1
    labels, name = held_out_blocks(data)
    assert name == "regions of stops"
    assert len(np.unique(labels)) == 8
    position = np.unique(data.state.positions, axis=0, return_inverse=True)[1].reshape(-1)
    assert all(len(np.unique(labels[position == number])) == 1 for number in range(60))


def test_a_line_that_no_other_row_covers_is_divided():
    """One line along each axis: without it nothing is known of the axis."""
    share = np.linspace(0.0, 1.0, 20)
    rows = [np.insert((0.5, 0.5), axis, at) for axis in range(3) for at in share]
    labels, name = held_out_blocks(tracked(rows))
    assert name == "regions of stops"
    assert len(np.unique(labels)) >= 6


def test_reference_visits_do_not_break_a_line():
    shares, line = out_and_back()
    home = np.full((1, 3), 0.33)
    parts = [np.concatenate([home, shares[start : start + 6]]) for start in range(0, len(shares), 6)]
    data = tracked(np.concatenate(parts))
    found = lines(data)
    measured = ~np.isclose(data.state.positions / LENGTHS, 0.33).all(axis=1)
    assert same_partition(found[measured], line)
    assert (found[~measured] == -1).all()


@pytest.mark.parametrize(
    "rows",
    [
        [0, 1, 2, 3, 3, 2, 1, 0] * 5,  # the turning points read twice
        [0, 1, 2, 3] * 5,  # one way
        ([0, 1, 2, 3, 2, 1] * 5)[:30],  # the turning points read once
        np.repeat([0, 1, 2, 3, 3, 2, 1, 0] * 5, 2).tolist(),  # every reading twice
    ],
)
def test_cycles_of_iso_230_2_are_found_by_the_recurring_targets(rows):
    data = laser(100.0 * np.array(rows))
    assert cycles(data).tolist() == np.repeat(np.arange(5), len(rows) // 5).tolist()
    labels, name = held_out_blocks(data)
    assert name == "cycles"
    assert len(np.unique(labels)) == 5


def test_cycles_with_stated_directions_and_runs():
    there = [0, 1, 2, 3, 3, 2, 1, 0]
    stated = laser(np.array(there * 4) * 100.0, approach=([1] * 4 + [-1] * 4) * 4)
    assert cycles(stated).tolist() == np.repeat(np.arange(4), 8).tolist()
    named = laser(np.array(there * 4) * 100.0, run=np.repeat([7, 3, 9, 1], 8))
    assert cycles(named).tolist() == np.repeat(np.arange(4), 8).tolist()


def test_two_runs_predict_each_other_and_one_is_held_out_by_position():
    there = np.linspace(0.0, 5000.0, 20)
    runs = np.repeat([1, 2], 40)
    labels, name = held_out_blocks(laser(np.concatenate([there, there[::-1]] * 2), run=runs))
    assert name == "cycles"
    assert labels.tolist() == (runs - 1).tolist()
    data = laser(np.concatenate([there, there[::-1]]), run=np.ones(40))
    labels, name = held_out_blocks(data)
    assert name == "sets of positions"
    assert all(len(np.unique(labels[data.state.positions[:, 0] == at])) == 1 for at in there)


def test_a_continuous_record_is_held_out_by_stretches():
    data = laser(np.linspace(0.0, 5000.0, 4000))
    labels, _ = held_out_blocks(data)
    assert len(np.unique(labels)) == 8
    assert np.count_nonzero(np.diff(labels)) == 63


def test_no_rows_and_one_position():
    assert tracked(np.zeros((0, 3))).stops.tolist() == []
    labels, _ = held_out_blocks(tracked(np.tile(scattered(1), (5, 1))))
    assert labels.tolist() == [0] * 5
