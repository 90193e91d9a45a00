"""Data of a Siemens control that a program or an archive sets: work offsets and tool lengths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from postproc.text.expressions import NotKnown, Value

FRAMES, NAMES = "$P_UIFR", "$TC_TP2"
LENGTHS = {"$TC_DP3": "length", "$TC_DP12": "wear", "$TC_DP21": "base"}
RADII = {"$TC_DP6": "radius", "$TC_DP15": "wear"}
SIDEWAYS = frozenset(f"$TC_DP{n}" for n in (4, 5, 13, 14, 22, 23))
"""Lengths across the axis of a milling tool."""
PARTS = frozenset(("TR", "RT", "FI", "SC", "MI"))
"""Components of a frame: translation, rotation, fine shift, scale, mirror."""
NEUTRAL = {"RT": 0.0, "SC": 1.0, "MI": 0.0}
SETTABLE = {0: "G500", 1: "G54", 2: "G55", 3: "G56", 4: "G57", **{n: f"G{500 + n}" for n in range(5, 100)}}
"""Work offsets by the index of their frame."""


@dataclass
class ControlData:
    """The values that the program has set."""

    whole: dict[str, dict[str, float]] = field(default_factory=dict)
    """Work offsets by name and axis, mm or degrees, that were set as a whole."""
    single: dict[str, dict[str, float]] = field(default_factory=dict)
    """Those of which single axes were set."""
    fine: dict[str, dict[str, float]] = field(default_factory=dict)
    """Fine shifts, which come on top."""
    lengths: dict[tuple[int, int], dict[str, float]] = field(default_factory=dict)
    """Length 1, its wear and its base, mm, by tool and cutting edge."""
    rounds: dict[tuple[int, int], dict[str, float]] = field(default_factory=dict)
    """Radius and its wear, mm."""
    names: dict[int, str] = field(default_factory=dict)
    """Names of the tools, by number."""

    def set(self, name: str, indices: tuple[Value, ...], value: Value) -> None:
        """Take over a value that affects the position of the tool; NotKnown for one that is not followed."""
        if name == FRAMES:
            self._set_frame(indices, value)
        elif name in LENGTHS and isinstance(value, float):
            self.lengths.setdefault((_index(indices, 0), _index(indices, 1)), {})[LENGTHS[name]] = value
        elif name in RADII and isinstance(value, float):
            self.rounds.setdefault((_index(indices, 0), _index(indices, 1)), {})[RADII[name]] = value
        elif name in SIDEWAYS and value != 0.0:
            raise NotKnown(f"{name} is a tool length across the tool axis, which is not corrected: write 0")
        elif name == NAMES and isinstance(value, str):
            self.names[_index(indices, 0)] = value

    def _set_frame(self, indices: tuple[Value, ...], value: Value) -> None:
        number = _index(indices, 0)
        frame = SETTABLE.get(number)
        if frame is None:
            raise NotKnown(f"{FRAMES}[{number}] is no work offset: write an index from 0 to {max(SETTABLE)}")
        if len(indices) == 1 and isinstance(value, str):
            shifts = axes_of(value)
            self.whole[frame] = {axis: shift for axis, shift in shifts.items() if FINE not in axis}
            self.single.pop(frame, None)
            self.fine[frame] = {axis.removesuffix(FINE): shifts[axis] for axis in shifts if FINE in axis}
        elif len(indices) == 3 and isinstance(value, float):
            axis, part = indices[1], str(indices[2])
            if isinstance(axis, float):
                axis = dict(enumerate("XYZ")).get(int(axis), "")
            if part in NEUTRAL and value != NEUTRAL[part]:
                raise NotKnown(f"{frame} is rotated, scaled or mirrored, which is not followed: write shifts only")
            if part not in PARTS or not axis:
                raise NotKnown(
                    f"{FRAMES}[{', '.join(map(str, indices))}] is not known to ncomp: write an axis, and TR or FI"
                )
            if part not in NEUTRAL:
                (self.fine if part == "FI" else self.single).setdefault(frame, {})[axis] = value
        else:
            raise NotKnown(f"{frame} has a value in a form that is not followed: write CTRANS and CFINE")

    def coarse(self, name: str) -> dict[str, float]:
        """The axes of a work offset that were set, mm or degrees, without fine shifts."""
        whole = {**dict.fromkeys("XYZ", 0.0), **self.whole[name]} if name in self.whole else {}
        return {**whole, **self.single.get(name, {})}

    def offset(self, name: str) -> dict[str, float]:
        """The work offset of a name with its fine shifts, mm or degrees by axis."""
        coarse = {**self.whole.get(name, {}), **self.single.get(name, {})}
        fine = self.fine.get(name, {})
        return {axis: coarse.get(axis, 0.0) + fine.get(axis, 0.0) for axis in {**coarse, **fine}}

    @property
    def offsets(self) -> frozenset[str]:
        """Names of all work offsets that were set."""
        return frozenset((*self.whole, *self.single, *self.fine))

    def tools(self) -> dict[str, float]:
        """Lengths, mm, by number and by name of the tool, and edge, as `edge_key` names them."""
        return self._by_key({at: parts for at, parts in self.lengths.items() if "length" in parts})

    def worn(self) -> frozenset[str]:
        """Tools and edges of which wear or base were set, and length 1 was not."""
        return frozenset(self._by_key({at: parts for at, parts in self.lengths.items() if "length" not in parts}))

    def radii(self) -> dict[str, float]:
        """Radii likewise."""
        return self._by_key(self.rounds)

    def _by_key(self, values: dict[tuple[int, int], dict[str, float]]) -> dict[str, float]:
        found: dict[str, float] = {}
        for (tool, edge), parts in values.items():
            for key in (str(tool), self.names.get(tool)):
                if key is not None:
                    found[edge_key(key, edge)] = sum(parts.values())
        return found


def edge_key(tool: int | str, edge: int) -> str:
    """Name of the length of a cutting edge in a set-up: `5` for D1 of T5, `5 D2` for D2."""
    return str(tool) if edge == 1 else f"{tool} D{edge}"


def _index(indices: tuple[Value, ...], position: int) -> int:
    value = indices[position] if position < len(indices) else None
    if not isinstance(value, float) or value != int(value):
        raise NotKnown(f"index {position + 1} of a variable of the control is no whole number: write a whole number")
    return int(value)


# ---- frames as values of expressions: shifts, in a text such as `X=10.0 Y=2.5 X~=0.01`

FINE = "~"
"""Behind the axis of a fine shift."""


def translation(*parts: Value) -> str:
    """CTRANS(X, 10, Y, 2.5)."""
    return _text(_pairs(parts))


def fine_translation(*parts: Value) -> str:
    """CFINE(X, 0.01): shifts that stay apart, because a statement may set the coarse ones alone."""
    return _text([(axis + FINE, value) for axis, value in _pairs(parts)])


def _pairs(parts: Sequence[Value]) -> list[tuple[str, float]]:
    if len(parts) % 2:
        raise TypeError
    pairs = zip(parts[::2], parts[1::2], strict=True)
    return [(axis, value) for axis, value in pairs if isinstance(axis, str) and isinstance(value, float)]


def unturned(*parts: Value) -> str:
    """CROT and CMIRROR that change nothing."""
    if any(isinstance(value, float) and value != 0.0 for value in parts[1::2]):
        raise NotKnown("CROT or CMIRROR rotates or mirrors a frame, which is not followed: write CTRANS and CFINE only")
    return ""


def unscaled(*parts: Value) -> str:
    """CSCALE that changes nothing."""
    if any(isinstance(value, float) and value != 1.0 for value in parts[1::2]):
        raise NotKnown("CSCALE scales a frame, which is not followed: write CTRANS and CFINE only")
    return ""


def chained(first: Value, second: Value) -> str:
    """One frame in another."""
    if not isinstance(first, str) or not isinstance(second, str):
        raise TypeError
    a, b = axes_of(first), axes_of(second)
    return _text([(axis, a.get(axis, 0.0) + b.get(axis, 0.0)) for axis in {**a, **b}])


def axes_of(frame: str) -> dict[str, float]:
    """The shifts of a frame by axis, fine ones by axis and FINE."""
    try:
        return {axis: float(value) for axis, value in (part.split("=") for part in frame.split())}
    except ValueError:
        raise NotKnown(f"{frame!r} is no frame: write CTRANS and CFINE") from None


def _text(pairs: Sequence[tuple[str, float]]) -> str:
    return " ".join(f"{axis}={value!r}" for axis, value in pairs)
