"""Another order of the linear axes: the machine's file may be wrong.

The order of linear axes next to each other changes no nominal point, only the lever arms of their angular errors: the
models of both orders are fitted and compared. The order of rotary axes shows without a model (`chain_order`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from calibration.fit.bases.search import Choice
from calibration.fit.cross_validation import CrossValidation, Gains, predicted_by_others
from calibration.fit.fit import Fit, fit
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import with_effects
from calibration.observation.stops_and_lines import held_out_blocks
from kinematics.files.number_text import rounded

MISFIT = 4.0
"""chi2 per degree of freedom, by the instrument specification, below which the order is not doubted."""
FALLS = 4.0
"""Factor by which the excess of chi2 per degree of freedom over 1 must fall."""


def other_order(measurement: Measurement, choice: Choice) -> str:
    """Finding on an order of the linear axes that predicts held-out blocks better; empty without one.

    Only neighbours on one side of the bed that both move are exchanged.
    """
    if measurement.components < 3 or measurement.across is not None:
        return ""
    own = _fitted(measurement, choice)
    if own.chi2_reduced < MISFIT:
        return ""
    tried = [_fitted(other, choice) for other in _exchanged(measurement)]
    best = min(tried, key=lambda each: each.chi2_reduced, default=own)
    if FALLS * (best.chi2_reduced - 1.0) > own.chi2_reduced - 1.0:
        return ""
    before, after = _held_out(own, choice), _held_out(best, choice)
    if before is None or after is None:
        return ""
    # both are compared with the same nominal points
    um, noise = (one - other for one, other in zip(after.gains, before.gains, strict=True))
    if not Gains(um, noise).better:
        return ""
    return (
        f"the data fit the chain {best.measurement.machine.chain} better than {measurement.machine.chain} of the "
        f"machine's file: held-out {after.name} {rounded(before.rms_um, 3)} -> {rounded(after.rms_um, 3)} um RMS, "
        f"chi2/dof {own.chi2_reduced:.3g} -> {best.chi2_reduced:.3g}. Check the order of the axes: the file's order is "
        "used, and a cross-axis error may be a consequence of it"
    )


def _fitted(measurement: Measurement, choice: Choice) -> Fit:
    model, prior = with_effects(measurement, choice.bases, (), *choice.scales)
    return fit(measurement, model, prior=prior)


def _held_out(found: Fit, choice: Choice) -> CrossValidation | None:
    good = found.good
    return predicted_by_others(
        good, *held_out_blocks(good), lambda others: _fitted(good.rows(np.flatnonzero(others)), choice)
    )


def _exchanged(measurement: Measurement) -> Iterator[Measurement]:
    """The measurement as one of machines with two linear axes exchanged."""
    machine, moving = measurement.machine, measurement.moving
    for i, (one, other) in enumerate(zip(machine.axes[:-1], machine.axes[1:], strict=True)):
        linear = not (one.rotary or other.rotary) and one.side == other.side
        if linear and one.name in moving and other.name in moving:
            order = np.arange(len(machine.axes))
            order[[i, i + 1]] = i + 1, i
            axes = tuple(machine.axes[k] for k in order.tolist())
            yield _in_order(replace(measurement, machine=replace(machine, axes=axes), actual=None), order)


def _in_order(measurement: Measurement, order: np.ndarray) -> Measurement:
    """The measurement with the columns of its axes in another order."""
    state = measurement.state
    columns: dict[str, Any] = {"positions": state.positions[:, order]}
    for name in ("approach", "last_move", "velocity", "acceleration"):
        column = getattr(state, name)
        columns[name] = None if column is None else column[:, order]
    return replace(measurement, state=replace(state, **columns))
