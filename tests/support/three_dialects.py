"""One part written in ISO, Siemens and Klartext: what it consists of, a generator of such parts, and three writers.

Coordinates are those of the part, mm and degrees, with three decimals. Every step that begins a region says X Y Z.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

from hypothesis import strategies as st

from support.programs import setup_of

LEVEL = 30.0
"""Z above holes."""


class Go(NamedTuple):
    """A straight line, as a rapid or with feed."""

    rapid: bool
    to: dict[str, float]


class Arc(NamedTuple):
    """In the plane of X and Y; sense +1 counter-clockwise."""

    sense: int
    to: tuple[float, float]
    centre: tuple[float, float]
    start: tuple[float, float]


class Hole(NamedTuple):
    """From LEVEL, by a cycle."""

    at: tuple[float, float]
    depth: float


class Shift(NamedTuple):
    """Steps in coordinates that are shifted."""

    by: tuple[float, float, float]
    steps: list[Step]


class Turned(NamedTuple):
    """Steps in coordinates that are turned about a point, degrees counter-clockwise."""

    about: tuple[float, float]
    angle: float
    steps: list[Step]


class Loop(NamedTuple):
    """Steps that run several times; they begin where they end."""

    passes: int
    steps: list[Step]


Step: TypeAlias = Go | Arc | Hole | Shift | Turned | Loop

# ---- parts

values = st.integers(-60_000, 60_000).map(lambda microns: microns / 1000)
heights = st.integers(0, 20_000).map(lambda microns: microns / 1000)
tilts = st.integers(-300, 300).map(lambda tenths: tenths / 10)
points = st.fixed_dictionaries({"X": values, "Y": values, "Z": heights})


@st.composite
def paths(draw, longest: int = 5):
    """Lines and arcs; the first step says X Y Z."""
    place = draw(points)
    steps: list[Step] = [Go(draw(st.booleans()), dict(place))]
    for _ in range(draw(st.integers(0, longest))):
        if draw(st.booleans()):
            named = draw(st.sets(st.sampled_from("XYZ"), min_size=1))
            to = {axis: value for axis, value in draw(points).items() if axis in named}
            steps.append(Go(draw(st.booleans()), to))
            place.update(to)
        else:
            start = (place["X"], place["Y"])
            radius, first, turn = draw(st.integers(2, 20)), draw(tilts) * 12, draw(st.integers(20, 300))
            sense = draw(st.sampled_from([1, -1]))
            a, b = math.radians(first), math.radians(first + sense * turn)
            centre = (round(start[0] - radius * math.cos(a), 3), round(start[1] - radius * math.sin(a), 3))
            end = (round(centre[0] + radius * math.cos(b), 3), round(centre[1] + radius * math.sin(b), 3))
            steps.append(Arc(sense, end, centre, start))
            place["X"], place["Y"] = end
    return steps


@st.composite
def loops(draw):
    """A path that is run again, from where it ends."""
    end = draw(points)
    body = [*draw(paths(2)), Go(False, end)]
    return [Go(True, dict(end)), Loop(draw(st.integers(2, 4)), body)]


@st.composite
def holes(draw):
    """Holes, approached above the part."""
    found = draw(
        st.lists(st.builds(Hole, st.tuples(values, values), heights.map(lambda z: -z)), min_size=1, max_size=3)
    )
    return [Go(True, {"X": 1.0, "Y": 2.0, "Z": LEVEL}), *found, Go(True, {"X": 0.0, "Y": 0.0, "Z": LEVEL})]


@st.composite
def parts(draw, drilled: bool = False):
    """Everything, for three axes."""
    found: list[Step] = []
    for kind in draw(st.lists(st.sampled_from(["path", "shift", "turn", "loop", "hole"]), min_size=1, max_size=5)):
        if kind == "shift":
            found.append(Shift(draw(st.tuples(values, values, heights)), draw(paths())))
        elif kind == "turn":
            found.append(Turned(draw(st.tuples(values, values)), draw(tilts), draw(paths())))
        elif kind == "hole" and drilled:
            found += draw(holes())
        else:
            found += draw(loops() if kind == "loop" else paths())
    return [*found, Go(True, {"X": 0.0, "Y": 0.0, "Z": LEVEL})]


@st.composite
def tilted_parts(draw, axes: tuple[str, str]):
    """Lines of the tool point with two rotary axes."""
    angles = st.fixed_dictionaries(dict.fromkeys(axes, tilts))
    poses = st.tuples(points, angles).map(lambda both: both[0] | both[1])
    found: list[Step] = [Go(True, draw(poses))]
    for pose in draw(st.lists(poses, max_size=5)):
        named = draw(st.sets(st.sampled_from([*"XYZ", *axes]), min_size=1))
        found.append(Go(False, {axis: value for axis, value in pose.items() if axis in named}))
    return found


# ---- writers


def number(value: float) -> str:
    text = f"{value + 0.0:.3f}".rstrip("0")
    return text + "0" if text.endswith(".") else text


@dataclass
class Iso:
    """Fanuc's words."""

    tcp: bool = False
    lines: list[str] = field(default_factory=list)
    name = "iso"

    def program(self, steps: list[Step]) -> str:
        self.lines = ["G90 G21 G17 G54 G94", "T1 M6", "G43.4 H1" if self.tcp else "G43 H1"]
        self.write(steps)
        return "\n".join([*self.lines, "M30", ""])

    def words(self, to: dict[str, float]) -> str:
        return " ".join(axis + number(value) for axis, value in to.items())

    def write(self, steps: list[Step]) -> None:
        for step in steps:
            getattr(self, type(step).__name__.lower())(step)

    def go(self, step: Go) -> None:
        self.lines.append(f"{'G0' if step.rapid else 'G1'} {self.words(step.to)} F500")

    def arc(self, step: Arc) -> None:
        i, j = (c - s for c, s in zip(step.centre, step.start, strict=True))
        end = self.words(dict(zip("XY", step.to, strict=True)))
        self.lines.append(f"G{3 if step.sense > 0 else 2} {end} I{number(i)} J{number(j)} F500")

    def hole(self, step: Hole) -> None:
        self.lines += [
            f"G98 G81 {self.words(dict(zip('XY', step.at, strict=True)))} Z{number(step.depth)} R25. F100",
            "G80",
        ]

    def shift(self, step: Shift) -> None:
        self.lines.append("G52 " + self.words(dict(zip("XYZ", step.by, strict=True))))
        self.write(step.steps)
        self.lines.append("G52 X0. Y0. Z0.")

    def turned(self, step: Turned) -> None:
        x, y = step.about
        self.lines.append(f"G68 X{number(x)} Y{number(y)} R{number(step.angle)}")
        self.write([moved(inner, (x, y)) for inner in step.steps])
        self.lines.append("G69")

    def loop(self, step: Loop) -> None:
        self.lines += ["#100=0", f"WHILE[#100 LT {step.passes}]DO1"]
        self.write(step.steps)
        self.lines += ["#100=#100+1", "END1"]


class Siemens(Iso):
    """840D."""

    name = "siemens"

    def program(self, steps: list[Step]) -> str:
        self.lines = [
            "%_N_PART_MPF",
            "DEF INT II",
            "G90 G71 G17 G54 G94",
            "T1 M6 D1",
            *(["TRAORI"] if self.tcp else []),
        ]
        self.write(steps)
        return "\n".join([*self.lines, "M30", ""])

    def words(self, to: dict[str, float]) -> str:
        return " ".join(
            f"{axis}={number(value)}" if axis == "Y" else axis + number(value) for axis, value in to.items()
        )

    def arc(self, step: Arc) -> None:
        end = self.words(dict(zip("XY", step.to, strict=True)))
        i, j = step.centre
        self.lines.append(f"G{3 if step.sense > 0 else 2} {end} I=AC({number(i)}) J=AC({number(j)}) F500")

    def hole(self, step: Hole) -> None:
        self.lines += [
            f"MCALL CYCLE81({number(LEVEL)},25,0,{number(step.depth)})",
            "G0 " + self.words(dict(zip("XY", step.at, strict=True))),
            "MCALL",
        ]

    def shift(self, step: Shift) -> None:
        self.lines.append("TRANS " + self.words(dict(zip("XYZ", step.by, strict=True))))
        self.write(step.steps)
        self.lines.append("TRANS")

    def turned(self, step: Turned) -> None:
        self.lines += ["TRANS " + self.words(dict(zip("XY", step.about, strict=True))), f"AROT Z{number(step.angle)}"]
        self.write(step.steps)
        self.lines.append("ROT")

    def loop(self, step: Loop) -> None:
        self.lines.append(f"FOR II=1 TO {step.passes}")
        self.write(step.steps)
        self.lines.append("ENDFOR")


class Klartext(Iso):
    """HEIDENHAIN."""

    name = "heidenhain"

    def __init__(self, tcp: bool = False) -> None:
        super().__init__(tcp)
        self.labels = itertools.count(1)

    def program(self, steps: list[Step]) -> str:
        self.lines = ["BEGIN PGM PART MM", "TOOL CALL 1 Z S2000", *(["M128"] if self.tcp else [])]
        self.write(steps)
        return "\n".join([*self.lines, "M30", "END PGM PART MM", ""])

    def words(self, to: dict[str, float]) -> str:
        return " ".join(
            axis + ("" if value < 0 else "+") + number(value).replace(".", ",") for axis, value in to.items()
        )

    def go(self, step: Go) -> None:
        self.lines.append(f"L {self.words(step.to)} {'FMAX' if step.rapid else 'F500'}")

    def arc(self, step: Arc) -> None:
        centre, end = (self.words(dict(zip("XY", place, strict=True))) for place in (step.centre, step.to))
        self.lines += [f"CC {centre}", f"C {end} DR{'+' if step.sense > 0 else '-'} F500"]

    def hole(self, step: Hole) -> None:
        cycle = {200: 5.0, 201: step.depth - 20.0, 203: 20.0, 204: LEVEL - 20.0}
        said = " ~\n  ".join(f"Q{n}={number(value)} ;DATA" for n, value in cycle.items())
        at = self.words(dict(zip("XY", step.at, strict=True)))
        self.lines += [f"CYCL DEF 200 DRILLING ~\n  {said}", f"L {at} FMAX M99"]

    def shift(self, step: Shift) -> None:
        self._datum("XYZ", step.by)
        self.write(step.steps)
        self._datum("XYZ", (0.0, 0.0, 0.0))

    def turned(self, step: Turned) -> None:
        self._datum("XY", step.about)
        self._rotation(step.angle)
        self.write(step.steps)
        self._rotation(0.0)
        self._datum("XY", (0.0, 0.0))

    def loop(self, step: Loop) -> None:
        label = next(self.labels)
        self.lines.append(f"LBL {label}")
        self.write(step.steps)
        self.lines.append(f"CALL LBL {label} REP{step.passes - 1}")

    def _datum(self, axes: str, shift: tuple[float, ...]) -> None:
        said = [
            f"CYCL DEF 7.{i} {self.words({axis: value})}"
            for i, (axis, value) in enumerate(zip(axes, shift, strict=True), 1)
        ]
        self.lines += ["CYCL DEF 7.0 DATUM SHIFT", *said]

    def _rotation(self, angle: float) -> None:
        self.lines += ["CYCL DEF 10.0 ROTATION", f"CYCL DEF 10.1 ROT{'' if angle < 0 else '+'}{number(angle)}"]


WRITERS = (Iso, Siemens, Klartext)


def moved(step: Step, by: tuple[float, float]) -> Step:
    """A line or an arc in coordinates whose origin is elsewhere."""

    def place(x: float, y: float) -> tuple[float, float]:
        return round(x + by[0], 3), round(y + by[1], 3)

    if isinstance(step, Go):
        shift = dict(zip("XY", by, strict=True))
        return Go(step.rapid, {axis: round(value + shift.get(axis, 0.0), 3) for axis, value in step.to.items()})
    assert isinstance(step, Arc)
    return Arc(step.sense, place(*step.to), place(*step.centre), place(*step.start))


TOOLS = ["T1=80"]
OFFSETS = {"gantry": "100,200,-300", "trunnion_bc": "5,-3,20", "head_table": "5,-3,60"}


def setup(machine, dialect):
    name = "0" if dialect == "heidenhain" else "G54"
    return setup_of(machine, [f"{name}={OFFSETS[machine.name]}"], TOOLS)
