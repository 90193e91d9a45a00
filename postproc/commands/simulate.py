"""`ncomp simulate`: a virtual machine with known errors, and what an instrument would observe of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from kinematics.errors import UserError
from postproc.commands import strategy as options
from postproc.commands import virtual_machine as virtual
from postproc.commands.shared import MachineName, check_places, machine_of, result
from postproc.numbers import given_once

if TYPE_CHECKING:
    import numpy as np

    from calibration.instruments import Instrument
    from calibration.measurement import Measurement
    from calibration.plan import Plan
    from kinematics.effects import Effect
    from kinematics.machine import Machine
    from kinematics.state import State
    from kinematics.transforms import Pose

INSTRUMENT, FAULTS = "The instrument", "What goes wrong"
SHEETS: Mapping[str, Mapping[str, float]] = {
    "laser-tracker": {"u_range_um_per_m": 0.25, "u_angle_um": 10.0, "u_angle_um_per_m": 2.5},
    "interferometer": {"u_um": 0.2, "u_um_per_m": 0.5},
    "part": {"u_um": 1.0, "u_um_per_m": 1.5},
}
"""Standard uncertainties unless others are given: of the tracker those of the virtual calibration paper, Table 3."""
SETUP_S = 1200.0
"""To move a tracker; virtual calibration paper, 3.2."""
AWAY_MM = 1500.0
"""From the volume to a tracker of which nothing is said."""
NEAREST_MM = 1.0
"""A target closer to a tracker has no direction."""
LONG = 200_000
"""Observations from which progress is shown."""

EPILOG = (
    "Examples:\n\n"
    "`ncomp simulate --machine gantry --strategy hexahedron --points 600 --tracker -1500,1500,300 -o data.csv "
    "--truth truth.json`\n\n"
    "`ncomp simulate --machine bzt_pfu --strategy plan.csv --effect backlash:axis=X,width=12 "
    "--effect thermal-scale-sensor:axis=Z,sensor=scale,coefficient=11 --temperature scale=20:24 -o data.csv`\n\n"
    "`ncomp simulate --machine cframe --strategy axes --runs 5 --instrument interferometer --calibration cal.json "
    "-o data.csv`"
)


def simulate(
    machine: MachineName,
    strategy: Annotated[
        str, typer.Option(metavar="NAME|PLAN.csv", help="A strategy, as in *ncomp plan*, or a plan of all its options.")
    ],
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="DATA.csv", help="Measurement; - for standard output.")
    ],
    truth: virtual.TruthFile = None,
    points: options.Points = None,
    spacing: options.Spacing = None,
    ranges: options.Ranges = None,
    margin: options.Margin = 0.0,
    rotary: options.RotaryMode = "fixed",
    order: options.OrderName = "given",
    runs: options.Runs = 1,
    target: options.TargetVectors = None,
    target_order: options.TargetOrderName = "in-turn",
    errors: virtual.Errors = None,
    calibration: virtual.TruthCalibration = None,
    location: virtual.Location = 0.0,
    effect: virtual.EffectTexts = None,
    temperature: virtual.Temperatures = None,
    instrument: Annotated[
        str, typer.Option(metavar="KIND", rich_help_panel=INSTRUMENT, help="laser-tracker, interferometer or part.")
    ] = "laser-tracker",
    uncertainty: Annotated[
        list[str] | None,
        typer.Option(
            "--uncertainty",
            "-u",
            metavar="u_angle_um=10",
            rich_help_panel=INSTRUMENT,
            help="Standard uncertainties (k=1), by their keys in a measurement file; all others are zero. Repeatable.",
        ),
    ] = None,
    tracker: Annotated[
        list[str] | None,
        typer.Option(
            metavar="x,y,z",
            rich_help_panel=INSTRUMENT,
            help="Where it stands, mm, in the workpiece frame (on the bed: machine frame). Repeatable: stations.",
        ),
    ] = None,
    stands_on: Annotated[
        str, typer.Option(metavar="workpiece|bed", rich_help_panel=INSTRUMENT, help="On the table, or on the floor.")
    ] = "workpiece",
    elevation: Annotated[
        str | None,
        typer.Option(metavar="low:high", rich_help_panel=INSTRUMENT, help="Articulation of the tracker, degrees."),
    ] = None,
    incidence: Annotated[
        float | None,
        typer.Option(
            metavar="deg", rich_help_panel=INSTRUMENT, help="Largest angle between beam and reflector's axis."
        ),
    ] = None,
    planar: Annotated[
        bool, typer.Option("--planar", rich_help_panel=INSTRUMENT, help="A part measured in x and y only.")
    ] = False,
    noise: Annotated[
        float, typer.Option(min=0.0, rich_help_panel=INSTRUMENT, help="Noise, times the uncertainties; 0 is none.")
    ] = 1.0,
    outliers: Annotated[
        float, typer.Option(metavar="share", min=0.0, max=1.0, rich_help_panel=FAULTS, help="50 to 500 um off.")
    ] = 0.0,
    duplicates: Annotated[
        float,
        typer.Option(metavar="share", min=0.0, max=1.0, rich_help_panel=FAULTS, help="Rows that stand there twice."),
    ] = 0.0,
    missing: Annotated[
        float, typer.Option(metavar="share", min=0.0, max=1.0, rich_help_panel=FAULTS, help="Rows that are not there.")
    ] = 0.0,
    seed: options.Seed = 0,
) -> None:
    """Simulate a measurement of a machine with known errors, which moves by its exact kinematics."""
    import numpy as np

    from calibration.effect_text import read_effects
    from calibration.measurement_file import write_measurement
    from calibration.simulate import Faults, observe, read_out, spoil, with_temperatures
    from kinematics.model import encode_model
    from postproc.terminal import console, progress_of, say

    if truth is not None and truth == output:
        raise UserError(f"--truth and --output both name {output}")
    check_places((strategy, calibration), (output, truth))
    options.check_finite(
        location=location,
        incidence=incidence,
        noise=noise,
        outliers=outliers,
        duplicates=duplicates,
        missing=missing,
    )
    found = machine_of(machine)
    # one stream each, so that another instrument measures the same machine
    draws = [np.random.default_rng(each) for each in np.random.SeedSequence(seed).spawn(4)]
    told = read_effects(effect or [], found)
    model = virtual.virtual_model(found, errors, calibration, location, told, draws[0])
    sensor = _instrument(instrument, uncertainty or [], planar)
    plan = _plan(found, strategy, points, spacing, ranges, margin, rotary, order, runs, target, target_order, seed)
    state, poses = _placed(plan, instrument, tracker or [], draws[1])
    _check_names(told, plan, state)
    state = with_temperatures(state, virtual.courses_of(temperature or [])) if temperature else state
    standing = _standing(stands_on)
    rows = _reached(plan, state, sensor, poses, standing, elevation, incidence)
    repeat = len(state) // len(plan)
    axis = None if plan.axis is None else np.tile(plan.axis, repeat)[rows]
    run = np.tile(plan.run, repeat)[rows]
    with progress_of(len(state), "simulating", LONG) as progress:
        measured = observe(
            found, model, state.rows(rows), sensor, draws[2], poses, plan.targets, stands_on=standing,
            axis=axis if instrument == "interferometer" else None, run=run, noise_scale=noise, progress=progress,
        )  # fmt: skip
    if poses is not None:
        _check_distance(measured)
    measured, spoiled = spoil(read_out(measured), Faults(outliers, duplicates=duplicates, missing=missing), draws[3])
    _check_left(measured)
    with result(truth) as truth_file, result(output) as file:
        write_measurement(measured, file)
        truth_file.write(encode_model(model))
    console.print(plan.summary)
    for note in spoiled:
        say("simulated", note)
    console.print(f"{len(measured)} observations by {instrument} of {len(model.effects)} effects, seed {seed}")


def _instrument(kind: str, uncertainties: list[str], planar: bool) -> Instrument:
    from calibration.measurement_file import KINDS, check_uncertainties, uncertainty_keys

    if kind not in SHEETS:
        raise UserError(f"--instrument {kind}: expected one of {', '.join(SHEETS)}")
    known = uncertainty_keys(KINDS[kind])
    given: list[tuple[str, float]] = []
    for text in uncertainties:
        name, _, value = text.partition("=")
        if name.strip() not in known:
            raise UserError(f"--uncertainty {text}: {kind} has {', '.join(known)}")
        (number,) = options.numbers(value, 1, f"--uncertainty {text}")
        if number < 0:
            raise UserError(f"--uncertainty {text}: negative")
        given.append((name.strip(), number))
    values = given_once(given, "--uncertainty ") if given else SHEETS[kind]
    check_uncertainties(kind, values, "--uncertainty", "-u {}=...")
    return KINDS[kind](**values, **({"components": 2 if planar else 3} if kind == "part" else {}))  # type: ignore[arg-type]


def _plan(
    machine: Machine,
    strategy: str,
    points: str | None,
    spacing: float | None,
    ranges: list[str] | None,
    margin: float,
    rotary: str,
    order: str,
    runs: int,
    targets: list[str] | None,
    target_order: str,
    seed: int,
) -> Plan:
    """The plan of a file, or of a strategy."""
    from calibration.plan_file import read_plan
    from postproc.terminal import say

    if strategy == "continuous":
        raise UserError("laser runs in motion are simulated by: ncomp simulate-continuous")
    if strategy.lower().endswith(".csv") or Path(strategy).is_file():
        if not Path(strategy).exists():
            raise UserError(f"--strategy {strategy}: there is no such file")
        if any(option is not None for option in (points, spacing, ranges, targets)):
            raise UserError(f"{strategy} says already where to measure, and with which targets")
        plan = read_plan(Path(strategy), machine)
        for note in plan.notes:
            say("note", note)
        return plan
    choices = options.choices_of(
        machine,
        ranges=ranges,
        margin=margin,
        rotary=rotary,
        order=order,
        runs=runs,
        targets=targets,
        target_order=target_order,
        seed=seed,
    )
    return options.plan_of(machine, strategy, points, spacing, choices)


def _placed(
    plan: Plan, instrument: str, trackers: list[str], rng: np.random.Generator
) -> tuple[State, Mapping[str, Pose] | None]:
    """The states that are measured, once for each station, and the poses of a tracker at its stations."""
    from calibration.simulate import at_stations, tracker_pose
    from postproc.terminal import say

    if instrument != "laser-tracker":
        if trackers:
            raise UserError(f"--tracker is no option of --instrument {instrument}")
        return plan.state, None
    places = [options.numbers(text, 3, f"--tracker {text}") for text in trackers]
    if not places:
        places = [_beside(plan)]
        said = ",".join(f"{v:g}" for v in places[0])
        say("note", f"the tracker stands 1.5 m before the volume, at its middle: --tracker {said}")
    poses = {f"s{k}": tracker_pose((x, y, z), rng) for k, (x, y, z) in enumerate(places, start=1)}
    return at_stations(plan.state, list(poses), SETUP_S), poses


def _beside(plan: Plan) -> tuple[float, ...]:
    from kinematics.forward import tool_point

    points = tool_point(plan.machine, plan.positions)
    low, high = points.min(axis=0), points.max(axis=0)
    _, y, z = ((low + high) / 2).round().tolist()
    return float(round(low[0] - AWAY_MM)), y, z


def _standing(text: str) -> Literal["workpiece", "bed"]:
    from calibration.places import STANDS_ON

    if text not in STANDS_ON:
        raise UserError(f"--stands-on {text}: expected workpiece or bed")
    return STANDS_ON[text]


def _check_names(effects: list[Effect], plan: Plan, state: State) -> None:
    """UserError for an effect of a target or a station that the measurement does not have."""
    import numpy as np

    known = {"target": list(plan.targets), "station": []}
    if state.station is not None:
        known["station"] = np.unique(state.station).tolist()
    for effect in effects:
        for what, names in known.items():
            name = getattr(effect, what, None)
            if name is not None and name not in names:
                there = f"known are {', '.join(names)}" if names else "there is none"
                raise UserError(f"--effect {effect.name}: no {what} {name!r}; {there}")


def _check_distance(measured: Measurement) -> None:
    """UserError for a target inside the tracker."""
    import numpy as np

    far = np.linalg.norm(measured.observed, axis=1) >= NEAREST_MM
    if not far.all():
        row = int(np.argmin(far))
        assert measured.state.station is not None
        raise UserError(
            f"--tracker: observation {row + 1} is closer than {NEAREST_MM:g} mm to the tracker at "
            f"{measured.state.station[row]}; it can't stand there"
        )


def _reached(
    plan: Plan,
    state: State,
    instrument: Instrument,
    poses: Mapping[str, Pose] | None,
    stands_on: Literal["workpiece", "bed"],
    elevation: str | None,
    incidence: float | None,
) -> np.ndarray:
    """Rows that the instrument sees; what it does not is said."""
    import numpy as np

    from calibration.measurement import Measurement
    from calibration.reach import Reach, in_reach
    from postproc.terminal import say

    if elevation is None and incidence is None:
        return np.arange(len(state))
    if poses is None:
        raise UserError("--elevation and --incidence are options of --instrument laser-tracker")
    limits = None
    if elevation is not None:
        low, high = options.numbers(elevation, 2, f"--elevation {elevation}", ":")
        limits = (low, high)
    blank = Measurement(
        plan.machine, instrument, state, np.zeros((len(state), 3)), plan.targets, stands_on=stands_on, run=None
    )
    seen = in_reach(blank, poses, Reach(limits, incidence))
    for note in seen.notes:
        say("note", note)
    if not seen.rows.any():
        raise UserError("the tracker sees none of the points from where it stands")
    return np.flatnonzero(seen.rows)


def _check_left(measured: Measurement) -> None:
    if not len(measured):
        raise UserError("--missing leaves no observation")
