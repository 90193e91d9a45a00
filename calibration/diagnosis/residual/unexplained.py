"""The unexplained residual: the variables that it depends on, and accepted causes that only imitate it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.diagnosis.residual.absorber import (
    absorbed,
    absorbing,
    fair_to,
    in_time,
    log_odds_of_function,
    share_of_excess,
    with_fair_noise,
    with_walk,
    without_support,
)
from calibration.diagnosis.residual.chance_level import PERIODIC, SEARCHES, SMOOTH, Chance, searched
from calibration.diagnosis.residual.dependence import (
    EVIDENCE,
    LENGTHS,
    Unexplained,
    explaining_variables,
    log_odds,
    of_variables,
)
from calibration.diagnosis.residual.distance_correlation import Dependence, dependences
from calibration.diagnosis.residual.fitted_variables import fitted_variables
from calibration.diagnosis.residual.readings import readings, with_function_of_readings
from calibration.diagnosis.residual.shifts_of_stops import function_of_stops
from calibration.diagnosis.residual.unnamed import evidence, may_depend_on
from calibration.diagnosis.residual.whiteness import ALONG_TIME, Columns, Test, whiteness
from calibration.diagnosis.search.candidates import RARE, Candidate
from calibration.diagnosis.search.evaluation import WORTH, evaluate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.score import Score
from calibration.diagnosis.search.stage import Accepted, Stage
from calibration.instruments import LaserTracker, TouchProbe
from calibration.measurement.measurement import Measurement
from calibration.registration.observed_points import carried
from kinematics.effects import AngleStep
from kinematics.state import TIME
from kinematics.transforms import Array

SEED = 1
STATIC = ("cross-axis", "tracker-range", "air-scale", "tracker-angle", "cyclic", "quantised-compensation")
"""Kinds of causes that depend on positions alone, and not on the axis of one error motion of the model."""
WALK_LEVEL = 1e-6
"""Chance of neighbours in time that deviate alike, below which a residual may be a random walk."""
FAR_MORE = 1.5
"""Ratio of the log odds of a jump to those of a function of time above which the function only imitates the jump.

Also the ratio of the log odds of a random walk to those of a jump above which the jump is a part of the walk, and of an
error of the machine to one of the readings above which it is no error of the readings."""

LARGER_PART = 0.5
"""Least share of the excess over the noise that periodic shapes explain together, beside an error without a name."""


def tests(linearised: LinearisedFit) -> list[Test]:
    """Tests whether the residuals of a linearised fit are white; the parameters fitted to them are accounted for."""
    measurement, rows = linearised.measurement, linearised.rows
    state, machine = measurement.state, measurement.machine
    moving = list(measurement.moving)
    where = {axis: state.position(machine, axis)[rows] for axis in moving}
    side = {} if state.approach is None else {axis: state.approach[rows, machine.index(axis)] for axis in moving}
    columns = Columns(
        None if state.time is None else state.time[rows],
        where,
        side,
        None if measurement.run is None else measurement.run[rows],
        None if state.station is None else state.station[rows],
        {name: kelvin[rows] for name, kelvin in state.temperatures.items()},
    )
    return whiteness(linearised.residual.reshape(len(rows), -1), columns, absorbed=linearised.spanned)


def variables(measurement: Measurement, rows: np.ndarray) -> dict[str, Array]:
    """Variables `(n,)` that residuals may depend on and that vary: axes, time, temperatures, feed, directions."""
    state, machine = measurement.state, measurement.machine
    moving = list(measurement.moving)
    found = {axis: state.position(machine, axis)[rows] for axis in moving}
    if state.time is not None:
        found["time"] = state.time[rows]
    found |= {f"temperature {name}": kelvin[rows] for name, kelvin in state.temperatures.items()}
    if measurement.feed is not None:
        found["feed"] = measurement.feed[rows]
    if state.approach is not None:
        found |= {f"direction of {axis}": state.approach[rows, machine.index(axis)] for axis in moving}
    return {name: column for name, column in found.items() if np.ptp(column) > 0}


def unexplained(linearised: LinearisedFit) -> Unexplained | None:
    """A smooth function that explains the residuals of a linearised fit, and its variables; None where none does."""
    given, white = variables(linearised.measurement, linearised.rows), of_machine(linearised, linearised.residual)
    found = explaining_variables(white, given, np.random.default_rng(SEED))
    if found is None:
        of_stops = function_of_stops(linearised, given)
        return of_stops and of_stops._replace(shape=_in_noise(linearised, of_stops.shape))
    even = linearised.evenly_noisy
    lengths = fitted_variables(even, found, list(given))
    if set(lengths) != set(found.variables):
        found = of_variables(white, given, lengths, found.p_value, np.random.default_rng(SEED))
    misreading = with_function_of_readings(even)
    if misreading.function is None:
        return found
    read, seen = linearised.residual.reshape(len(linearised.rows), -1), dict(zip(*misreading.function, strict=True))
    angles = readings(linearised.measurement, linearised.rows)
    if all(may_depend_on(linearised, name) for name in found.variables):
        likelier = misreading.log_odds > absorbing(even, found, whole=True).log_odds + EVIDENCE
    else:  # no error of the tool depends on all of the variables
        own = dict(zip(found.variables, found.lengths, strict=True))
        likelier = log_odds(read, angles, seen) > log_odds(white, given, own) + EVIDENCE
    return of_variables(read, angles, seen, found.p_value, np.random.default_rng(SEED)) if likelier else found


def of_same_variables(linearised: LinearisedFit, dependence: Unexplained) -> Unexplained:
    """A dependence in the residuals of another linearised fit."""
    white, given = of_machine(linearised, linearised.residual), variables(linearised.measurement, linearised.rows)
    lengths = dict(zip(dependence.variables, dependence.lengths, strict=True))
    return of_variables(white, given, lengths, dependence.p_value, np.random.default_rng(SEED))


def random_walk(linearised: LinearisedFit, *, shown: bool = False) -> Unexplained | None:
    """A dependence on time without a smooth form: the residuals of a linearised fit are a random walk; else None.

    Neighbours in time deviate alike, more clearly than neighbours along any axis, where no noise of an axis hides it;
    beside this noise a random walk of the tool is far likelier than none. A permutation of blocks can't show it: such
    residuals have hardly any blocks that are independent. shown: a cause fell because it is a part of the walk, so that
    neighbours need not show it again.
    """
    if linearised.state.time is None:
        return None
    along = {test.name: test.p_value for test in tests(linearised.evenly_noisy) if test.name.startswith("along ")}
    own = along.pop(ALONG_TIME, 1.0)
    if not shown and (own > WALK_LEVEL or own > min(along.values(), default=1.0)):
        return None
    if with_walk(linearised).log_odds < 2.0 * EVIDENCE:
        return None
    white, given = of_machine(linearised, linearised.residual), variables(linearised.measurement, linearised.rows)
    return of_variables(white, given, {TIME: min(LENGTHS)}, own, np.random.default_rng(SEED))


def nearly_of_readings(linearised: LinearisedFit, dependence: Unexplained) -> Unexplained | None:
    """A function of the tracker's readings that explains nearly as much as one of positions does; None without one."""
    machine = linearised.measurement.machine
    if dependence.of_readings or not set(dependence.variables) <= set(machine.names):
        return None
    even = linearised.evenly_noisy
    misreading = with_function_of_readings(even)
    if misreading.function is None:
        return None
    if FAR_MORE * misreading.log_odds < absorbing(even, dependence, whole=True).log_odds:
        return None
    read, seen = linearised.residual.reshape(len(linearised.rows), -1), dict(zip(*misreading.function, strict=True))
    angles = readings(linearised.measurement, linearised.rows)
    return of_variables(read, angles, seen, dependence.p_value, np.random.default_rng(SEED))


def one_by_one(linearised: LinearisedFit) -> list[Dependence]:
    """Dependence of the residuals of a linearised fit on each variable alone, the clearest first."""
    given = variables(linearised.measurement, linearised.rows)
    return dependences(of_machine(linearised, linearised.residual), given, np.random.default_rng(SEED))


def impostors(stage: Stage, dependence: Unexplained, library: Sequence[Candidate]) -> list[Accepted]:
    """Accepted causes that only imitate the unexplained residual.

    A cause without which a smooth function of its variables explains the data nearly as well. Also a cause that is not
    smooth or was searched for, where the same search finds as much in residuals with random signs.
    """
    chance = Chance(absorbed(stage.linearised, dependence), library)
    fair = fair_to(stage, dependence)
    unsupported = _numbers(stage, without_support(stage, fair, dependence))
    even = stage._replace(linearised=stage.linearised.evenly_noisy) if unsupported else stage
    blamed = [stage.accepted[i] for i in unsupported if not _stands_beside(even, i, dependence)]
    blamed += [each for each in _jumps_by_shifts(stage, fair, dependence) if not any(each is other for other in blamed)]
    return blamed + [
        each
        for each in stage.accepted
        if not any(each is other for other in blamed)
        and (each.candidate.effect.kind not in SMOOTH or searched(each.candidate) in SEARCHES)
        and chance.finds(each.candidate, each.score.gain)
    ]


def _jumps_by_shifts(stage: Stage, fair: Stage, dependence: Unexplained) -> list[Accepted]:
    """Accepted jumps that are not likelier with the whole function than the function alone, beside shifts of the stops.

    Beside such shifts the function, though it is there, has little support of its own. fair: by `fair_to`.
    """
    if stage.linearised.measurement.noise is None or fair.linearised is not stage.linearised:
        return []
    jumps = (i for i, each in enumerate(stage.accepted) if _jumps(each))
    return [stage.accepted[i] for i in jumps if not _likelier_with(stage, [i], dependence)]


def small_parts(stage: Stage) -> list[Accepted]:
    """Accepted waves and sawtooth errors that together explain less of an unknown error than they leave.

    For residuals that are not noise, but no function of the recorded variables. The search finds some period in any
    error that is neither smooth nor periodic.
    """
    shapes = [i for i, each in enumerate(stage.accepted) if searched(each.candidate) in PERIODIC]
    if not shapes:
        return []
    even = stage._replace(linearised=stage.linearised.evenly_noisy)
    part = share_of_excess(even.without(*shapes), even.linearised)
    return [stage.accepted[i] for i in shapes] if part < LARGER_PART else []


def misread(stage: Stage) -> list[Accepted]:
    """Accepted causes that only imitate an error of the tracker's readings: all together, else each of them.

    A smooth function of the tracker's readings is likelier than they are. Causes of the instrument alone are such
    functions themselves: these fall only if one is needed beside them too, and is likelier alone than together with
    them.
    """
    static = [i for i, each in enumerate(stage.accepted) if each.candidate.kind in STATIC]
    if not static:
        return []
    fair = stage._replace(linearised=with_fair_noise(stage.linearised, with_function_of_readings))
    for group in ([static] if len(static) > 1 else []) + [[i] for i in static]:
        without = fair.without(*group)
        free = sum(stage.accepted[i].score.effective_parameters for i in group)
        own = 0.5 * (without.squares - fair.linearised.squares - free * np.log(without.scalars))
        # as the function, causes may spare the error motions more than they explain
        own = max(own, by_evidence(without, *(stage.accepted[i].candidate for i in group)))
        if all(stage.accepted[i].candidate.effect.ACTS_ON == "instrument" for i in group):
            beside = with_function_of_readings(fair.linearised)
            own += beside.log_odds if beside.function else np.inf
        if with_function_of_readings(without).log_odds > own + EVIDENCE:
            return [stage.accepted[i] for i in group]
    return []


def wandering(stage: Stage) -> list[Accepted]:
    """Accepted jumps that only imitate a wandering: a function of time, or a random walk, explains more.

    Also a jump that is no larger than the steps of a random walk beside it, and any course in time that is a part of
    this walk. A jump remains if the function and the jump together are likelier than the function alone.
    """
    timed = [i for i, each in enumerate(stage.accepted) if in_time(each.candidate.effect)]
    if not timed:
        return []
    even, found = stage._replace(linearised=stage.linearised.evenly_noisy), []
    walking = stage._replace(linearised=with_fair_noise(stage.linearised, with_walk))
    for i in timed:
        each = stage.accepted[i]
        if (_jumps(each) and _far_less_than_walk(walking, i)) or _of_walk(walking, i):
            found.append(each)
            continue
        if not _jumps(each):
            continue
        without = even.without(i)
        score = each.score if even.linearised is stage.linearised else evaluate(without, [each.candidate])[0].score
        own = _in_full_or_by_evidence(without, score, each.candidate)
        dependence = unexplained(without)
        if dependence is None or TIME not in dependence.variables:
            continue
        # the model may imitate all terms of a function that begins late, and still not the course itself
        alone = log_odds_of_function(without, dependence)
        alone = alone or log_odds_of_function(without, dependence, whole=True)
        if alone > max(-0.5 * score.delta_bic, own / FAR_MORE) and not _stands_beside(even, i, dependence):
            found.append(each)
    return found


def _stands_beside(stage: Stage, index: int, dependence: Unexplained) -> bool:
    """True for a jump if it and the whole function are likelier than the function alone. stage: with even noise."""
    return _jumps(stage.accepted[index]) and _likelier_with(stage, [index], dependence)


def stand_together(stage: Stage, causes: Sequence[Accepted]) -> bool:
    """True for causes with a jump among them if they are likelier than a smooth function in their place.

    Several smooth causes imitate an unnamed function so well that the evidence does not distinguish them.
    """
    if not any(map(_jumps, causes)):
        return False
    even = stage._replace(linearised=stage.linearised.evenly_noisy)
    numbers = _numbers(stage, causes)
    dependence = unexplained(even.without(*numbers))
    return dependence is not None and _likelier_with(even, numbers, dependence)


def _numbers(stage: Stage, causes: Sequence[Accepted]) -> list[int]:
    """Numbers of some of the accepted causes of a stage."""
    return [i for i, each in enumerate(stage.accepted) if any(each is other for other in causes)]


def _jumps(accepted: Accepted) -> bool:
    return accepted.candidate.effect.moment is not None


def _likelier_with(stage: Stage, numbers: Sequence[int], dependence: Unexplained) -> bool:
    """True where accepted causes, given by number, and the whole function are likelier than the function alone.

    Each counts by its evidence, without the correlation of the residuals. Beside a mere imitation of it the function
    loses more evidence than the imitation has.
    """
    without = stage.without(*numbers)
    alone, beside = (log_odds_of_function(rest, dependence, whole=True) for rest in (without, stage.linearised))
    own = by_evidence(without, *(stage.accepted[i].candidate for i in numbers))
    return own + beside > alone + EVIDENCE


def _far_less_than_walk(stage: Stage, index: int) -> bool:
    """True for an accepted jump in whose place a random walk of the tool is far likelier."""
    without, candidate = stage.without(index), stage.accepted[index].candidate
    score = evaluate(without, [candidate])[0].score
    return with_walk(without).log_odds > FAR_MORE * _in_full_or_by_evidence(without, score, candidate)


def _in_full_or_by_evidence(without: LinearisedFit, score: Score, candidate: Candidate) -> float:
    """Log odds of a jump on the fit without it, the larger of two.

    Rows that are correlated count in full for a function: for a jump only if it explains far more. Beside a
    calibration, whose error motions it spares, a jump that is there explains little itself.
    """
    return max(in_full(without, score), by_evidence(without, candidate))


def against_walk(stage: Stage, index: int) -> float:
    """Log odds of an accepted cause against a random walk of the tool in its place; infinite for no course in time.

    A random walk beside the cause, where the data need one, counts for it. Before any data the walk is as rare as a
    rare cause.
    """
    if not in_time(stage.accepted[index].candidate.effect) or stage.linearised.state.time is None:
        return np.inf
    stage = stage._replace(linearised=with_fair_noise(stage.linearised, with_walk))
    without = stage.without(index)
    own = by_evidence(without, stage.accepted[index].candidate)
    return own + RARE + with_walk(stage.linearised).log_odds - with_walk(without).log_odds


def _of_walk(stage: Stage, index: int) -> bool:
    """True for a cause without evidence beside a random walk of the tool whose steps are those of the other rows."""
    beside = with_walk(stage.linearised)
    if not beside.log_odds:
        return False
    model = stage.fit.model
    part = model.slices[stage.numbers[index]]
    linear = [quantity.linear for quantity in stage.accepted[index].candidate.effect.parameter_table]
    own = np.arange(part.start, part.stop)[linear] + stage.linearised.design.shape[1] - len(model.parameters)
    root, size = beside.linearised.posterior.root[own], beside.linearised.away[own]
    gain = float(size @ np.linalg.solve(root @ root.T, size))
    return bool(gain < len(own) * np.log(stage.linearised.scalars) - WORTH)


def smoothed(stage: Stage) -> list[Accepted]:
    """Accepted steps of a tracker's circles that only imitate an error of the machine, or of the readings.

    A smooth function of the readings, or of the variables on which the residual depends without the step, is likelier.
    """
    even, found = stage._replace(linearised=stage.linearised.evenly_noisy), []
    for i, each in enumerate(stage.accepted):
        if not isinstance(each.candidate.effect, AngleStep):
            continue
        without = even.without(i)
        score = each.score if even.linearised is stage.linearised else evaluate(without, [each.candidate])[0].score
        own, dependence = in_full(without, score) - each.candidate.rarity, unexplained(without)
        smooth = log_odds_of_function(without, dependence, whole=True)
        if max(smooth, with_function_of_readings(without).log_odds) > own:
            found.append(each)
    return found


def in_full(without: LinearisedFit, score: Score) -> float:
    """Log odds of a cause by its score on the fit without it, in the unit of those of a function.

    The squares that it explains count in full, however large those are that it leaves.
    """
    return 0.5 * (score.squares - score.effective_parameters * float(np.log(without.scalars)))


def by_evidence(without: LinearisedFit, *candidates: Candidate) -> float:
    """Log odds of causes on the fit without them, by the evidence of their columns, as those of a function.

    The evidence counts what a cause spares the error motions, which imitate a part of it. The search for its moment,
    or for its first shape, counts by the tries; every further shape as a parameter.
    """
    projected = without.projected(without.columns(*(each.effect for each in candidates)))
    odds = evidence(projected.schur, projected.columns.T @ without.residual)[0]
    for each in candidates:
        odds -= float(np.log(each.trials) + 0.5 * max(each.shapes - 1, 0) * np.log(without.scalars)) + each.rarity
    return odds


def in_lengths(linearised: LinearisedFit, dependence: Unexplained) -> Array:
    """Unexplained function `(n, d)`, mm and rad, at the rows of a linearised fit, in the frame of the observations."""
    noise, turns = _noise(linearised), _into_tool(linearised)
    if turns is None or dependence.of_readings:
        return np.asarray((noise @ dependence.shape[:, :, None])[:, :, 0])
    errors = dependence.shape * np.linalg.norm(turns @ noise, axis=2)
    return np.asarray((np.swapaxes(turns, 1, 2) @ errors[:, :, None])[:, :, 0])


def _in_noise(linearised: LinearisedFit, lengths: Array) -> Array:
    """The shape `(n, d)` of a function, by its lengths `(n, d)` of which `in_lengths` is the inverse."""
    noise, turns = _noise(linearised), _into_tool(linearised)
    if turns is None:
        return np.asarray(np.linalg.solve(noise, lengths[:, :, None])[:, :, 0])
    return np.asarray((turns @ lengths[:, :, None])[:, :, 0] / np.linalg.norm(turns @ noise, axis=2))


def shared_rms(linearised: LinearisedFit, dependence: Unexplained) -> float:
    """RMS, um per scalar (rotary axes: urad), of the part of kept rows' residuals along the function `dependence`."""
    return float(np.sqrt(max(shared_squares(linearised, dependence).mean(), 0.0)))


def shared_squares(linearised: LinearisedFit, dependence: Unexplained) -> Array:
    """Means over kept rows `(d,)`, um^2, of the products of residuals and the function `dependence`; in x, y, z.

    A tracker makes the function as uncertain across the beam as a reading: its own square would be that uncertainty.
    """
    both = [linearised.in_lengths(linearised.residual), in_lengths(linearised, dependence)]
    if linearised.measurement.instrument.BY_BEAM:
        turns = linearised.fit.registration.rotations(linearised.measurement.rows(linearised.rows))
        both = [np.einsum("nji,nj->ni", turns, lengths) for lengths in both]
    shared = np.prod(both, axis=0) * linearised.measurement.per_micro[linearised.rows] ** 2
    return np.asarray(shared[linearised.good].mean(axis=0))


def of_machine(linearised: LinearisedFit, values: Array) -> Array:
    """White values `(N,)` as `(n, d)`, in units of noise; along the tool where rotary axes turn points."""
    white, turns = values.reshape(len(linearised.rows), -1), _into_tool(linearised)
    if turns is None:
        return white
    unwhite = turns @ _noise(linearised)
    return np.asarray((unwhite @ white[:, :, None])[:, :, 0] / np.linalg.norm(unwhite, axis=2))


def _into_tool(linearised: LinearisedFit) -> Array | None:
    """Rotations `(n, 3, 3)` from observations to the tool; None without points or without moving rotary axes."""
    measurement = linearised.measurement
    turning = [axis for axis in measurement.moving if axis[0] in "ABC"]
    if not turning or not isinstance(measurement.instrument, LaserTracker | TouchProbe):
        return None
    some = measurement.rows(linearised.rows)
    return np.swapaxes(linearised.fit.registration.rotations(some) @ carried(some), 1, 2)


def _noise(linearised: LinearisedFit) -> Array:
    """Roots `(n, d, d)` of the noise covariances, without the weights of the rows."""
    return np.asarray(np.linalg.inv(linearised.white) * np.sqrt(linearised.weights)[:, None, None])
