"""Causes in the machine, from their physics. What acts along an axis is counted forward, where a command goes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from virtual_machine.cause import HOUR, UM, Answer, Cause, micro, of_axis, unit
from virtual_machine.chain import Array
from virtual_machine.session import Session

REFERENCE = 20.0
"""degC, where nothing has grown."""


@dataclass(frozen=True)
class Backlash(Cause):
    """Backlash of the nut: the axis hangs back half of it, on the side that it came from."""

    LINEAR: ClassVar[tuple[str, ...]] = ("width",)
    axis: str
    width: float = 1.0

    def errors(self, session: Session) -> Array:
        """Half the backlash behind the command, whichever way it came; in the middle before the first move."""
        behind = -0.5 * self.width * micro(self.axis) * session.approach(self.axis)
        return of_axis(session, self.axis, session.chain.axis(self.axis).own, behind)

    def answer(self) -> Answer:
        """Named with its axis and width."""
        return Answer(("backlash",), (self.axis,), sizes={f"width_{unit(self.axis)}": (self.width,)})


@dataclass(frozen=True)
class Settling(Cause):
    """An axis that stops short by a share of its last move."""

    LINEAR: ClassVar[tuple[str, ...]] = ("share_ppm",)
    axis: str
    share_ppm: float = 1.0

    def errors(self, session: Session) -> Array:
        """Short by ppm of the last move."""
        short = -1e-6 * self.share_ppm * session.last_move(self.axis) * session.chain.axis(self.axis).per_file_unit
        return of_axis(session, self.axis, session.chain.axis(self.axis).own, short)

    def answer(self) -> Answer:
        """Named with its axis and share."""
        return Answer(("settling",), (self.axis,), sizes={"share_ppm": (self.share_ppm,)})


@dataclass(frozen=True)
class Cyclic(Cause):
    """A screw that is off its lead within each turn, with a second harmonic; or a gear of a rotary axis."""

    LINEAR: ClassVar[tuple[str, ...]] = ("waves",)
    axis: str
    period: float
    """mm or degrees."""
    phases: tuple[float, float]
    waves: tuple[float, float] = (1.0, 0.3)
    """Amplitudes of the first and second harmonic."""

    def errors(self, session: Session) -> Array:
        """The sum of both waves."""
        turn = 2 * np.pi * session.place(self.axis) / self.period
        first, second = (a * np.sin(k * turn + p) for k, a, p in zip((1, 2), self.waves, self.phases, strict=True))
        return of_axis(session, self.axis, session.chain.axis(self.axis).own, (first + second) * micro(self.axis))

    def answer(self) -> Answer:
        """Named with its axis; judged by its period and the amplitude of its first harmonic."""
        period = "period_deg" if self.axis[0] in "ABC" else "period_mm"
        sizes = {period: (self.period,), "amplitude": (abs(self.waves[0]),)}
        return Answer(("cyclic",), (self.axis,), sizes=sizes)


@dataclass(frozen=True)
class Steps(Cause):
    """A controller's table that puts a slope right in steps: what is left is a saw tooth."""

    LINEAR: ClassVar[tuple[str, ...]] = ("step",)
    axis: str
    pitch: float
    offset: float
    step: float = 1.0

    def errors(self, session: Session) -> Array:
        """The staircase of the table, one step ahead at each node, less the straight slope that it stands for."""
        nodes = (session.place(self.axis) - self.offset) / self.pitch
        staircase, slope = np.floor(nodes) + 0.5, nodes
        return of_axis(
            session, self.axis, session.chain.axis(self.axis).own, self.step * micro(self.axis) * (staircase - slope)
        )

    def answer(self) -> Answer:
        """Named with its axis, step and pitch."""
        pitch = "pitch_deg" if self.axis[0] in "ABC" else "pitch_mm"
        sizes = {f"step_{unit(self.axis)}": (self.step,), pitch: (self.pitch,)}
        return Answer(("quantised-compensation",), (self.axis,), sizes=sizes)


@dataclass(frozen=True)
class Lag(Cause):
    """A position loop that is late: in motion the axis is behind by the way of so many milliseconds."""

    LINEAR: ClassVar[tuple[str, ...]] = ("lag_ms",)
    axis: str
    lag_ms: float = 1.0

    def errors(self, session: Session) -> Array:
        """Behind by lag x velocity."""
        behind = -1e-3 * self.lag_ms * session.velocity(self.axis)
        return of_axis(session, self.axis, session.chain.axis(self.axis).own, behind)

    def answer(self) -> Answer:
        """Named with its axis and lag."""
        return Answer(("following-error",), (self.axis,), sizes={"lag_ms": (self.lag_ms,)})


@dataclass(frozen=True)
class Tilt(Cause):
    """The line of an axis stands elsewhere: a linear axis tilted (E_C0Y), a rotary one shifted (E_X0C) or tilted."""

    LINEAR: ClassVar[tuple[str, ...]] = ("value",)
    axis: str
    component: str
    value: float = 1.0

    def errors(self, session: Session) -> Array:
        """A tilted line displaces the carriage sideways, without rotation; a rotary axis has constants."""
        axis, k = session.chain.axis(self.axis), "XYZABC".index(self.component)
        if axis.rotary:
            return of_axis(session, self.axis, k, np.full(len(session), self.value * micro(self.component)))
        sideways = np.cross(np.eye(3)[k - 3], axis.direction) * self.value * micro(self.component)
        return sum(
            (of_axis(session, self.axis, i, sideways[i] * session.place(self.axis)) for i in range(3)),
            start=np.zeros((*session.positions.shape, 6)),
        )

    def answer(self) -> Answer:
        """Named with its axis and component."""
        sizes = {f"value_{unit(self.component)}": (self.value,)}
        return Answer(("location",), (self.axis,), {"component": self.component}, sizes)


@dataclass(frozen=True)
class Sag(Cause):
    """A beam that sags in the middle of its guide, the more, the farther out another axis carries its weight.

    The machine was levelled with the other axis in the middle, so that neither the mean sag nor a slope is left.
    """

    LINEAR: ClassVar[tuple[str, ...]] = ("depth",)
    axis: str
    other: str
    depth: float = 1.0
    """um, between middle and ends of the guide, the other axis at its upper end; below zero down."""

    def errors(self, session: Session) -> Array:
        """(4 u (1 - u) - 2/3) (2 v - 1), of shares u and v of the two travels."""
        u, v = (self._share(session, name) for name in (self.axis, self.other))
        return of_axis(session, self.axis, 2, self.depth * UM * (4 * u * (1 - u) - 2 / 3) * (2 * v - 1))

    @staticmethod
    def _share(session: Session, name: str) -> Array:
        low, high = session.chain.axis(name).travel
        return np.asarray((session.place(name) - low) / (high - low))

    def answer(self) -> Answer:
        """Named with either axis, since the product, -2/3 P2(u) P1(v), is one of both."""
        size = {f"coefficient of P2 {self.axis}": (-2.0 * self.depth / 3.0,)}
        fields = {"component": "Z", "both axes": {self.axis, self.other}}
        return Answer(("cross-axis",), (self.axis, self.other), fields, size)


@dataclass(frozen=True)
class Drift(Cause):
    """The tool point wanders with time: steadily, or towards an end. In the tool's own directions."""

    LINEAR: ClassVar[tuple[str, ...]] = ("size",)
    component: str
    time_constant_s: float | None = None
    size: float = 1.0
    """um per hour, or the whole way in um."""

    def course(self, session: Session) -> Array:
        """Course of the size `(n,)`."""
        if self.time_constant_s is None:
            return np.asarray(session.clock / HOUR)
        return np.asarray(1.0 - np.exp(-session.clock / self.time_constant_s))

    def tool(self, session: Session) -> Array:
        """One component of it moves."""
        result = np.zeros((len(session), 6))
        result[:, "XYZABC".index(self.component)] = self.size * micro(self.component) * self.course(session)
        return result

    def answer(self) -> Answer:
        """Named with its component."""
        sizes = {f"rate_{unit(self.component)}_per_h": (self.size,)}
        if self.time_constant_s is not None:
            sizes = {f"amplitudes_{unit(self.component)}": (self.size,), "time_constants_s": (self.time_constant_s,)}
        return Answer(("thermal-drift",), (), {"component": self.component}, sizes)


@dataclass(frozen=True)
class Growth(Cause):
    """The scale of a linear axis grows from its zero: with a logged temperature, or steadily with time."""

    LINEAR: ClassVar[tuple[str, ...]] = ("size",)
    axis: str
    sensor: str | None
    size: float = 1.0
    """um per m and K, or per m and hour."""

    def errors(self, session: Session) -> Array:
        """So much for each metre from zero."""
        warmth = session.clock / HOUR if self.sensor is None else session.temperatures[self.sensor] - REFERENCE
        metres = session.place(self.axis) * 1e-3
        return of_axis(session, self.axis, session.chain.axis(self.axis).own, self.size * UM * warmth * metres)

    def answer(self) -> Answer:
        """Named with its axis; by temperature and by time are one kind in contract 4.3."""
        key = "rate_um_per_m_per_h" if self.sensor is None else "coefficient_um_per_m_per_k"
        kinds = ("thermal-scale",) if self.sensor is None else ("thermal-scale", "thermal-scale-sensor")
        return Answer(kinds, (self.axis,), sizes={key: (self.size,)})


@dataclass(frozen=True)
class Ripple(Cause):
    """Part of a positioning error that is finer than the basis of a coarse model."""

    LINEAR: ClassVar[tuple[str, ...]] = ("amplitude",)
    axis: str
    waves: float
    """Over the travel."""
    phase: float
    amplitude: float = 1.0

    def errors(self, session: Session) -> Array:
        """A sine over the travel."""
        axis = session.chain.axis(self.axis)
        low, high = axis.travel
        phase = 2 * np.pi * self.waves * (session.place(self.axis) - low) / (high - low) + self.phase
        return of_axis(session, self.axis, axis.own, self.amplitude * micro(self.axis) * np.sin(phase))

    def answer(self) -> Answer:
        """Named with its axis and component: a sine is a periodic error, or asks for a finer basis."""
        return Answer(("higher-frequency", "cyclic"), (self.axis,), {"component": self.axis[0]})


@dataclass(frozen=True)
class Unknown(Cause):
    """What no table of effects holds: a bump in X, times a slope in Z, times a wave in time, at the tool point."""

    LINEAR: ClassVar[tuple[str, ...]] = ("size",)
    component: str = "X"
    size: float = 1.0

    def tool(self, session: Session) -> Array:
        """Bump x slope x wave; the bump is a quarter of the travel wide, the wave 1.5 periods long."""
        u, v = (Sag._share(session, name) for name in ("X", "Z"))
        duration = float(session.clock[-1])
        wave = np.sin(3 * np.pi * session.clock / duration)
        result = np.zeros((len(session), 6))
        shape = np.exp(-0.5 * ((u - 0.45) / 0.25) ** 2) * (2 * v - 1) * wave
        result[:, "XYZ".index(self.component)] = self.size * UM * shape
        return result

    def answer(self) -> Answer:
        """No kind has it."""
        return Answer(())
