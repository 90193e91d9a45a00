"""A small FANUC control (series 30i, milling, custom macro B), in the words of its manuals.

Left out, because parameters or models decide: numbers without a decimal point; the axis of a cycle in another plane than
G17 (parameter 5101); G43 without Z (5001, 5006); a new offset under G52 or G92; G52 with G68; the depth behind a change
of G90 and G91 within a cycle; an R above the level before a cycle; repeated I, J, K of G65; G16, G41, G51, G66, G87, G88;
ROUND of an exact half; a variable that is assigned and read in one block.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import count
from pathlib import PurePath

from tests.referees.moves import LONGEST, PLANES, ROUNDING_MM, Move, Point, Unclear, arc_middle, centre_of, turned

CYCLES = {73, 74, 76, 81, 82, 83, 84, 85, 86, 89}
ARGUMENTS = dict(
    zip(
        "ABCIJKDEFHMQRSTUVWXYZ",
        (1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 13, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26),
        strict=True,
    )
)
"""Local variables of a macro by the letters of G65 (argument specification I)."""
CENTRES = {"X": "I", "Y": "J", "Z": "K"}
INCH_MM = 25.4
CONTINUES = "~"
"""End of a block whose comment says that it is a part of a move."""
NUMBER = re.compile(r"\d+\.?\d*|\.\d+")
COMPARED: dict[str, Callable[[float, float], bool]] = {
    "EQ": lambda a, b: a == b,
    "NE": lambda a, b: a != b,
    "GT": lambda a, b: a > b,
    "GE": lambda a, b: a >= b,
    "LT": lambda a, b: a < b,
    "LE": lambda a, b: a <= b,
}
FUNCTIONS: dict[str, Callable[[float], float]] = {
    "SIN": lambda a: math.sin(math.radians(a)),
    "COS": lambda a: math.cos(math.radians(a)),
    "TAN": lambda a: math.tan(math.radians(a)),
    "SQRT": math.sqrt,
    "ABS": abs,
    "FIX": math.trunc,
    "FUP": lambda a: math.copysign(math.ceil(abs(a)), a),
    "ROUND": lambda a: math.copysign(math.floor(abs(a) + 0.5), a),
}


class Formula:
    """A text without blanks that is read from left to right; `variables` answers for `#i`, None where it is empty."""

    def __init__(self, text: str, variables: Callable[[int], float | None]) -> None:
        self.text, self.at, self.variables = text, 0, variables

    def take(self, word: str) -> bool:
        """True, and behind it, where a word stands."""
        if not self.text.startswith(word, self.at):
            return False
        self.at += len(word)
        return True

    def number(self) -> float:
        """A number."""
        found = NUMBER.match(self.text, self.at)
        if found is None:
            raise Unclear(f"no number: {self.text[self.at :]}")
        self.at = found.end()
        return float(found[0])

    def atom(self) -> float | None:
        """A number, a variable, a function or a bracket, with its sign."""
        if self.take("-"):
            value = self.atom()
            return None if value is None else -value
        if self.take("+"):
            return self.atom()
        if self.take("#"):
            return self.variables(int(_whole(self.atom())))
        if self.take("["):
            value = self.sum()
            self.expect("]")
            return value
        if self.take("ATAN"):
            opposite = _known(self.atom())
            self.expect("/")
            return math.degrees(math.atan2(opposite, _known(self.atom()))) % 360.0
        for name, function in FUNCTIONS.items():
            if self.take(name):
                return function(_known(self.atom()))
        return self.number()

    def product(self) -> float | None:
        """Multiplication, division and MOD bind closer than a sum."""
        value = self.atom()
        while True:
            if self.take("*"):
                value = _known(value) * _known(self.atom())
            elif self.take("/"):
                value = _known(value) / _known(self.atom())
            elif self.take("MOD"):
                value = math.fmod(_known(value), _known(self.atom()))
            else:
                return value

    def sum(self) -> float | None:
        """Sums and differences."""
        value = self.product()
        while True:
            if self.take("+"):
                value = _known(value) + _known(self.product())
            elif self.take("-"):
                value = _known(value) - _known(self.product())
            else:
                return value

    def condition(self) -> bool:
        """`[a EQ b]`; an empty variable and 0 are the same but for EQ and NE."""
        self.expect("[")
        left = self.sum()
        name = next((name for name in COMPARED if self.take(name)), None)
        if name is None:
            raise Unclear(f"a condition without comparison: {self.text}")
        right = self.sum()
        self.expect("]")
        if name in {"EQ", "NE"} and None in (left, right):
            return (left is right) == (name == "EQ")
        return COMPARED[name](_known(left), _known(right))

    def expect(self, word: str) -> None:
        """The word that has to stand here."""
        if not self.take(word):
            raise Unclear(f"{word} is missing: {self.text[self.at :]}")


def _known(value: float | None) -> float:
    return 0.0 if value is None else value


def _whole(value: float | None) -> int:
    number = _known(value)
    if abs(number - round(number)) > 1e-9:
        raise Unclear(f"a number that should be whole: {number}")
    return round(number)


class Fanuc:
    """Runs a program; `files` are its text and those of the programs that it calls, the main one first."""

    def __init__(
        self, files: Mapping[str, str], offsets: Mapping[str, Point], lengths: Mapping[int, float], rotary: str
    ) -> None:
        self.programs, self.main = _programs(files)
        self.offsets = {name: dict(offset) for name, offset in offsets.items()}
        self.lengths, self.axes = lengths, "XYZ" + rotary
        self.common: dict[int, float | None] = {}
        self.moves: list[Move] = []
        self.blocks = count()
        self.at: Point = dict.fromkeys(self.axes, math.nan)
        """The tool tip with the work offset added, as in `Move.end`."""
        self.unit, self.absolute, self.plane, self.motion = 1.0, True, "XY", 0
        self.work, self.shift, self.turn = "G54", dict.fromkeys(self.axes, 0.0), 0.0
        self.pivot: Point = dict.fromkeys("XYZ", 0.0)
        self.length, self.tip = 0.0, False
        self.inverse_time, self.feed = False, 0.0
        self.cycle: dict[str, float] = {}
        """Z, R and K of the cycle in force, and the level L before it; empty without one."""
        self.to_level = True
        self.continues = False
        """The block goes on with the move before it, as its comment says."""

    def run(self) -> list[Move]:
        """All moves."""
        self._run(self.main, {})
        return self.moves

    # ---- the order of the blocks

    def _run(self, name: str, local: dict[int, float | None]) -> int | None:
        """Run a program to M99 or M30; the N number behind M99 P."""
        lines = self.programs[name]
        at = 0
        while at < len(lines):
            if next(self.blocks) > LONGEST:
                raise Unclear("an endless program")
            text = re.sub(r"^N\d+", "", lines[at]).removesuffix(CONTINUES)
            self.continues = lines[at].endswith(CONTINUES)
            if text == "M30":
                if name != self.main:
                    raise Unclear("M30 of a subprogram")
                return None
            at = self._statement(name, lines, at, text, local)
            if at < 0:
                return None if at == -1 else -at - 2
        return None

    def _statement(self, name: str, lines: list[str], at: int, text: str, local: dict[int, float | None]) -> int:
        """Execute a block; the place of the next one, -1 behind M99, and -2 - n behind M99 Pn."""

        def variable(number: int) -> float | None:
            return None if number == 0 else (local if number <= 33 else self.common).get(number)

        formula = Formula(text, variable)
        if formula.take("WHILE"):
            if formula.condition():
                return at + 1
            return _find(lines, f"END{text[formula.at + 2 :]}", at) + 1
        if re.fullmatch(r"END\d", text):
            opening = [i for i in range(at) if re.sub(r"^N\d+", "", lines[i]).endswith(f"DO{text[3:]}")]
            return opening[-1]
        if formula.take("IF"):
            if not formula.condition():
                return at + 1
            if formula.take("GOTO"):
                return _block(lines, _whole(formula.sum()))
            formula.expect("THEN")
        elif formula.take("GOTO"):
            return _block(lines, _whole(formula.sum()))
        if formula.take("#"):
            number = _whole(formula.atom())
            formula.expect("=")
            (local if number <= 33 else self.common)[number] = formula.sum()
            return at + 1
        words = list(_words(formula))
        calls = [value for letter, value in words if letter == "M" and value in {98.0, 99.0}]
        if calls == [99.0]:
            back = dict(words).get("P")
            if name == self.main:
                return _block(lines, _whole(back)) if back is not None else self._endless()
            return -1 if back is None else -2 - _whole(back)
        if calls or ("G", 65.0) in words:
            return self._call(words, lines, at, local)
        self._block(words)
        return at + 1

    def _endless(self) -> int:
        raise Unclear("M99 of a main program")

    def _call(self, words: list[tuple[str, float]], lines: list[str], at: int, local: dict[int, float | None]) -> int:
        """M98 with the variables of the caller, G65 with new ones from its arguments."""
        said = dict(words)
        number, repeats = _whole(said["P"]), _whole(said.get("L", 1.0))
        macro = said.get("G") == 65.0
        if not macro and number > 9999:  # P51001: program 1001 five times
            number, repeats = number % 10000, number // 10000
        new: dict[int, float | None] = {ARGUMENTS[a]: v for a, v in words if a in ARGUMENTS} if macro else {}
        goes_on = None
        for _ in range(repeats):
            goes_on = self._run(str(number), dict(new) if macro else local)
        return at + 1 if goes_on is None else _block(lines, goes_on)

    # ---- one block

    def _block(self, words: list[tuple[str, float]]) -> None:
        codes = [round(value, 1) for letter, value in words if letter == "G"]
        said = {letter: value for letter, value in words if letter not in "GMNO"}
        for code in codes:
            self._mode(code)
        counted = "K" if self.cycle else ""  # of holes
        lengths = {a: value * self.unit for a, value in said.items() if a in "XYZIJKRQ" and a != counted}
        if "F" in said:
            self.feed = said["F"] if self.inverse_time else said["F"] * self.unit
        match [code for code in codes if code in {4, 10, 28, 52, 53, 68, 92}]:
            case []:
                self._go(said | lengths, codes)
            case [4]:
                pass
            case [10]:
                self._data(said | lengths)
            case [28]:
                self._home(said)
            case [52]:
                self.shift |= {axis: value for axis, value in (said | lengths).items() if axis in self.axes}
            case [53]:
                self._machine(said | lengths)
            case [68]:
                self.turn = said["R"]
                self.pivot |= {axis: lengths[axis] for axis in PLANES[self.plane][:2]}
            case [92]:
                now = self._programmed()
                for axis in self.axes:
                    if axis in said:
                        self.shift[axis] += now[axis] - (said | lengths)[axis]

    def _mode(self, code: float) -> None:
        """Modal codes, which hold from their block on."""
        match code:
            case 0 | 1 | 2 | 3:
                self.motion, self.cycle = int(code), {}
            case 17 | 18 | 19:
                self.plane = {17: "XY", 18: "ZX", 19: "YZ"}[int(code)]
            case 20 | 21:
                self.unit = INCH_MM if code == 20 else 1.0
            case 90 | 91:
                self.absolute = code == 90
            case 93 | 94:
                self.inverse_time = code == 93
            case 98 | 99:
                self.to_level = code == 98
            case 80:
                self.cycle = {}
            case 69:
                self.turn = 0.0
            case 54 | 55 | 56 | 57 | 58 | 59:
                self._offset(f"G{int(code)}")
            case 43 | 43.4 | 49 | 54.1 | 4 | 10 | 28 | 52 | 53 | 65 | 68 | 92 | 40 | 64:
                pass
            case _ if code in CYCLES:
                if not self.cycle:
                    self.cycle = {"L": self.at["Z"]}
                self.motion = int(code)
            case _:
                raise Unclear(f"G{code:g}")

    def _offset(self, name: str) -> None:
        if any(abs(value) > 1e-9 for value in self.shift.values()) and name != self.work:
            raise Unclear("a new offset under G52 or G92")
        self.work = name

    def _data(self, said: Point) -> None:
        """G10 L2 sets G54 to G59, L20 the offsets of G54.1; with G91 it adds."""
        names = {2: f"G{53 + _whole(said['P'])}", 20: f"G54.1P{_whole(said['P'])}"}
        offset = self.offsets[names[_whole(said["L"])]]
        for axis in self.axes:
            if axis in said:
                offset[axis] = said[axis] + (0.0 if self.absolute else offset[axis])

    def _home(self, said: Point) -> None:
        if self.absolute or any(said[axis] for axis in self.axes if axis in said):
            raise Unclear("G28 by an intermediate position")
        named = "".join(axis for axis in self.axes if axis in said)
        self.at |= dict.fromkeys(named, math.nan)
        self.moves.append(Move("machine", dict(self.at), self.length, named=""))

    def _machine(self, said: Point) -> None:
        """Machine coordinates, without offset and length; the block must be absolute."""
        if not self.absolute:
            raise Unclear("G53 with G91")
        named = "".join(axis for axis in self.axes if axis in said)
        for axis in named:
            self.at[axis] = said[axis] - (self.length if axis == "Z" else 0.0)
        self.moves.append(Move("machine", dict(self.at), self.length, named=named))

    # ---- coordinates

    def _turned(self, p: Point, sense: float) -> Point:
        if not self.turn:
            return p
        first, second, _ = PLANES[self.plane]
        beside = p | {axis: p[axis] - self.pivot[axis] for axis in (first, second)}
        back = turned(beside, self.plane, sense * self.turn)
        return back | {axis: back[axis] + self.pivot[axis] for axis in (first, second)}

    def _placed(self, p: Point) -> Point:
        """A programmed position with everything added that the control adds."""
        work = self.offsets[self.work]
        return {axis: value + self.shift[axis] + work[axis] for axis, value in self._turned(p, 1.0).items()}

    def _programmed(self) -> Point:
        """The present position, as the program would name it."""
        work = self.offsets[self.work]
        return self._turned({axis: self.at[axis] - self.shift[axis] - work[axis] for axis in self.axes}, -1.0)

    def _target(self, said: Point) -> Point:
        now = self._programmed()
        named = {axis: said[axis] for axis in self.axes if axis in said}
        return self._placed(
            now | {axis: value + (0.0 if self.absolute else now[axis]) for axis, value in named.items()}
        )

    # ---- moves

    def _go(self, said: Point, codes: list[float]) -> None:
        if 54.1 in codes:
            self._offset(f"G54.1P{_whole(said['P'])}")
        for code in codes:
            if code in {43, 43.4, 49}:
                self._length(code, said)
        if self.cycle:
            self.cycle |= {letter: said[letter] for letter in "ZR" if letter in said}
            if any(letter in said for letter in "XYZR"):
                self._drill(said)
        elif any(axis in said for axis in self.axes):
            if self.motion in {2, 3}:
                self._arc(said)
            else:
                self._emit("line" if self.motion else "rapid", self._target(said))
        elif self.motion in {2, 3} and any(letter in said for letter in "IJK"):
            self._arc(said)

    def _length(self, code: float, said: Point) -> None:
        new = 0.0 if code == 49 else self.lengths[_whole(said["H"])]
        if code == 43 and "Z" not in said:
            raise Unclear("G43 without Z")
        tip = code == 43.4
        self.at["Z"] += self.length - new
        if tip != self.tip:
            self.at |= dict.fromkeys("XYZ", math.nan)
        self.length, self.tip = new, tip

    def _emit(self, kind: str, end: Point, middle: Point | None = None, *, repeated: bool = False) -> None:
        self.at = self.at | end
        feed = (
            ("inverse" if self.inverse_time else "minute", self.feed) if kind in {"line", "arc", "hole"} else ("", 0.0)
        )
        self.moves.append(Move(kind, dict(self.at), self.length, self.tip, feed, middle or {}, repeated=repeated,
                               continues=self.continues))  # fmt: skip

    def _arc(self, said: Point) -> None:
        first, second, _ = PLANES[self.plane]
        left = self.motion == 3
        now, end = self._programmed(), self._target(said)
        if "R" in said:
            centre = centre_of(self.at, end, said["R"], self.plane, left)
        else:
            beside = now | {axis: now[axis] + said.get(CENTRES[axis], 0.0) for axis in (first, second)}
            centre = self._placed(beside)
        whole = all(abs(end[axis] - self.at[axis]) < ROUNDING_MM for axis in (first, second))
        self._emit("arc", end, arc_middle(self.at, end, centre, self.plane, left))
        self.moves[-1] = replace(self.moves[-1], whole_turn=whole)

    def _drill(self, said: Point) -> None:
        """Rapid over the hole, rapid to R, feed to Z, and back to the level before the cycle or to R."""
        if self.plane != "XY" or self.turn:
            raise Unclear("a cycle in another plane, or under G68")
        level, holes = self.cycle["L"], _whole(said.get("K", 1.0))
        ground = self.offsets[self.work]["Z"] + self.shift["Z"]
        if self.absolute:
            r, bottom = self.cycle["R"] + ground, self.cycle["Z"] + ground
        else:
            r = level + self.cycle["R"]
            bottom = r + self.cycle["Z"]
        if r > level + 1e-9:
            raise Unclear("R above the level before the cycle")
        for _ in range(holes):
            beside = self._target({axis: said[axis] for axis in "XY" if axis in said})
            several = holes > 1
            self._emit("above", beside | {"Z": self.at["Z"]}, repeated=several)
            self._emit("above", {"Z": r}, repeated=several)
            self._emit("hole", {"Z": bottom}, repeated=several)
            self._emit("back", {"Z": level if self.to_level else r}, repeated=several)


def _words(formula: Formula) -> Iterator[tuple[str, float]]:
    """Letters with their values; a word with an empty variable is as if it were not there."""
    while formula.at < len(formula.text):
        letter = formula.text[formula.at]
        formula.at += 1
        if not letter.isalpha():
            raise Unclear(f"no word: {formula.text[formula.at - 1 :]}")
        value = formula.atom()
        if value is not None:
            yield letter, value


def _programs(files: Mapping[str, str]) -> tuple[dict[str, list[str]], str]:
    """Blocks of all programs by their numbers, without comments and blanks, and the number of the main one."""
    programs: dict[str, list[str]] = {}
    main = ""
    for name, text in files.items():
        number = PurePath(name).stem.lstrip("Oo0") or "0"
        programs[number] = []
        for line in text.splitlines():
            part = CONTINUES if re.search(r"\(NCOMP (FROM|ARC)", line) else ""
            code = re.sub(r"\([^)]*\)|\s|%", "", line).upper()
            code += part if code else ""
            head = re.fullmatch(r"[O:]0*(\d+)", code)
            if head is not None:
                number = head[1]
                programs[number] = []
            elif code:
                programs[number].append(code)
            main = main or (number if programs[number] else "")
    return programs, main


def _find(lines: list[str], text: str, after: int) -> int:
    return next(i for i in range(after, len(lines)) if re.sub(r"^N\d+", "", lines[i]) == text)


def _block(lines: list[str], number: int) -> int:
    """Place of a block by its N number."""
    return next(i for i, line in enumerate(lines) if re.match(rf"N0*{number}(?!\d)", line))
