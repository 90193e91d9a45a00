"""A small HEIDENHAIN control (TNC 640, milling, tool axis Z), in the words of its manuals.

Left out, because parameters or models decide or the manuals leave it open: a pole with one coordinate; C and CR with Z;
M89, CYCL CALL POS and the patterns; a second set-up clearance below the first; a shift under an active rotation, and
mirrors and scales; RL and RR, APPR and DEP, FK; PLANE; CALL LBL REP of a part that repeats itself by the same label;
a repeat number that is not whole; signs of powers. RND and CHF are read as the corners that they break.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable, Mapping
from itertools import count
from pathlib import PurePath

from tests.referees.moves import LONGEST, ROUNDING_MM, Move, Point, Unclear, arc_middle, centre_of, sweep, turned

NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)")
WORD = re.compile(r"(I?)(PR|PA|ROT|[XYZABC])([-+]?)(QL?\d+|\d+[.,]?\d*|[.,]\d+)")
TOKEN = re.compile(r"\s*(QL?\d+|\d+[.,]?\d*|[.,]\d+|[A-Z]+|[-+*/()])")
INCH_MM = 25.4
DRILLING = {200, 201, 203, 205, 206, 207, 240}
DATA = {"BEGIN", "BLK", "STOP", "TOOL", "RND", "CHF", "*", "LBL"}
"""First words of blocks that neither move nor change coordinates here; a TOOL CALL is none of them."""
FUNCTIONS: dict[str, Callable[[float], float]] = {
    "SIN": lambda a: math.sin(math.radians(a)),
    "COS": lambda a: math.cos(math.radians(a)),
    "SQRT": math.sqrt,
    "ABS": abs,
    "INT": math.trunc,
    "NEG": lambda a: -a,
    "SQ": lambda a: a * a,
}
COMPARED: dict[str, Callable[[float, float], bool]] = {
    "EQU": lambda a, b: a == b,
    "NE": lambda a, b: a != b,
    "GT": lambda a, b: a > b,
    "LT": lambda a, b: a < b,
}


class EndOfProgram(Exception):
    """M30 or M2."""


class Klartext:
    """Runs a program; `files` are its text and those of the programs that it calls, the main one first."""

    def __init__(
        self, files: Mapping[str, str], presets: Mapping[int, Point], lengths: Mapping[int, float], rotary: str
    ) -> None:
        self.files = {PurePath(name).stem.lower(): _blocks(text) for name, text in files.items()}
        self.main = next(iter(self.files))
        self.unit = INCH_MM if self.files[self.main][0].endswith("INCH") else 1.0
        self.presets, self.lengths, self.axes = presets, lengths, "XYZ" + rotary
        self.moves: list[Move] = []
        self.blocks = count()
        self.q: dict[str, float] = {}
        self.at: Point = dict.fromkeys(self.axes, math.nan)
        """The tool tip with the preset added, as in `Move.end`."""
        self.preset, self.shift, self.turn = 0, dict.fromkeys(self.axes, 0.0), 0.0
        self.pole: Point = {}
        """In coordinates of `at`."""
        self.length, self.tip, self.feed = 0.0, False, 0.0
        self.cycle = 0
        self.heading: tuple[float, float] | None = None
        """Direction in X and Y in which the last feed move ended."""
        self.continues = False

    def run(self) -> list[Move]:
        """All moves."""
        with contextlib.suppress(EndOfProgram):
            self._from(self.files[self.main], 0, {}, called=False)
        return self.moves

    # ---- the order of the blocks

    def _from(self, lines: list[str], at: int, local: dict[str, float], *, called: bool) -> None:
        """Run blocks from a place to the end of the program, or of the subprogram (LBL 0)."""
        left: dict[int, int] = {}
        while at < len(lines):
            if next(self.blocks) > LONGEST:
                raise Unclear("an endless program")
            text, part = lines[at].removesuffix("~"), lines[at].endswith("~")
            words = text.split()
            self.continues = part
            at += 1
            match words:
                case ["END", "PGM", *_]:
                    return
                case ["LBL", "0"] if called:
                    return
                case ["CALL", "LBL", label]:
                    self._from(lines, _label(lines, label), local, called=True)
                case ["CALL", "LBL", label, *more]:
                    repeats = re.fullmatch(r"REP(\d+)(/\d+)?", "".join(more))
                    if repeats is None:
                        raise Unclear(text)
                    left.setdefault(at, int(repeats[1]))
                    left[at] -= 1
                    if left[at] >= 0:
                        at = _label(lines, label)
                    else:
                        del left[at]
                case ["CALL", "PGM", name]:
                    self._from(self.files[PurePath(name.lower()).stem], 0, {}, called=False)
                case ["FN", number, "IF", a, sign, b, "GOTO", "LBL", label] if number in {"9:", "10:", "11:", "12:"}:
                    if COMPARED[sign](self._value(a, local), self._value(b, local)):
                        at = _label(lines, label)
                case _:
                    self._block(text, words, local)

    # ---- one block

    def _block(self, text: str, words: list[str], local: dict[str, float]) -> None:
        assigned = re.fullmatch(r"(?:FN \d: )?(QL?\d+) *=(.*)", text)
        if assigned is not None:
            (local if assigned[1].startswith("QL") else self.q)[assigned[1]] = self._assigned(text, assigned[2], local)
            return
        if "M128" in words or "M129" in words:
            if len(words) > 1 + (words[0] == "L"):
                raise Unclear("M128 with a move")
            self._tip(on="M128" in words)
            return
        match words:
            case ["TOOL", "CALL", number, *_]:
                self._tool(self.lengths[int(number)])
            case [("L" | "LP" | "C" | "CR" | "CP" | "CT" | "CC") as kind, *rest]:
                self._path(kind, rest, local)
            case ["CYCL", "CALL", *_]:
                self._drill()
            case ["CYCL", "DEF", number, *rest]:
                self._define(number, rest, local)
            case _ if words[0] not in DATA:
                raise Unclear(text)
            case _:
                pass

    def _tool(self, length: float) -> None:
        """The length holds from the next move of Z on; the tip stands elsewhere until then."""
        self.at["Z"] += self.length - length
        self.length = length

    def _tip(self, *, on: bool) -> None:
        if on != self.tip:
            self.at |= dict.fromkeys("XYZ", math.nan)
        self.tip = on

    def _define(self, number: str, rest: list[str], local: dict[str, float]) -> None:
        if number.startswith("7."):
            for axis, value, added in self._words(rest, local):
                if self.turn:
                    raise Unclear("a shift under a rotation")
                self.shift[axis] = value + (self.shift[axis] if added else 0.0)
        elif number.startswith("10."):
            for _, value, added in self._words(rest, local):
                self.turn = value + (self.turn if added else 0.0)
        elif number == "247":
            said = dict(re.findall(r"(Q\d+)=([-+]?\d+)", " ".join(rest)))
            self.preset, self.shift, self.turn = int(said["Q339"]), dict.fromkeys(self.axes, 0.0), 0.0
        elif int(number) in DRILLING:
            self.cycle = int(number)
            for name, value in re.findall(r"(Q\d+) *=([-+]?[\d.,]+)", " ".join(rest)):
                self.q[name] = float(value.replace(",", "."))
        else:
            raise Unclear(f"cycle {number}")

    # ---- values

    def _value(self, text: str, local: dict[str, float]) -> float:
        name = text.lstrip("+-")
        if not name.startswith("Q"):
            return float(text.replace(",", "."))
        value = (local if name.startswith("QL") else self.q)[name]
        return -value if text.startswith("-") else value

    def _assigned(self, text: str, formula: str, local: dict[str, float]) -> float:
        """Value of an assignment: a function FN, or a formula."""
        function = re.match(r"FN (\d):", text)
        words = formula.split()
        if function is None:
            return Formula(formula, lambda name: self._value(name, local)).whole()
        numbers = [self._value(word, local) for word in words if re.fullmatch(r"[-+]?[Q\d.,][L\d.,]*", word)]
        a, b = numbers[0], numbers[-1]
        match int(function[1]), len(words):
            case 0, 1:
                return a
            case 1, 3:
                return a + b
            case 2, 3:
                return a - b
            case 3, 3:
                return a * b
            case 4, 3:
                return a / b
            case 5, 2:
                return math.sqrt(b)
            case 6, 2:
                return math.sin(math.radians(b))
            case 7, 2:
                return math.cos(math.radians(b))
            case 8, 3:
                return math.hypot(a, b)
        raise Unclear(text)

    def _words(self, words: list[str], local: dict[str, float]) -> list[tuple[str, float, bool]]:
        """Coordinates: address, value in mm or degrees, True for an increment."""
        found = []
        for word in words:
            parts = WORD.fullmatch(word)
            if parts is not None:
                scale = self.unit if parts[2] in {"X", "Y", "Z", "PR"} else 1.0
                found.append((parts[2], scale * self._value(parts[3] + parts[4], local), bool(parts[1])))
        return found

    # ---- coordinates

    def _placed(self, p: Point) -> Point:
        """A programmed position: turned about the datum, shifted, from the preset."""
        preset = self.presets[self.preset]
        return {axis: value + self.shift[axis] + preset[axis] for axis, value in turned(p, "XY", self.turn).items()}

    def _programmed(self) -> Point:
        preset = self.presets[self.preset]
        return turned({axis: self.at[axis] - self.shift[axis] - preset[axis] for axis in self.axes}, "XY", -self.turn)

    def _target(self, said: list[tuple[str, float, bool]]) -> Point:
        now = self._programmed()
        named = {axis: value + (now[axis] if added else 0.0) for axis, value, added in said if axis in self.axes}
        return self._placed(now | named)

    # ---- moves

    def _path(self, kind: str, words: list[str], local: dict[str, float]) -> None:
        said = self._words(words, local)
        if kind == "CC":
            where = self._target(said) if said else self.at
            if said and {axis for axis, _, _ in said} != {"X", "Y"}:
                raise Unclear("a pole with one coordinate")
            self.pole = {axis: where[axis] for axis in "XY"}
            return
        fast = "FMAX" in words
        for word in words:
            if re.fullmatch(r"F(QL?\d+|[\d.,]+)", word):
                self.feed = self._value(word[1:], local)
        if "M91" in words:
            named = {axis: value for axis, value, _ in said}
            self.at |= {axis: value - (self.length if axis == "Z" else 0.0) for axis, value in named.items()}
            self.moves.append(Move("machine", dict(self.at), self.length, named="".join(named)))
        elif said:
            end = self._polar(said) if kind in {"LP", "CP"} else self._target(said)
            if kind in {"L", "LP"}:
                self._emit("rapid" if fast else "line", end)
            else:
                self._arc(kind, words, said, end)
        if "M99" in words:
            self._drill()
        if "M30" in words or "M2" in words:
            raise EndOfProgram

    def _polar(self, said: list[tuple[str, float, bool]]) -> Point:
        """The end by radius and angle about the pole, from the first axis to the second; the others as they are."""
        values = {name: (value, added) for name, value, added in said}
        u, v = self.at["X"] - self.pole["X"], self.at["Y"] - self.pole["Y"]
        radius, angle = math.hypot(u, v), math.degrees(math.atan2(v, u)) - self.turn
        if "PR" in values:
            radius = values["PR"][0] + (radius if values["PR"][1] else 0.0)
        if "PA" in values:
            angle = values["PA"][0] + (angle if values["PA"][1] else 0.0)
        end = self._target([word for word in said if word[0] not in {"PR", "PA"}])
        way = math.radians(angle + self.turn)
        return end | {"X": self.pole["X"] + radius * math.cos(way), "Y": self.pole["Y"] + radius * math.sin(way)}

    def _arc(self, kind: str, words: list[str], said: list[tuple[str, float, bool]], end: Point) -> None:
        start = self.at
        if kind == "CT":
            if self.heading is None:
                raise Unclear("CT without a direction")
            left, centre = _tangent(start, end, self.heading)
        elif kind == "CR":
            radius = next(self._value(word[1:], local={}) for word in words if re.fullmatch(r"R[-+]?[\d.,]+", word))
            left = "DR+" in words
            centre = centre_of(start, end, radius * self.unit, "XY", left)
        else:
            left, centre = "DR+" in words, self.pole
        if kind != "CP" and abs(end["Z"] - start["Z"]) > ROUNDING_MM:
            raise Unclear(f"{kind} with Z")
        turns = 0
        whole = [abs(value) for name, value, added in said if name == "PA" and added]
        if whole:  # IPA is the angle itself, more than a turn too
            turns = round((math.radians(whole[0]) - sweep(start, end, centre, "XY", left)) / math.tau)
        middle = arc_middle(start, end, centre, "XY", left, turns)
        self._emit("arc", end, middle)
        sense = 1.0 if left else -1.0
        self.heading = (-sense * (end["Y"] - centre["Y"]), sense * (end["X"] - centre["X"]))

    def _emit(self, kind: str, end: Point, middle: Point | None = None) -> None:
        along = end["X"] - self.at["X"], end["Y"] - self.at["Y"]
        self.heading = along if kind == "line" and any(along) and end["Z"] == self.at["Z"] else None
        self.at = self.at | end
        feed = ("minute", self.feed) if kind in {"line", "arc"} else ("", 0.0)
        self.moves.append(
            Move(kind, dict(self.at), self.length, self.tip, feed, middle or {}, continues=self.continues)
        )

    def _drill(self) -> None:
        """Rapid to the set-up clearance, the hole, back to the clearance, and on to the second one."""
        if self.tip or not self.cycle:
            raise Unclear("a cycle under M128, or none")
        surface = self.presets[self.preset]["Z"] + self.shift["Z"] + self.q["Q203"] * self.unit
        clear, second = self.q["Q200"] * self.unit, self.q.get("Q204", 0.0) * self.unit
        if second < clear:
            raise Unclear("a second set-up clearance below the first")
        self._emit("above", {**self.at, "Z": surface + clear})
        self._emit("hole", {**self.at, "Z": surface + self.q["Q201"] * self.unit})
        self._emit("back", {**self.at, "Z": surface + second})


def _tangent(start: Point, end: Point, heading: tuple[float, float]) -> tuple[bool, Point]:
    """Whether an arc that continues a direction turns to the left, and its centre."""
    size = math.hypot(*heading)
    normal = (-heading[1] / size, heading[0] / size)
    u, v = end["X"] - start["X"], end["Y"] - start["Y"]
    side = u * normal[0] + v * normal[1]
    if abs(side) < 1e-9:
        raise Unclear("CT straight on")
    radius = (u * u + v * v) / (2.0 * side)
    return side > 0.0, {"X": start["X"] + radius * normal[0], "Y": start["Y"] + radius * normal[1]}


class Formula:
    """`Q1 = ...`: functions bind closest, then products, then sums."""

    def __init__(self, text: str, value: Callable[[str], float]) -> None:
        self.tokens, self.value = TOKEN.findall(text), value
        if "".join(self.tokens) != re.sub(r"\s", "", text):
            raise Unclear(text)

    def whole(self) -> float:
        """Value of all of it."""
        value = self.sum()
        if self.tokens:
            raise Unclear(" ".join(self.tokens))
        return value

    def sum(self) -> float:
        """Sums and differences."""
        value = self.product()
        while self.tokens and self.tokens[0] in "+-":
            value = value + self.product() if self.tokens.pop(0) == "+" else value - self.product()
        return value

    def product(self) -> float:
        """Products and quotients."""
        value = self.atom()
        while self.tokens and self.tokens[0] in "*/":
            value = value * self.atom() if self.tokens.pop(0) == "*" else value / self.atom()
        return value

    def atom(self) -> float:
        """A number, a parameter, a function or a bracket, with its sign."""
        token = self.tokens.pop(0)
        if token in "+-":
            return self.atom() if token == "+" else -self.atom()
        if token == "(":
            value = self.sum()
            if self.tokens.pop(0) != ")":
                raise Unclear("brackets")
            return value
        return FUNCTIONS[token](self.atom()) if token in FUNCTIONS else self.value(token)


def _blocks(text: str) -> list[str]:
    """Blocks without numbers and comments; behind one that goes on with the move before it stands `~`."""
    found: list[str] = []
    open_ = False
    for line in text.splitlines():
        code, _, comment = line.partition(";")
        goes_on = line.rstrip().endswith("~")
        code = " ".join(code.rstrip().removesuffix("~").split())
        if open_:
            found[-1] += " " + code
        elif re.sub(r"^\d+ *", "", code):
            part = "~" if re.match(r" *NCOMP (FROM|ARC)", comment) else ""
            found.append(re.sub(r"^\d+ *", "", code) + part)
        open_ = goes_on
    return found


def _label(lines: list[str], label: str) -> int:
    """The place behind a label."""
    return lines.index(f"LBL {label}") + 1
