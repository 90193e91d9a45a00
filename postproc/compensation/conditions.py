"""Conditions of the machine while a program runs: time and temperatures, from options or from a log.

The conditions at the start of the program are taken for the whole program.
"""

from __future__ import annotations

import math
import operator
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from kinematics.error_model.model import ErrorModel
from kinematics.files.text_cells import checked_degrees
from kinematics.machine import Machine
from kinematics.pieces import ErrorMotions
from kinematics.state import REFERENCE_DEGC, State
from kinematics.transforms import Array, read_only
from kinematics.user_error import UserError
from postproc.text.number_style import given_number, given_once

if TYPE_CHECKING:
    from kinematics.files.temperature_log import TemperatureLog

MODELS, VALUES = 4, 8
"""Number of models whose tables of error motions are kept, and of other quantities that are."""


@dataclass(frozen=True)
class Conditions:
    """Quantities, besides positions and directions, that errors depend on; by default those of a cold machine."""

    elapsed: float | None = None
    """Time since the zero of thermal effects, s: since the machine was switched on, or measuring began."""
    temperatures: Mapping[str, float] = field(default_factory=dict)
    """Temperatures by sensor, degC."""
    past: State | None = None
    """States from the log; the last row is the start of the program."""
    log: str = ""
    """Log file of `past`; empty for none."""
    unread: tuple[str, ...] = ()
    """Columns of the log that are neither time nor temperature."""
    _motions: deque[ErrorMotions] = field(
        default_factory=lambda: deque(maxlen=MODELS), init=False, repr=False, compare=False
    )

    _values: deque[tuple[Hashable, tuple[Machine, ErrorModel], Array]] = field(
        default_factory=lambda: deque(maxlen=VALUES), init=False, repr=False, compare=False
    )

    def state(self, positions: Array, approach: Array | None = None) -> State:
        """The state at axis positions `(n, axes)`, mm and rad, approached in directions `approach` `(n, axes)`."""
        n = len(positions)
        temperatures = {name: np.full(n, value - REFERENCE_DEGC) for name, value in self.temperatures.items()}
        return State(
            positions, approach, time=np.full(n, self.elapsed or 0.0), temperatures=temperatures, past=self.past
        )

    def states(self, approach: Array | None = None) -> States:
        """The state as a function of positions, for moves with these approach directions `(n, axes)`."""
        return States(self, approach)

    def errors(self, machine: Machine, model: ErrorModel) -> ErrorMotions:
        """The error motions by a model, whose tables are kept for the models used last."""
        for known in tuple(self._motions):  # other threads may add to them
            if known.machine is machine and known.model is model:
                return known
        self._motions.appendleft(motions := ErrorMotions(machine, model, self.state))
        return motions

    def known(
        self, name: str, of: tuple[Machine, ErrorModel], at: Iterable[Hashable], value: Callable[[], Array]
    ) -> Array:
        """A quantity of a machine and a model at some touch-offs, read-only; the last ones are kept."""
        key = name, tuple(at)
        for own, machine_and_model, found in tuple(self._values):  # other threads may add to them
            if own == key and all(map(operator.is_, machine_and_model, of)):
                return found
        self._values.appendleft((key, of, found := read_only(value())))
        return found

    def json(self) -> dict[str, Any]:
        """The machine-readable form."""
        return {"elapsed_s": self.elapsed, "temperatures_degC": dict(self.temperatures), "log": self.log or None}

    def text(self) -> str:
        """Text for the user; empty if no condition is given."""
        texts = [] if self.elapsed is None else [f"{self.elapsed:g} s after time zero"]
        texts += [f"{name} {value:g} degC" for name, value in self.temperatures.items()]
        return ", ".join(texts) + (", held over the program" if texts else "")

    def _in_log(self) -> str:
        """Columns of the log, for messages about missing ones."""
        if not self.log or self.past is None:
            return ""
        from kinematics.files.column_map import SECONDS, TEMPERATURE
        from kinematics.files.temperature_log import neither

        names = [SECONDS, *(TEMPERATURE + name for name in self.past.temperatures)]
        return f"; log {self.log} has {', '.join(names)}{neither(self.unread)}"

    def notes(self, model: ErrorModel) -> list[str]:
        """Notes for the user on a model under these conditions; UserError if a condition that it needs is missing."""
        of_machine = [effect for effect in model.effects if effect.ACTS_ON != "instrument"]
        used: set[str] = set()
        steady: list[str] = []
        for effect in of_machine:
            used.update(effect.sensors)
            for sensor in effect.sensors:
                if sensor not in self.temperatures:
                    give = f"--temperature {sensor}=degC or --log"
                    raise UserError(f"{effect.name} needs the temperature {sensor!r}: give {give}{self._in_log()}")
            if effect.HAS_MEMORY and "time" in effect.needs:
                steady += [effect.name] if self.past is None else []
            elif "time" in effect.needs and self.elapsed is None:
                raise UserError(f"{effect.name} needs the time since its zero: give --elapsed s or --log")
        logged = () if self.past is None else self.past.temperatures
        timed = any("time" in effect.needs or effect.HAS_MEMORY for effect in of_machine)
        unused = [name for name in self.temperatures if name not in used and name not in logged]
        notes = [f"temperature {name} was given and no effect uses it" for name in unused]
        if self.log and not timed and not used:
            notes.append(f"log {self.log} was given, and no effect of the calibration depends on time or temperature")
        elif self.elapsed is not None and not timed and not self.log:
            notes.append(f"--elapsed {self.elapsed:g} was given, and no effect of the calibration depends on time")
        if steady:
            notes.append(
                f"{', '.join(steady)}: a steady state at the given temperature is assumed; --log gives its history"
            )
        return notes


class States(msgspec.Struct, frozen=True):
    """The state of the machine as a function of positions, for moves with their approach directions."""

    conditions: Conditions
    approach: Array | None = None
    """Directions `(n, axes)`."""

    def __call__(self, positions: Array) -> State:
        """The state at axis positions `(n, axes)`, mm and rad."""
        return self.conditions.state(positions, self.approach)

    def errors(self, machine: Machine, model: ErrorModel) -> Callable[[Array], Array]:
        """Error motions `(n, axes + 1, 6)` by a model, mm and rad, as a function of axis positions `(n, axes)`."""
        motions = self.conditions.errors(machine, model)
        return lambda positions: motions.at(positions, self.approach)


def make_conditions(
    temperatures: Iterable[str] = (),
    elapsed: float | None = None,
    log: str | Path | None = None,
    log_columns: str | Path | None = None,
) -> Conditions:
    """The conditions from the options of the command line, which overrule the last row of the log.

    The time of a log of time stamps begins with its first row.
    """
    if elapsed is not None and not 0.0 <= elapsed < math.inf:
        raise UserError(f"--elapsed {elapsed:g}: expected a time in s, not below 0")
    given = given_once(map(parse_temperature, temperatures), "--temperature ")
    logged = None if log is None and log_columns is None else _logged(log, log_columns)
    if logged is None:
        return Conditions(elapsed, given)
    time, columns = logged.times.seconds, dict(logged.temperatures)
    if elapsed is not None:
        time = time - time[-1] + elapsed
    for name, value in given.items():
        columns.setdefault(name, np.full(len(time), value))[-1] = value
    kelvin = {name: values - REFERENCE_DEGC for name, values in columns.items()}
    past = State(np.zeros((len(time), 0)), time=time, temperatures=kelvin)
    last = {name: float(values[-1]) for name, values in columns.items()}
    return Conditions(float(time[-1]), last, past, str(log), logged.unread)


def _logged(log: str | Path | None, columns: str | Path | None) -> TemperatureLog | None:
    """The log; its reader is loaded for a log only."""
    from kinematics.files.temperature_log import read_given_log

    return read_given_log(log, columns)


def parse_temperature(text: str) -> tuple[str, float]:
    """Sensor and temperature, degC, of a text such as `spindle=31.5`; UserError if it has another form."""
    name, _, value = text.partition("=")
    if not name.strip() or not value.strip():
        raise UserError(f"--temperature {text}: expected SENSOR=degC, for example spindle=31.5")
    where = f"--temperature {text}"
    return name.strip(), checked_degrees(given_number(value, where), where)
