"""Periodic errors of the axes as terms, proposed from what a structure leaves of the observations.

Their periods cannot all be in a dictionary: the positioning error of each axis is scanned for them. A wave (`Cyclic`),
and a sawtooth of steps (`QuantisedCompensation`), are families of their own; several waves of one axis too.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import msgspec
import numpy as np

from calibration.diagnosis.forms import of_others, plain
from calibration.diagnosis.prior_odds import odds_of_kind, with_log_prior
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Structure
from calibration.gaussian_terms.term import Term
from calibration.measurement.measurement import Measurement
from kinematics.effects import Cyclic, Effect, QuantisedCompensation
from kinematics.effects.base import own_component, unit_of
from kinematics.transforms import Array

LEADS_MM = (4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 25.0, 32.0, 40.0)
"""Leads of ball screws (ISO 3408-2) of machine tools, whose turns give the commonest periodic errors of linear axes."""
SHORTEST_PERIOD_MM, SHORTEST_PERIOD_DEG = min(LEADS_MM), 1.0
"""Shortest period: a turn of a ball screw, and a tooth of a gear with 360 of them, more than most rotary axes have."""
OF_LEADS = 0.5
"""Share of the periodic errors whose period is one of these: the others are of couplings, scales, racks, belts."""
POSITIONS_OF_PERIOD = 4
"""Positions of a log in a shorter period, which its positions show by design."""
WAVE_HARMONICS = (1, 2, 4, 8, 16)
"""Numbers of harmonics of a wave, with the same odds: a scale, a gear or a screw repeats exactly, but is no sine."""
FEWEST_TURNS = 3.0
"""Fewest periods over the travel; longer ones are error motions."""
TURNING_PARTS = 3
"""Most waves, or sawteeth, of an axis: its motor, its gear and its screw turn."""
SCAN_STEP_PERIODS = 0.4
"""Step of a scan, in periods over the travel: neighbours have nearly the same wave."""
PEAKS = 3
"""Periods of each axis that are proposed."""
STEPS_APART = 3
"""Steps of the scan by which they differ at least."""
MEMBERS = 4
"""Members of a proposal between two steps of the scan."""
PERIODS_BETWEEN = 10
"""Periods between two neighbours at a time."""
CLOSER = 4.0
"""Distance to the neighbours of a finer member, in half distances of finer members: what is found later, beside it,
moves the likeliest period by one of them."""
OFFSETS, FINER_OFFSETS = 32, 5
"""Offsets of a sawtooth that are tried, over its pitch, and those between two neighbours at a time."""


def waves(structure: Structure, without: Collection[int] = ()) -> list[Term]:
    """Waves and sawteeth near the likeliest periods of each axis, with their prior odds.

    They are sought in what the structure leaves, or would leave without the terms of some numbers: these are in their
    place. A family is shared by all proposals for one more wave of an axis; it is that of a term left out where this is
    a wave of the axis.
    """
    known = {term.family for number, term in enumerate(structure.terms) if number not in without}
    left = _left(structure, without)
    scans = [Scan.of(structure, left, axis) for axis in structure.data.observations.measurement.moving]
    proposed = [term for scan in scans for term in (*scan.of_leads(), *scan.waves(), *scan.sawteeth())]
    return [_in_family(term, family) for term in proposed if (family := _one_more(term.family, known)) is not None]


def waves_of_motions(structure: Structure) -> list[Term]:
    """Waves in the place of finer error motions of a structure, which hide them from `waves`; with their prior odds."""
    observations, known = structure.data.observations, {term.family for term in structure.terms}
    left = beside_waves(structure)[: observations.residual.size]
    proposed = [term for axis in observations.measurement.moving for term in Scan.of(structure, left, axis).waves()]
    return [_in_family(term, family) for term in proposed if (family := _one_more(term.family, known)) is not None]


def beside_waves(structure: Structure) -> Array:
    """Whitened residual `(N,)` of a structure without its finer error motions."""
    geometry, kept = structure.data.geometry, np.ones(len(structure.sizes), bool)
    kept[: geometry.width] = ~geometry.wavy[geometry.bands]
    return np.asarray(structure.equations.residual - structure.explained(kept))


def _left(structure: Structure, without: Collection[int]) -> Array:
    """Whitened residual `(n d,)` of a structure without the terms of some numbers; nothing else is fitted again."""
    kept = np.ones(len(structure.sizes), bool)
    for number in without:
        kept[structure.columns_of(number)] = False
    observations = structure.data.observations
    return np.asarray(structure.equations.residual - structure.explained(kept))[: observations.residual.size]


def _one_more(family: Hashable, known: Collection[Hashable]) -> Hashable | None:
    """The first family of these that is not known: of the first, the second, ... wave of an axis; None beyond them."""
    numbered = [family, *((family, count) for count in range(2, TURNING_PARTS + 1))]
    return next((each for each in numbered if each not in known), None)


def _in_family(term: Term, family: Hashable) -> Term:
    finer = term.finer
    if finer is None:
        return replace(term, family=family)
    return replace(term, family=family, finer=lambda: [_in_family(each, family) for each in finer()])


def shortest_period(measurement: Measurement, axis: str) -> float:
    """The shortest period that is sought along an axis, mm or degrees."""
    low, high = measurement.moving[axis]
    shortest = SHORTEST_PERIOD_DEG if axis[0] in "ABC" else SHORTEST_PERIOD_MM
    return min(shortest, POSITIONS_OF_PERIOD * (high - low) / measurement.distinct_positions[axis])


@dataclass(frozen=True)
class Scan:
    """What may be left of the positioning error of an axis, at each of its positions."""

    observations: Observations
    axis: str
    positions: Array
    """Different positions `(m,)`, mm or degrees."""
    along: Array
    """Products `(m,)` of the whitened arm of the error, um or urad, with the whitened residual at each position."""
    weight: Array
    """Squares `(m,)` of the arm."""
    travel: float
    """Length that the positions cover, mm or degrees."""
    turns: Array
    """Periods over the travel `(k,)` that are scanned."""

    @cached_property
    def _of_harmonics(self) -> dict[int, Term]:
        """A wave of any period, by its number of harmonics."""
        return {}

    @classmethod
    def of(cls, structure: Structure, left: Array, axis: str) -> Scan:
        """The scan of an axis, by a whitened residual `(n d,)`; of no periods where the travel has too few."""
        observations = structure.data.observations
        measurement = observations.measurement
        low, high = measurement.moving[axis]
        turns = np.arange(FEWEST_TURNS, (high - low) / shortest_period(measurement, axis), SCAN_STEP_PERIODS)
        arm = observations.transform[:, :, observations.own_arm(axis)] * unit_of(axis)[1]
        arm = structure.whitener.rows(arm[:, :, None])[:, 0]
        position = measurement.state.position(measurement.machine, axis)
        positions, number = np.unique(position, return_inverse=True)
        rows = len(observations), observations.components
        along = np.bincount(number, (arm * left).reshape(rows).sum(axis=1)).astype(float)
        weight = np.bincount(number, (arm**2).reshape(rows).sum(axis=1)).astype(float)
        return cls(observations, axis, positions, along, weight, high - low, turns)

    def of_leads(self) -> Iterator[Term]:
        """Waves with the periods of usual ball screws, which half of the periodic errors of linear axes have."""
        for lead in LEADS_MM if self._of_other_periods < 1.0 else ():
            turns = self.travel / lead
            if turns >= FEWEST_TURNS:
                term = self._wave(turns, SCAN_STEP_PERIODS / MEMBERS, 1)
                yield self._with_odds(term, len(LEADS_MM) / OF_LEADS)

    @property
    def _of_other_periods(self) -> float:
        """Share of the periodic errors of the axis whose period is none of a usual screw."""
        return 1.0 if self.axis[0] in "ABC" else 1.0 - OF_LEADS

    def waves(self) -> Iterator[Term]:
        """Waves near the likeliest periods."""
        for turns in self._proposed_turns:
            scanned = MEMBERS * len(self.turns)
            yield self._with_odds(self._wave(turns, SCAN_STEP_PERIODS / MEMBERS, 1), scanned / self._of_other_periods)

    def _wave(self, turns: float, step: float, harmonics: int) -> Term:
        """A wave of so many periods over the travel; those of its neighbours are one step more and less.

        Its finer members have other periods, or more harmonics: also shorter ones than any lead.
        """
        closer, period = CLOSER * step / (PERIODS_BETWEEN + 1), self.travel / turns
        if harmonics not in self._of_harmonics:
            orders, zeros = np.tile(np.arange(1.0, harmonics + 1.0), 2), (0.0,) * harmonics
            wave = Cyclic(own_component(self.axis), self.axis, period, zeros, zeros)
            self._of_harmonics[harmonics] = plain(self.observations, wave, 1.0 / orders)
        any_period = self._of_harmonics[harmonics]
        near = [
            (other, harmonics) for way in _between(PERIODS_BETWEEN) if (other := turns + way * step) >= FEWEST_TURNS
        ]
        near += [(turns, more) for more in WAVE_HARMONICS if more > harmonics]
        effect = msgspec.structs.replace(any_period.effects[0], period=period)
        return of_others(
            self.observations,
            any_period,
            (effect,),
            lambda: [self._wave(other, closer, count) for other, count in near],
        )

    def sawteeth(self) -> Iterator[Term]:
        """Sawteeth near the likeliest periods, each at its likeliest offset."""
        shares = np.arange(OFFSETS) / OFFSETS
        for turns in self._proposed_turns:
            best = float(shares[np.argmax(self._gains_of_teeth(turns, shares))])
            yield self._with_odds(
                self._teeth(turns, best, SCAN_STEP_PERIODS / MEMBERS, 1.0 / OFFSETS),
                MEMBERS * len(self.turns) * OFFSETS,
            )

    def _teeth(self, turns: float, share: float, step: float, apart: float) -> Term:
        """A sawtooth of so many teeth over the travel, a share of the pitch behind the middle of the travel.

        Its neighbours have one step more and less teeth, and are a share of `apart` away.
        """
        pitch = self.travel / turns
        effect = QuantisedCompensation(self.axis, 0.0, pitch, (self._middle + share * pitch) % pitch)
        closer = CLOSER * step / (PERIODS_BETWEEN + 1), CLOSER * apart / (FINER_OFFSETS + 1)
        others = [other for way in _between(PERIODS_BETWEEN) if (other := turns + way * step) >= FEWEST_TURNS]
        near = list(product(others, _between(FINER_OFFSETS)))
        return self._term(effect, lambda: [self._teeth(other, share + off * apart, *closer) for other, off in near])

    def _gains_of_teeth(self, turns: float, shares: Array) -> Array:
        """Squares `(k,)` that sawteeth of these offsets explain."""
        phase = (self.positions - self._middle)[:, None] * (turns / self.travel) - shares
        teeth = 0.5 - (phase - np.floor(phase))
        return np.asarray((self.along @ teeth) ** 2 / np.maximum(self.weight @ teeth**2, np.finfo(float).tiny))

    @property
    def _middle(self) -> float:
        return float(self.positions[0] + self.positions[-1]) / 2.0

    def _term(self, effect: Effect, finer: Callable[[], Sequence[Term]]) -> Term:
        return replace(plain(self.observations, effect), finer=finer)

    def _with_odds(self, term: Term, members: float) -> Term:
        """The term with its odds: those of its kind, shared by so many members, and by the axes."""
        axes = len(self.observations.measurement.moving)
        odds = odds_of_kind(term, self.observations.priors) / (axes * members)
        return with_log_prior(term, float(np.log(odds)))

    @cached_property
    def _proposed_turns(self) -> list[float]:
        """Periods over the travel near the likeliest ones, between the neighbours in the scan; none of a short axis."""
        if not len(self.turns):
            return []
        peaks: list[int] = []
        for number in np.argsort(-self._power()).tolist():
            if all(abs(number - other) > STEPS_APART for other in peaks):
                peaks.append(number)
            if len(peaks) == PEAKS:
                break
        near = SCAN_STEP_PERIODS / MEMBERS * np.arange(-MEMBERS, MEMBERS + 1)
        proposed = [float(self.turns[peak] + change) for peak in peaks for change in near]
        return [turns for turns in proposed if turns >= FEWEST_TURNS]

    def _power(self) -> Array:
        """Squares `(k,)` that waves explain, as at dense positions.

        Each wave is the product of a coarse one and of a fine one: few exponentials are computed.
        """
        fine = int(np.ceil(np.sqrt(len(self.turns))))
        shares = 2j * np.pi * (self.positions - self._middle)[:, None] / self.travel
        coarse = np.exp(shares * self.turns[::fine]) * self.along[:, None]
        sums = coarse.T @ np.exp(shares * SCAN_STEP_PERIODS * np.arange(fine))
        return np.asarray(np.abs(sums.reshape(-1)[: len(self.turns)]) ** 2)


def _between(count: int) -> list[float]:
    """Evenly spaced numbers between -1 and 1, without these."""
    return [float(share) for share in np.linspace(-1.0, 1.0, count + 2)[1:-1]]
