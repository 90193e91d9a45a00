"""Conditions of the machine while a program runs: time and temperatures, from options or from a log.

The conditions at the start of the program are taken for the whole program.
"""

from __future__ import annotations

import math
import operator
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from kinematics.error_model.model import ErrorModel
from kinematics.files import read_input
from kinematics.files.toml_entries import utf8_text
from kinematics.machine import Machine
from kinematics.pieces import ErrorMotions
from kinematics.state import REFERENCE, State
from kinematics.transforms import Array, read_only
from kinematics.user_error import UserError
from postproc.text.number_style import given_number, given_once

ABSOLUTE_ZERO = -273.15
HOTTEST = 200.0
"""Temperature, degC, above which a number is in another unit: kelvin, or hundredths."""
"""Absolute zero, degC."""
TEMPERATURE = "temp_"
"""Prefix of the temperature columns of a log."""
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
        temperatures = {name: np.full(n, value - REFERENCE) for name, value in self.temperatures.items()}
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
        names = ["time_s", *(TEMPERATURE + name for name in self.past.temperatures)]
        return f"; log {self.log} has {', '.join(names)}{_neither(self.unread)}"

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
    temperatures: Iterable[str] = (), elapsed: float | None = None, log: Path | None = None
) -> Conditions:
    """The conditions from the options of the command line, which overrule the last row of the log."""
    if elapsed is not None and not 0.0 <= elapsed < math.inf:
        raise UserError(f"--elapsed {elapsed:g}: expected a time in s, not below 0")
    given = given_once(map(parse_temperature, temperatures), "--temperature ")
    if log is None:
        return Conditions(elapsed, given)
    time, columns, unread = _read_log(log)
    if elapsed is not None:
        time = time - time[-1] + elapsed
    for name, value in given.items():
        columns.setdefault(name, np.full(len(time), value))[-1] = value
    kelvin = {name: values - REFERENCE for name, values in columns.items()}
    past = State(np.zeros((len(time), 0)), time=time, temperatures=kelvin)
    last = {name: float(values[-1]) for name, values in columns.items()}
    return Conditions(float(time[-1]), last, past, str(log), unread)


def parse_temperature(text: str) -> tuple[str, float]:
    """Sensor and temperature, degC, of a text such as `spindle=31.5`; UserError if it has another form."""
    name, _, value = text.partition("=")
    if not name.strip() or not value.strip():
        raise UserError(f"--temperature {text}: expected SENSOR=degC, for example spindle=31.5")
    return name.strip(), degrees(value, f"--temperature {text}")


def degrees(text: str, where: str) -> float:
    """Temperature from a text, degC; UserError, beginning with `where`, if it is not a temperature."""
    value = given_number(text, where)
    if value < ABSOLUTE_ZERO:
        raise UserError(f"{where}: {value:g} degC is below absolute zero ({ABSOLUTE_ZERO:g})")
    if value > HOTTEST:
        raise UserError(f"{where}: {value:g} degC is no temperature of a machine: write degC (is this kelvin?)")
    return value


def _neither(names: Sequence[str]) -> str:
    """Part of a message on columns of a log that are not read; empty for none."""
    if not names:
        return ""
    verb = "is" if len(names) == 1 else "are"
    return f"; the columns of a log are time_s and temp_NAME, and {', '.join(names)} {verb} neither"


def _read_log(path: Path) -> tuple[Array, dict[str, Array], tuple[str, ...]]:
    """Times `(n,)`, s, temperatures `(n,)` by sensor, degC, and the names of all other columns of a log.

    UserError with line and column.
    """
    text = utf8_text(read_input(path, "log"), f"log {path}").removeprefix("\ufeff")
    rows = _rows(text, path)
    line, header = next(rows, (1, []))
    names = [name.strip() for name in header]
    temperatures = [i for i, name in enumerate(names) if name.startswith(TEMPERATURE)]
    unread = tuple(name for name in names if name and name != "time_s" and not name.startswith(TEMPERATURE))
    for name in ("time_s", *(names[i] for i in temperatures)):
        if names.count(name) != 1:
            lacks = _neither(unread) if name not in names else ""
            lacks += "; separate cells by ','" if len(names) == 1 and ";" in names[0] else ""
            found = names.count(name) or "none"
            raise UserError(f"log {path}:{line}: expected one column {name}, found {found}{lacks}")
    columns = [names.index("time_s"), *temperatures]
    values = []
    for line, row in rows:
        if len(row) != len(names):
            raise UserError(f"log {path}:{line}: the row has {len(row)} values, and the header {len(names)} columns")
        locations = [f"log {path}:{line}, column {names[i]}" for i in columns]
        readers = [given_number, *[degrees] * len(temperatures)]
        values.append([read(row[i], at) for read, i, at in zip(readers, columns, locations, strict=True)])
        if len(values) > 1 and values[-1][0] < values[-2][0]:
            raise UserError(
                f"log {path}:{line}, column time_s: the time is before that of the last row: sort the rows by time"
            )
    if not values:
        raise UserError(f"log {path} has no rows of values")
    time, *courses = np.array(values).T
    return time, {names[i].removeprefix(TEMPERATURE): t for i, t in zip(temperatures, courses, strict=True)}, unread


def _rows(text: str, path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line and values of each row, without empty rows and comments (#)."""
    import csv

    reader = csv.reader(text.splitlines(), strict=True)
    try:
        for row in reader:
            if row and any(value.strip() for value in row) and not row[0].lstrip().startswith("#"):
                yield reader.line_num, row
    except csv.Error as fault:
        raise UserError(f"log {path}:{reader.line_num}: {fault}") from None
