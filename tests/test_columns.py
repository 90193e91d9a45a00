"""The chain as columns gives the poses of the exact matrix product."""

import numpy as np
import pytest
from hypothesis import strategies as st
from support.random_chains import chains
from support.tiers import drawn

import machines
from kinematics.columns import ChainColumns, length, minus, point_deviations, rows_of, vector
from kinematics.deviation import exact_deviation
from kinematics.forward import forward
from kinematics.machine import Machine

MM, DIRECTION = 1e-10, 1e-13


def assert_agrees(machine: Machine, seed: int, size: float, rows: int = 40) -> None:
    """Nominal and actual poses at random positions, with errors up to `size`, mm and rad, of the axes and the tool."""
    rng = np.random.default_rng(seed)
    low, high = np.clip(machine.travel, -1000.0, 1000.0)
    q = rng.uniform(low, high, (rows, len(machine.axes)))
    tool = rng.uniform(-200.0, 200.0, (rows, 3)) if seed % 2 else np.tile([0.0, 0.0, -80.0], (rows, 1))
    errors = rng.uniform(-size, size, (rows, len(machine.axes) + 1, 6))
    errors[:, rng.integers(len(machine.axes))] = 0.0
    chain = ChainColumns(machine, q)
    for given in (None, errors, errors[:, :-1]):
        pose = forward(machine, q, given)
        points = rows_of(chain.point(vector(tool), given), rows)
        assert np.abs(points - pose.apply(tool)).max() < MM
        assert np.abs(rows_of(chain.tool_axis(given), rows) - pose.rotation[:, :, 2]).max() < DIRECTION
    exact = exact_deviation(machine, q, errors, tool).position
    assert np.abs(point_deviations(machine, q, errors, tool) - exact).max() < MM
    some = np.arange(0, rows, 3)
    part = chain.rows(some).point(vector(tool[some]))
    assert np.abs(rows_of(part, len(some)) - forward(machine, q[some]).apply(tool[some])).max() < MM


@pytest.mark.parametrize("size", [1e-3, 0.3])
@pytest.mark.parametrize("name", machines.names())
def test_poses_of_every_shipped_machine(name, size):
    assert_agrees(machines.load(name), 1, size)
    assert_agrees(machines.load(name), 2, size)


NEARLY_Y = 'name = "random"\nchain = "w b C t"\naxes.C = { travel = [-200, 150], direction = [0, 1, 1.7e-10], point = [0, 0, 0] }'


@drawn(
    few=10,
    many=200,
    also={"toml": NEARLY_Y, "seed": 0, "size": 1e-5},
    toml=chains(),
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([1e-5, 1e-3, 0.3]),
)
def test_poses_of_any_chain(toml, seed, size):
    assert_agrees(machines.parse(toml, "random"), seed, size)


@pytest.mark.parametrize("name", [name for name in machines.names() if not machines.load(name).rotary.all()])
def test_linear_steps_displace_the_tool_point(name):
    machine = machines.load(name)
    rng = np.random.default_rng(4)
    q = rng.uniform(*np.clip(machine.travel, -1000.0, 1000.0), (50, len(machine.axes)))
    chain, displacement = ChainColumns(machine, q), vector(rng.uniform(-1.0, 1.0, (50, 3)))
    moved = q.copy()
    moved[:, list(machine.translators)] += rows_of(chain.linear_steps(displacement), 50)
    tool = vector((0.0, 0.0, -80.0))
    found = minus(ChainColumns(machine, moved, chain).point(tool), chain.point(tool))
    assert length(minus(found, displacement)).max() < 1e-10
