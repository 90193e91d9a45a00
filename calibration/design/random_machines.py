"""Random machines as coefficients: their errors are linear in these, so that a chunk of machines is one matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from calibration.simulation.true_model import HalfWidths, largest_true_model
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.machine import Machine
from kinematics.transforms import Array


@dataclass(frozen=True)
class TrueModels:
    """Virtual machines: their parameters are uniform between `low` and `high`, or fixed where the two are the same."""

    model: ErrorModel
    """The error model with all parameters at their largest values."""
    low: Array
    """Lower limits `(t,)` of the parameters, in the units of the model."""
    high: Array
    """Upper limits `(t,)` of the parameters, in the units of the model."""
    linear: Array
    """1 `(t,)` for amplitudes, 0 for parameters of their shape (a period, a time constant)."""

    @classmethod
    def of(
        cls, machine: Machine, half_widths: HalfWidths, drawn: Sequence[Effect] = (), fixed: Sequence[Effect] = ()
    ) -> TrueModels:
        """Error motions within half-widths; `drawn` effects within plus and minus their amplitudes; `fixed` ones."""
        motions = largest_true_model(machine, half_widths)
        effects = (*motions, *drawn, *fixed)
        model = msgspec.structs.replace(no_errors(machine), effects=effects)
        table = [quantity for effect in effects for quantity in effect.parameter_table]
        linear = np.array([quantity.linear for quantity in table], bool)
        moves = np.repeat(
            [k < len(motions) + len(drawn) for k in range(len(effects))], [len(e.parameters) for e in effects]
        )
        high = model.parameters
        low = np.where(moves & linear, np.maximum(-np.abs(high), [quantity.lower for quantity in table]), high)
        return cls(model, low, high, linear.astype(float))

    def draw(self, rng: np.random.Generator, number: int) -> Array:
        """Random coefficients `(t, number)`; the first draws do not depend on their number."""
        share = rng.uniform(size=(number, len(self.low)))
        return np.asarray((self.low + share * (self.high - self.low)).T)

    def variances(self) -> Array:
        """Variances `(t,)` of the coefficients: a third of the squared half-width of a uniform distribution."""
        return np.asarray((self.high - self.low) ** 2 / 12.0)

    def machine(self, coefficients: Array) -> ErrorModel:
        """The error model of one draw `(t,)`."""
        return self.model.with_parameters(coefficients)
