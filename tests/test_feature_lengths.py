"""How short a way errors bend on: what every effect says of it, against what it does."""

import numpy as np
import pytest
from support.effect_examples import EXAMPLES, full_state

from kinematics.effects import QuantisedCompensation
from kinematics.error_model.model import LONGEST_FEATURE

STEPS = 4
"""In which moves are looked at on a bend length."""
DENSE = 16
SHARE = 0.04
"""Share of the size of an effect that two bends within a step may hide."""
OF_MACHINE = [example for example in EXAMPLES if example.effect.ACTS_ON != "instrument"]


def along(effect, machine, axis, points):
    """What an effect adds `(components, points)` along one axis, mm or rad, at positions in mm or degrees."""
    i = machine.index(axis)
    states = full_state(machine, len(points))
    first = states.rows(np.zeros(len(points), int))
    first.positions[:, i] = points * machine.scale[i]
    return np.array([values for _, _, values in effect.contributions(machine, first)])


@pytest.mark.parametrize("example", OF_MACHINE, ids=lambda example: example.name)
def test_second_differences_bound_what_lies_between(example):
    effect, machine = example.effect, example.machine
    for axis in machine.axes:
        turns = axis.rotary and effect.ACTS_ON == "workpiece"  # the path of a part on a rotary axis
        length = effect.feature_lengths.get(axis.name, np.rad2deg(LONGEST_FEATURE) if turns else None)
        if effect.HAS_MEMORY or isinstance(effect, QuantisedCompensation):
            continue  # depends on rows before; jumps, which nothing bounds
        low, high = np.clip(axis.travel, -360.0, 360.0)
        step = min(length or np.inf, (high - low) / 2) / STEPS
        points = low + step / DENSE * np.arange(DENSE * min(int((high - low) / step), 200) + 1)
        for values in along(effect, machine, axis.name, points):
            coarse = values[::DENSE]
            between = np.abs(values - np.interp(points, points[::DENSE], coarse))[:-1].reshape(-1, DENSE).max(axis=1)
            bends = np.abs(np.diff(coarse, 2))
            if length is None:
                assert between.max() <= 1e-12
                continue
            bends = np.concatenate([4.0 * bends[:1], bends, 4.0 * bends[-1:]])
            assert (between - (bends[:-1] + bends[1:]) / 4.0).max() <= SHARE * np.ptp(values) + 1e-12
