"""Other orders of the axes in a machine's chain: the machine's file may be wrong.

Only the nominal machine is compared, which has no free parameter but its registration. Linear axes next to each other
can be exchanged without a change of the nominal points: their order shows in the lever arms of angular errors only.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.measurement.measurement import STANDSTILL_RANGE, Measurement
from calibration.plausibility.recording_mistakes import Reversed
from kinematics.machine import split_chain

SAME_NOMINAL_MM = 1e-6
"""Distance, mm, up to which the nominal points of two chains are the same."""


def other_chains(measurement: Measurement) -> Reversed:
    """The measurement with each rotary axis that moves at any other position of the chain, also beyond the bed.

    Chains with the same nominal points are tried once.
    """
    machine = measurement.machine
    links = machine.chain.split()[1:-1]
    moving = np.ptp(measurement.state.positions / machine.scale, axis=0) > STANDSTILL_RANGE
    known = [measurement.nominal_points]
    for axis, moves in zip(machine.axes, moving.tolist(), strict=True):
        others = [link for link in links if link != axis.name]
        for place in range(len(links) if axis.rotary and moves else 0):
            chain = f"w {' '.join([*others[:place], axis.name, *others[place:]])} t"
            other = _in_order(measurement, chain)
            points = other.nominal_points
            if all(np.abs(points - each).max() > SAME_NOMINAL_MM for each in known):
                known.append(points)
                by = f"with the axes in the order {chain}"
                yield f"{by} (the machine's file has {machine.chain}: check it against the machine)", other


def _in_order(measurement: Measurement, chain: str) -> Measurement:
    """The measurement as one of the machine with this chain; columns of the state other than positions stay."""
    machine, state = measurement.machine, measurement.state
    places = split_chain(chain)
    axes = tuple(replace(machine.axes[machine.index(name)], side=side) for name, side in places)
    positions = state.positions[:, [machine.index(name) for name, _ in places]]
    return replace(measurement, machine=replace(machine, axes=axes), state=replace(state, positions=positions))
