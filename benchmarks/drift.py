"""How well `ncomp drift` follows a machine between parts, and what a part gains by it.

    python benchmarks/drift.py --machines 4

A virtual C-frame mill warms up and cools down twice in two days, and works through a third one. Its zeros, the growth
of its axes and its squareness follow three temperatures (spindle, column, bed) behind lags that no single lag matches,
and walk at random by 0.5 um, um/m and urad per square root of an hour. Two more sensors, of the coolant and of the
hall, have courses of their own and matter to nothing. Sensors read to 0.1 K. Every 40 minutes a probe touches four
spheres, each to 1 um (k = 1). At the middle between two visits of the third day the drift since the morning is
predicted, by the readings until then and the temperatures now, and compared with the true one at 125 points of the
volume. A part is cut at these times as well, by the program as it is and by the program that is corrected for the
drift; `ncomp.verify` shows the errors of the true machine along it.

    python benchmarks/drift.py --logs 20

One sphere, touched every 30 minutes for 19 hours without a sensor (u 1 um): how often readings are left out or refused,
for a machine that walks, for one that warms up by 30 um besides, and for one that walks while its last readings are
off, or whose sphere was knocked; and how often the drift half an hour later is within U.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

import ncomp
from calibration.following.drift import drift_at
from calibration.following.follow import follow
from calibration.following.followed import Followed
from calibration.measurement.measurement import Measurement
from kinematics.deviation import exact_deviation
from kinematics.effects import Effect, LocationJump, Scale
from kinematics.effects.combined.when import lagged
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.error_transform import error_transform_with_tool
from kinematics.inverse import linear_positions
from kinematics.state import State
from kinematics.transforms import Array
from machines import load

DAY, VISIT, TOUCH = 86400.0, 2400.0, 30.0
"""Length of a day, time from visit to visit, and time from touch to touch, s."""
SPHERES = {
    "s1": (120.0, 90.0, 60.0),
    "s2": (480.0, 90.0, 60.0),
    "s3": (300.0, 360.0, 60.0),
    "s4": (300.0, 200.0, 260.0),
}
TIP = (0.0, 0.0, -150.0)
MINUTES = 60.0
TRUE: Sequence[tuple[Effect, Sequence[tuple[str, float, float]]]] = (
    (LocationJump("X", "X", 0.0), [("column", 0.9, 20.0)]),
    (LocationJump("Y", "Y", 0.0), [("column", -1.1, 45.0)]),
    (LocationJump("Z", "Z", 0.0), [("spindle", -1.0, 8.0), ("spindle", -0.7, 70.0)]),
    (Scale("X", 0.0), [("bed", 9.0, 30.0)]),
    (Scale("Y", 0.0), [("bed", 7.0, 30.0)]),
    (Scale("Z", 0.0), [("column", 6.0, 25.0)]),
    (LocationJump("C", "Y", 0.0), [("bed", 1.5, 60.0)]),
    (LocationJump("B", "Z", 0.0), [("column", -2.5, 40.0)]),
)
"""Each parameter with the sensors that it follows: coefficient per K, lag in minutes."""
USELESS = "coolant", "hall"
WALK = 0.5
PROGRAM = (
    "G21 G90 G54\nT1 M6\nG43 H1\nG0 X-150 Y-100 Z30\nG1 Z0 F1000\nX150\nY100\nX-150\nY-100\nZ60\n"
    "X150 Y100\nG0 Z100\nM30\n"
)
SET_UP = {"work_offset": ["G54=300,220,100"], "tool_length": ["T1=100"]}


@dataclass
class Virtual:
    """A virtual machine over three days, in steps of one touch."""

    seed: int

    def __post_init__(self) -> None:
        self.machine, rng = load("cframe"), np.random.default_rng(self.seed)
        self.time = np.arange(0.0, 3.0 * DAY, TOUCH)
        hours = self.time / 3600.0 % 24.0
        on = (hours > 6.0) & (hours < 16.0)
        load_of = np.repeat(rng.uniform(0.3, 1.0, len(self.time) // 120 + 1), 120)[: len(self.time)]
        hall = 1.5 * np.sin(2.0 * np.pi * (hours - 9.0) / 24.0) + self._wander(rng, 0.3)
        heat = on * load_of
        courses = {
            "spindle": hall + lagged(22.0 * heat, self.time, 20.0 * MINUTES)[0],
            "column": hall + lagged(9.0 * heat, self.time, 120.0 * MINUTES)[0],
            "bed": hall + lagged(6.0 * on, self.time, 200.0 * MINUTES)[0],
            "coolant": lagged(10.0 * on * rng.permutation(load_of), self.time, 40.0 * MINUTES)[0],
            "hall": self._wander(rng, 0.8),
        }
        self.sensors = {name: 20.0 + np.round(course, 1) for name, course in courses.items()}
        steps = WALK * np.sqrt(TOUCH / 3600.0) * rng.standard_normal((len(self.time), len(TRUE)))
        self.values = np.cumsum(steps, axis=0)
        for k, (_, terms) in enumerate(TRUE):
            for sensor, coefficient, lag in terms:
                self.values[:, k] += coefficient * lagged(courses[sensor], self.time, lag * MINUTES)[0]
        self.rng = rng

    def _wander(self, rng: np.random.Generator, size: float) -> Array:
        """A temperature that wanders by `size` K in an hour."""
        return np.cumsum(size * np.sqrt(TOUCH / 3600.0) * rng.standard_normal(len(self.time)))

    def model(self, now: int, since: int = 0) -> ErrorModel:
        """The true drift from one step to another, which a touch-off at the first does not contain."""
        effects = [
            msgspec.structs.replace(effect, since_touch_off=True).with_parameters([value])
            for (effect, _), value in zip(TRUE, self.values[now] - self.values[since], strict=True)
        ]
        return msgspec.structs.replace(no_errors(self.machine), effects=tuple(effects))

    def deviation(self, model: ErrorModel, positions: Array) -> Array:
        """Deviations `(n, 3)`, um, of the tip."""
        state = State(positions, approach=np.zeros_like(positions))
        tool = np.tile(TIP, (len(positions), 1))
        return np.asarray(
            1e3 * exact_deviation(self.machine, positions, model.errors(self.machine, state), tool).position
        )

    def touches(self) -> Iterator[tuple[int, str]]:
        """The rows of the log, with the number of their step."""
        per_visit = int(VISIT / TOUCH)
        for first in range(0, len(self.time) - len(SPHERES), per_visit):
            for k, (name, centre) in enumerate(SPHERES.items()):
                now = first + k
                target = np.array([centre]) + 1e-3 * self.rng.standard_normal((1, 3))
                zero = np.zeros((1, len(self.machine.axes)))
                q = linear_positions(self.machine, zero, target, np.array([TIP]))
                for _ in range(3):
                    error = 1e-3 * self.deviation(self.model(now), q)
                    q = linear_positions(self.machine, zero, target - error, np.array([TIP]))
                place = dict(zip(self.machine.names, q[0].tolist(), strict=True))
                cells = [f"{place[axis]:.5f}" for axis in "XYZ"]
                temperatures = [f"{course[now]:.1f}" for course in self.sensors.values()]
                yield now, ",".join([f"{self.time[now]:.0f}", *cells, name, *temperatures])

    def log(self, rows: Sequence[str]) -> str:
        """The log of touches."""
        head = ["# machine: cframe", "# instrument: touch-probe", "# u_um: 1", f"# probe: {' '.join(map(str, TIP))}"]
        spheres = [f"# sphere.{name}: {' '.join(map(str, centre))}" for name, centre in SPHERES.items()]
        names = ",".join(["time_s,X,Y,Z,sphere", *(f"temp_{name}" for name in self.sensors)])
        return "\n".join([*head, *spheres, names, *rows]) + "\n"


def measurement_of(log: str) -> Measurement:
    """The measurement in a log."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "touches.csv"
        path.write_text(log, encoding="utf-8")
        return ncomp.read_measurement(path, "cframe")


def volume(virtual: Virtual) -> Array:
    """Positions of the axes `(125, axes)`, mm, with the tip in the volume of parts."""
    x, y, z = np.meshgrid(np.linspace(120, 480, 5), np.linspace(90, 360, 5), np.linspace(60, 260, 5))
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    return linear_positions(
        virtual.machine, np.zeros((len(points), len(virtual.machine.axes))), points, np.tile(TIP, (len(points), 1))
    )


class Judged(NamedTuple):
    """One time, um: volume and part before and after, and how far the uncertainty and the sensors are right."""

    rms: tuple[float, float]
    largest: tuple[float, float]
    part: tuple[float, float]
    covered: float
    """Share of the components of the remaining errors within U (k = 2)."""
    useless: float
    """Share of the dependences that are on sensors which matter to nothing."""


def judged(virtual: Virtual, touches: Sequence[tuple[int, str]], every: int) -> Iterator[Judged]:
    """The third day, between visits."""
    morning, per_visit = int((2.0 * DAY + 5.0 * 3600.0) / TOUCH), int(VISIT / TOUCH)
    setup, machine = ncomp.set_up(virtual.machine, **SET_UP), virtual.machine
    places = volume(virtual)
    tool, state = np.tile(TIP, (len(places), 1)), State(places, approach=np.zeros_like(places))
    transform = error_transform_with_tool(machine, places, tool)[:, :3]
    for first in range(morning + 2 * per_visit, len(virtual.time) - per_visit, per_visit * every):
        now = first // per_visit * per_visit + per_visit // 2
        found = follow(measurement_of(virtual.log([row for step, row in touches if step < now])))
        kelvin = {name: float(course[now]) for name, course in virtual.sensors.items()}
        times = f"{virtual.time[now]:.0f}", f"{virtual.time[morning]:.0f}"
        drift = drift_at(found, no_errors(machine), *times, kelvin)
        true, model = virtual.model(now, morning), drift.estimate.on(no_errors(machine))
        before = virtual.deviation(true, places)
        left = before - virtual.deviation(model, places)
        big_u = 2e3 * model.standard_uncertainty(machine, state, transform)
        program = ncomp.correct(PROGRAM, machine, drift.model, setup=setup).text
        part = ncomp.verify(PROGRAM, program, machine, drift.model, align=true, setup=setup).verdict
        sizes = [np.linalg.norm(each, axis=1) for each in (before, left)]
        rms, largest = [float(np.sqrt(np.mean(size**2))) for size in sizes], [float(size.max()) for size in sizes]
        yield Judged(
            (rms[0], rms[1]), (largest[0], largest[1]), (part.before.largest, part.after.largest),
            float(np.mean(np.abs(left) < big_u)), by_useless(found),
        )  # fmt: skip


def by_useless(found: Followed) -> float:
    """Number of dependences on sensors that matter to nothing, as a share of all."""
    terms = found.structure.terms
    return sum(term.sensor in USELESS for term in terms) / max(len(terms), 1)


def one_sphere(rng: np.random.Generator, warm_um: float, off_um: float, count: int) -> tuple[str, list[bool]]:
    """What becomes of a log whose last readings are off in X, and whether each zero is within U (k = 2) later."""
    step, n = 1800.0, 40
    time = step * np.arange(n)
    heat = lagged(1.0 * ((time > 4 * 3600.0) & (time < 12 * 3600.0)), time, 60.0 * MINUTES)[0]
    drift = np.cumsum(WALK * np.sqrt(step / 3600.0) * rng.standard_normal((n, 3)), axis=0)
    drift += heat[:, None] * (0.0, warm_um / 4.0, warm_um)
    read = drift + rng.standard_normal((n, 3))
    read[n - 1 - count :, 0] += off_um
    positions = np.array(SPHERES["s1"]) - np.array(TIP) - 1e-3 * read
    cells = (",".join(f"{value:.5f}" for value in row) for row in positions[:-1].tolist())
    rows = [f"{moment:.0f},{place},s1" for moment, place in zip(time.tolist(), cells, strict=False)]
    head = ["# machine: cframe", "# instrument: touch-probe", "# u_um: 1", f"# probe: {' '.join(map(str, TIP))}"]
    names = [f"# sphere.s1: {' '.join(map(str, SPHERES['s1']))}", "time_s,X,Y,Z,sphere"]
    try:
        found = follow(measurement_of("\n".join([*head, *names, *rows]) + "\n"))
    except ncomp.UserError:
        return "refused", []
    estimate = found.at(float(time[-1]))
    left = np.abs(estimate.values - (drift[-1] - drift[0]))
    within = left < 2.0 * np.sqrt(np.diag(estimate.covariance))
    return "left out" if found.implausible else "taken", within.tolist()


def logs(number: int) -> None:
    """The table of logs of one sphere."""
    head = "machine", "taken", "readings left out", "refused", "within U (k=2)"
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
    cases = [("walks", 0.0, 0.0, 0), ("warms up by 30 um, and walks", 30.0, 0.0, 0)]
    for off in (5.0, 10.0, 20.0, 50.0):
        cases.append((f"last reading off by {off:g} um", 0.0, off, 1))
        cases.append((f"last 2 readings off by {off:g} um", 0.0, off, 2))
    for off in (5.0, 7.0, 10.0, 15.0, 20.0):
        cases.append((f"sphere knocked by {off:g} um 6 h before", 0.0, off, 12))
    for name, *case in cases:
        ends = [one_sphere(np.random.default_rng(seed), *case) for seed in range(number)]
        counts = [sum(end == word for end, _ in ends) for word in ("taken", "left out", "refused")]
        within = [each for _, own in ends for each in own]
        covered = f"{np.mean(within):.1%}" if within else "-"
        print(f"| {name} | {' | '.join(map(str, counts))} | {covered} |", flush=True)


def main() -> None:
    """The table of docs/drift.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machines", type=int, default=4)
    parser.add_argument("--every", type=int, default=5, help="visits between two times that are judged")
    parser.add_argument("--logs", type=int, help="logs of one sphere in each case, instead of the volume")
    given = parser.parse_args()
    if given.logs:
        logs(given.logs)
        return
    head = "log", "volume, RMS, um", "largest, um", "part, largest, um", "within U (k=2)", "useless sensors", "times"
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for name, share in {"all touches": 1.0, "a third left out": 2.0 / 3.0}.items():
        found: list[Judged] = []
        for seed in range(given.machines):
            virtual = Virtual(seed)
            kept = np.random.default_rng(seed).random(len(virtual.time)) < share
            found += judged(virtual, [each for each in virtual.touches() if kept[each[0]] or each[0] < 4], given.every)
        rms = (
            np.sqrt(np.mean([each.rms[0] ** 2 for each in found])),
            np.sqrt(np.mean([each.rms[1] ** 2 for each in found])),
        )
        cells = [
            name, f"{rms[0]:.1f} -> {rms[1]:.1f}",
            *(f"{max(a for a, _ in pairs):.1f} -> {max(b for _, b in pairs):.1f}" for pairs in (
                [each.largest for each in found], [each.part for each in found]
            )),
            f"{np.mean([each.covered for each in found]):.1%}",
            f"{np.mean([each.useless for each in found]):.0%} of the dependences", str(len(found)),
        ]  # fmt: skip
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
