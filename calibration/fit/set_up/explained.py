"""The fit of a measurement whose error motions, noise and outliers the sum of Gaussian terms finds, without causes.

The terms (`calibration.gaussian_terms`) decide the sizes of the error motions, the noise and the outliers; with these
sizes as priors, and this noise, the fit is exact in all parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from calibration.fit.datum import model_in_datum
from calibration.fit.fit import Fit, fit
from calibration.fit.problem import Problem
from calibration.fit.written.calibrated import prior_sizes
from calibration.fit.written.next_stop import with_next_stop
from calibration.gaussian_terms.band_sizes import Likeliest, likeliest
from calibration.gaussian_terms.geometry import Asked, automatic_bases
from calibration.gaussian_terms.linearised import linearised
from calibration.gaussian_terms.observations import Observations, with_short_stops
from calibration.gaussian_terms.structure import MOST_STRUCTURE_ROUNDS, Data, Structure, settled
from calibration.measurement.estimated_noise import EstimatedNoise
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import BasisChoice, stated_bases, with_effects
from calibration.observation.outliers import Variance
from kinematics.effects import COMPONENTS, Backlash, Effect
from kinematics.effects.base import own_component, unit_of
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.running.progress import Progress
from kinematics.transforms import Array, blocks
from kinematics.user_error import UserError

AUTO = "auto"
"""The bases whose sizes the data decide."""
MOST_SIZING_SCALARS = 9000
"""Most observations by which sizes and noise are found; whole stops, evenly spread."""
LARGE_NOISE_FACTOR = 100.0
"""Factor on the variances of the specification with which a search begins: an instrument ten times worse."""
NOISE_STANDARD_ERRORS = 4.0
"""Standard errors by which the variances of an instrument must differ from its specification."""
NONLINEAR_ROUNDS = 2
"""Times that sizes and noise are found where effects depend on time constants or periods."""


@dataclass(frozen=True)
class Wanted:
    """Request for a fit; fields as the arguments of `calibration.fit.calibrate.calibrate`."""

    basis: str
    effects: tuple[Effect, ...]
    prior_scale: float | None
    variance: Variance
    progress: Progress

    @property
    def automatic(self) -> bool:
        """True where the data decide the sizes of all functions."""
        return self.basis == AUTO

    def asked(self, measurement: Measurement, effects: tuple[Effect, ...]) -> Asked:
        """What is stated of the fit of a measurement, with effects at their present values."""
        bases = None if self.automatic else stated_bases(self.basis, list(measurement.moving))
        own: tuple[Effect, ...] = ()
        if self.automatic:
            shown = (axis for axis in measurement.moving if measurement.errors_shown[axis].backlash)
            own = tuple(Backlash(axis, 0.0) for axis in shown)
        return Asked((*own, *effects), bases, self.prior_scale, of_fit=True, first_sides=False)


@dataclass(frozen=True)
class Explained:
    """A fit, and the structure that has found its sizes and its noise."""

    fit: Fit
    structure: Structure
    """With the likeliest sizes and noise."""

    @property
    def bases(self) -> Mapping[str, BasisChoice]:
        """The basis of the error motions of each axis."""
        stated = self.structure.data.asked.bases
        return automatic_bases(self.structure.data.observations.measurement, of_fit=True) if stated is None else stated

    @property
    def model(self) -> ErrorModel:
        """The machine in the datum, with its location errors; U contains what an axis repeats to."""
        model = model_in_datum(self.fit.model, self.fit.measurement, self.fit.prior)
        return with_next_stop(model, self.not_repeating)

    @property
    def not_repeating(self) -> Mapping[str, float]:
        """What each axis repeats to, um or urad, where the data show it; of stated bases nothing."""
        return self.structure.not_repeating if self.structure.data.asked.bases is None else {}


def explained(measurement: Measurement, wanted: Wanted) -> Explained:
    """The fit of a measurement."""
    effects, about = wanted.effects, None
    linear = all(flag for effect in effects for flag in effect.linear)
    wanted.progress("error motions and noise")
    rows, suspects = _trusted(_some(measurement.without_copies), effects)
    for _ in range(1 if linear else NONLINEAR_ROUNDS):
        observations = Observations.of(rows, about)
        data = Data.of(observations, asked=wanted.asked(rows, effects))
        structure = Structure.first(replace(data, gross=data.gross | suspects))
        # few readings do not show their noise
        find = _with_sizes if measurement.instrument.MAY_BE_FEW else _with_sizes_and_noise
        likelier = max(_ends(structure, find), key=_log_posterior)
        structure = linearised(likelier, find) if about is None else likelier
        found = _fitted(measurement, structure, wanted)
        about = msgspec.structs.replace(found.model, covariance=None)
        by_name = {effect.name: effect for effect in about.effects}
        effects = tuple(by_name[effect.name] for effect in effects)
    return Explained(found, structure)


def _starts(structure: Structure) -> Iterator[Structure]:
    """The starts of the search: where it begins with little noise, it may end where fine error motions stand for it."""
    yield structure
    if not structure.data.observations.measurement.instrument.MAY_BE_FEW:
        yield replace(structure, noise=replace(structure.noise, factor=LARGE_NOISE_FACTOR))


def _ends(structure: Structure, find: Callable[[Structure], Structure]) -> list[Structure]:
    """Where the search ends from each of its starts; UserError where it ends nowhere, as with exact readings."""
    found = []
    for first in _starts(structure):
        with suppress(np.linalg.LinAlgError):
            found.append(find(first))
    if not found:
        source = structure.data.observations.measurement.source
        raise UserError(
            f"{source}: the readings agree with the fit to rounding, so that their noise cannot be found: state the "
            "uncertainty of the instrument that they have, or add noise to simulated readings"
        )
    return found


def _log_posterior(structure: Structure) -> float:
    """Log posterior of a structure of bands alone, up to a constant of the data."""
    return structure.log_evidence + structure.log_noise_prior + _likeliest(structure).log_prior


def _with_sizes(structure: Structure) -> Structure:
    """The structure with the likeliest sizes of its bands."""
    return structure.resized(_likeliest(structure).sizes)


def _with_sizes_and_noise(structure: Structure) -> Structure:
    """The structure with the likeliest sizes, noise and outliers."""
    found = _with_sizes(structure)
    for _ in range(MOST_STRUCTURE_ROUNDS):
        before = found.noise
        found = _with_sizes(found.with_noise())
        if settled(before, found.noise):
            break
    return found


def _likeliest(structure: Structure) -> Likeliest:
    bands, priors = structure.data.geometry, structure.priors
    return likeliest(structure.equations, bands, priors, structure.noise.factor, structure.band_sizes)


def coarse_fit(measurement: Measurement, effects: Sequence[Effect] = ()) -> Fit:
    """A fit of coarse error motions, which cannot imitate single rows, with the noise of its residuals."""
    bases = {axis: _coarse(measurement, axis, choice) for axis, choice in automatic_bases(measurement).items()}
    model, prior = with_effects(measurement, bases, effects, 1.0)
    return fit(measurement, model, prior=prior, variance="estimate")


def _coarse(measurement: Measurement, axis: str, automatic: BasisChoice) -> BasisChoice:
    """A parabola of a linear axis, and waves of a rotary one: two over a whole turn, one over a part of it."""
    if automatic.kind == "fourier":
        return BasisChoice("fourier", 2)
    if measurement.machine.axes[measurement.machine.index(axis)].rotary:
        return BasisChoice("fourier", 1)
    return BasisChoice("legendre", max(1, min(2, measurement.distinct_positions[axis] - 1)))


def start_of(structure: Structure, effects: Sequence[Effect]) -> ErrorModel:
    """The model at the start of a fit: that of a structure, with stated effects at their first values."""
    stated = {effect.name: effect for effect in effects}
    own = tuple(stated.get(effect.name, effect) for effect in structure.data.geometry.effects)
    machine = structure.data.observations.measurement.machine
    return msgspec.structs.replace(no_errors(machine), effects=own)


def _fitted(measurement: Measurement, structure: Structure, wanted: Wanted) -> Fit:
    """The exact fit with sizes and noise of a structure; its covariance contains the uncertainty of the sizes."""
    noise = _noise(measurement, structure, wanted.variance)
    variance = wanted.variance if noise is None else "sheet"
    noisy, model = replace(measurement, noise=noise), start_of(structure, wanted.effects)
    found = fit(noisy, model, prior=prior_sizes(structure), variance=variance, progress=wanted.progress)
    if measurement.instrument.MAY_BE_FEW:
        return found
    known = _likeliest(structure)
    wider = prior_sizes(structure.resized(known.root_mean_squares))
    ratio = wider / found.prior
    solved = found.solved._replace(information=found.solved.information * np.outer(ratio, ratio))
    covariance = Problem.of(noisy, found.model, wider).covariance(solved, found.widening)
    moves = structure.data.geometry.parameters @ known.moves
    covariance = covariance + moves @ known.covariance @ moves.T
    return replace(found, model=found.model.with_parameters(found.model.parameters, covariance))


def _trusted(measurement: Measurement, effects: Sequence[Effect]) -> tuple[Measurement, np.ndarray]:
    """The measurement without stations that failed, and its rows, short stops apart, that disagree with the others."""
    short = with_short_stops(measurement)[0]
    if measurement.instrument.MAY_BE_FEW:
        return measurement, np.zeros(len(short), bool)
    found = coarse_fit(short, effects)
    if found.failed:
        return _trusted(measurement.rows(np.flatnonzero(~np.isin(measurement.groups, found.failed))), effects)
    return measurement, np.asarray(~found.kept | found.suspected)


def _noise(measurement: Measurement, structure: Structure, variance: Variance) -> EstimatedNoise | None:
    """The noise of a structure; None where it agrees with the specification, or is a common factor on it."""
    factor, repeats, clear = structure.noise.factor, structure.noise.repeats, structure.not_repeating
    determined = float(structure.posterior.determined.sum())
    freedom = max(structure.whitener.scalars - determined, 1.0)
    if abs(np.log(factor)) < NOISE_STANDARD_ERRORS * np.sqrt(2.0 / freedom):
        factor = 1.0
    if not clear and (factor == 1.0 or variance == "estimate"):
        return None
    sizes = {axis: size * unit_of(axis)[1] for axis, size in repeats.items()}
    return EstimatedNoise(factor, {axis: sizes[axis] for axis in clear}, measurement.stops, _arms(measurement, sizes))


def _arms(measurement: Measurement, sizes: Mapping[str, float]) -> Array:
    """Change of the observations `(n, d, axes)`, mm or rad, by positioning errors of some axes of these sizes."""
    registration, machine = measurement.first_registration[0], measurement.machine
    columns = [6 * machine.index(axis) + COMPONENTS.index(own_component(axis)) for axis in sizes]
    arms = [
        measurement.rows(rows).instrument.transform(measurement.rows(rows), registration)[:, :, columns]
        for rows in blocks(len(measurement))
    ]
    return np.asarray(np.concatenate(arms) * np.array(list(sizes.values())))


def _some(measurement: Measurement) -> Measurement:
    """Whole stops with at most MOST_SIZING_SCALARS observations, evenly spread, and the ends of the axes' ranges."""
    count = len(measurement) * measurement.components
    if count <= MOST_SIZING_SCALARS:
        return measurement
    stop, positions = measurement.stops, measurement.state.positions
    number = int(stop[-1]) + 1
    chosen = np.unique(np.linspace(0, number - 1, max(2, number * MOST_SIZING_SCALARS // count)).astype(int))
    ends = stop[np.concatenate([positions.argmin(axis=0), positions.argmax(axis=0)])]
    return measurement.rows(np.flatnonzero(np.isin(stop, np.concatenate([chosen, ends]))))
