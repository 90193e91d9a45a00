"""A gantry with errors, `w b X Y Z t`, written without ncomp: its machine file, its calibration, its tool point."""

from __future__ import annotations

import json
import random
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
AXES = "XYZ"
LETTERS = "XYZABC"
HALF = 1000.0
"""Half the travel of every axis, mm; error motions are polynomials over the whole of it."""
HASH = "f5c855c98c3eafe6"
"""Hash of the chain of the shipped gantry."""


def machine_text(control: str, tables: str = "") -> str:
    """A machine file."""
    axes = "".join(f"[axes.{axis}]\ntravel = [{-HALF}, {HALF}]\nhome = 0.0\n" for axis in AXES)
    return f'name = "fuzz"\nchain = "w b X Y Z t"\n{axes}[control]\n{control}\n{tables}'


@dataclass(frozen=True)
class Errors:
    """Polynomials of the six error motions of each axis in u = 0..1 over the travel, (3, 6, terms), um and urad."""

    parameters: Array
    play: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Lost motion, um: an axis that moves up is half of it lower."""
    wave: tuple[float, float] = (0.0, 1.0)
    """Amplitude, um, and period, mm, of a cyclic error of each axis along itself."""
    teeth: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Steps of a table in the control: height, um, pitch and position of one, mm; the same in each axis."""

    def text(self) -> str:
        """Text of a calibration file."""
        effects = [
            {
                "kind": "error-motion",
                "component": LETTERS[j],
                "axis": AXES[i],
                "basis": {"kind": "polynomial", "interval": [-HALF, HALF], "degree": len(self.parameters[i, j]) - 1},
                "parameters": list(self.parameters[i, j]),
                "units": {"parameters": "um" if j < 3 else "urad"},
            }
            for i in range(3)
            for j in range(6)
            if self.parameters[i, j].any()
        ]
        effects += [
            {"kind": "backlash", "axis": axis, "width": width, "units": {"width": "um"}}
            for axis, width in zip(AXES, self.play, strict=True)
            if width
        ]
        effects += [effect for axis in AXES for effect in self._repeated(axis)]
        content = {
            "ncomp_calibration": 1,
            "machine": {"name": "fuzz", "chain": "w b X Y Z t", "chain_hash": HASH},
            "provenance": {"made_by": "fuzz", "made_at": "2026-11-01T00:00:00Z", "source": "", "inputs": {}},
            "demonstration": False,
            "effects": effects,
            "covariance": None,
        }
        return json.dumps(content, indent=1) + "\n"

    def _repeated(self, axis: str) -> list[dict[str, object]]:
        amplitude, period = self.wave
        step, pitch, offset = self.teeth
        wave = {
            "kind": "cyclic", "component": axis, "axis": axis, "period": period, "sine": [amplitude], "cosine": [0.0],
            "units": {"period": "mm", "sine": "um", "cosine": "um"},
        }  # fmt: skip
        teeth = {
            "kind": "quantised-compensation", "axis": axis, "step": step, "pitch": pitch, "offset": offset,
            "units": {"step": "um", "pitch": "mm", "offset": "mm"},
        }  # fmt: skip
        return [*([wave] if amplitude else []), *([teeth] if step else [])]

    def _own(self, q: Array) -> Array:
        """Cyclic errors and steps (n, 3), um, of each axis along itself."""
        step, pitch, offset = self.teeth
        wave = self.wave[0] * np.sin(2 * np.pi * q / self.wave[1])
        return np.asarray(wave + step * (0.5 - ((q - offset) / pitch) % 1.0))

    def to_step(self, q: Array) -> float:
        """Distance, mm, of the nearest step from axis positions (n, 3); infinite without steps."""
        step, pitch, offset = self.teeth
        phase = ((q - offset) / pitch) % 1.0
        return float(np.minimum(phase, 1.0 - phase).min() * pitch) if step else np.inf

    def tool_point(self, q: Array, tool: float, side: Array | None = None) -> Array:
        """Tool point (n, 3), mm, at axis positions (n, 3); `side` (n, 3) in -1..1 is the side of its backlash."""
        u = np.clip((q + HALF) / (2 * HALF), 0.0, 1.0)
        powers = u[:, :, None] ** np.arange(self.parameters.shape[2])
        e = np.einsum("nat,act->nac", powers, self.parameters) * 1e-6
        e[:, range(3), range(3)] += self._own(q) * 1e-6
        at = np.tile([0.0, 0.0, -tool], (len(q), 1))
        for i in (2, 1, 0):
            turn, shift = e[:, i, 3:], e[:, i, :3] * 1e3
            at = at + np.cross(turn, at) + 0.5 * np.cross(turn, np.cross(turn, at)) + shift
            at[:, i] += q[:, i]
        if side is not None:
            at = at - 0.5e-3 * side * np.array(self.play)
        return np.asarray(at)

    @property
    def largest(self) -> float:
        """More than any deviation of the tool point, mm."""
        return float(
            np.abs(self.parameters[:, :3]).sum() * 1e-3 + np.abs(self.parameters[:, 3:]).sum() * 4.0 * HALF * 1e-6
        )


def read_errors(text: str) -> Errors:
    """Errors from a calibration file that `text` wrote."""
    effects = json.loads(text)["effects"]
    terms = max([len(effect.get("parameters", ())) for effect in effects], default=1)
    parameters, play = np.zeros((3, 6, max(terms, 1))), [0.0, 0.0, 0.0]
    wave, teeth = (0.0, 1.0), (0.0, 1.0, 0.0)
    for effect in effects:
        axis = AXES.index(effect["axis"])
        if effect["kind"] == "backlash":
            play[axis] = effect["width"]
        elif effect["kind"] == "cyclic":
            wave = (effect["sine"][0], effect["period"])
        elif effect["kind"] == "quantised-compensation":
            teeth = (effect["step"], effect["pitch"], effect["offset"])
        else:
            values = effect["parameters"]
            parameters[axis, LETTERS.index(effect["component"]), : len(values)] = values
    return Errors(parameters, (play[0], play[1], play[2]), wave, teeth)


def constant(rng: random.Random) -> Errors:
    """The tool point is off by the same everywhere: some tenths of a millimetre."""
    parameters = np.zeros((3, 6, 1))
    for i in range(3):
        parameters[i, i, 0] = rng.choice([-1, 1]) * rng.randint(50, 400)
    return Errors(parameters)


def smooth(rng: random.Random) -> Errors:
    """All error motions, smooth; steep enough that a position misread by a millimetre shows."""
    parameters = np.zeros((3, 6, 4))
    for i in range(3):
        for j in range(6):
            size = 250.0 if j < 3 else 60.0
            parameters[i, j] = [round(rng.uniform(-1, 1) * size, 2) for _ in range(4)]
    return Errors(parameters)


def flat(_: random.Random, play: tuple[float, ...]) -> Errors:
    """Backlash and nothing else."""
    return Errors(np.zeros((3, 6, 1)), (play[0], play[1], play[2]))


def gentle(rng: random.Random, play: tuple[float, ...]) -> Errors:
    """Backlash beside error motions whose corrections turn axes back within moves."""
    parameters = np.zeros((3, 6, 4))
    for i in range(3):
        for j in range(3):
            parameters[i, j] = [round(rng.uniform(-1, 1) * 60.0, 2) for _ in range(4)]
    return Errors(parameters, (play[0], play[1], play[2]))


def repeated(rng: random.Random) -> Errors:
    """A cyclic error, steps, or both, beside gentle error motions."""
    kind, play = rng.randrange(3), (0.0, 0.0, 0.0)
    wave = (rng.choice([2.0, 5.0]), rng.choice([10.0, 63.5])) if kind else (0.0, 1.0)
    teeth = (0.0, 1.0, 0.0) if kind == 1 else (rng.choice([3.0, 5.0]), rng.choice([25.0, 50.0]), rng.uniform(0, 10))
    return replace(gentle(rng, play), wave=wave, teeth=teeth)
