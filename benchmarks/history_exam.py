"""How good the trends of `ncomp history` are: virtual machines with known lives, judged quarter by quarter.

    python benchmarks/history_exam.py --machines 20

A machine has seven quantities: three squarenesses and three backlashes (um/m, um), a pivot (um). A laser tracker
measures all of them each quarter (u 2), a ballbar squareness X-Y and backlash X and Y each month (u 1.5), a touch probe
the pivot each week (u 1). Results scatter by a standard deviation of the machine's own, 0.3 to 3 um. A third of the
machines does not change. A third wanders, by a random walk of 0.5 um per square root of a year. The last third wanders
so too, and changes: squareness X-Y wears by 2 to 6 um/m a year, a crash that is entered shifts squareness X-Z and the
pivot, one that nobody enters shifts backlash Z, a service takes backlash Y back, and after three years another tracker
measures, which is off by 5 in all.

After each quarter, what is announced by the results so far is compared with what was done, and forecasts of a year with
what came: of the true value, as long as nothing happens to it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from history.trends.changes import Found, found_in
from history.trends.forecast import forecast
from history.trends.model import likeliest
from history.trends.series import Event, Series
from kinematics.error_model.priors import PRIORS
from kinematics.transforms import Array

QUANTITIES = {
    "squareness X-Y": ("laser-tracker", "ballbar"), "squareness X-Z": ("laser-tracker",),
    "squareness Y-Z": ("laser-tracker",), "backlash X": ("laser-tracker", "ballbar"),
    "backlash Y": ("laser-tracker", "ballbar"), "backlash Z": ("laser-tracker",),
    "E_X0C": ("laser-tracker", "touch-probe"),
}  # fmt: skip
RATE = {"laser-tracker": 4, "ballbar": 12, "touch-probe": 52}
U = {"laser-tracker": 2.0, "ballbar": 1.5, "touch-probe": 1.0}
KINDS = ("machines that do not change", "machines that wander", "machines that change")
START, OTHER_TRACKER, OFFSET = 50.0, 3.0, 5.0
"""Years since 1970; years until another tracker, and by how much it is off, um."""


@dataclass
class Life:
    """What happens to the quantities of a machine."""

    scatter: float
    walks: dict[str, Array]
    """Random walk of each quantity, week by week."""
    rate: dict[str, float] = field(default_factory=dict)
    steps: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    """Time and size of the steps of each quantity."""
    events: list[Event] = field(default_factory=list)
    other_tracker: bool = False

    def truth(self, name: str, times: Array) -> Array:
        """The true values of a quantity."""
        steps = sum(size * (times >= time) for time, size in self.steps.get(name, []))
        weeks = START + np.arange(len(self.walks[name])) / 52.0
        return np.asarray(
            self.rate.get(name, 0.0) * (times - START) + steps + np.interp(times, weeks, self.walks[name])
        )


def life(rng: np.random.Generator, years: float, kind: str) -> Life:
    """A machine's life."""
    scatter, walk = rng.choice([0.3, 1.0, 3.0]), 0.5 if kind != KINDS[0] else 0.0
    steps = rng.normal(0.0, walk / np.sqrt(52.0), (len(QUANTITIES), int(52 * years) + 1))
    found = Life(float(scatter), dict(zip(QUANTITIES, np.cumsum(steps, axis=1), strict=True)))
    if kind == KINDS[2]:
        crash, hidden, service = START + rng.uniform(1.0, years - 0.5, 3)
        found.rate["squareness X-Y"] = float(rng.uniform(2.0, 6.0))
        for name, time in (("squareness X-Z", crash), ("E_X0C", crash), ("backlash Z", hidden)):
            found.steps[name] = [(time, float(rng.choice([-1.0, 1.0]) * rng.uniform(10.0, 40.0)))]
        found.steps["backlash Y"] = [(service, float(-rng.uniform(6.0, 15.0)))]
        found.events = [Event(crash, "crash"), Event(service, "service")]
        found.other_tracker = True
    return found


def results(rng: np.random.Generator, own: Life, name: str, years: float) -> Series:
    """The results of a quantity over a life."""
    rows = []
    for method in QUANTITIES[name]:
        for time in (START + (np.arange(int(years * RATE[method])) + rng.uniform(0.2, 0.8)) / RATE[method]).tolist():
            new = own.other_tracker and method == "laser-tracker" and time > START + OTHER_TRACKER
            value = float(own.truth(name, np.array([time]))[0]) + rng.normal(0.0, np.hypot(U[method], own.scatter))
            rows.append((time, value + OFFSET * new, U[method], f"{method} B" if new else method))
    times, values, u, methods = zip(*sorted(rows), strict=True)
    return Series(name, "um", *map(np.array, (times, values, u)), methods, tuple(range(len(times))), tuple(own.events))


@dataclass
class Score:
    """What became of the machines."""

    years: float = 0.0
    false: list[str] = field(default_factory=list)
    announced: dict[str, list[float]] = field(default_factory=dict)
    """Years from each true change to its announcement."""
    missed: list[str] = field(default_factory=list)
    forecasts: int = 0
    held: int = 0


def is_true(found: Found, own: Life, name: str) -> bool:
    """True where an announced change is one of those that were made.

    A slow one is true where at least half of it has come, and, if it is less than its U, where the machine wanders.
    """
    if found.kind == "method":
        return own.other_tracker
    low, high = found.between
    if name in own.rate:
        return True
    if found.kind == "drift" and abs(found.size) < 2.0 * found.u:
        return bool(np.ptp(own.walks[name]) > 0.0)
    if found.kind == "drift":
        moved = float(np.diff(own.truth(name, np.array([low, high])))[0])
        return moved * found.size > 0.0 and abs(moved) > abs(found.size) * (high - low) / 2.0
    return any(low - 0.3 <= time <= high + 0.3 for time, _ in own.steps.get(name, []))


def judge(score: Score, own: Life, series: Series, years: float) -> None:
    """Judge the announcements and forecasts of one quantity after each quarter."""
    name, known = series.name, set()
    happened = [time for time, _ in own.steps.get(name, [])]
    for now in np.arange(START + 0.5, START + years + 1e-9, 0.25).tolist():
        structure = likeliest(series.until(now), PRIORS)
        for found in (each for each in found_in(structure) if each.verdict == "announced"):
            key = found.kind
            if not is_true(found, own, name):
                if ("false", key) not in known:
                    score.false.append(f"{name}: {found.kind} {found.size:.1f} at {found.between[0] - START:.1f}")
                    known.add(("false", key))
            elif key != "method" and (happened or name in own.rate):
                key = "drift" if name in own.rate else "change"
                began = happened[0] if key == "change" else START
                if key in known:
                    continue
                score.announced.setdefault(f"{key} {name}", []).append(now - began)
                known.add(key)
        for ahead in (0.25, 1.0):
            if now + ahead <= START + years and not any(now - 0.3 < time <= now + ahead for time in happened):
                at = np.array([now + ahead])
                low, high = forecast(structure, at).band
                score.forecasts += 1
                score.held += bool(low[0] <= own.truth(name, at)[0] <= high[0])
    expected = [("change", name)] * (name in own.steps) + [("drift", name)] * (name in own.rate)
    score.missed += [f"{kind} {name}" for kind, name in expected if kind not in known]


def lines(score: Score) -> Iterator[str]:
    """The score in words."""
    yield f"{len(score.false)} false announcements in {score.years:.0f} machine-years: {score.false}"
    for name, delays in sorted(score.announced.items()):
        yield f"{name}: announced {len(delays)} times, after {np.median(delays):.2f} years (median)"
    yield f"missed: {score.missed}"
    yield f"forecasts: {score.held} of {score.forecasts} within the band of 95 % ({score.held / score.forecasts:.1%})"


def main() -> None:
    """Judge the machines."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=20)
    parser.add_argument("--years", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    scores = {kind: Score() for kind in KINDS}
    for number in range(given.machines):
        rng, kind = np.random.default_rng((given.seed, number)), KINDS[number % 3]
        own = life(rng, given.years, kind)
        scores[kind].years += given.years
        for name in QUANTITIES:
            judge(scores[kind], own, results(rng, own, name, given.years), given.years)
    for kind, score in scores.items():
        print(kind)
        for line in lines(score):
            print(f"  {line}")


if __name__ == "__main__":
    main()
