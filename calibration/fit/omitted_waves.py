"""Waves of rotary axes that a fit leaves out, in its uncertainties.

A basis has the waves per turn that the rows demand, or that a user states. The next one may be in the machine all the
same: over a part of a turn it shifts the mean line of its axis, and few rows do not show that. Each error motion of
such an axis therefore has one more wave here, as large as its last one may be. It stays zero, so that no estimate
changes; the covariance is that of the errors of this estimate: the covariance C beside the wave, and the square of the
shift d by the wave's most probable size, C + d d'. Over a whole turn a wave shifts no line; what the evidence leaves
out there is as small as the noise, but what a stated basis leaves out may have any size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from calibration.fit.curves.between_positions import BetweenPositions, with_curves_between
from calibration.fit.fit import Fit
from calibration.fit.linear import Posterior
from calibration.fit.problem import Problem
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import ROTARY
from calibration.plausibility.finding import Finding
from kinematics.basis import Basis, Fourier, Harmonics
from kinematics.effects import Effect, ErrorMotion
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

REPORTED_ODDS = 20.0
"""Odds against none from which a wave that the basis lacks is reported (Kass and Raftery 1995: strong evidence)."""
PART_DEG = 300.0
"""Arc, degrees, below which the next wave shifts the mean line of an axis."""
LARGEST_NAMED_ODDS = 1000
"""Odds above which a report gives no number."""


@dataclass(frozen=True)
class OmittedWaves:
    """A model with one more wave of zero in each error motion of its rotary axes."""

    model: ErrorModel
    """The model with these waves, and its covariance beside them."""
    prior: Array
    """Standard deviations `(p,)` of its parameters."""
    own: np.ndarray
    """True `(p,)` for the parameters of these waves."""
    information: Array
    """Information `(p, p)` of the data, in units of the priors, registration eliminated."""
    step: Array
    """Step `(p,)` to the most probable parameters, in units of the priors."""

    @classmethod
    def of(cls, model: ErrorModel, prior: Array, own: np.ndarray, information: Array, slope: Array) -> OmittedWaves:
        """The waves `own` of a model; slope `(p,)`: of the log likelihood; all in units of the priors."""
        posterior = Posterior(information, 1.0)
        step = posterior.solve(slope - model.parameters / prior)
        root = prior[:, None] * posterior.root
        return cls(model.with_parameters(model.parameters, root @ root.T), prior, own, information, step)

    def beside(self, found: Fit) -> Fit:
        """The fit with this model: of the result, only the model and the priors belong to the waves."""
        away = np.zeros(len(self.own))
        away[~self.own] = found.away
        return replace(found, model=self.model, prior=self.prior, away=away)

    def uncertain(self, model: ErrorModel) -> ErrorModel:
        """A model with the same waves, whose covariance is that beside them, with the covariance of its errors."""
        of_waves = {e.name: part for e, part in zip(self.model.effects, self.model.slices, strict=True)}
        rows, sizes = list[int](), list[float]()
        for effect, part in zip(model.effects, model.slices, strict=True):
            mine = of_waves.get(effect.name)
            if mine is not None and self.own[mine].any():
                rows += [part.stop - 2, part.stop - 1]
                sizes += (self.prior * self.step)[mine][-2:].tolist()
        covariance = np.array(model.covariance)
        moved = covariance[:, rows] @ np.linalg.solve(covariance[np.ix_(rows, rows)], sizes)
        return model.with_parameters(model.parameters, covariance + np.outer(moved, moved))

    def uncertain_fit(self, found: Fit) -> Fit:
        """The fit with this model, and the covariance of its errors."""
        return replace(self.beside(found), model=self.uncertain(self.model))

    def findings(self, *, chosen: bool) -> Iterator[Finding]:
        """A finding for each axis whose next wave reaches `REPORTED_ODDS` against none; chosen: as of `left_out`."""
        other = "" if chosen else ", or leave out --basis"
        waves = list(self._waves())
        for axis in dict.fromkeys(effect.axis for effect, _ in waves):
            motions = [(effect, part) for effect, part in waves if effect.axis == axis]
            rows = np.concatenate([np.arange(part.stop - 2, part.stop) for _, part in motions])
            odds = self._odds(rows)
            if odds < np.log(REPORTED_ODDS):
                continue
            sizes = np.linalg.norm((self.prior * self.step)[rows].reshape(-1, 2), axis=1)
            k = int(np.argmax(sizes / self.prior[rows[::2]]))
            effect, number = motions[k][0], _waves_of(motions[k][0])
            size = f"{sizes[k]:.2g} {'urad' if effect.angular else 'um'} of {effect.name}"
            times = f"{np.exp(odds):.0f}" if odds < np.log(LARGEST_NAMED_ODDS) else f"more than {LARGEST_NAMED_ODDS}"
            yield Finding(
                "waves",
                f"the rows show wave number {number} per turn of {axis} ({size}), which its basis lacks: {times} times "
                f"as likely as none. The fit leaves it out, and U contains it: state --basis {axis}=fourier:{number}"
                f"{other}",
                False,
            )

    def _waves(self) -> Iterator[tuple[ErrorMotion, slice]]:
        for motion, part in self.model.error_motions:
            if self.own[part].any():
                yield motion, part

    def _odds(self, rows: np.ndarray) -> float:
        """Logarithm of the odds of some of the waves against none: evidence with and without them."""
        others = np.flatnonzero(~self.own)
        slope = self.information @ self.step + self.step
        without = Posterior(self.information[np.ix_(others, others)], 1.0)
        own, cross = self.information[np.ix_(rows, rows)], self.information[np.ix_(others, rows)]
        schur = without.complement(own, cross) + np.eye(len(rows))
        along = slope[rows] - cross.T @ without.solve(slope[others])
        return 0.5 * float(along @ np.linalg.solve(schur, along) - np.linalg.slogdet(schur)[1])


def omitted_waves(found: Fit, *, chosen: bool) -> OmittedWaves | None:
    """The waves that a fit leaves out; None without a rotary axis.

    chosen: as of `left_out`.
    """
    model, prior, own = left_out(found.model, found.prior, [found.measurement], chosen=chosen)
    if not own.any():
        return None
    problem = Problem.of(found.measurement, model, prior)
    point = problem.point(model.parameters, found.registration)
    solved = problem.solve(point, found.kept.astype(float), found.variance_factor * found.widening)
    # the problem starts here, so that its priors have no part in the step
    step = solved.step[point.registered :] / prior
    return OmittedWaves.of(model, prior, own, solved.information, solved.information @ step + step)


def with_curves_and_waves(found: Fit, *, chosen: bool) -> tuple[Fit, tuple[BetweenPositions, ...], OmittedWaves | None]:
    """The fit with its curves between positions, where `chosen`, and the waves that it leaves out in its covariance."""
    waves = omitted_waves(found, chosen=chosen)
    honest = found if waves is None else waves.beside(found)
    curved, between = with_curves_between(honest) if chosen else (honest, ())
    if waves is not None:
        curved = replace(curved, model=waves.uncertain(curved.model))
    return curved, between, waves


def left_out(
    model: ErrorModel, prior: Array, measurements: Sequence[Measurement], *, chosen: bool
) -> tuple[ErrorModel, Array, np.ndarray]:
    """`with_next_waves` of the waves that a model of some measurements may lack.

    chosen: the evidence has selected the bases. Stated ones may lack any wave, also over a whole turn, which counts for
    spheres: other instruments show the errors between the waves in the residuals.
    """
    if chosen:
        return with_next_waves(model, prior, PART_DEG)
    spheres = any(each.instrument.OBSERVES == "offset" for each in measurements)
    return with_next_waves(model, prior, np.inf if spheres else 0.0)


def with_next_waves(model: ErrorModel, prior: Array, most_deg: float) -> tuple[ErrorModel, Array, np.ndarray]:
    """The model with the next wave, zero, of each error motion of waves per turn; its priors; true for these waves.

    prior `(p,)`: of the model. most_deg: only where the measured arc is shorter, degrees.
    """
    effects, priors, own = list[Effect](), list[Array](), list[np.ndarray]()
    wider = [_with_next_wave(effect, most_deg) for effect in model.effects]
    sizes = _sizes(model, [new is not old for new, old in zip(wider, model.effects, strict=True)])
    for effect, part in zip(wider, model.slices, strict=True):
        added = len(effect.parameters) - (part.stop - part.start)
        effects.append(effect)
        priors.append(np.append(prior[part], [sizes[_class_of(effect)]] * added if added else []))
        own.append(np.arange(len(effect.parameters)) >= part.stop - part.start)
    wide = msgspec.structs.replace(model, effects=tuple(effects), covariance=None)
    return wide, np.concatenate(priors), np.concatenate(own)


def _sizes(model: ErrorModel, widened: Sequence[bool]) -> dict[str, float]:
    """Standard deviations of the next waves, um and urad, by axis and kind of error motion.

    They are the RMS size of the last waves, as found with their uncertainties.
    """
    squares: dict[str, list[float]] = {}
    for effect, own in zip(model.effects, widened, strict=True):
        if own:
            last = np.array(effect.parameters[-2:]) ** 2 + np.array(effect.uncertainties[-2:]) ** 2
            squares.setdefault(_class_of(effect), []).extend(last.tolist())
    return {name: float(np.sqrt(np.mean(own))) for name, own in squares.items()}


def _class_of(effect: Effect) -> str:
    """Axis and kind of an error motion."""
    return f"{effect.axes[0]} {effect.angular}"


def _with_next_wave(effect: Effect, most_deg: float) -> Effect:
    if not (isinstance(effect, ErrorMotion) and effect.axis[0] in ROTARY):
        return effect
    low, high = effect.basis.interval
    if high - low >= most_deg:
        return effect
    basis: Basis
    match effect.basis:
        case Fourier(interval, harmonics):
            basis = Fourier(interval, (*harmonics, (high - low) / 180.0 * (len(harmonics) + 1)))
        case Harmonics(interval, order):
            basis = Harmonics(interval, order + 1)
        case _:
            return effect
    return ErrorMotion(
        effect.component, effect.axis, basis, (*effect.parameters, 0.0, 0.0), u=(0.0,) * (len(effect.parameters) + 2)
    )


def _waves_of(effect: ErrorMotion) -> int:
    """Number of waves of an error motion."""
    return (len(effect.parameters) - 1) // 2
