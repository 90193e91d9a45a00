"""Causes that the data cannot show, with the measurements that would show them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from calibration.diagnosis.search.candidates import HIGHER_FREQUENCY
from calibration.diagnosis.search.evaluation import SEEN, WORTH, Evaluated
from calibration.diagnosis.search.shapes.spectra import resolved, usual_waves
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import is_log, moving_axes
from kinematics.effects import Cyclic, LocationError, QuantisedCompensation, Scale

SIGNAL = 0.02
"""Signal period of a linear encoder, mm: glass scales have 4 to 40 um."""
NOT_OF_THE_LIBRARY = Cyclic | QuantisedCompensation | LocationError | Scale
"""Effects that are proposed from the residual, or that are differences from a calibration."""
REMEDIES = {
    "backlash": "positions approached from both sides, in an order in which neither side comes later",
    "settling": "moves of different lengths to the same positions, and dwell times",
    "following-error": "the same path at two feeds, and in both directions",
    "late-read-back": "the same path at two feeds",
    "first-cycle": "a second run of the same positions",
    "thermal-drift": "positions in shuffled order, or measured once more backwards, with times",
    "thermal-scale": "positions in shuffled order, or measured once more backwards, with times and temperatures",
    "tracker-drift": "positions measured once more backwards, and fixed references on the bed",
    "tracker-range": "a calibrated bar, or fixed references of known distance (a second station helps)",
    "air-scale": "a length standard (calibrated bar, interferometer), or barometer and thermometer of the air",
    "tracker-angle": "three stations at very different azimuths, or both faces of the tracker",
    "target-offset": "targets exchanged, or the tool turned, between two runs",
    "station-shift": "fixed references, measured again and again",
    "cross-axis": "positions in which both axes move independently, over their whole travel",
    "cyclic": "positions at irregular, finer spacing",
    "quantised-compensation": "positions at irregular, finer spacing",
    HIGHER_FREQUENCY: "positions at finer spacing",
    "location": "a second tool vector, and positions over the whole travel",
    "location-jump": "the same positions before and after the moment, and fixed references on the bed",
    "reversal": "positions approached from both sides, over the whole travel",
    "lateral-play": "positions approached from both sides, with two targets far apart on the tool",
    "hysteresis": "positions at different ways behind a reversal: short steps back, and long ones",
    "reversal-spike": "positions at short steps behind a reversal",
    "servo-mismatch": "a circle or a line at 45 degrees in both directions, at two feeds",
    "thermal-scale-duty": "a log of the axis' temperature, and the same positions once more after a rest",
    "thermal-drift-duty": "the same positions after spells of different spindle speeds and after rests, with times",
    "thermal-distortion": "positions in shuffled order, or measured once more backwards, with times and temperatures",
    "joint-compliance": "the same pose with another weight at the tool, and with the arm stretched and folded",
    "ram-sag": "both axes of the ram in and out, independently of each other",
    "racking": "positions on both sides of the bridge, with two targets far apart on the tool",
    "wobble": "positions over a whole turn, with two targets far apart",
    "tracker-range-drift": "fixed references, measured again and again, at two distances in line with the tracker",
    "air-scale-drift": "a length standard, measured again and again, or barometer and thermometer of the air",
    "cmm-scale": "the part measured once more, turned by 90 degrees on the measuring machine, and a length standard",
    "cmm-squareness": "the part measured once more, turned by 90 degrees on the measuring machine",
}
"""Measurements that make a cause visible, by its kind."""


@dataclass(frozen=True)
class NotVisible:
    """A cause that these data could not show, however large."""

    name: str
    share: float
    """Share of its signal that neither the model nor the registration can imitate."""
    remedy: str


def not_visible(evaluated: Sequence[Evaluated]) -> list[NotVisible]:
    """Causes of the library of whose signal the model and the registration leave a share below `SEEN`."""
    best: dict[str, tuple[float, str]] = {}
    for each in evaluated:
        if each.candidate.replaces or isinstance(each.candidate.effect, NOT_OF_THE_LIBRARY):
            continue
        name, share = each.candidate.effect.name, each.projected.visible
        if name not in best or share > best[name][0]:
            best[name] = (share, each.candidate.kind)
    return [
        NotVisible(name, share, REMEDIES.get(kind, "other positions"))
        for name, (share, kind) in best.items()
        if share < SEEN
    ]


def below_spacing(measurement: Measurement) -> Iterator[NotVisible]:
    """Sub-divisional errors of encoders: cyclic, with a period that the positions of an axis do not resolve."""
    for axis, (low, high) in moving_axes(measurement).items():
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
