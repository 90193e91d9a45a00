"""A machine tool: a serial chain of axes from the workpiece `w` over the bed `b` to the tool `t`.

The chain is written as in ISO 10791-6, `w C B b X Y Z t`. Positive means, as in ISO 841, the *tool relative to the
workpiece*, also for axes that carry the workpiece: a table turns or travels in the opposite direction.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from kinematics.error_model.priors import PRIORS, Priors
from kinematics.files.report_head import ReportHead
from kinematics.transforms import Array, read_only
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from kinematics.touch_off import Datum

Vector = tuple[float, float, float]

TURN_DEG = 360.0
TRAVEL_ROUNDING = 1e-9
"""Distance outside the travel or beyond the farthest tilt, mm or rad, that is rounding: it counts as the end."""
EVERY_OTHER = "default"
"""Name of the entry that holds for all work offsets, or tools, that are not named."""
ISO_DIRECTION: Mapping[str, Vector] = {
    "X": (1, 0, 0), "U": (1, 0, 0), "A": (1, 0, 0),
    "Y": (0, 1, 0), "V": (0, 1, 0), "B": (0, 1, 0),
    "Z": (0, 0, 1), "W": (0, 0, 1), "C": (0, 0, 1),
}  # fmt: skip
_AXIS_NAME = re.compile(r"[XYZUVWABC]\d?")


@dataclass(frozen=True)
class Axis:
    """One axis of the chain; lengths in mm, angles in degrees, as in the machine's file."""

    name: str
    kind: Literal["linear", "rotary"]
    side: Literal["workpiece", "tool"]
    direction: Vector
    """Direction, of any length, of the tool relative to the workpiece for a positive command; of a rotary axis its
    line.
    """
    point: Vector
    """Machine frame: a point on a rotary axis; the carriage point, at position 0, that angular errors turn about."""
    travel: tuple[float, float]
    resolution: float
    home: float
    """Reference position; the assumed position of the axis until a program sets it."""
    rollover: Literal["", "as-written", "shortest", "signed"] = ""
    """Meaning of an absolute word of a rotary axis that turns fully: its number counts whole turns, the axis turns the
    shortest way, or the sign is the direction; empty where the machine file does not state it: as written."""

    @cached_property
    def unit_direction(self) -> Array:
        """Direction of length 1, shape (3,)."""
        d = np.asarray(self.direction, float)
        return read_only(np.asarray(d / np.linalg.norm(d)))

    @property
    def rotary(self) -> bool:
        """True for A, B and C."""
        return self.kind == "rotary"

    @property
    def turns_fully(self) -> bool:
        """True of a rotary axis that can turn once round or without end: its errors repeat with the turn."""
        return self.rotary and self.travel[1] - self.travel[0] >= TURN_DEG

    @property
    def unit(self) -> str:
        """Unit of its positions in files and on screens."""
        return "deg" if self.rotary else "mm"

    @cached_property
    def error_frame(self) -> Array:
        """Rotation (3, 3) from the axis' error frame to the machine frame.

        The six error motions are counted in the machine's x, y, z; for a slanting axis (B of the DMU 50) in that
        frame turned by the smallest rotation that lays the axis' ISO letter direction on its line, so that
        E_BB is still the angular positioning error of B. Of an axis that runs against its letter, E_ii is counted
        along the letter, so minus its positioning error.
        """
        letter = np.asarray(ISO_DIRECTION[self.name[0]], float)
        line = self.unit_direction
        if letter @ line < 0:
            line = -line
        v, c = np.cross(letter, line), float(letter @ line)
        k = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
        return read_only(np.asarray(np.eye(3) + k + k @ k / (1.0 + c)))

    @cached_property
    def tilted(self) -> Array:
        """Changes `(3, 3)` of the direction in the error frame, a row for a tilt of 1 rad about each of its axes."""
        return read_only(
            np.array([self.error_frame.T @ np.cross(tilt, self.unit_direction) for tilt in self.error_frame.T])
        )


Family = Literal["any", "fanuc", "linuxcnc", "grbl", "mach3"]
Probing = Literal["", "beside"]


@dataclass(frozen=True)
class Control:
    """Choices of the machine's control that an NC program does not contain."""

    integer_words: Literal["units", "increments"] = "units"
    """Meaning of a coordinate without decimal point: 10 is 10 mm, or 10 least increments of the control."""
    increment: float = 1e-3
    """Least input increment (mm or degrees) that `integer_words = "increments"` counts in."""
    arc_centres: Literal["incremental", "absolute"] = "incremental"
    """Meaning of I J K before any G90.1 or G91.1."""
    tool_change_moves: tuple[str, ...] = ("X", "Y", "Z")
    """Axes that a tool change moves."""
    tcp_at_start: bool = False
    """True for a control whose kinematics position the tool point in the workpiece frame from the start (LinuxCNC)."""
    passive_axes: tuple[str, ...] = ()
    """Names of axes outside the chain, as of an extruder: their words pass as they are (Siemens programs)."""
    calls_leave_state: bool = False
    """Programs in other files that a program calls do not change tool, frames and modes (Klartext)."""
    family: Family = "any"
    """Whose reading of ISO code counts where controls differ; for any, such code is refused."""
    start: str = ""
    """Position of the axes when a program starts, `X0,Y0,Z5`, mm or degrees, in the coordinates in force at its first
    move: for programs that begin with increments."""
    probing: Probing = ""
    """`beside`: what the probing moves and cycles of a program find changes no coordinate of its contour, and offsets
    that they set are those of the set-up; without it such programs are refused."""
    block_skip: Literal["", "on", "off"] = ""
    """Position of the block-skip switch: on, so that blocks with a slash do not run, or off; without it a program in
    which it matters is refused."""
    kinematics_types: tuple[Literal["axes", "tool-point"], ...] = ()
    """LinuxCNC: what the kinematics that `G12.1 P` selects move, by their numbers from 0: the axes, or the tool point
    in the workpiece frame; without it such programs are refused."""
    random_toolchanger: bool = False
    """LinuxCNC: RANDOM_TOOLCHANGER = 1 of its INI file, with which tool 0 is a tool of the table."""
    klartext_arcs: Literal["helix", "plane", "axes"] = "helix"
    """Form of a corrected Klartext arc that moves an axis across its plane: a helix (`CP IPA Z`, for every control),
    not at all, or by a word beside those of the arc (`C X Y Z`)."""
    scaled_axes: Literal["", "XYZ", "XY"] = ""
    """Axes that Klartext cycle 11 scales (machine parameter 7410); without it such programs are refused."""
    pass_through: tuple[str, ...] = ()
    """Codes, cycles, calls and functions unknown to ncomp that pass unchanged: they move nothing and change no mode."""
    g53_tool_length: Literal["kept", "suppressed"] = "kept"
    """Siemens G53, G153 and SUPA: the tool length stays in force in machine coordinates (MD10760 = 0), or not (1)."""
    repeats: Literal["", "truncate", "round"] = ""
    """Number of repeats of Klartext `CALL LBL REP` with a parameter that is not whole: its integer part, or the nearest
    whole number (a half upwards); without it such programs are refused."""
    rotary_feed: Literal["leave", "inverse-time", "scaled"] = "leave"
    """Feed moves of rotary axes alone (G94): left without a correction, or corrected and given the time that their F
    means, by G93 or by an F for the path of X Y Z."""
    unit: Literal["", "mm", "inch"] = ""
    """Unit of the control: of its tables without a unit, and of programs before G20 or G21 (G70, G71). Where it is not
    given, mm is assumed."""


@dataclass(frozen=True)
class Machine:
    """A named chain of axes, in order from the workpiece to the tool, with its defaults for reading NC programs."""

    name: str
    """Name of the machine."""
    description: str
    """What it is, in a sentence."""
    axes: tuple[Axis, ...]
    """Axes from the workpiece to the tool."""
    control: Control = field(default_factory=Control)
    """What is known about its control."""
    work_offsets: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Offsets by name (G54, or a preset number; EVERY_OTHER) and axis, mm or degrees."""
    tools: Mapping[str, float] = field(default_factory=dict)
    """Tool lengths, mm, by number as text."""
    offsets_assumed: bool = False
    """The work offsets are assumptions, for programs whose work offsets nobody gives."""
    tools_assumed: bool = False
    """The tool lengths are assumptions likewise."""
    datums: Mapping[str, Datum] = field(default_factory=dict)
    """Datum entries of work offsets, by their name; `default` for all that are not named."""
    report: ReportHead = field(default_factory=ReportHead)
    """Entries of the head of its reports."""
    priors: Priors = PRIORS
    """What is known of its errors before any data."""
    history: str = ""
    """Database of its life: a file, or the address of a server; empty where its results are not entered."""

    def __repr__(self) -> str:
        return f"<Machine: {self.name}, {self.chain}>"

    @property
    def chain(self) -> str:
        """The ISO 10791-6 notation, `w C B b X Y Z t`."""
        workpiece = [a.name for a in self.axes if a.side == "workpiece"]
        tool = [a.name for a in self.axes if a.side == "tool"]
        return " ".join(["w", *workpiece, "b", *tool, "t"])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Axis names in chain order: the order of every array of axis positions."""
        return tuple(a.name for a in self.axes)

    @cached_property
    def rotary(self) -> NDArrayBool:
        """Mask (axes,) of the rotary axes."""
        return read_only(np.array([a.rotary for a in self.axes], bool))

    @cached_property
    def scale(self) -> Array:
        """Factors (axes,) from file units (mm, degrees) to internal ones (mm, rad)."""
        return read_only(np.where(self.rotary, math.pi / 180.0, 1.0))

    @cached_property
    def travel(self) -> Array:
        """Lower and upper ends (2, axes), mm and rad."""
        return read_only(np.array([a.travel for a in self.axes], float).T * self.scale)

    @property
    def rounding_mm(self) -> float:
        """Largest distance, mm, of a position from the nearest one in steps of the resolution of X, Y and Z."""
        return max(self.axes[i].resolution for i in self.translators) * math.sqrt(3.0) / 2

    @property
    def turned_mm(self) -> float:
        """Distance, mm, by which the rounding of rotary words moves the tool point at most."""
        reach = float(np.linalg.norm(np.abs(self.travel).max(axis=0)[~self.rotary]))
        reach += max(float(np.linalg.norm(axis.point)) for axis in self.axes)
        return reach * sum(math.radians(axis.resolution) / 2 for axis in self.axes if axis.rotary)

    @cached_property
    def translators(self) -> tuple[int, ...]:
        """Columns of the linear axes that position the tool: the first independent ones, X Y Z before U V W.

        Raises UserError when the linear axes do not span space.
        """
        linear = [i for i, a in enumerate(self.axes) if not a.rotary]
        linear.sort(key=lambda i: ("XYZUVW".index(self.axes[i].name[0]), self.axes[i].name))
        chosen: list[int] = []
        for i in linear:
            span = np.array([self.axes[j].unit_direction for j in (*chosen, i)])
            if np.linalg.matrix_rank(span) > len(chosen):
                chosen.append(i)
        if len(chosen) < 3:
            raise UserError(
                f"machine {self.name}: its linear axes do not span space, so it cannot position a tool point"
            )
        return tuple(sorted(chosen))

    def index(self, name: str) -> int:
        """Column of the axis; UserError when the machine has none of that name."""
        if name not in self.names:
            raise UserError(f"machine {self.name} ({self.chain}) has no axis {name}")
        return self.names.index(name)

    @cached_property
    def chain_hash(self) -> str:
        """Identifies the geometry (not travels or defaults), to which a calibration and a derived transform belong."""
        geometry = [
            (a.name, a.side, *(np.round(a.unit_direction, 12) + 0.0).tolist(), *map(float, a.point)) for a in self.axes
        ]
        return hashlib.sha256(repr(geometry).encode()).hexdigest()[:16]


NDArrayBool = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


def split_chain(chain: str) -> list[tuple[str, Literal["workpiece", "tool"]]]:
    """Axis names and sides of an ISO 10791-6 chain; UserError when it is not one."""
    links = chain.split()
    if len(links) < 3 or links[0] != "w" or links[-1] != "t" or links.count("b") != 1:
        raise UserError(f"chain {chain!r} is not of the form 'w ... b ... t' (ISO 10791-6), e.g. 'w C B b X Y Z t'")
    names = [link for link in links[1:-1] if link != "b"]
    for name in names:
        if not _AXIS_NAME.fullmatch(name):
            raise UserError(f"chain {chain!r}: {name!r} is no axis name (X Y Z U V W A B C, with an optional digit)")
        if names.count(name) > 1:
            raise UserError(f"chain {chain!r}: axis {name} appears twice")
    bed = links.index("b")
    return [(n, "workpiece" if links.index(n) < bed else "tool") for n in names]


def make_axis(
    name: str,
    side: Literal["workpiece", "tool"],
    travel: Sequence[float],
    *,
    direction: Sequence[float] | None = None,
    point: Sequence[float] = (0.0, 0.0, 0.0),
    resolution: float = 1e-4,
    home: float | None = None,
    rollover: Literal["", "as-written", "shortest", "signed"] = "",
) -> Axis:
    """An axis from its file entries, checked; UserError with the entry and the reason."""
    where = f"axis {name}"
    d = tuple(float(v) for v in (direction if direction is not None else ISO_DIRECTION[name[0]]))
    p = tuple(float(v) for v in point)
    if not all(map(math.isfinite, d)) or math.hypot(*d) == 0:
        raise UserError(f"{where}: direction {list(d)} is no direction: expected three numbers, not all of them 0")
    if not all(map(math.isfinite, p)):
        raise UserError(f"{where}: point {list(p)} is not finite")
    low, high = (float(v) for v in travel)
    if math.isnan(low) or math.isnan(high) or low >= high:
        raise UserError(f"{where}: travel {list(travel)} must go from a lower to a higher position")
    if not (resolution > 0 and math.isfinite(resolution)):
        raise UserError(f"{where}: resolution {resolution} must be positive")
    home_position = min(max(0.0, low), high) if home is None else float(home)
    if not (low <= home_position <= high and math.isfinite(home_position)):
        raise UserError(f"{where}: home {home} is outside its travel {list(travel)}: expected a position within it")
    kind: Literal["linear", "rotary"] = "rotary" if name[0] in "ABC" else "linear"
    direction_, point_ = (d[0], d[1], d[2]), (p[0], p[1], p[2])
    axis = Axis(name, kind, side, direction_, point_, (low, high), float(resolution), home_position, rollover)
    if rollover and not axis.turns_fully:
        raise UserError(f"{where}: rollover = {rollover!r} needs a rotary axis with a travel of 360 degrees or more")
    return axis
