"""Causes that the data cannot show, with the measurements that would show them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.diagnosis.search.candidates import HIGHER_FREQUENCY, Candidate
from calibration.diagnosis.search.evaluation import SEEN, WORTH, Evaluated
from calibration.diagnosis.search.shapes.spectra import resolved, usual_waves
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import is_log

SIGNAL = 0.02
"""Signal period of a linear encoder, mm: glass scales have 4 to 40 um."""
FINER = "positions at finer spacing"
"""Measurement that makes an error of a higher spatial frequency visible."""
OF_ITS_RUN = "runs without a new zero of the instrument: the zero of the first run contains it"
"""Measurement that makes a transient of the first run visible where there are several runs."""


@dataclass(frozen=True)
class NotVisible:
    """A cause that these data could not show, however large."""

    name: str
    share: float
    """Share of its signal that neither the model nor the registration can imitate."""
    remedy: str


def shown_by(candidate: Candidate) -> str:
    """The measurement that makes a candidate visible."""
    return FINER if candidate.kind == HIGHER_FREQUENCY else candidate.effect.SHOWN_BY


def not_visible(evaluated: Sequence[Evaluated], measurement: Measurement) -> list[NotVisible]:
    """Causes of the library of whose signal the model and the registration leave a share below `SEEN`."""
    cycles = measurement.state.cycle
    again = {"first-cycle": OF_ITS_RUN} if cycles is not None and len(np.unique(cycles)) > 1 else {}
    best: dict[str, tuple[float, str]] = {}
    for each in evaluated:
        effect = each.candidate.effect
        if each.candidate.replaces or effect.PERIODIC or effect.OF_AXIS_LINE:
            # proposed from the residual, or differences from a calibration
            continue
        name, share = each.candidate.effect.name, each.projected.visible
        if name not in best or share > best[name][0]:
            best[name] = (share, again.get(each.candidate.kind) or shown_by(each.candidate))
    return [NotVisible(name, share, remedy) for name, (share, remedy) in best.items() if share < SEEN]


def below_spacing(measurement: Measurement) -> Iterator[NotVisible]:
    """Sub-divisional errors of encoders: cyclic, with a period that the positions of an axis do not resolve."""
    for axis, (low, high) in measurement.moving.items():
        if axis[0] in "ABC":
            continue
        waves_of = resolved if is_log(measurement, axis) else usual_waves
        shortest = (high - low) / waves_of(measurement.state.position(measurement.machine, axis), high - low)
        if shortest > SIGNAL:
            yield NotVisible(
                f"sub-divisional error of the encoder of {axis}",
                0.0,
                f"positions in steps of a few um along {axis}, over some signal periods of its encoder: these "
                f"positions show no period below {shortest:.3g} mm; the error looks like noise in {axis}",
            )


def smallest_sizes(evaluated: Sequence[Evaluated], scalars: int) -> Iterator[tuple[str, float, str]]:
    """Name, size and unit of the smallest effect of one parameter that these data would show."""
    seen = set()
    for each in evaluated:
        table = [quantity for quantity in each.candidate.effect.parameter_table if quantity.linear]
        own = float(each.projected.schur[0, 0])
        name = each.candidate.effect.name
        if len(table) == 1 and own > 0 and each.projected.visible >= SEEN and name not in seen:
            seen.add(name)
            needed = -WORTH + (1 + each.candidate.shapes) * math.log(scalars)
            yield name, table[0].typical * math.sqrt(needed / own), table[0].unit
