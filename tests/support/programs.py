"""Programs through ncomp inside a test: read, corrected, judged; random error models; random programs."""

import dataclasses
import datetime
import functools
import io
import math
import random
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

import machines
from kinematics.basis import BSpline, Fourier, Legendre, Polynomial
from kinematics.effects import Effect, ErrorMotion, LocationError
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.error_model.priors import PRIORS
from kinematics.error_model.provenance import Provenance, reference
from kinematics.machine import Machine
from postproc.control.setup import Setup, make_setup
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.correct.result import CorrectionResult
from postproc.correct.unroll import UnrolledProgram, unrolled
from postproc.dialects import Dialect, find_dialect
from postproc.execution import StoredProgram, execution
from postproc.motion.motions import Motions, merged
from postproc.text.notes import Notes
from postproc.text.source import ENCODING, HEAD_SIZE, Source
from postproc.verification.verify import read_motions

THREE_AXES = ("gantry", "cframe", "bzt_pfu")
FIVE_AXES = ("dmu50", "trunnion_ac", "trunnion_bc", "head_head", "head_table")


@functools.cache
def load(name: str) -> Machine:
    """A shipped machine whose tool changer moves Z only, and whose Klartext cycle 11 scales X, Y and Z."""
    machine = machines.load(name)
    control = dataclasses.replace(machine.control, tool_change_moves=("Z",), scaled_axes="XYZ")
    return dataclasses.replace(machine, control=control)


WHOLE = {"tolerance_um": 1e3}
"""Every move stays in one piece, and no block is added."""
AT_MOST = {"max_correction_um": PRIORS.largest_correction_um}
"""The limit of corrections without a search for the largest error of the calibration, which takes time."""


class Corrected(NamedTuple):
    text: str
    report: CorrectionResult


def source_of(text: str, name: str = "test.nc") -> Source:
    data = text.encode(ENCODING)
    return Source(name, data[:HEAD_SIZE].decode(ENCODING), data)


def setup_of(
    machine: Machine, offsets: Iterable[str] = (), tools: Iterable[str] = (), datums: Iterable[str] = ()
) -> Setup:
    return make_setup(machine, offsets, tools, datums=datums, zero=True)


def read_lines(
    text: str, machine: Machine, offsets: Iterable[str] = (), tools: Iterable[str] = ()
) -> tuple[Motions, list[int]]:
    """All moves of an ISO program, and the line of each."""
    source = source_of(text)
    dialect = find_dialect("iso", source.name, "")
    interpreter = dialect.interpreter(machine, setup_of(machine, offsets, tools), Notes())
    parts = [part.motions for part in execution(source, dialect, interpreter).parts()]
    lines = [motions.blocks[i].line for motions in parts for i in motions.block]
    return parts[0] if len(parts) == 1 else merged(parts), lines


def read(text: str, machine: Machine, offsets: Iterable[str] = (), tools: Iterable[str] = ()) -> Motions:
    """All moves of an ISO program."""
    source = source_of(text)
    return merged(
        read_motions(source, find_dialect("iso", source.name, ""), machine, setup_of(machine, offsets, tools))
    )


def correct(
    text: str,
    machine: Machine,
    model: ErrorModel | None = None,
    offsets: Iterable[str] = (),
    tools: Iterable[str] = (),
    datums: Iterable[str] = (),
    **options: bool | float,
) -> Corrected:
    """An ISO program corrected; without a model, for the machine without errors."""
    source, out = source_of(text), io.BytesIO()
    dialect = find_dialect("iso", source.name, "")
    setup = setup_of(machine, offsets, tools, datums)
    job = Job(source, dialect, machine, model or no_errors(machine), setup, **{**AT_MOST, **options})
    report = Pipeline(job).run(out, lambda _: None)
    return Corrected(out.getvalue().decode(ENCODING), report)


def written_out(source: Source, dialect: Dialect, machine: Machine, setup: Setup) -> UnrolledProgram:
    """A program with jumps, loops or calls written out, which is not yet read again."""
    program, interpreter = (dialect.interpreter(machine, setup, Notes()) for _ in range(2))
    return unrolled(StoredProgram(source, dialect, program), interpreter)


def model_of(machine: Machine, *effects: Effect) -> ErrorModel:
    return ErrorModel(machine=reference(machine), effects=tuple(effects), provenance=Provenance("test", made_at()))


@functools.cache
def made_at() -> datetime.datetime:
    """When the calibrations of the tests were made: always valid, and the same all through a run."""
    return datetime.datetime.now(datetime.UTC).replace(microsecond=0)


def shifted(machine: Machine, **um: float) -> ErrorModel:
    """Every tool point is off by so many um in x, y, z: E_X0X, E_Y0Y, E_Z0Z."""
    return model_of(machine, *(LocationError(axis, axis, value) for axis, value in um.items()))


def random_model(machine: Machine, seed: int, size: float = 100.0) -> ErrorModel:
    """All error motions and location errors, each up to `size` um or urad, in every kind of basis."""
    rng = np.random.default_rng(seed)
    effects: list[ErrorMotion | LocationError] = []
    for axis in machine.axes:
        low, high = (float(np.clip(end, -360.0, 360.0)) if axis.rotary else end for end in axis.travel)
        for component in "XYZABC":
            basis = _random_basis(rng, low, high)
            share = 1.0 if isinstance(basis, BSpline) else 1.0 / basis.size
            values = tuple((rng.uniform(-1, 1, basis.size) * size * share).tolist())
            effects.append(ErrorMotion(component, axis.name, basis, values, u=(1.0,) * basis.size))
        effects.append(LocationError("ABC"[rng.integers(3)], axis.name, float(rng.uniform(-1, 1) * size), u=(1.0,)))
    return model_of(machine, *effects)


def _random_basis(rng: np.random.Generator, low: float, high: float):
    nodes = tuple(np.linspace(low, high, int(rng.integers(3, 9))).tolist())
    return [
        Polynomial((low, high), int(rng.integers(0, 5))),
        Legendre((low, high), int(rng.integers(0, 6))),
        Fourier((low, high), (1.0, 2.0, 3.0)),
        BSpline(nodes, 1),
        BSpline(nodes, 3),
    ][rng.integers(5)]


def centred(machine: Machine, name: str = "G54") -> str:
    """A work offset in the middle of the travels of X Y Z."""
    middles = [sum(machine.axes[machine.index(axis)].travel) / 2 for axis in "XYZ"]
    return f"{name}={','.join(f'{middle:.3f}' for middle in middles)}"


OFFSETS = ("G54", "G55", "G54.1 P3")
LINUXCNC_OFFSETS = ("G54", "G55", "G59.3")
TOOLS = ("T1=80.5", "T2=120.25", "T3=0")


def random_setup(machine: Machine) -> dict[str, tuple[str, ...]]:
    """Offsets and tools that the random programs are made for: all near the middle of the travels."""
    x, y, z = (sum(machine.axes[machine.index(axis)].travel) / 2 - 50.0 * (axis == "Z") for axis in "XYZ")
    places = {"G54": (x, y, z), "G55": (x - 7.5, y + 3.125, z), "G54.1P3": (x + 4.0, y - 9.0, z - 11.0)}
    places["G59.3"] = (x + 1.5, y - 2.75, z + 8.0)
    offsets = tuple(f"{name}={','.join(map(str, place))}" for name, place in places.items())
    return {"offsets": offsets, "tools": TOOLS}


LETTERS = {"XYZ": "IJ", "ZXY": "KI", "YZX": "JK"}


class RandomProgram:
    """A valid ISO program in a random style, that stays within 60 mm of the origin of each work offset."""

    def __init__(self, machine: Machine, seed: int, *, tcp: bool = False, for_linuxcnc: bool = False) -> None:
        self.rng = random.Random(seed)
        self.machine, self.tcp, self.for_linuxcnc = machine, tcp, for_linuxcnc
        self.rotary = [axis for axis in machine.axes if axis.rotary]
        self.lower = self.rng.random() < 0.2
        self.blank = self.rng.choice(("", " ", " ", "  "))
        self.numbered = self.rng.random() < 0.5
        self.number_style = self.rng.choice(("plain", "point", "padded", "short", "signed"))
        self.end = self.rng.choice(("\n", "\r\n"))
        self.unit, self.absolute, self.plane, self.motion = 1.0, True, "XYZ", 0
        self.position = dict.fromkeys("XYZ", 0.0)
        self.said: set[str] = set()
        self.lines: list[str] = []

    def text(self, blocks: int) -> str:
        if self.rng.random() < 0.5:
            self.lines += ["%", "O0007 (RANDOM)"]
        if self.rng.random() < 0.3:
            self.lines.append("(X1 Y2 is a comment)")
        self.emit("G21", "G90", "G17", "G54", "F600")
        if self.tcp:
            self.emit("G43.4", "H2")
        self.go_everywhere()
        steps = [
            *[self.line] * 8, *[self.arc] * 5, *[self.arc_by_radius] * 2, self.full_circle, self.full_circle,
            self.switch_distance, self.switch_unit, self.switch_plane, self.switch_offset, self.machine_position,
            self.go_home, self.change_tool, self.aside, self.turn, self.turn_and_go,
        ]  # fmt: skip
        for _ in range(blocks):
            self.rng.choice(steps)()
        self.emit("M30")
        if self.lines[0] == "%":
            self.lines.append("%")
        last = self.end if self.rng.random() < 0.7 else ""
        return self.end.join(self.lines) + last

    # ---- blocks

    def line(self) -> None:
        motion = self.rng.choice((0, 1))
        self.go([f"G{motion}"] if self.motion != motion else [], {axis: self.near(axis) for axis in self.some_axes()})

    def arc(self) -> None:
        first, second, third = self.plane
        if not {first, second} <= self.said:
            return
        radius, start, turn = self.rng.uniform(0.5, 20), self.rng.uniform(0, 6.28), self.rng.uniform(0.01, 6.27)
        sense = self.rng.choice((2, 3))
        turn *= 1 if sense == 3 else -1
        offset = [self.rounded(-radius * math.cos(start)), self.rounded(-radius * math.sin(start))]
        centre = [self.position[first] + offset[0], self.position[second] + offset[1]]
        if max(abs(c) + radius for c in centre) > 60:
            return
        radius = math.hypot(*offset)
        angle = math.atan2(-offset[1], -offset[0]) + turn
        targets = {first: centre[0] + radius * math.cos(angle), second: centre[1] + radius * math.sin(angle)}
        if third in self.said and self.rng.random() < 0.3:
            targets[third] = self.near(third)
        self.go([f"G{sense}"], targets, dict(zip(LETTERS[self.plane], offset, strict=True)))

    def arc_by_radius(self) -> None:
        first, second, _ = self.plane
        if not {first, second} <= self.said:
            return
        targets = {axis: self.near(axis) for axis in (first, second)}
        ends = {axis: self.reached(axis, value) for axis, value in targets.items()}
        chord = math.dist([self.position[first], self.position[second]], list(ends.values()))
        if chord < 0.01 or chord > 30:
            return
        radius = self.rng.choice((0.5, 0.501, 0.51, 0.6, 1.0, 3.0)) * chord + 0.001
        sign = self.rng.choice((1, 1, -1))
        self.go([f"G{self.rng.choice((2, 3))}"], targets, {"R": sign * self.rounded(radius, up=True)})

    def full_circle(self) -> None:
        first, second, _ = self.plane
        if not {first, second} <= self.said:
            return
        offset = [self.rounded(self.rng.uniform(-15, 15)) for _ in range(2)]
        if self.rng.random() < 0.3:
            offset[self.rng.randrange(2)] = 0.0
        if math.hypot(*offset) < 0.1:
            return
        here = {axis: self.position[axis] for axis in (first, second) if self.rng.random() < 0.5}
        named = {axis: value for axis, value in here.items() if abs(self.reached(axis, value) - value) < 1e-9}
        centre = {letter: v for letter, v in zip(LETTERS[self.plane], offset, strict=True) if v or not any(offset)}
        self.go([f"G{self.rng.choice((2, 3))}"], named, centre)

    def switch_distance(self) -> None:
        if set("XYZ") <= self.said:
            self.absolute = not self.absolute
            self.emit("G90" if self.absolute else "G91")

    def switch_unit(self) -> None:
        self.unit = 26.4 - self.unit
        self.emit("G21" if self.unit == 1.0 else "G20")

    def switch_plane(self) -> None:
        self.plane = self.rng.choice(("XYZ", "ZXY", "YZX"))
        self.emit({"XYZ": "G17", "ZXY": "G18", "YZX": "G19"}[self.plane])

    def switch_offset(self) -> None:
        if self.tcp:
            return
        self.be_absolute()
        self.said.clear()
        self.emit(self.rng.choice(LINUXCNC_OFFSETS if self.for_linuxcnc else OFFSETS))
        self.go_on(somewhere=True)

    def machine_position(self) -> None:
        if self.tcp:
            return
        self.be_absolute()
        self.leave_inches()
        axis = self.machine.axes[self.machine.index("Z")]
        self.motion = 0
        self.emit("G53", "G0", "Z" + self.number((axis.travel[1] - 40.0) / self.unit))
        self.said.discard("Z")
        self.go_on(somewhere=True)

    def go_home(self) -> None:
        if self.tcp:
            return
        axes = self.rng.choice(("Z", "XY", "XYZ"))
        self.emit("G91", "G28", *(f"{axis}0" for axis in axes))
        self.said -= set(axes)
        self.absolute = True
        self.emit("G90")
        self.go_on()

    def change_tool(self) -> None:
        if self.tcp:
            return
        self.be_absolute()
        self.leave_inches()
        if self.for_linuxcnc:
            self.go_everywhere()  # its test client forgets an arc when the tool is changed behind it
        number = self.rng.randint(1, 3)
        self.emit(f"T{number}", "M6")
        self.said.discard("Z")
        self.emit("G43", f"H{number}")
        self.go_on()

    def aside(self) -> None:
        self.emit(*self.rng.choice((("F250.",), ("M8",), ("S1200", "M3"), ("G4", "P0.1"), ("G94", "F600"), ())))

    def turn(self) -> None:
        if self.rotary and self.absolute:
            self.motion = self.rng.choice((0, 0, 1))
            self.emit(f"G{self.motion}", *self.angles())
            if self.motion == 1:
                self.go([], {axis: self.near(axis) for axis in "XYZ"})

    def turn_and_go(self) -> None:
        if self.absolute:
            axes = self.some_axes()
            self.go([f"G{self.rng.choice((0, 1))}"], {axis: self.near(axis) for axis in axes}, None, self.angles())

    # ---- what they are made of

    def go_everywhere(self) -> None:
        self.motion = 0
        self.go(["G0"], {axis: self.rng.uniform(-20, 20) for axis in "XYZ"})

    def go_on(self, *, somewhere: bool = False) -> None:
        """Say again all that is no longer said, in one block or two; or move it by increments first, and others."""
        self.motion = 0
        lost = [axis for axis in "XYZ" if axis not in self.said]
        self.rng.shuffle(lost)
        if somewhere and self.rng.random() < 0.3:
            self.emit("G91", "G0", *(axis + self.number(self.rng.uniform(-1, 1)) for axis in lost))
            self.emit("G90")
            self.go([], {axis: self.near(axis) for axis in self.said & set("XY")})
        for part in [lost] if self.rng.random() < 0.6 else [lost[:1], lost[1:]]:
            if part:
                self.go(["G0"], {axis: self.rng.uniform(-20, 20) for axis in part})

    def leave_inches(self) -> None:
        """LinuxCNC 2.9 takes a length offset of mm for inches, or the other way round, in G53 behind a change."""
        if self.for_linuxcnc and self.unit != 1.0:
            self.switch_unit()

    def be_absolute(self) -> None:
        if not self.absolute:
            self.absolute = True
            self.emit("G90")

    def some_axes(self) -> list[str]:
        usable = sorted(self.said) if not self.absolute else list("XYZ")
        return sorted(self.rng.sample(usable, self.rng.randint(1, len(usable)))) if usable else []

    def near(self, axis: str) -> float:
        return max(-40.0, min(40.0, self.position[axis] + self.rng.choice((0.05, 1, 10)) * self.rng.uniform(-1, 1)))

    def angles(self) -> list[str]:
        chosen = [axis for axis in self.rotary if self.rng.random() < 0.7] or self.rotary[:1]
        ranges = {axis.name: (max(axis.travel[0], -30.0), min(axis.travel[1], 30.0)) for axis in chosen}
        return [f"{name}{self.rng.uniform(*ends):.3f}" for name, ends in ranges.items()]

    def go(self, head: list[str], targets: dict[str, float], centre: dict[str, float] | None = None, tail=()):
        words = [axis + self.number(self.said_value(axis, value)) for axis, value in targets.items()]
        for axis, value in targets.items():
            self.position[axis] = self.reached(axis, value)
            if self.absolute:
                self.said.add(axis)
        words += tail
        words += [letter + self.number(value / self.unit) for letter, value in (centre or {}).items()]
        if words:
            self.motion = int(head[0][1]) if head else self.motion
            self.emit(*head, *words)

    def said_value(self, axis: str, value: float) -> float:
        return (value - (0.0 if self.absolute else self.position[axis])) / self.unit

    def reached(self, axis: str, value: float) -> float:
        base = 0.0 if self.absolute else self.position[axis]
        return base + round(self.said_value(axis, value), self.decimals) * self.unit

    @property
    def decimals(self) -> int:
        return 3 if self.unit == 1.0 else 4

    def rounded(self, value: float, *, up: bool = False) -> float:
        steps = value / self.unit * 10**self.decimals
        return (math.ceil(steps) if up else round(steps)) / 10**self.decimals * self.unit

    def number(self, value: float) -> str:
        text = f"{value:.{self.decimals}f}"
        if text.strip("-0.") == "":
            text = text.removeprefix("-")
        if self.number_style in ("point", "short", "plain"):
            text = text.rstrip("0")
        if self.number_style == "plain":
            text = text.removesuffix(".")
        if self.number_style == "short":
            text = text.replace("0.", ".", 1) if text.lstrip("-").startswith("0.") and len(text) > 3 else text
        if self.number_style == "signed" and not text.startswith("-"):
            text = "+" + text
        return text

    def emit(self, *words: str) -> None:
        words = tuple(words)
        if self.numbered:
            words = (f"N{10 * len(self.lines)}", *words)
        text = self.blank.join(words)
        if self.rng.random() < 0.1:
            text += self.blank + self.rng.choice(("(note)", "; note", "(g0 x5)"))
        self.lines.append(text.lower() if self.lower else text)
