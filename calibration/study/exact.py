"""Some draws of a study once more by the exact kinematics, to check its linear equations."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calibration.design.equations import Sample
from calibration.design.solver import Sizes
from calibration.design.volume import Volume
from calibration.evaluation.volumetric import volumetric_error_um
from calibration.fit.linear import Part
from calibration.measurement.measurement import Measurement
from calibration.observation.normal_equations import residuals, whitened
from calibration.simulation.simulate import observe
from calibration.study.chunks import Chunk, Prepared
from kinematics.deviation import exact_deviation
from kinematics.error_model.model import ErrorModel
from kinematics.forward import tool_point
from kinematics.transforms import Array

MOST_EXACT_STEPS = 20
LAST_EXACT_STEP = 1e-6
"""Largest component of the last step, as a share of the largest parameter."""


class Compared(NamedTuple):
    """Volumetric errors `(draws,)`, um, of the same draws."""

    linear: Array
    exact: Array

    @property
    def difference(self) -> float:
        """Largest difference between the two, um."""
        return float(np.abs(self.exact - self.linear).max(initial=0.0))


def compared(prepared: Prepared, draws: int) -> Compared:
    """The first draws of a case by the linear equations, and by iterated exact kinematics, with the same noise."""
    drawn = prepared.sample(Chunk(0, draws))
    linear, exact = np.empty(draws), np.empty(draws)
    for (parts, sizes), numbers in prepared.choices(drawn).items():
        parameters = prepared.fitted(parts, sizes, drawn, numbers)
        linear[numbers] = prepared.fits.errors(parts, parameters, drawn.coefficients[:, numbers])[0]
        for number in numbers.tolist():
            true_model = prepared.case.true_models.machine(drawn.coefficients[:, number])
            found = _fitted(prepared, parts, sizes, drawn, number)
            exact[number] = _remaining_error(prepared.case.volumes[0], true_model, found)
    return Compared(linear, exact)


def measurement_of(prepared: Prepared, drawn: Sample, number: int) -> Measurement:
    """The measurement of one draw: observations by the exact kinematics, with the errors of the instrument."""
    setup, nominal = prepared.setup, prepared.setup.measurement
    true_model = prepared.case.true_models.machine(drawn.coefficients[:, number])
    seen = observe(
        nominal.machine, true_model, nominal.state, nominal.instrument, np.random.default_rng(0), setup.poses,
        nominal.targets, axis=nominal.axis, run=nominal.run, noise_scale=0.0,
    )  # fmt: skip
    # the noise of a sample is weighted, that of observations is in mm
    in_mm = np.linalg.solve(setup.white, drawn.noise[number][..., None])[..., 0]
    errors = drawn.stated[number].tolist()
    distances = tuple(
        each._replace(length=each.length + each.u * error)
        for each, error in zip(nominal.distances, errors, strict=True)
    )
    return replace(seen, observed=seen.observed + in_mm, spheres=nominal.spheres, distances=distances)


def _fitted(prepared: Prepared, parts: tuple[Part, ...], sizes: Sizes, drawn: Sample, number: int) -> ErrorModel:
    """The fit of one draw: residuals by the exact matrix product, steps by the factorisation of the study."""
    fits, setup, measured = prepared.fits, prepared.setup, measurement_of(prepared, drawn, number)
    model, registration = fits.columns.model(parts), setup.registration
    parameters = np.zeros(len(model.parameters))
    for _ in range(MOST_EXACT_STEPS):
        residual = whitened(setup.white, residuals(measured, model, registration)).reshape(-1)
        residual = np.concatenate([residual, measured.instrument.stated_residuals(measured, registration)])
        step = fits.step(parts, sizes, residual, parameters)
        registration = registration.moved(fits.columns.registered(parts, residual, step))
        parameters = parameters + step
        model = model.with_parameters(parameters)
        if np.abs(step).max() < LAST_EXACT_STEP * max(1.0, float(np.abs(parameters).max())):
            break
    return model


def _remaining_error(volume: Volume, true_model: ErrorModel, found: ErrorModel) -> float:
    """RMS error in a volume after correction by the fit, aligned, um."""
    machine, q = volume.machine, volume.state.positions
    there, fitted = (
        exact_deviation(machine, q, model.errors(machine, volume.state), volume.tool).position
        for model in (true_model, found)
    )
    return volumetric_error_um(there - fitted, tool_point(machine, q, volume.tool)).rms
