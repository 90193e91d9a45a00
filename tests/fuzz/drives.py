"""Examiner: five-axis machines whose linear and rotary drives have play, and what a run claims about its errors.

Programs of the tool point (G43.4, TRAORI, M128) and of axis positions are read here, on five machines. The drives run
densely sampled paths; an axis stays where it is until it is pushed, with the kinematics of `tests/virtual_machine`.
"""

from __future__ import annotations

import json
import math
import random
import re
import sys
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.fuzz.case import Case, Outcome, Verdict
from tests.fuzz.ncomp import correct

Array = NDArray[np.float64]
TESTS = Path(__file__).parents[1]
MACHINES = ("dmu50", "head_table", "trunnion_bc", "trunnion_ac", "head_head")
FAMILIES = {"iso": "nc", "siemens": "mpf", "heidenhain": "h"}
LENGTH = 80.0
"""Length of the tool, mm."""
UNCLAIMED_UM = 0.3
"""Largest error of an end, um, beyond the largest that the run claims."""
RMS_UM = 0.15
"""Largest difference between the RMS of all ends and the claimed one, um: rounding, and steps below the resolution."""
DENSE = 2000
"""Samples along a curved path: a turning point of 500 mm radius is missed by 0.02 um."""
LINEAR_STEPS = (0.0006, 0.004, 0.012, 0.03, 0.3, 5.0)
"""Sizes of linear steps, mm: below, about and above the play."""
ROTARY_STEPS = (0.0006, 0.002, 0.05, 1.0, 8.0, 40.0)
"""Sizes of rotary steps, degrees."""
LEAST_COMPARED = 0.9
ACCEPT = "worse,stale,outside,insignificant"
_WORD = re.compile(r"(I?)([XYZABCIJ])\s*=?\s*([-+]?(?:\d+\.?\d*|\.\d+))")
_OWN = re.compile(r"NCOMP (TAKE-UP|ARC|FROM)")


def draw(seed: int) -> Case:
    """The machines take turns, so that each gets a fifth of the programs."""
    rng = random.Random(seed)
    machine, family = MACHINES[seed % len(MACHINES)], rng.choice(list(FAMILIES))
    writer = Writer(family, rng, _chain(machine), tcp=rng.random() < 0.6)
    x, y, z = (_offset(machine)[axis] for axis in "XYZ")
    offset = "0" if family == "heidenhain" else "G54"
    options = (
        *("--work-offset", f"{offset}={x},{y},{z}", "--tool-length", f"T1={LENGTH}", "--datum", f"{offset}=true"),
        *("--no-travel-check", "--accept", ACCEPT),
    )
    text = writer.program()
    return Case(text, f"part.{FAMILIES[family]}", machine, calibration(machine, rng), options)


class Writer:
    """Writes a random program in one dialect."""

    def __init__(self, family: str, rng: random.Random, chain: Any, *, tcp: bool) -> None:
        self.family, self.rng, self.tcp = family, rng, tcp
        self.axes = [*"XYZ", *(axis.name for axis in chain.axes if axis.rotary)]
        self.range = {axis.name: axis.travel for axis in chain.axes if axis.rotary}
        self.at: dict[str, float] = {}
        self.lines: list[str] = []
        self.incremental = False

    def program(self) -> str:
        """Head, a first position of all axes, some moves."""
        tcp = {"iso": "G43.4 H1", "siemens": "TRAORI", "heidenhain": "M128"}[self.family]
        self.lines += {
            "iso": ["G21 G90 G17 G94 G54", "T1 M6", tcp if self.tcp else "G43 H1"],
            "siemens": ["G17 G90 G71 G94 G54", "T1 M6 D1", *([tcp] if self.tcp else [])],
            "heidenhain": ["BEGIN PGM PART MM", "TOOL CALL 1 Z S1000", *([tcp] if self.tcp else [])],
        }[self.family]
        self.move({axis: self.first(axis) for axis in self.axes}, rapid=True)
        for _ in range(self.rng.randint(4, 14)):
            self.rng.choice(
                (self.line,) * 6 + (self.back,) * 3 + (self.rapid,) + (self.arc, self.switch) * (not self.tcp)
            )()
        self.lines += {"heidenhain": ["M30", "END PGM PART MM"]}.get(self.family, ["M30"])
        return "\n".join([*self.lines, ""])

    def first(self, axis: str) -> float:
        if axis in self.range:
            low, high = (max(self.range[axis][0], -150.0), min(self.range[axis][1], 150.0))
            return round(self.rng.uniform(low, high) * 0.8 + 0.1 * (low + high), 3)
        return round(self.rng.uniform(-50, 50), 3)

    def place(self, axis: str) -> float:
        """A position one random step away, inside the travel."""
        steps = ROTARY_STEPS if axis in self.range else LINEAR_STEPS
        new = self.at[axis] + self.rng.choice(steps) * self.rng.uniform(0.5, 1.0) * self.rng.choice((-1, 1))
        low, high = self.range.get(axis, (-80.0, 80.0))
        return round(new, 4) if max(low, -175.0) < new < min(high, 175.0) else self.at[axis]

    def some(self) -> dict[str, float]:
        linear = self.rng.sample("XYZ", self.rng.randint(0, 3))
        rotary = [axis for axis in self.range if self.rng.random() < 0.4]
        return {axis: self.place(axis) for axis in [*linear, *rotary] or ["X"]}

    def line(self) -> None:
        self.move(self.some())

    def rapid(self) -> None:
        self.move(self.some(), rapid=True)

    def back(self) -> None:
        """A step back of one axis."""
        axis = self.rng.choice(self.axes)
        self.move({axis: self.place(axis)})

    def switch(self) -> None:
        """To increments, or back to positions."""
        if self.family != "heidenhain":
            self.incremental = not self.incremental
            self.lines.append("G91" if self.incremental else "G90")

    def arc(self) -> None:
        if self.family == "heidenhain":
            return self.line()
        radius, begin, turn = self.rng.choice((2.0, 20.0)), self.rng.uniform(0, 6.28), self.rng.uniform(0.4, 5.8)
        sense = self.rng.choice((1, -1))
        i, j = (round(-radius * wave(begin), 4) for wave in (math.cos, math.sin))
        end = math.atan2(-j, -i) + sense * turn
        radius = math.hypot(i, j)
        to = {"X": self.at["X"] + i + radius * math.cos(end), "Y": self.at["Y"] + j + radius * math.sin(end)}
        self.move(
            {axis: round(value, 4) for axis, value in to.items()},
            arc=f"G{3 if sense > 0 else 2}",
            more=f" I{i:.4f} J{j:.4f}",
        )
        return None

    def move(self, to: dict[str, float], *, rapid: bool = False, arc: str = "", more: str = "") -> None:
        words = []
        for axis, value in to.items():
            step = value - self.at[axis] if self.incremental else value
            words.append(f"{axis}{step:+.4f}" if self.family == "heidenhain" else f"{axis}{step:.4f}")
        self.at |= to
        text = " ".join(words) + more
        if self.family == "heidenhain":
            self.lines.append(f"L {text} {'FMAX' if rapid else 'F500'}")
        else:
            self.lines.append(f"{arc or ('G0' if rapid else 'G1')} {text}{'' if rapid else ' F500'}")


# ---- errors


def calibration(machine: str, rng: random.Random) -> str:
    """Play of some axes, and constant errors."""
    axes = _chain(machine).axes
    playing = [axis.name for axis in axes if rng.random() < (0.4 if axis.rotary else 0.6)] or ["X"]
    effects: list[dict[str, Any]] = [
        {"kind": "backlash", "axis": name, "width": rng.uniform(3, 60 if name in "ABC" else 25),
         "units": {"width": "urad" if name in "ABC" else "um"}}
        for name in playing
    ]  # fmt: skip
    if rng.random() < 0.3:
        name = rng.choice(playing)
        component = rng.choice([letter for letter in "XYZ" if letter != name])
        effects.append(
            {
                "kind": "lateral-play",
                "component": component,
                "axis": name,
                "play": rng.uniform(-8, 8),
                "units": {"play": "um"},
            }
        )
    if rng.random() < 0.6:
        effects += [
            {"kind": "error-motion", "component": axis, "axis": axis, "parameters": [rng.uniform(-25, 25)],
             "basis": {"kind": "polynomial", "interval": [-10000, 10000], "degree": 0}, "units": {"parameters": "um"}}
            for axis in "XYZ"
        ]  # fmt: skip
    return calibration_of(machine, effects)


def calibration_of(machine: str, effects: list[dict[str, Any]]) -> str:
    """Text of a calibration file with these effects."""
    return json.dumps(
        {
            "ncomp_calibration": 1,
            "machine": {"name": machine, "chain": _text(machine)["chain"], "chain_hash": _hash(machine)},
            "provenance": {"made_by": "fuzz", "made_at": "2026-11-01T00:00:00Z", "source": "", "inputs": {}},
            "demonstration": False,
            "effects": effects,
            "covariance": None,
        }
    )


class Machine:
    """A machine with these errors: where its tool is, and where its axes are while its drives run."""

    def __init__(self, name: str, effects: list[dict[str, Any]], offset: str) -> None:
        """offset: the work offset as an option has it."""
        self.chain = _chain(name)
        self.offset = dict(zip("XYZ", map(float, offset.split(",")), strict=True))
        self.half = np.zeros(len(self.chain.axes))
        """Half of the play of each axis, mm and rad."""
        self.constant = np.zeros((len(self.half), 6))
        self.lateral: list[tuple[int, int, float]] = []
        for effect in effects:
            i = self.chain.index(effect["axis"])
            if effect["kind"] == "backlash":
                self.half[i] += effect["width"] / 2 * (1e-6 if self.chain.axes[i].rotary else 1e-3)
            elif effect["kind"] == "lateral-play":
                self.lateral.append((i, "XYZ".index(effect["component"]), effect["play"] / 2 * 1e-3))
            else:
                self.constant[i, "XYZ".index(effect["component"])] += effect["parameters"][0] * 1e-3

    def points(self, q: Array, errors: Array | None = None) -> Array:
        """Tips (n, 3) at axis positions (n, axes)."""
        from virtual_machine.chain import tool_points

        errors = np.zeros((*q.shape, 6)) if errors is None else errors
        return np.asarray(
            tool_points(self.chain, q, errors, np.zeros((len(q), 6)), np.tile((0.0, 0.0, -LENGTH), (len(q), 1)))
        )

    def actual(self, drive: Array, axis: Array) -> Array:
        """Tips (n, 3) where the axes are at `axis` (n, axes), and their drives at `drive`."""
        errors = np.broadcast_to(self.constant, (*drive.shape, 6)).copy()
        for i, component, half in self.lateral:
            errors[:, i, component] += half * (drive[:, i] - axis[:, i]) / self.half[i]
        return self.points(axis, errors)

    def drives(self, places: Array, *, tcp: bool) -> Array:
        """Axis positions (n, axes), mm and rad, of programmed ones, mm and degrees, in the order of the chain."""
        linear = [self.chain.index(axis) for axis in "XYZ"]
        q = np.asarray(self.chain.to_radians(places))
        q[:, linear] += [self.offset[axis] for axis in "XYZ"]
        if not tcp:
            q[:, linear[2]] += LENGTH
            return q
        wanted = q[:, linear].copy()
        q[:, linear] = 0.0
        at_zero = self.points(q)  # the tip is affine in X, Y and Z
        columns = []
        for i in linear:
            step = q.copy()
            step[:, i] = 1.0
            columns.append(self.points(step) - at_zero)
        q[:, linear] = np.linalg.solve(np.stack(columns, axis=2), (wanted - at_zero)[..., None])[..., 0]
        return q


# ---- programs


@dataclass
class Reading:
    """Ends of the moves of a program, and where its drives and axes then are."""

    machine: Machine
    tcp: bool = False
    at: dict[str, float] = field(default_factory=dict)
    axis: Array | None = None
    mode: str = "G0"
    absolute: bool = True
    drive_ends: list[Array] = field(default_factory=list)
    axis_ends: list[Array] = field(default_factory=list)

    def run(self, text: str) -> Reading:
        """Read every line; the ends of take-ups are not kept, and those of segments replace each other."""
        for line in text.splitlines():
            self._read(re.sub(r"\(.*?\)|;.*", "", line), _OWN.search(line))
        return self

    def _read(self, line: str, own: re.Match[str] | None) -> None:
        """A line without its comment; `own`: what ncomp says of a line that it has added."""
        self.tcp |= bool(re.search(r"G43\.4|TRAORI|M128", line))
        for code in re.findall(r"G9[01](?!\d)", line):
            self.absolute = code == "G90"
        self.mode = next(iter(re.findall(r"G[0123](?!\d)", line)), self.mode)
        words = _WORD.findall(re.sub(r"[GMTDFS]\d\S*", "", line))
        if words and not line.startswith(("BEGIN", "END", "TOOL")):
            self._go({name: float(value) for _, name, value in words}, own[1] if own else "")

    def _go(self, words: dict[str, float], own: str) -> None:
        centre = words.pop("I", 0.0), words.pop("J", 0.0)
        start = dict(self.at)
        for name, value in words.items():
            self.at[name] = value if self.absolute else self.at[name] + value
        names, first = self.machine.chain.names, self.axis is None
        last = np.array([self.at[name] for name in names])
        begin = last if first else np.array([start[name] for name in names])
        shares = np.linspace(0.0, 1.0, DENSE + 1)[1:, None]
        places = begin + shares * (last - begin)
        if self.mode in ("G2", "G3"):
            self._round(places, shares[:, 0], begin, last, centre)
        elif not self.tcp:
            places = places[-1:]
        drives = self.machine.drives(places, tcp=self.tcp)
        if self.axis is None:
            self.axis = drives[-1].copy()
        for i, half in enumerate(self.machine.half.tolist()):
            if half == 0.0:
                self.axis[i] = drives[-1, i]
                continue
            at = float(self.axis[i])
            for drive in drives[:, i].tolist():
                at = min(max(at, drive - half), drive + half)
            self.axis[i] = at
        if own == "TAKE-UP":
            return
        if own:
            self.drive_ends.pop()
            self.axis_ends.pop()
        self.drive_ends.append(drives[-1])
        self.axis_ends.append(self.axis.copy())

    def _round(self, places: Array, shares: Array, begin: Array, last: Array, centre: tuple[float, float]) -> None:
        x, y = (self.machine.chain.index(axis) for axis in "XY")
        middle = complex(begin[x] + centre[0], begin[y] + centre[1])
        first, end = complex(begin[x], begin[y]) - middle, complex(last[x], last[y]) - middle
        sense = 1.0 if self.mode == "G3" else -1.0
        turn = sense * ((sense * np.angle(end / first)) % (2 * np.pi))
        round_ = middle + first * np.exp(1j * turn * shares) * (1.0 + shares * (abs(end) / abs(first) - 1.0))
        places[:, x], places[:, y] = round_.real, round_.imag


def judge(case: Case) -> Outcome:
    """The errors of both programs at their ends, and what the run has claimed."""
    done = correct(case)
    if done.text is None:
        return Outcome(Verdict.REFUSED, done.refusal)
    place = case.options[case.options.index("--work-offset") + 1].partition("=")[2]
    machine = Machine(case.machine, json.loads(case.calibration)["effects"], place)
    readings = [Reading(machine).run(text) for text in (case.program, done.text)]
    nominal = np.array(readings[0].drive_ends)
    if len(readings[1].drive_ends) != len(nominal):
        return Outcome(Verdict.DIFFERS, f"moves: {len(readings[1].drive_ends)} instead of {len(nominal)}")
    for when, reading in zip(("before", "after"), readings, strict=True):
        actual = machine.actual(np.array(reading.drive_ends), np.array(reading.axis_ends))
        errors = 1e3 * np.linalg.norm(actual - machine.points(nominal), axis=1)
        claim = done.report["predicted_error_um"][when]
        beyond = int((errors > claim["max"] + UNCLAIMED_UM).sum())
        if beyond:
            return Outcome(
                Verdict.DIFFERS,
                f"unclaimed {when}: {beyond} ends, up to {errors.max():.2f} um, claimed {claim['max']}, move {errors.argmax() + 1}",
            )
        rms = float(np.sqrt(np.mean(errors**2)))
        if abs(rms - claim["rms"]) > RMS_UM or claim["count"] != len(errors):
            return Outcome(
                Verdict.DIFFERS,
                f"claim {when}: {rms:.2f} um RMS of {len(errors)}, claimed {claim['rms']} of {claim['count']}",
            )
    return Outcome(Verdict.COMPARED)


# ---- machines


@cache
def _chain(name: str) -> Any:
    if str(TESTS) not in sys.path:
        sys.path.insert(0, str(TESTS))
    from virtual_machine.chain import load

    return load(name)


@cache
def _text(name: str) -> Any:
    import tomllib

    return tomllib.loads((TESTS.parent / "machines" / f"{name}.toml").read_text(encoding="utf-8"))


@cache
def _hash(name: str) -> str:
    """Hash of the chain, as a calibration file names it."""
    import machines
    from kinematics.error_model.provenance import reference

    return str(reference(machines.load(name)).chain_hash)


@cache
def _offset(name: str) -> dict[str, float]:
    """Work offset, mm: the middle of the travel, as far as the programs reach from it."""
    middle = {axis: round(sum(_chain(name).axis(axis).travel) / 2, 3) for axis in "XYZ"}
    return middle | {"Z": middle["Z"] - LENGTH}
