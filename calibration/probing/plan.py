"""A measurement with a touch probe on spheres: from spheres and a number of rotary positions to rows and moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from calibration.instruments.touch_probe import TIP
from calibration.measurement.measurement import Target, with_moves
from calibration.measurement.plan import Plan
from calibration.optimal.measuring_order import toured
from calibration.probing.bodies import Artefact, Bodies, Probe
from calibration.probing.designs import DESIGNS, candidates, circles, grid, laid, rotary_ranges
from calibration.probing.optimal import most_informative
from calibration.probing.paths import TOUCH, Moves, Reached, Ways, centre_point, moves_of, unproven
from calibration.probing.touches import Approach
from kinematics.inverse import linear_positions
from kinematics.machine import Machine, Vector
from kinematics.running.progress import Progress, silent
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

CANDIDATES = 200
DEFAULT_CONTACTS = 34
SETUP_MIN = 20.0
FEWEST_ROTARY_POSITIONS = 4
"""Fewest rotary positions within reach of a plan."""


@dataclass(frozen=True)
class Feeds:
    """Feeds of a measuring program, mm/min; degrees/min where only rotary axes move."""

    move: float = 2000.0
    probing: float = 200.0
    measuring: float = 30.0
    """Feed of the second touch, which counts."""


@dataclass(frozen=True)
class ProbeRequest:
    """Requirements of the measurement."""

    probe: Probe
    artefact: Artefact
    design: str = "optimised"
    points: int = DEFAULT_CONTACTS
    """Number of rotary positions."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Ranges of rotary axes, degrees."""
    references: int = 0
    """Number of rotary positions between repetitions of the first centre; 0: only at the end."""
    approach: Approach = field(default_factory=Approach)
    feeds: Feeds = field(default_factory=Feeds)
    u_um: float = 1.0
    """Standard uncertainty of each coordinate of a centre, um."""
    seed: int = 0
    candidates: int = CANDIDATES
    """Number of evenly spread rotary positions among which an optimised plan chooses."""


@dataclass(frozen=True)
class ProbePlan:
    """The plan with its moves."""

    plan: Plan
    request: ProbeRequest
    bodies: Bodies
    moves: Moves
    park: Array
    """Positions `(axes,)` of the linear axes at which the rotary axes turn."""
    expected_um: float | None
    """RMS error, um, at other rotary positions for errors of typical size; None for designs that are not optimised."""
    notes: tuple[str, ...]


def probe_plan(machine: Machine, request: ProbeRequest, progress: Progress = silent) -> ProbePlan:
    """The plan of a request; UserError where the machine does not reach the spheres."""
    _check(machine, request)
    bodies = Bodies(machine, request.probe, request.artefact)
    ranges = rotary_ranges(machine, request.ranges)
    angles = _angles(machine, request, ranges)
    positions = laid(machine, ranges, angles)
    ways = Ways(bodies, request.approach, positions, request.seed)
    spheres = range(len(bodies.names))
    reach = {}
    for k in range(len(positions)):
        progress("positions within reach", k / len(positions))
        reach[k] = [r for s in spheres if (r := ways.reached(positions[k], s))]
    within = [k for k, found in reach.items() if found]
    if len(within) < FEWEST_ROTARY_POSITIONS:
        raise UserError(
            f"the machine reaches the spheres at {len(within)} of {len(positions)} rotary positions: check --sphere "
            "(workpiece frame, all axes at 0), the length of the probe (--target probe=0,0,-L) and --range"
        )
    expected, notes = None, []
    if request.design == "optimised":
        done = partial(progress, "rotary positions that show most")
        order, expected = most_informative(bodies, [reach[k] for k in within], request.points, request.u_um, done)
        chosen = [within[k] for k in order]
        chosen = [chosen[k] for k in toured(machine, positions[chosen])]
    else:
        chosen = within
        beyond = len(positions) - len(within)
        notes += [f"{beyond} of {len(positions)} rotary positions are out of reach and left out"] if beyond else []
    rows = _with_repetitions([reach[k] for k in chosen], request.references)
    notes += _unreached(bodies, rows)
    moves = moves_of(ways, rows)
    if len(unproven(ways, moves)):
        raise UserError(
            "some turns of the rotary axes are not clear of the probe at the parking position: state smaller ranges "
            "(--range), or spheres nearer to the lines of the rotary axes"
        )
    plan = _plan(machine, request, bodies, rows, moves, len(chosen))
    return ProbePlan(plan, request, bodies, moves, ways.park, expected, tuple(notes))


def default_spheres(machine: Machine, count: int, offset: Mapping[str, float]) -> dict[str, Vector]:
    """Spheres for a machine without stated ones: 60 to 120 mm above the part's zero, 100 mm around it, mm.

    offset: zero of the part by axis, mm, from the assumed work offset of the machine file; its height is left out.
    """
    x, y = offset.get("X", 0.0), offset.get("Y", 0.0)
    tables = any(axis.rotary and axis.side == "workpiece" for axis in machine.axes)
    floor = 0.0 if tables else offset.get("Z", 0.0) - 100.0
    angles = np.radians(20.0) + 2.0 * np.pi * np.arange(count) / max(count, 1)
    return {
        f"s{k + 1}": (
            round(x + 100.0 * float(np.cos(a))),
            round(y + 100.0 * float(np.sin(a))),
            round(floor + 70.0 + 25.0 * (k % 3)),
        )
        for k, a in enumerate(angles.tolist())
    }


def _check(machine: Machine, request: ProbeRequest) -> None:
    if request.design not in DESIGNS:
        raise UserError(f"--strategy {request.design}: for a touch probe expected one of {', '.join(DESIGNS)}")
    if request.design == "samba" and len(request.artefact.centres) < 3:
        raise UserError("--strategy samba: it needs three spheres or more (--sphere)")
    x, y, z = request.probe.tip
    if np.hypot(x, y) > 0.5 or z > -request.probe.free_length:
        raise UserError(
            f"--target probe={x:g},{y:g},{z:g}: the tip must be below the spindle nose, on its axis, by the free "
            f"length of the stylus ({request.probe.free_length:g} mm) or more"
        )
    if not len(machine.translators) == 3:
        raise UserError(f"machine {machine.name}: a touch probe needs three linear axes")
    if not request.points >= FEWEST_ROTARY_POSITIONS:
        raise UserError(f"--points {request.points}: expected {FEWEST_ROTARY_POSITIONS} rotary positions or more")


def _angles(machine: Machine, request: ProbeRequest, ranges: Mapping[int, tuple[float, float]]) -> Array:
    """Rotary positions `(n, rotary axes)`, degrees, of the design."""
    if request.design == "bk":
        return circles(machine, ranges, request.points)
    if request.design in ("grid", "samba"):
        return grid(ranges, request.points)
    number = request.candidates if request.design == "optimised" else request.points
    found = candidates(ranges, number, request.seed)
    return found if request.design == "optimised" else found[-number:]


def _with_repetitions(poses: Sequence[list[Reached]], references: int) -> list[Reached]:
    """The centres of all poses, with the first one again at the end, and after every `references` poses."""
    rows: list[Reached] = []
    first = poses[0][0]
    for k, own in enumerate(poses):
        if references and k and k % references == 0:
            rows.append(first)
        rows += own
    return [*rows, first]


def _unreached(bodies: Bodies, rows: Sequence[Reached]) -> list[str]:
    """Notes on spheres that are out of reach everywhere."""
    used = {row.centre.sphere for row in rows}
    return [
        f"sphere {name} is out of reach at all chosen positions" for k, name in enumerate(bodies.names) if k not in used
    ]


def _plan(
    machine: Machine, request: ProbeRequest, bodies: Bodies, rows: Sequence[Reached], moves: Moves, poses: int
) -> Plan:
    """The rows as a plan, with the time at the end of each."""
    centres = np.array([centre_point(bodies, row.centre) for row in rows])
    raised = np.array([row.centre.raised for row in rows])
    positions = linear_positions(machine, raised, centres, request.probe.tip)
    time = _times(machine, request, moves, len(rows))
    names = np.array(bodies.names)[[row.centre.sphere for row in rows]]
    n = len(rows)
    state = replace(with_moves(State(positions)), time=time, cycle=np.zeros(n), station=names, target=np.full(n, TIP))
    turned = np.round(positions[:, machine.rotary], 9)
    number = np.cumsum(np.append(True, np.any(turned[1:] != turned[:-1], axis=1)))
    return Plan(
        machine, f"touch-probe {request.design}", state, np.char.add("P", number.astype(str)), np.full(n, "1"),
        {TIP: Target(request.probe.tip)}, minutes=SETUP_MIN + float(time[-1]) / 60.0, requested=request.points,
        position_count=poses, spheres=dict(request.artefact.centres),
    )  # fmt: skip


def _times(machine: Machine, request: ProbeRequest, moves: Moves, rows: int) -> Array:
    """Time `(rows,)`, s, at the end of each centre, by the lengths of its moves and their feeds."""
    steps = np.abs(np.diff(moves.positions / machine.scale, axis=0))
    linear = np.linalg.norm(np.where(machine.rotary, 0.0, steps), axis=1)
    turned = np.where(machine.rotary, steps, 0.0).max(axis=1)
    feeds = np.where(moves.kind[1:] == TOUCH, request.feeds.probing, request.feeds.move)
    # the second touch: a fifth of the clearance
    again = (moves.kind[1:] == TOUCH) * 0.2 * request.approach.clearance * 60.0 / request.feeds.measuring
    seconds = np.where(linear > 0.0, linear, turned) / feeds * 60.0 + again
    return np.cumsum(np.bincount(moves.row[1:], weights=seconds, minlength=rows))
