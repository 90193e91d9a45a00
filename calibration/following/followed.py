"""The result of following a machine: its drift at a time, with its uncertainty, and where it is known from."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np

from calibration.following.earlier import Learned
from calibration.following.terms import Structure
from calibration.following.walk import walked
from calibration.gaussian_terms.posterior import Equations, Posterior
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.provenance import SIMULATED, Provenance
from kinematics.files.text_cells import number_at
from kinematics.files.time_stamps import ZONE, moment, seconds_between
from kinematics.state import REFERENCE_DEGC
from kinematics.transforms import Array
from kinematics.user_error import UserError
from kinematics.version import VERSION
from rendering.shown import Shown

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement
    from kinematics.effects import Effect


class Implausible(NamedTuple):
    """A reading that is left out."""

    row: int
    log_odds: float
    """That it has a shift of its own, against probing, walk and sensors."""


class Place(NamedTuple):
    """The drift at a place of the log."""

    number: int
    """That of the place in the touches."""
    name: str
    drift: Array
    """Deviation since the reference `(3,)`, um, tool relative to workpiece, in the workpiece frame."""
    u: Array
    """Standard uncertainties `(3,)`, um; infinite in directions that the feature does not show."""


@dataclass(frozen=True, repr=False)
class Estimate(Shown):
    """The drift from the reference to a time."""

    effects: tuple[Effect, ...]
    """The parameters that drift, with their values."""
    covariance: Array
    """Their covariance `(p, p)`, in their units."""
    by_sensors: Array
    """The part of each value that its sensors explain `(p,)`; the rest is the walk."""
    places: tuple[Place, ...]
    age_s: float
    """Time from the last plausible reading, s."""

    @property
    def values(self) -> Array:
        """`(p,)`, in the units of the effects."""
        return np.array([effect.parameters[0] for effect in self.effects])

    @property
    def largest(self) -> float:
        """Largest drift in one direction of a place, um."""
        return max(float(np.abs(place.drift[np.isfinite(place.u)]).max()) for place in self.places)

    @property
    def U(self) -> float:
        """Largest expanded uncertainty (k = 2) in one direction of a place, um."""
        return max(2.0 * float(place.u[np.isfinite(place.u)].max()) for place in self.places)

    @property
    def significant(self) -> bool:
        """True where the drift is larger than its uncertainty (k = 2) in a direction of a place."""
        return any(bool(np.any(np.abs(place.drift) > 2.0 * place.u)) for place in self.places)

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return f"drift up to {self.largest:.1f} um, U (k=2) {self.U:.1f} um"

    def on(self, model: ErrorModel) -> ErrorModel:
        """A calibration with the drift added, which no work offset that was touched off before contains."""
        old, new = len(model.parameters), len(self.effects)
        covariance = np.zeros((old + new, old + new))
        before = model.covariance
        u = [v for effect in model.effects for v in effect.uncertainties]
        covariance[:old, :old] = np.diag(np.square(u)) if before is None else np.array(before)
        covariance[old:, old:] = self.covariance
        joined = msgspec.structs.replace(model, effects=(*model.effects, *self.effects))
        return joined.with_parameters(joined.parameters, covariance)


@dataclass(frozen=True, repr=False)
class Followed(Shown):
    """What a log of touches tells of the drift of a machine."""

    measurement: Measurement
    structure: Structure
    implausible: tuple[Implausible, ...]
    learned: tuple[Learned, ...] = ()
    """Earlier logs that were given, and what they count for."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        terms, left_out = len(self.structure.terms), len(self.implausible)
        return f"{len(self.measurement)} readings, {terms} dependences on sensors, {left_out} readings left out"

    @cached_property
    def times(self) -> Array:
        """Times of the plausible readings `(n,)`, s."""
        time = self.structure.touches.measurement.state.time
        assert time is not None
        return time

    def seconds(self, stamp: str | None, name: str) -> float | None:
        """A time stamp by the clock of the log, or a number of seconds, in seconds of the log.

        UserError for another text, where only one of both clocks states its zone, and for an hour that the clock of the
        log has twice.
        """
        if stamp is None or ":" not in stamp:
            return None if stamp is None else number_at(stamp, name)
        start, given = self.measurement.start, moment(stamp, name)
        if start is None:
            raise UserError(f"{name} {stamp}: {self.measurement.source} has times in s and no date: give the time in s")
        if given.tzinfo is None and start.tzinfo is not None:
            given = given.replace(tzinfo=start.tzinfo)
            if given.utcoffset() != given.replace(fold=1).utcoffset():
                raise UserError(f"{name} {stamp}: the clock has this hour twice, or not at all: add +01:00 or +02:00")
        if given.tzinfo is not None and start.tzinfo is None:
            raise UserError(
                f"{name} {stamp}: {self.measurement.source} does not state the zone of its clock: write "
                f"'# {ZONE}: Europe/Berlin' into it"
            )
        return seconds_between(start, given)

    def at(
        self,
        time: float | None = None,
        *,
        since: float | None = None,
        temperatures: Mapping[str, float] | None = None,
    ) -> Estimate:
        """The drift from the time `since` to `time`, s, by default of all readings of the last run.

        temperatures: degC at that time, by sensor; of the others the last reading counts. UserError for a time before
        the last reading, and for an unknown sensor.
        """
        first, last = self.first, float(self.times[-1])
        until, begin = last if time is None else time, first if since is None else since
        if until < last:
            raise UserError(f"--at: {last - until:.0f} s before the last reading: a drift is given from then on")
        if not first <= begin <= until:
            raise UserError("--since: expected a time between the first reading, of the last run, and --at")
        kelvin = self._temperatures(temperatures or {})
        structure = self.structure
        touches, places = structure.touches, 3 * (int(structure.touches.places.max()) + 1)
        found = walked(touches, structure.columns, structure.sizes, begin, until)
        white, state = found.columns[0], found.state[0]
        posterior = Posterior.of(Equations.of(white[:, 1:], white[:, 0]), structure.prior, 1.0)
        direct = np.zeros((len(touches.effects), len(posterior.mean)))
        for k, term in enumerate(structure.terms):
            course = structure.course(term, kelvin, until)
            then = float(np.interp(begin, self.times, course[:-1]))
            direct[term.parameter, places + k] = course[-1] - then
        free = direct - state[:, 1:]
        values = state[:, 0] + free @ posterior.mean
        covariance = found.covariance[0] + free @ posterior.covariance @ free.T
        own = zip(touches.effects, values.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True)
        effects = tuple(effect.with_parameters([value], (u,)) for effect, value, u in own)
        by_sensors = direct @ posterior.mean
        return Estimate(effects, covariance, by_sensors, self._places(values, covariance), until - last)

    @property
    def first(self) -> float:
        """Time of the first reading, of the last run where there are several, s."""
        run = self.structure.touches.measurement.run
        return float(self.times[0] if run is None else self.times[run == run[-1]][0])

    def _temperatures(self, given: Mapping[str, float]) -> dict[str, float]:
        known = self.structure.touches.measurement.state.temperatures
        for name in given:
            if name not in known:
                raise UserError(f"--temperature {name}: the log has no such sensor: {', '.join(known) or 'none'}")
        return {name: given[name] - REFERENCE_DEGC if name in given else float(own[-1]) for name, own in known.items()}

    def _places(self, values: Array, covariance: Array) -> tuple[Place, ...]:
        touches = self.structure.touches
        machine, limit = touches.measurement.machine, touches.measurement.machine.priors.largest_correction_um
        rotary = machine.rotary
        found = []
        run = touches.measurement.run
        for place in np.unique(touches.places if run is None else touches.places[run == run[-1]]).tolist():
            row = int(np.flatnonzero(touches.places == place)[-1])
            jacobian = touches.jacobian[row]
            u = np.sqrt(np.einsum("ip,pq,iq->i", jacobian, covariance, jacobian))
            u[np.diagonal(touches.covariances[row]) > limit**2] = np.inf
            angles = np.degrees(touches.measurement.state.positions[row, rotary])
            turned = [
                f"{axis.name}{angle:g}" for axis, angle in zip(np.array(machine.axes)[rotary], angles, strict=True)
            ]
            found.append(Place(place, " ".join([str(touches.measurement.groups[row]), *turned]), jacobian @ values, u))
        return tuple(found)

    def coefficients(self) -> list[tuple[float, float]]:
        """The coefficient of each term with its standard uncertainty, per K in the unit of the parameter."""
        structure = self.structure
        white = structure.walked(structure.columns).columns[0]
        posterior = Posterior.of(Equations.of(white[:, 1:], white[:, 0]), structure.prior, 1.0)
        count = len(structure.terms)
        own = posterior.mean[len(posterior.mean) - count :], np.sqrt(np.diag(posterior.covariance))[-count or None :]
        return list(zip(*(each.tolist() for each in own), strict=True)) if count else []

    def provenance(self, calibration: ErrorModel) -> Provenance:
        """That of a calibration with the drift added: it keeps the validity of the calibration."""
        inputs = {**calibration.provenance.inputs, self.measurement.source: self.measurement.fingerprint}
        with_others = ", learned with ".join(["", *(each.source for each in self.learned if each.readings)])
        drift = (
            f"drift by {self.measurement.source}{with_others}{f', {SIMULATED}' if self.measurement.simulated else ''}"
        )
        return msgspec.structs.replace(
            calibration.provenance,
            made_by=f"ncomp {VERSION}",
            made_at=datetime.datetime.now(datetime.UTC).replace(microsecond=0),
            source=f"{calibration.provenance.source}; {drift}".removeprefix("; "),
            inputs=inputs,
        )
