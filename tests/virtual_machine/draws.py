"""The questions of the exam: for every kind of cause a design that makes it visible, and a cause drawn by seed."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from virtual_machine import instrument_causes as instrument
from virtual_machine import machine_causes as machine
from virtual_machine.cause import UM, Cause
from virtual_machine.chain import Chain, load
from virtual_machine.designs import PLACES, along_one, hexahedron, in_motion, scattered, stands, swept
from virtual_machine.observe import (
    Laser,
    Setup,
    Stand,
    Tracker,
    along_axis,
    observed,
    scale_along,
    scale_to,
    share_left,
    without_noise,
)
from virtual_machine.session import Session
from virtual_machine.sheet import laser_sheet, tracker_sheet
from virtual_machine.truth import smooth, table_1

MACHINES = ("gantry", "cframe", "dmu50")
TIMES = (2.0, 10.0)
"""Sizes of causes as multiples of the noise of the mean, drawn log-uniformly."""
PLAIN = (5.0, 10.0)
"""The same of causes that are plain to see, of any name."""
LEADS = {"gantry": (10.0, 16.0, 20.0, 25.0, 40.0), "cframe": (5.0, 8.0, 10.0, 12.0), "dmu50": (5.0, 8.0, 10.0, 12.0)}
"""mm: screws."""
GEARS = (4.0, 5.0, 7.5, 10.0)
"""degrees."""
LASER = Laser(0.2, 0.3)
COARSE = {True: "fourier:2", False: "legendre:3"}
"""Bases of rotary and linear axes that hold the smooth error motions, and no ripple."""
LEFT = {"tracker-angle": 0.3}
"""Of its displacement that has to be left when the stations are registered: a wave over a short arc is a turn."""
LOCATIONS = {
    "gantry": ("C0Y", "B0Z", "A0Z"),
    "cframe": ("C0Y", "B0Z", "A0Z"),
    "dmu50": ("C0Y", "B0Z", "A0Z", "X0C", "Y0C", "A0C", "B0C", "X0B", "Z0B", "A0B", "C0B"),
}
"""That the frame of a fit (docs/calibration.md) leaves to be seen."""

Calibrated = Literal["no", "before", "coarse"]
"""By the data themselves; by earlier data without the cause; from the same data with too coarse a basis."""


@dataclass(frozen=True)
class Design:
    """What a kind needs in order to be seen."""

    passes: int = 3
    stations: int = 1
    with_references: bool = False
    moving: bool = False
    near: bool = False

    def setup(self, chain: Chain, rng: np.random.Generator) -> Setup:
        """A session on a machine with smooth error motions, its tracker on its stands."""
        session = self.session(chain, rng)
        return with_machine(session, rng, near=self.near)

    def session(self, chain: Chain, rng: np.random.Generator) -> Session:
        """Drawn at random."""
        if self.moving:
            return in_motion(chain, rng)
        positions = PLACES[chain.name].positions * 3 // max(self.passes, 3)
        return scattered(
            chain,
            rng,
            passes=self.passes,
            stations=self.stations,
            with_references=self.with_references,
            positions=positions,
        )

    def and_also(self, other: Design) -> Design:
        """What both need."""
        return Design(
            max(self.passes, other.passes),
            max(self.stations, other.stations),
            self.with_references or other.with_references,
            self.moving or other.moving,
            self.near or other.near,
        )


@dataclass(frozen=True)
class Kind:
    """A kind of cause: its design, and a cause of it, of any size, in a session."""

    design: Design
    cause: Callable[[Session, np.random.Generator], Cause]
    calibrated: Calibrated = "no"


@dataclass(frozen=True)
class Draw:
    """One question: data, what is wrong in them, and which calibration goes with them."""

    name: str
    setup: Setup
    causes: tuple[Cause, ...]
    seed: Sequence[int]
    """Seed of the noise."""
    calibrated: Calibrated = "no"
    times: tuple[float, ...] = ()
    """Sizes of the causes, in units of the noise of the mean; 0 of outliers."""
    earlier: Setup | None = field(default=None, repr=False)
    """The session of the calibration before."""
    coarse: str = ""
    """Basis of the coarse calibration; empty for what holds the smooth error motions alone."""
    laser_along: str = ""
    """The axis that an interferometer measures; empty of a tracker."""

    @property
    def coarse_basis(self) -> str:
        """Basis of the coarse calibration, as `ncomp fit` takes it."""
        return self.coarse or ",".join(f"{axis.name}={COARSE[axis.rotary]}" for axis in self.setup.session.chain.axes)

    def sheet(self, *, clean: bool = False) -> str:
        """The measurement file; `clean` is the same, with the same noise, with nothing wrong."""
        setup = self.setup if clean else self.setup.having(*self.causes)
        if self.laser_along:
            readings = along_axis(setup, self.laser_along, LASER, np.random.default_rng(self.seed))
            return laser_sheet(setup.session, self.laser_along, LASER, readings)
        readings = observed(setup, np.random.default_rng(self.seed))
        return tracker_sheet(setup.session, setup.tracker, readings)

    def earlier_sheet(self) -> str:
        """The measurement file of the calibration before."""
        assert self.earlier is not None
        readings = observed(self.earlier, np.random.default_rng([*self.seed, 1]))
        return tracker_sheet(self.earlier.session, self.earlier.tracker, readings)


def seed_of(*parts: object) -> list[int]:
    """The same numbers for the same words, whatever runs them."""
    return [zlib.crc32(str(part).encode()) for part in parts]


def draw(kinds: Sequence[str], name: str, seed: int) -> Draw:
    """A machine with these kinds of causes at once, none for no kinds."""
    seeds = seed_of(*kinds, name, seed)
    rng, chain = np.random.default_rng(seeds), load(name)
    design = Design()
    for kind in kinds:
        design = design.and_also(KINDS[kind].design)
    setup = design.setup(chain, rng)
    drawn = [_cause(KINDS[kind], setup, rng) for kind in kinds]
    needed = [KINDS[kind].calibrated for kind in kinds if KINDS[kind].calibrated != "no"]
    calibrated: Calibrated = needed[0] if needed else "no"
    earlier = replace(setup, session=design.session(chain, rng)) if calibrated == "before" else None
    causes, times = tuple(cause for cause, _ in drawn), tuple(times for _, times in drawn)
    return Draw(f"{'+'.join(kinds) or 'nothing'} {name} {seed}", setup, causes, seeds, calibrated, times, earlier)


def nothing(seed: int) -> Draw:
    """A machine in order, in each of the designs in turn."""
    designs = (Design(), Design(with_references=True), Design(4, 2), Design(moving=True))
    name = MACHINES[seed % len(MACHINES)]
    seeds = seed_of("nothing", name, seed)
    rng = np.random.default_rng(seeds)
    setup = designs[seed // len(MACHINES) % len(designs)].setup(load(name), rng)
    return Draw(f"nothing {name} {seed}", setup, (), seeds)


def unknown(name: str, seed: int) -> Draw:
    """What no table of effects holds."""
    seeds = seed_of("unknown", name, seed)
    rng = np.random.default_rng(seeds)
    setup = Design().setup(load(name), rng)
    times = _times(rng)
    cause = scale_to(setup, machine.Unknown(str(rng.choice(list("XYZ")))), times)
    return Draw(f"unknown {name} {seed}", setup, (cause,), seeds, times=(times,))


def tied_growth(name: str, seed: int) -> Draw:
    """A tool point that grows in Z with time, in one sweep: a tracker whose stand sinks looks the same.

    The slowest axis goes with time, so its error motion takes most of it: few steps of that axis, and a large growth.
    """
    seeds = seed_of("tied growth", name, seed)
    rng = np.random.default_rng(seeds)
    setup = with_machine(swept(load(name), rng, (4, 9, 9)), rng)
    times = _times(rng, PLAIN)
    cause = scale_to(setup, machine.Drift("Z"), times)
    return Draw(f"growth in Z {name} {seed}", setup, (cause,), seeds, times=(times,))


def tied_backlash(name: str, seed: int) -> Draw:
    """Backlash in one sweep of equal steps: an axis that stops short by a share of its step looks the same.

    Not of the slowest axis, which never turns back.
    """
    seeds = seed_of("tied backlash", name, seed)
    rng = np.random.default_rng(seeds)
    setup = with_machine(swept(load(name), rng, (7, 7, 7)), rng)
    times = _times(rng, PLAIN)
    cause = scale_to(setup, machine.Backlash(_any(setup.session.chain.names[1:], rng)), times)
    return Draw(f"backlash in a sweep {name} {seed}", setup, (cause,), seeds, times=(times,))


def range_of_one_station(name: str, seed: int) -> Draw:
    """A range offset that one station cannot tell from the machine."""
    seeds = seed_of("range", name, seed)
    rng = np.random.default_rng(seeds)
    setup = Design().setup(load(name), rng)
    times = _times(rng)
    return Draw(
        f"range {name} {seed}", setup, (scale_to(setup, instrument.RangeOffset(), times),), seeds, times=(times,)
    )


def by_laser(kind: str, name: str, seed: int) -> Draw:
    """A cause along one linear axis, which an interferometer measures forward and backward, three runs."""
    seeds = seed_of("laser", kind, name, seed)
    rng, chain = np.random.default_rng(seeds), load(name)
    axis = _any(chain.linear, rng)
    setup = with_machine(along_one(chain, rng, axis), rng)
    cause = KINDS[kind].cause(setup.session, rng)
    while axis not in cause.answer().axes:
        cause = KINDS[kind].cause(setup.session, rng)
    times = _times(rng)
    cause = scale_along(setup, axis, LASER, cause, times)
    return Draw(f"laser {kind} {name} {seed}", setup, (cause,), seeds, times=(times,), laser_along=axis)


def of_table_1(seed: int) -> Draw:
    """The gantry of the virtual calibration paper: edges of the volume and random positions, 620 in all."""
    seeds = seed_of("table 1", seed)
    rng, chain = np.random.default_rng(seeds), load("gantry")
    session = hexahedron(chain, rng, edge=27, inside=312)
    stand = Stand(np.array([-1500.0, 1500.0, 300.0]), np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
    setup = Setup(session, table_1(chain, rng), Tracker(0.0, 0.25, 10.0, 2.5), {"s1": stand})
    return Draw(f"table 1 {seed}", setup, (), seeds, "coarse", coarse="legendre:6")


def with_machine(session: Session, rng: np.random.Generator, *, near: bool = False) -> Setup:
    """The session on a machine with smooth error motions, its tracker on its stands."""
    chain = session.chain
    return Setup(session, smooth(chain, rng), PLACES[chain.name].tracker, stands(chain, rng, near=near))


def _times(rng: np.random.Generator, among: tuple[float, float] = TIMES) -> float:
    low, high = np.log(among)
    return float(np.exp(rng.uniform(low, high)))


def _cause(kind: Kind, setup: Setup, rng: np.random.Generator) -> tuple[Cause, float]:
    """A cause in its size, on either side of zero."""
    cause = kind.cause(setup.session, rng)
    while kind.calibrated == "before" and share_left(setup, cause) < LEFT.get(cause.answer().kinds[0], 0.0):
        cause = kind.cause(setup.session, rng)
    if isinstance(cause, instrument.Outliers):
        return _large(cause, setup, rng), 0.0
    times = _times(rng)
    unsigned = isinstance(cause, machine.Backlash | machine.Lag | machine.Settling)
    sign = 1.0 if unsigned else float(rng.choice([-1.0, 1.0]))
    share = share_left(setup, cause) if kind.calibrated == "before" else 1.0
    return scale_to(setup, cause, times).scaled(sign / share), times


def _large(cause: instrument.Outliers, setup: Setup, rng: np.random.Generator) -> instrument.Outliers:
    """Outliers of 10 to 50 standard uncertainties across the beam, in any direction."""
    length = np.linalg.norm(without_noise(setup)[list(cause.numbers)], axis=1)
    directions = rng.normal(size=(len(length), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sizes = rng.uniform(10.0, 50.0, len(length)) * setup.tracker.across(length) / UM
    return replace(cause, shifts=tuple((directions * sizes[:, None]).reshape(-1).tolist()))


def _any(names: Sequence[str], rng: np.random.Generator) -> str:
    return str(rng.choice(list(names)))


def _cyclic(session: Session, rng: np.random.Generator) -> Cause:
    chain = session.chain
    axis = _any(chain.names, rng)
    period = float(rng.choice(GEARS if chain.axis(axis).rotary else LEADS[chain.name]))
    first, second = rng.uniform(0.0, 2 * np.pi, 2)
    return machine.Cyclic(axis, period, (float(first), float(second)))


def _drift(session: Session, rng: np.random.Generator) -> Cause:
    constant = float(rng.uniform(0.2, 0.5) * session.clock[-1]) if rng.random() < 0.5 else None
    return machine.Drift(_any("XYZ", rng), constant)


def _growth(session: Session, rng: np.random.Generator) -> Cause:
    return machine.Growth(_any(session.chain.linear, rng), "scale" if rng.random() < 0.5 else None)


def _sag(session: Session, rng: np.random.Generator) -> Cause:
    del session
    pairs = (("X", "Y"), ("Y", "X"), ("X", "Z"), ("Y", "Z"))
    return machine.Sag(*pairs[int(rng.integers(len(pairs)))])


def _steps(session: Session, rng: np.random.Generator) -> Cause:
    axis = _any(session.chain.linear, rng)
    pitch = float(np.ptp(session.chain.axis(axis).travel) / rng.uniform(6.0, 14.0))
    return machine.Steps(axis, round(pitch), round(float(rng.uniform(0.0, pitch))))


def _location(session: Session, rng: np.random.Generator) -> Cause:
    name = _any(LOCATIONS[session.chain.name], rng)
    return machine.Tilt(name[2], name[0])


def _ripple(session: Session, rng: np.random.Generator) -> Cause:
    waves, phase = rng.uniform(2.5, 4.5), rng.uniform(0.0, 2 * np.pi)
    return machine.Ripple(_any(session.chain.linear, rng), float(waves), float(phase))


def _outliers(session: Session, rng: np.random.Generator) -> Cause:
    rows = np.sort(rng.choice(np.flatnonzero(session.on_tool), int(rng.integers(2, 7)), replace=False)).tolist()
    return instrument.Outliers(tuple(rows), (1.0,) * 3 * len(rows))


def _station_shift(session: Session, rng: np.random.Generator) -> Cause:
    """Between the two runs of the second station; as much shift as turn, at 2 m."""
    rows = np.flatnonzero((session.stations == "s2") & (session.run == "r4"))
    shift, turn = rng.normal(size=3), 0.5 * rng.normal(size=3)
    return instrument.StationShift("s2", int(rows[0]), tuple(shift.tolist()), tuple(turn.tolist()))


def _angle(session: Session, rng: np.random.Generator) -> Cause:
    del session
    phase = rng.uniform(0.0, 2 * np.pi)
    circle, harmonic = _any(("azimuth", "elevation"), rng), int(rng.integers(1, 3))
    return instrument.AngleHarmonic(circle, harmonic, float(np.sin(phase)), float(np.cos(phase)))


def _tracker_drift(session: Session, rng: np.random.Generator) -> Cause:
    del session
    return instrument.TrackerDrift(tuple(rng.normal(size=3).tolist()), tuple((0.5 * rng.normal(size=3)).tolist()))


OUTSIDE_AND_BACK = Design(4, 2)
REFERENCED = Design(with_references=True)
ROUND = Design(3, 3, near=True)
KINDS: Mapping[str, Kind] = {
    "backlash": Kind(Design(), lambda session, rng: machine.Backlash(_any(session.chain.names, rng))),
    "cyclic": Kind(Design(), _cyclic),
    "thermal-drift": Kind(REFERENCED, _drift),
    "thermal-scale": Kind(Design(), _growth),
    "cross-axis": Kind(Design(), _sag),
    "quantised-compensation": Kind(Design(), _steps),
    "following-error": Kind(Design(moving=True), lambda session, rng: machine.Lag(_any(session.chain.linear, rng))),
    "location": Kind(Design(), _location, "before"),
    "higher-frequency": Kind(Design(), _ripple, "coarse"),
    "outliers": Kind(Design(), _outliers),
    "station-shift": Kind(OUTSIDE_AND_BACK, _station_shift),
    "tracker-angle": Kind(ROUND, _angle, "before"),
    "tracker-range": Kind(ROUND, lambda *_: instrument.RangeOffset(), "before"),
    "tracker-drift": Kind(REFERENCED, _tracker_drift),
    "air-scale": Kind(ROUND, lambda *_: instrument.AirScale(), "before"),
}  # fmt: skip
"""Of contract 4.3. References on the table tell a tracker that moves from a tool point that does; range, air and
angles need a machine that is known from before, since none of them has a length of its own in the data."""
BY_LASER = ("backlash", "cyclic", "quantised-compensation", "thermal-scale")
"""Kinds that an interferometer sees too."""
PAIRS = (
    ("backlash", "cyclic"),
    ("backlash", "thermal-drift"),
    ("thermal-scale", "cross-axis"),
    ("cyclic", "tracker-drift"),
    ("backlash", "outliers"),
    ("station-shift", "backlash"),
    ("following-error", "backlash"),
    ("thermal-drift", "cross-axis"),
)
"""Kinds at once."""
