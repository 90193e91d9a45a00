"""Preparation of a diagnosis: the checked data, the model that they are compared with, and their noise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import msgspec

from calibration.diagnosis.linear_order import other_order
from calibration.diagnosis.repeatability import Repeats, repeats
from calibration.diagnosis.residual.chance_level import PERIODIC, ByChance
from calibration.diagnosis.search.candidates import Untested, changes, library
from calibration.diagnosis.search.recent_fits import RecentFits
from calibration.diagnosis.search.selection import Search, Selector
from calibration.diagnosis.search.shapes import proposed_shapes
from calibration.diagnosis.search.start_model import base_of
from calibration.fit.acceptance import refuse_few, too_few
from calibration.fit.identifiability import identifiability
from calibration.fit.set_up.checked_data import checked_data
from calibration.fit.set_up.moved_spheres import moved_spheres
from calibration.fit.set_up.target_positions import TargetPosition
from calibration.gaussian_terms.given.larger_range import larger_ranges
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import is_log
from calibration.observation.outliers import Variance
from calibration.plausibility.finding import Finding
from kinematics.error_model.model import ErrorModel
from kinematics.running.progress import Progress
from kinematics.user_error import UserError

QUIET = 1e-2
"""Least ratio of the repeats' variance to the specified variance: rounded readings repeat exactly."""
CONTRADICTED, ENOUGH = 1e-3, 20
"""p-value of the specification below which repeats replace it, and the degrees of freedom that they need."""


class Start(NamedTuple):
    """Start of a search for causes."""

    selector: Selector
    findings: list[Finding]
    positions: list[TargetPosition]
    """Positions of targets by the data."""
    noise: Repeats | None
    untested: list[Untested]


def prepared(
    measurement: Measurement,
    calibration: ErrorModel | None,
    variance: Variance,
    progress: Progress,
    searching: Progress,
) -> Start:
    """The start of the search, without a calibration beside a model of all error motions.

    progress, searching: for the start, and for the search itself.
    UserError where the data are not plausible, cannot be fitted, or do not determine the model.
    """
    progress("checking the data")
    measurement, findings, positions = checked_data(measurement)
    base = base_of(measurement, calibration, progress)
    if base.choice is not None and (doubt := other_order(measurement, base.choice)):
        findings.append(Finding("chain", doubt, False))
    if calibration is not None and base.calibration is not None:
        findings += _larger(calibration, measurement)
    progress("fitting the present model")
    candidates, untested = library(measurement, base.model)
    if base.present is not None:
        free = [line.name for line in base.lines]
        candidates += [each for each in changes(base.present.model) if each.effect.name not in free]
    # in the log of a moving axis waves are no rare causes, and larger than others
    log = all(is_log(measurement, axis) for axis in measurement.moving)
    search = Search(proposed_shapes.proposals)
    if not log:
        search = Search(proposed_shapes.dominant, by_chance=ByChance(candidates, PERIODIC))
    selector = Selector(measurement, base, candidates, variance, searching, search)
    noise = repeats(measurement, selector.bare.fit.kept)
    if variance == "sheet" and noise is not None and _contradicted(noise):
        selector = replace(selector, measurement=_as_noisy_as(measurement, noise), bare_stages={}, recent=RecentFits())
        text = f"repeats contradict the instrument specification, its noise is taken from them: {noise.text}"
        findings.append(Finding("noise", text, False))
    if calibration is None:
        selector = _determined(selector)
    return Start(selector, findings, positions, noise, untested)


def _determined(selector: Selector) -> Selector:
    """The selector, with the coarser bases of the search where the rows are too few for its own.

    Rows of spheres have still coarser ones. UserError where they are too few for these too, or a sphere moved.
    """
    if not too_few([selector.bare.fit], identifiability(selector.bare.fit)):
        return selector
    measurement = selector.measurement
    moved = moved_spheres(measurement)
    if moved:
        raise UserError(f"{measurement.source}: {moved}")
    of_spheres = measurement.instrument.OBSERVES == "offset"
    base = selector.base
    coarser = selector.on(base.coarsest(measurement) if of_spheres else base.coarser(measurement, selector.progress))
    refuse_few([coarser.bare.fit], identifiability(coarser.bare.fit))
    return coarser


def _larger(calibration: ErrorModel, measurement: Measurement) -> Iterator[Finding]:
    """Axes that these data move beyond the ranges of a calibration."""
    for name, (known, whole) in larger_ranges(calibration, measurement).items():
        unit = measurement.machine.axes[measurement.machine.index(name)].unit
        text = (
            f"{name} was calibrated from {known[0]:.4g} to {known[1]:.4g} {unit}, which these data extend to "
            f"{whole[0]:.4g} to {whole[1]:.4g} {unit}: its error motions beyond follow from these data alone"
        )
        yield Finding("range", text, False)


def _contradicted(noise: Repeats) -> bool:
    """True where repeats contradict the instrument specification.

    Repeats far apart in time count only where they scatter less than specified, since drift adds scatter.
    """
    return (
        (not noise.apart or noise.factor < 1.0) and noise.degrees_of_freedom >= ENOUGH and noise.p_value < CONTRADICTED
    )


def _as_noisy_as(measurement: Measurement, noise: Repeats) -> Measurement:
    """The measurement with the uncertainties of its instrument scaled to the noise of the repeats."""
    instrument = measurement.instrument
    specified = {field: getattr(instrument, field) for field in instrument.__struct_fields__ if field.startswith("u_")}
    factor = max(noise.factor, QUIET) ** 0.5
    scaled = {field: value * factor for field, value in specified.items()}
    return replace(measurement, instrument=msgspec.structs.replace(instrument, **scaled))
