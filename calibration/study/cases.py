"""Cases ready for work in any process: all entries of a study's cases, read and laid out."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path

import numpy as np

import calibration
import kinematics
import machines
from calibration.design.layout import Setup, laid_out
from calibration.design.random_machines import TrueModels
from calibration.design.volume import Volume
from calibration.instruments import Instrument, TouchProbe
from calibration.measurement.measurement import SPINDLE_NOSE, Distance, Target
from calibration.measurement.plan import Choices, Plan, Timing
from calibration.measurement.plan_file import read_plan
from calibration.observation.reach import Reach
from calibration.optimal.candidates import obstacle_of
from calibration.optimal.optimise import Request, optimised
from calibration.planning.strategies import plan as plan_of
from calibration.simulation.effect_text import read_effects
from calibration.simulation.true_model import (
    DEFAULT,
    HalfWidths,
    checked_half_widths,
    location_errors,
    read_half_widths,
)
from calibration.study.definition import (
    SPHERES_BY_DEFAULT,
    CaseEntry,
    ErrorsEntry,
    FitEntry,
    Range,
    StudyEntry,
    instrument_of,
)
from calibration.study.spheres import sphere_plan
from kinematics.effects import Effect
from kinematics.machine import Machine, Vector
from kinematics.running.workers import code
from kinematics.state import REFERENCE_DEGC
from kinematics.user_error import UserError

CODE = (calibration.__name__, kinematics.__name__)
"""Packages that work on cases."""
OPTIMISED = "optimised"
"""Name of the strategy with optimised positions."""
ACTIVE = 180.0
"""Incidence, degrees, that denotes a reflector that turns to the tracker by itself."""


@dataclass(frozen=True)
class Case:
    """One method to measure virtual machines and to fit the data."""

    name: str
    plan: Plan
    instrument: Instrument
    trackers: tuple[Vector, ...]
    reach: Reach | None
    temperatures: Mapping[str, tuple[float, float]]
    fit: FitEntry
    other_effects: tuple[Effect, ...]
    true_models: TrueModels
    volumes: tuple[Volume, ...]
    """The grid, and other volumes of the evaluation."""
    seed: int
    distances: tuple[Distance, ...] = ()
    """Calibrated distances between the spheres of a touch probe."""

    def setup(self) -> Setup:
        """The case laid out."""
        return laid_out(
            self.plan, self.instrument, self.trackers, self.reach, self.fit.weighting, self.temperatures, self.distances
        )

    @property
    def key(self) -> str:
        """Fingerprint of everything that decides the results, the code included."""
        plan, true_models = self.plan, self.true_models
        decisive = (
            plan.machine, plan.strategy, plan.state, plan.run, plan.axis, plan.targets, self.instrument, self.trackers,
            self.reach, self.temperatures, self.fit, self.other_effects, true_models.model.effects,
            true_models.low, true_models.high, true_models.linear, self.volumes, self.seed, plan.spheres,
            self.distances,
        )  # fmt: skip
        digest = hashlib.sha256()
        for part in _content(decisive):
            digest.update(part)
        return f"{digest.hexdigest()[:12]}-{code(CODE)}"


def _content(value: object) -> Iterator[bytes]:
    """The content of a value, without caches: numbers, names and arrays, in their order."""
    if isinstance(value, np.ndarray):
        numbers = value.dtype.kind != "O"
        yield f"{value.dtype.str}{value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes() if numbers else repr(value.tolist()).encode()
    elif is_dataclass(value):
        for field in fields(value):
            if field.init:
                yield from _content(getattr(value, field.name))
    elif isinstance(value, Mapping):
        for name, entry in value.items():
            yield f"{name!r}:".encode()
            yield from _content(entry)
    elif isinstance(value, tuple | list):
        yield f"{len(value)}".encode()
        for entry in value:
            yield from _content(entry)
    else:
        yield f"{value!r};".encode()


def read_cases(study: StudyEntry, folder: Path) -> list[Case]:
    """All cases of a study; paths in it are relative to `folder`.

    UserError, with the name of the case, for an entry that cannot be used.
    """
    machine = machines.load(_path(study.machine, folder))
    instrument = instrument_of(study.instrument, "study", folder)
    true_models = _true_models(study.errors, machine, folder)
    return [_case(entry, study, machine, instrument, true_models, folder) for entry in study.case]


def _case(
    entry: CaseEntry, study: StudyEntry, machine: Machine, instrument: Instrument, true_models: TrueModels, folder: Path
) -> Case:
    try:
        fit = entry.fit or study.fit
        if entry.instrument is not None:
            instrument = instrument_of(entry.instrument, "instrument", folder)
        trackers = _trackers(entry)
        reach = _reach(entry, study)
        other_effects = read_effects([_path(text, folder) for text in fit.effects], machine, "[fit] effects")
        plan, distances = _planned(entry, machine, instrument, trackers, reach, folder)
        trackers = () if entry.strategy == OPTIMISED else trackers
        tool = next(iter(plan.targets.values())).position
        sensors = {
            name: (start - REFERENCE_DEGC, end - REFERENCE_DEGC)
            for name, (start, end) in study.instrument.temperature.items()
        }
        volume = _volume(study.volume, machine, tool, plan, sensors)
        case = Case(
            entry.name,
            plan,
            instrument,
            trackers or tuple(plan.stations.values()),
            reach,
            sensors,
            fit,
            tuple(other_effects),
            true_models,
            (volume,),
            study.seed,
            distances,
        )
        case.setup()
    except UserError as fault:
        raise UserError(f"case {entry.name}: {fault}") from None
    return case


def with_volume(case: Case, volume: Volume) -> Case:
    """The case with another volume of the evaluation."""
    return replace(case, volumes=(*case.volumes, volume))


def choices_of(entry: CaseEntry) -> Choices:
    """Choice of positions and of the measuring sequence, from the entry of a case."""
    timed = entry.dwell_s is not None or entry.feed is not None
    timing = (
        Timing(entry.point_s, entry.setup_min, entry.dwell_s, entry.feed)
        if timed
        else Timing(entry.point_s, entry.setup_min)
    )
    return Choices(
        ranges=entry.ranges,
        margin_mm=entry.margin_mm,
        planes_at=entry.planes_at,
        rotary=entry.rotary,  # type: ignore[arg-type]
        rotary_points=entry.rotary_points,
        order=entry.order,  # type: ignore[arg-type]
        targets=targets_of(entry),
        target_order=entry.target_order,  # type: ignore[arg-type]
        references=entry.references,
        approach=entry.approach,  # type: ignore[arg-type]
        overrun=entry.overrun,
        runs=entry.runs,
        timing=timing,
    )


def targets_of(entry: CaseEntry) -> dict[str, Target]:
    """The tool vectors of a case, by name."""
    named = entry.tools if isinstance(entry.tools, dict) else {str(k): v for k, v in enumerate(entry.tools, start=1)}
    return {name: Target(vector) for name, vector in named.items()} or {"1": SPINDLE_NOSE}


def _wish(entry: CaseEntry, trackers: tuple[Vector, ...], reach: Reach | None, machine: Machine) -> Request:
    """Requirements of an optimised case."""
    points = sum(entry.points) if isinstance(entry.points, tuple) else entry.points
    return Request(
        choices_of(entry),
        points,
        entry.minutes,
        trackers,
        reach,
        [obstacle_of(box) for box in entry.obstacles],
        read_effects(entry.visible, machine, "visible"),
        entry.candidates,
        entry.stations,
        entry.targets,
    )


def _planned(
    entry: CaseEntry,
    machine: Machine,
    instrument: Instrument,
    trackers: tuple[Vector, ...],
    reach: Reach | None,
    folder: Path,
) -> tuple[Plan, tuple[Distance, ...]]:
    """The plan of a case, and calibrated distances of the spheres that it may have."""
    if instrument.FINDS_CENTRES:
        return sphere_plan(entry, machine, TouchProbe.expect(instrument), folder)
    if entry.distances or entry.spheres != SPHERES_BY_DEFAULT:
        raise UserError('spheres and distances are of instrument = { kind = "touch-probe" }')
    if entry.strategy == OPTIMISED:
        return optimised(machine, instrument, _wish(entry, trackers, reach, machine)).plan, ()
    return _plan(entry, machine, folder), ()


def _plan(entry: CaseEntry, machine: Machine, folder: Path) -> Plan:
    if any((entry.minutes, entry.obstacles, entry.visible, entry.stations, entry.targets)):
        raise UserError(f'minutes, obstacles, visible, stations and targets are of strategy = "{OPTIMISED}"')
    if entry.strategy.lower().endswith(".csv"):
        if entry.points is not None or entry.spacing_mm is not None or entry.tools:
            raise UserError(f"{entry.strategy} has its own positions and tools: delete points, spacing_mm and tools")
        plan = read_plan(folder / entry.strategy, machine)
        return plan if plan.minutes else replace(plan, minutes=entry.setup_min + len(plan) * entry.point_s / 60.0)
    points = list(entry.points) if isinstance(entry.points, tuple) else entry.points
    return plan_of(machine, entry.strategy, points, entry.spacing_mm, choices_of(entry))


def _trackers(entry: CaseEntry) -> tuple[Vector, ...]:
    if all(isinstance(position, tuple) for position in entry.tracker):
        return tuple(position for position in entry.tracker if isinstance(position, tuple))
    numbers = tuple(position for position in entry.tracker if not isinstance(position, tuple))
    if len(numbers) != 3 or len(entry.tracker) != 3:
        raise UserError("tracker: expected [x, y, z], or a list of these")
    return (numbers,)


def _reach(entry: CaseEntry, study: StudyEntry) -> Reach | None:
    instrument = study.instrument
    incidence = entry.incidence_deg or instrument.incidence_deg
    limits = Reach(
        entry.elevation or instrument.elevation,
        None if incidence is None or incidence >= ACTIVE else incidence,
        instrument.range_mm,
    )
    return None if limits == Reach() else limits


def _turned(plan: Plan) -> dict[str, tuple[float, float]]:
    """Rotary axes that move in a plan, with the range that they cover, degrees."""
    positions = plan.positions / plan.machine.scale
    low, high = positions.min(axis=0), positions.max(axis=0)
    return {
        axis.name: (float(low[i]), float(high[i]))
        for i, axis in enumerate(plan.machine.axes)
        if axis.rotary and high[i] > low[i]
    }


def _volume(ranges: Mapping[str, Range], machine: Machine, tool: Vector, plan: Plan, sensors: Iterable[str]) -> Volume:
    """The grid of the evaluation, over stated ranges of axes, or the travel and the rotary ranges of the plan."""
    stated = {axis: own for axis, own in ranges.items() if machine.axes[machine.index(axis)].rotary}
    return Volume.of(machine, tool, {**_turned(plan), **stated}, sensors, ranges)


def _true_models(entry: ErrorsEntry, machine: Machine, folder: Path) -> TrueModels:
    drawn = read_effects([_path(text, folder) for text in entry.effects], machine, "[errors] effects")
    fixed = read_effects([_path(text, folder) for text in entry.fixed], machine, "[errors] fixed")
    locations = location_errors(machine, entry.location) if entry.location else []
    return TrueModels.of(machine, _half_widths(entry, folder), [*locations, *drawn], fixed)


def _half_widths(entry: ErrorsEntry, folder: Path) -> HalfWidths:
    if entry.model == "none":
        if entry.half_widths is not None:
            raise UserError('[errors] model = "none" has no rows E_XX and no half_widths: delete them or the model')
        return {}
    if isinstance(entry.half_widths, dict):
        return checked_half_widths(entry.half_widths, "[errors]")
    if entry.half_widths in (None, "table-1"):
        if entry.model == "fourier" and entry.half_widths is None:
            raise UserError('[errors] model = "fourier": rows E_XX = [a0, a1, n1, b1, c1, ...], or half_widths')
        return DEFAULT
    return read_half_widths(folder / str(entry.half_widths))


def _path(text: str, folder: Path) -> str:
    """A path with its folder; other texts unchanged."""
    is_path = text.lower().endswith((".json", ".toml")) and not text.lstrip().startswith("{")
    return str(folder / text) if is_path else text
