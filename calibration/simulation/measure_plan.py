"""Virtual measurement of a plan: the observations of an instrument at the positions, in the order of the plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from calibration.instruments import (
    Instrument,
    TouchProbe,
)
from calibration.instruments.touch_probe import TIP
from calibration.measurement.measurement import Measurement
from calibration.measurement.plan import Plan
from calibration.observation.reach import Reach, in_reach
from calibration.simulation.simulate import (
    Faults,
    at_stations,
    observe,
    read_out,
    spoil,
    stationed,
    tracker_pose,
    with_temperatures,
)
from calibration.simulation.touch_probe import Spheres, into_positions, probed
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.forward import tool_point
from kinematics.machine import Machine, Vector
from kinematics.state import State
from kinematics.transforms import Array, Pose
from kinematics.user_error import UserError
from rendering.shown import Shown

DEFAULT_TRACKER_MM = 1500.0
"""Distance from the volume to a tracker without a given position, mm."""
NEAREST_MEASURED_MM = 1.0
"""Smallest distance of a target from a tracker, mm; a closer one has no direction."""
REACH = "--elevation, --incidence and --beam-mm"
"""Options of the limits of a beam."""
SETUP_S = 1200.0
"""Time to move a tracker, s; virtual calibration paper, 3.2."""


@dataclass(frozen=True)
class VirtualInstrument:
    """An instrument, its stations, and the faults of its data."""

    instrument: Instrument
    """The instrument with its standard uncertainties (k = 1), um."""
    trackers: Sequence[tuple[float, float, float]] = ()
    """Positions of a laser tracker, mm, in the frame of `stands_on`, one station each; default: before the volume."""
    stands_on: Literal["workpiece", "bed"] = "workpiece"
    """Foundation of a laser tracker: the workpiece table, or the bed."""
    reach: Reach | None = None
    """Elevation and incidence that a tracker can see, degrees; None without limits."""
    error_motions: Sequence[str] = ()
    """Letters of the error motions of linear axes of an interferometer; default: the positioning deviation."""
    noise_scale: float = 1.0
    """Noise as a multiple of the uncertainties."""
    faults: Faults = field(default_factory=Faults)
    """Shares of outliers, doubled and missing rows."""
    temperatures: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Start and end by sensor, K from 20 degC."""
    spheres: Spheres = field(default_factory=lambda: Spheres({}, {}))
    """Spheres of a touch probe."""


@dataclass(frozen=True, repr=False)
class Simulated(Shown):
    """A virtual measurement."""

    measurement: Measurement
    """The virtual measurement."""
    notes: tuple[str, ...]
    """Position of the tracker that was chosen, and the points beyond its reach."""
    spoiled: tuple[str, ...]
    """Numbers of outliers, doubled and missing rows."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return self.measurement.headline


def streams(seed: int, count: int) -> list[np.random.Generator]:
    """Independent streams of random numbers."""
    return [np.random.default_rng(each) for each in np.random.SeedSequence(seed).spawn(count)]


def measure_plan(
    plan: Plan,
    model: ErrorModel,
    virtual: VirtualInstrument,
    draws: Sequence[np.random.Generator],
    progress: Callable[[int], None] = lambda _: None,
) -> Simulated:
    """The observations of a machine with the errors `model` at the positions of a plan.

    draws: random numbers of the poses, the noise and the faults. UserError for options that the instrument does not
    have, for a tracker that sees no point, and for a tracker inside the targets.
    """
    if virtual.instrument.FINDS_CENTRES:
        return _probed(plan, model, virtual, TouchProbe.expect(virtual.instrument), draws)
    if plan.spheres:
        raise UserError(f"--instrument {virtual.instrument.kind()}: a plan of spheres needs --instrument touch-probe")
    state, poses, stated, notes = _stationed(plan, virtual, draws[0])
    state, kinds = virtual.instrument.planned(state)
    check_names(model.effects, plan.targets, [] if state.station is None else np.unique(state.station).tolist())
    state = with_temperatures(state, virtual.temperatures) if virtual.temperatures else state
    rows, unseen = _reached(plan, state, virtual, poses)
    planned = rows % len(plan)  # the plan is repeated at each station
    readings = virtual.instrument.readings_in(plan.machine, plan.axis, planned, virtual.error_motions)
    rows = rows[readings.rows]
    runs = np.tile(plan.run, len(state) // len(plan)) if kinds is None else kinds
    measured = observe(
        plan.machine, model, state.rows(rows), virtual.instrument, draws[1], poses, plan.targets,
        stands_on=virtual.stands_on, axis=readings.axis, run=runs[rows], component=readings.component,
        noise_scale=virtual.noise_scale, progress=progress,
    )  # fmt: skip
    if poses is not None:
        check_distance(measured)
    measured, spoiled = spoil(read_out(replace(measured, spheres=stated)), virtual.faults, draws[2])
    if not len(measured):
        raise UserError("--missing leaves no observation: choose a smaller share")
    return Simulated(measured, (*notes, *unseen), spoiled)


def _probed(
    plan: Plan, model: ErrorModel, virtual: VirtualInstrument, probe: TouchProbe, draws: Sequence[np.random.Generator]
) -> Simulated:
    """The virtual measurement of a touch probe; draws as of `measure_plan`."""
    refused = {"--tracker": virtual.trackers, "--stands-on": virtual.stands_on != "workpiece", REACH: virtual.reach}
    for option, given in refused.items():
        if given:
            raise UserError(f"{option}: no option of --instrument touch-probe")
    if plan.spheres:
        virtual = replace(virtual, spheres=_of_plan(plan, virtual.spheres))
    if not virtual.spheres.centres:
        raise UserError("--instrument touch-probe: the spheres are missing: state --sphere NAME=x,y,z")
    check_names(model.effects, {TIP: None}, list(virtual.spheres.centres))
    if virtual.temperatures:
        plan = replace(plan, state=with_temperatures(plan.state, virtual.temperatures))
    measured, notes = probed(plan, model, probe, virtual.spheres, (draws[0], draws[1]), virtual.noise_scale)
    measured, spoiled = spoil(measured, virtual.faults, draws[2])
    if not len(measured):
        raise UserError("--missing leaves no observation: choose a smaller share")
    return Simulated(into_positions(measured), notes, spoiled)


def _of_plan(plan: Plan, stated: Spheres) -> Spheres:
    """The spheres of a plan with the stated distances; UserError for spheres that are stated besides."""
    if stated.centres:
        raise UserError("--sphere: the plan has its own spheres")
    return Spheres(plan.spheres, stated.distances)


def tracker_poses(
    machine: Machine, positions: Array, trackers: Sequence[tuple[float, float, float]], rng: np.random.Generator
) -> tuple[dict[str, Pose], tuple[str, ...]]:
    """Poses of a tracker by station, at positions, mm, or before the volume of positions `(n, axes)`; notes."""
    notes: tuple[str, ...] = ()
    if not trackers:
        trackers = [_before(machine, positions)]
        position = ",".join(f"{v:g}" for v in trackers[0])
        notes = (f"the tracker is 1.5 m in front of the middle of the volume: --tracker {position}",)
    return {f"s{k}": tracker_pose(tracker, rng) for k, tracker in enumerate(trackers, start=1)}, notes


def check_distance(measured: Measurement) -> None:
    """UserError for a target inside the tracker."""
    points = measured.state.need("observed", "a tracker")
    far = np.linalg.norm(points, axis=1) >= NEAREST_MEASURED_MM
    if not far.all():
        row = int(np.argmin(far))
        assert measured.state.station is not None
        raise UserError(
            f"--tracker: observation {row + 1} is closer than {NEAREST_MEASURED_MM:g} mm to the tracker at "
            f"{measured.state.station[row]}; move the tracker"
        )


def check_names(effects: Sequence[Effect], targets: Mapping[str, object], stations: Sequence[str]) -> None:
    """UserError for an effect of a target or a station that the measurement does not have."""
    for effect in effects:
        for kind, names in (("target", list(targets)), ("station", list(stations))):
            name = getattr(effect, kind, None)
            if name is not None and name not in names:
                known = f"known are {', '.join(names)}" if names else "there is none"
                raise UserError(f"--effect {effect.name}: no {kind} {name!r}; {known}")


def _before(machine: Machine, positions: Array) -> tuple[float, float, float]:
    points = tool_point(machine, positions)
    low, high = points.min(axis=0), points.max(axis=0)
    _, y, z = ((low + high) / 2).round().tolist()
    return float(round(low[0] - DEFAULT_TRACKER_MM)), y, z


def _stationed(
    plan: Plan, virtual: VirtualInstrument, rng: np.random.Generator
) -> tuple[State, Mapping[str, Pose] | None, Mapping[str, Vector], tuple[str, ...]]:
    """The measured states, poses of the instrument at its stations, positions that the plan states, and notes."""
    if not virtual.instrument.STATIONED:
        if virtual.trackers:
            raise UserError(f"--tracker is no option of --instrument {virtual.instrument.kind()}: leave it out")
        if virtual.stands_on != "workpiece":
            raise UserError(f"--stands-on is no option of --instrument {virtual.instrument.kind()}: leave it out")
        return (replace(plan.state, station=None) if plan.stations else plan.state), None, {}, ()
    if plan.stations:
        state, stations = stationed(plan, virtual.trackers)
        return state, {name: tracker_pose(position, rng) for name, position in stations.items()}, stations, ()
    poses, notes = tracker_poses(plan.machine, plan.positions, virtual.trackers, rng)
    return at_stations(plan.state, list(poses), SETUP_S), poses, {}, notes


def _reached(
    plan: Plan, state: State, virtual: VirtualInstrument, poses: Mapping[str, Pose] | None
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Rows that the instrument sees, and notes on the others."""
    if virtual.reach is None:
        return np.arange(len(state)), ()
    if poses is None:
        raise UserError(f"{REACH} are options of --instrument laser-tracker and ranging")
    blank = Measurement(
        plan.machine, virtual.instrument, state, np.zeros((len(state), 3)), plan.targets,
        stands_on=virtual.stands_on, run=None,
    )  # fmt: skip
    visible = in_reach(blank, poses, virtual.reach)
    if not visible.rows.any():
        raise UserError(f"the tracker observes none of the points from its position: {'; '.join(visible.notes)}")
    return np.flatnonzero(visible.rows), tuple(visible.notes)
