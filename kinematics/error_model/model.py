"""ErrorModel: a machine, its effects, fitted parameters and their covariance: the contents of a calibration file."""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple, Union, get_args

import msgspec
import numpy as np

from kinematics.effects import COMPONENTS, INSTRUMENT, Effect, ErrorMotion, LocationError
from kinematics.effects.base import unit_of
from kinematics.error_model.covariance import Rows
from kinematics.error_model.decoding_faults import CURE, given_twice, hint, reason_of_fault, utf8_content
from kinematics.error_model.effect_sums import Design, total_errors
from kinematics.error_model.layout import to_json
from kinematics.error_model.provenance import SIMULATED, VALID_DAYS, MachineReference, Provenance, reference
from kinematics.files import fingerprint, read_input, write_whole
from kinematics.files.mistaken import document_of, kind_of_file
from kinematics.machine import Machine
from kinematics.state import REFERENCE_DEGC, TEMPERATURE, State, variable_unit
from kinematics.transforms import Array
from kinematics.turn import beyond, gap_of, spread_beyond
from kinematics.user_error import UserError

MODEL_ROUNDING = 1e-9  # mm or degrees: positions come back from rad with an error far below this
LONGEST_FEATURE = np.deg2rad(40.0)
"""rad."""
PLUGIN = "if it is an effect of your own, name its file with --plugin FILE.py; otherwise "


class Observation(NamedTuple):
    """Changes of an observation by the effects."""

    errors: Array
    """Error motions `(n, axes + 1, 6)`, mm and rad, of the axes and the tool, as the data show them."""
    shift: Array
    """Displacement `(n, 3)`, mm, of the observed point in the instrument's frame."""


class ErrorModel(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Contract 4.4, version 1.

    Effects of the instrument belong to the data: only `observation` and `observation_design` contain them, no method
    for the errors of the machine does.
    """

    ncomp_calibration: Literal[1] = 1
    """Version of the file."""
    machine: MachineReference
    """Name, chain and fingerprint of the machine."""
    provenance: Provenance
    """Origin: program, date, data and their fingerprints."""
    demonstration: bool = False
    """True for a calibration that describes no real machine; announced on every run."""
    effects: tuple[Effect, ...]
    """Causes of error with their parameters, um and urad unless their units say another one."""
    covariance: tuple[tuple[float, ...], ...] | None = None
    """Covariance of all parameters in the order of the effects, in their units; None if they are independent with
    their u."""

    def __repr__(self) -> str:
        return f"<ErrorModel: {self.machine.name}, calibration {self.id}, {len(self.effects)} effects>"

    @property
    def id(self) -> str:
        """Fingerprint of the content."""
        return fingerprint(msgspec.json.encode(msgspec.structs.replace(self, provenance=self.provenance.lasting)))

    @property
    def parameters(self) -> Array:
        """All parameters, in the order of the effects and in their units."""
        return np.array([p for effect in self.effects for p in effect.parameters])

    @property
    def slices(self) -> tuple[slice, ...]:
        """The slice of each effect in all parameters."""
        ends = np.cumsum([0, *(len(effect.parameters) for effect in self.effects)]).tolist()
        return tuple(slice(low, high) for low, high in pairwise(ends))

    def with_parameters(self, values: Array, covariance: Array | None = None) -> ErrorModel:
        """The model with other parameters `(p,)` and covariance `(p, p)`; without one, each effect keeps its u."""
        u = None if covariance is None else np.sqrt(np.maximum(np.diag(covariance), 0.0))
        effects = tuple(
            effect.with_parameters(values[part].tolist(), effect.u if u is None else u[part].tolist())
            for effect, part in zip(self.effects, self.slices, strict=True)
        )
        rows = None if covariance is None else Rows.of(covariance)
        return msgspec.structs.replace(self, effects=effects, covariance=rows)

    @property
    def error_motions(self) -> tuple[tuple[ErrorMotion, slice], ...]:
        """The error motions of all axes, each with the slice of its parameters."""
        own = zip(self.effects, self.slices, strict=True)
        return tuple((effect, part) for effect, part in own if isinstance(effect, ErrorMotion))

    @property
    def location_errors(self) -> tuple[tuple[LocationError, slice], ...]:
        """The location errors of all axis lines, each with the slice of its parameter."""
        own = zip(self.effects, self.slices, strict=True)
        return tuple((effect, part) for effect, part in own if isinstance(effect, LocationError))

    @property
    def invented(self) -> bool:
        """True where no real machine was measured: a demonstration, and a calibration fitted to simulated data."""
        return self.demonstration or SIMULATED in self.provenance.source

    def age_days(self, now: datetime.datetime) -> float:
        """Days since the machine was measured; since the calibration was made where the date is not known."""
        return (now - self.valid_from).total_seconds() / 86400.0

    @property
    def valid_from(self) -> datetime.datetime:
        """Time from which its validity counts: the beginning of the measuring day, if it is known."""
        day = self.provenance.measured_on
        if day is msgspec.UNSET:
            return self.provenance.made_at
        return min(datetime.datetime.combine(day, datetime.time(), datetime.UTC), self.provenance.made_at)

    @property
    def valid_days(self) -> float:
        """Days from `valid_from` for which the calibration is valid; infinite for a demonstration."""
        stated = self.provenance.valid_days
        if self.demonstration:
            return math.inf
        return VALID_DAYS if stated is msgspec.UNSET else float(stated)

    @property
    def temperatures(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest temperature, degC, for which the calibration was measured, by sensor; where it is known.

        The range of the measurement, and of effects that are functions of a temperature their own.
        """
        stated = self.provenance.temperatures_degC
        known = {} if stated is msgspec.UNSET else dict(stated)
        for effect in self.effects:
            for variable, (low, high) in effect.intervals.items():
                if variable.startswith(TEMPERATURE):
                    sensor = variable.removeprefix(TEMPERATURE)
                    least, most = known.get(sensor, (-math.inf, math.inf))
                    known[sensor] = max(least, low + REFERENCE_DEGC), min(most, high + REFERENCE_DEGC)
        return known

    def part(self, keep: Callable[[Effect], bool]) -> ErrorModel:
        """The effects that `keep` is true of, with their part of the covariance; the model itself if that is all."""
        kept = [keep(effect) for effect in self.effects]
        if all(kept):
            return self
        effects = tuple(effect for effect, stays in zip(self.effects, kept, strict=True) if stays)
        covariance = None
        if effects and self.covariance is not None:
            rows = np.repeat(kept, [part.stop - part.start for part in self.slices])
            covariance = Rows.of(np.array(self.covariance)[np.ix_(rows, rows)])
        return msgspec.structs.replace(self, effects=effects, covariance=covariance)

    def errors(self, machine: Machine, state: State) -> Array:
        """Error motions `(n, axes + 1, 6)` of the machine, mm and rad: of the axes in their error frames, of the tool.

        In memory the rows of one error motion lie next to each other.
        """
        own = [effect for effect in self.effects if effect.ACTS_ON != "instrument"]
        return total_errors(own, machine, state)[:, :INSTRUMENT]

    def observation(self, machine: Machine, state: State) -> Observation:
        """Changes of observations by all effects, those of the instrument too."""
        columns_of_errors = total_errors(self.effects, machine, state)
        return Observation(columns_of_errors[:, :INSTRUMENT], columns_of_errors[:, INSTRUMENT, :3])

    def design(self, machine: Machine, state: State, transform: Array) -> Array:
        """Derivatives `(n, rows, parameters)` of `transform` times the error motions of the machine.

        transform `(n, rows, (axes + 1) * 6)`, as `error_transform_with_tool`. Columns of the instrument's parameters
        are zero.
        """
        return Design(self.effects, machine, state, with_instrument=False).of(slice(None), transform)

    def observation_design(self, machine: Machine, state: State, transform: Array) -> Array:
        """Derivatives `(n, rows, parameters)` of `transform` times all that is in `observation`.

        transform `(n, rows, (axes + 1) * 6 + 3)`: behind the columns of the error motions those of the shift of the
        observed point.
        """
        return Design(self.effects, machine, state, with_instrument=True).of(slice(None), transform)

    def standard_uncertainty(self, machine: Machine, state: State, transform: Array) -> Array:
        """Standard uncertainties (GUM, k = 1) `(n, rows)` of the error motions transformed by `transform`."""
        design = self.design(machine, state, transform)
        return self.propagated(design, self.unmeasured_variance(machine, state, transform))

    def propagated(self, design: Array, additional: Array | float = 0.0) -> Array:
        """Standard uncertainties `(n, rows)` by first order from derivatives `(n, rows, parameters)`.

        besides: variances `(n, rows)` that are added to those of the parameters.
        """
        if self.covariance is not None:
            variance = np.sum(design @ np.array(self.covariance) * design, axis=2)
        else:
            variance = design**2 @ np.square([u for effect in self.effects for u in effect.uncertainties])
        return np.asarray(np.sqrt(np.maximum(variance, 0.0) + additional))  # below zero by rounding only

    def unmeasured_variance(self, machine: Machine, state: State, transform: Array) -> Array:
        """Variances `(n, rows)` after `transform` of errors in an arc of a turn that was not measured.

        Each error motion has its typical size there, times `turn.spread_beyond`; they are independent.
        """
        variance = np.zeros(transform.shape[:2])
        for motion, _ in self.error_motions:
            i = machine.index(motion.axis)
            if machine.axes[i].turns_fully and gap_of(motion.basis.interval):
                size = motion.quantities()[0].typical * unit_of(motion.component)[1]
                spread = size * spread_beyond(motion.basis.interval, state.position(machine, motion.axis))
                arm = transform[:, :, 6 * i + COMPONENTS.index(motion.component)]
                variance += (arm * spread[:, None]) ** 2
        return variance

    def feature_lengths(self, machine: Machine) -> Array:
        """Shortest feature length of the errors of the machine on each axis `(axes,)`, mm and rad.

        The path of a part on a rotary axis is curved also without errors: its length is LONGEST_FEATURE at most.
        """
        lengths = np.where(machine.rotary, LONGEST_FEATURE, np.inf)
        for effect in self.effects:
            for axis, length in effect.feature_lengths.items():
                i = machine.index(axis)
                lengths[i] = min(lengths[i], length * machine.scale[i])
        return lengths

    def outside(self, machine: Machine, state: State) -> dict[tuple[str, str], float]:
        """Largest distance outside an effect's interval, by the effect's name and the unit; end values are held there.

        Units are mm, deg, s and K; for time and temperatures the name holds the variable behind the effect.
        """
        largest = {key: float(excess.max(initial=0.0)) for key, excess in self.excesses(machine, state).items()}
        return {key: excess for key, excess in largest.items() if excess > MODEL_ROUNDING}

    def excesses(self, machine: Machine, state: State) -> dict[tuple[str, str], Array]:
        """Distance of each row `(n,)` from the interval of each effect with rows outside; names and units as `outside`.

        0 inside. Of an axis that turns fully: how far along the turn from the arc that was measured.
        """
        found: dict[tuple[str, str], Array] = {}
        reached: dict[str, tuple[Array, float, float]] = {}
        for effect in self.effects:
            for variable, (low, high) in effect.intervals.items():
                if variable not in reached:
                    x = state.variable(machine, variable, effect.name)
                    reached[variable] = x, float(x.min(initial=np.inf)), float(x.max(initial=-np.inf))
                x, least, most = reached[variable]
                if low <= least and most <= high:
                    continue
                if variable in machine.names and machine.axes[machine.index(variable)].turns_fully:
                    excess = beyond((low, high), x)
                else:
                    excess = np.maximum(np.maximum(low - x, x - high), 0.0)
                name = effect.name if variable in machine.names else f"{effect.name} in {variable}"
                where = name, variable_unit(machine, variable)
                found[where] = np.maximum(excess, found.get(where, 0.0))
        return found


def no_errors(machine: Machine) -> ErrorModel:
    """The machine without errors, made today."""
    return ErrorModel(machine=reference(machine), provenance=Provenance.of_today(), effects=())


def read_model(path: Path, machine: Machine) -> ErrorModel:
    """The calibration in a file, for use on `machine`; UserError when it is none, or another machine's."""
    data = read_input(path, "calibration")
    model = decode_model(data, str(path))
    refuse_other_machine(model, machine, str(path))
    return model


def refuse_other_machine(model: ErrorModel, machine: Machine, name: str) -> None:
    """UserError unless the calibration of this name is of the machine."""
    if model.machine.chain_hash != machine.chain_hash:
        raise UserError(
            f"calibration {name} is of machine {model.machine.name} ({model.machine.chain}), "
            f"not of {machine.name} ({machine.chain}) with this geometry: give the machine of the calibration, or a "
            f"calibration of {machine.name}"
        )


def decode_model(data: bytes, source: str) -> ErrorModel:
    """The calibration in JSON, or in a certificate; `source` names it in the UserError for anything that is wrong."""
    data = document_of(data, source)
    try:
        data = utf8_content(data, source)
        content = msgspec.json.decode(data, type=dict[str, Any])
        if key := given_twice(content, data):
            raise UserError(f"calibration {source}: {key!r} is given twice in one place: delete one of them")
        version = content.get("ncomp_calibration")
        if version is None:
            none = "no ncomp calibration (it has no 'ncomp_calibration')"
            raise UserError(f"calibration {source}: {none}: give a file of ncomp fit")
        if version != 1 or type(version) is not int:
            raise UserError(
                f"calibration {source}: version {version} is not one this ncomp reads (1): use a newer ncomp"
            )
        units = _take_units(content)
        model = _converted(content)
    except msgspec.DecodeError as fault:
        if kind := "" if data.lstrip().startswith(b"{") else kind_of_file(data):
            raise UserError(f"calibration {source}: this is {kind}, no calibration: give a file of ncomp fit") from None
        reason = f"{reason_of_fault(str(fault))}{hint(str(fault), data)}"
        unknown = str(fault).startswith("Invalid value") and ".kind" in str(fault)
        raise UserError(f"calibration {source}: {reason}; {PLUGIN if unknown else ''}{CURE}") from None
    except UnicodeDecodeError:
        raise UserError(f"calibration {source}: not UTF-8 text: save it as UTF-8") from None
    _check(model, units, source)
    model.provenance.warn_of_other_plugins(model.effects, source)
    return model


def _converted(content: dict[str, Any]) -> ErrorModel:
    """The calibration of a content; msgspec.ValidationError for a wrong one."""
    effects = content.get("effects")
    named = {effect.get("kind") for effect in effects if isinstance(effect, dict)} if isinstance(effects, list) else {}
    kinds = tuple(kind for kind in get_args(Effect) if kind.__struct_config__.tag in named)
    if not kinds or len(kinds) < len(named):
        return msgspec.convert(content, ErrorModel)
    form = msgspec.convert(content, _form(kinds))
    return ErrorModel(**{field: getattr(form, field) for field in ErrorModel.__struct_fields__})


@cache
def _form(kinds: tuple[Any, ...]) -> type[msgspec.Struct]:
    """The fields of a calibration with effects of some kinds: msgspec takes long to learn the fields of all kinds."""
    fields = []
    for field in msgspec.structs.fields(ErrorModel):
        kind = tuple[Union[kinds], ...] if field.name == "effects" else field.type  # type: ignore[valid-type]  # noqa: UP007
        fields.append((field.name, kind) if field.required else (field.name, kind, field.default))
    return msgspec.defstruct("ErrorModel", fields, kw_only=True, forbid_unknown_fields=True)


def write_model(model: ErrorModel, path: Path) -> None:
    """Write the calibration as readable JSON."""
    write_whole(path, encode_model(model))


def encode_model(model: ErrorModel) -> bytes:
    """The calibration as readable JSON: of each effect kind and axis, parameters with units, u, note."""
    content = msgspec.to_builtins(model)
    content["effects"] = [_written(effect) for effect in model.effects]
    return (to_json(content) + "\n").encode()


def _written(effect: Effect) -> dict[str, Any]:
    """An effect as in files: without absent fields, with the units of its parameters."""
    fields = {name: value for name, value in msgspec.to_builtins(effect).items() if value is not None}
    u, note = fields.pop("u"), fields.pop("note")
    units = _units(effect)
    values = {name: fields.pop(name) for name in units}
    return {**fields, **values, "units": units, "u": u, "note": note}


def _units(effect: Effect) -> dict[str, str]:
    return {quantity.name: quantity.unit for quantity in effect.quantities()}


def _take_units(content: dict[str, Any]) -> list[Any]:
    """Remove the units of the parameters from a file's effects, and return them."""
    effects = content.get("effects")
    if not isinstance(effects, list):
        return []
    return [effect.pop("units", None) if isinstance(effect, dict) else None for effect in effects]


def _check(model: ErrorModel, units: list[Any], source: str) -> None:
    axes = set(model.machine.chain.split()) - {"w", "b", "t"}
    for effect, given in zip(model.effects, units, strict=True):
        if not axes.issuperset(effect.axes):
            of = f"{effect.name} is of an axis that {model.machine.chain} lacks"
            raise UserError(f"calibration {source}: {of}: {CURE}")
        if min(effect.uncertainties, default=0.0) < 0:
            raise UserError(f"calibration {source}: {effect.name} has a negative standard uncertainty u: {CURE}")
        if given is not None and given != _units(effect):
            raise UserError(f"calibration {source}: {effect.name} has units {given}, expected {_units(effect)}")
    ranges = model.provenance.temperatures_degC
    for sensor, (low, high) in {} if ranges is msgspec.UNSET else ranges.items():
        if low > high:
            raise UserError(f"calibration {source}: temperatures_degC: {sensor} from {low:g} to {high:g} degC")
    if model.covariance is None:
        return
    n = len(model.parameters)
    if [len(row) for row in model.covariance] != [n] * n:
        raise UserError(f"calibration {source}: covariance is not {n} x {n}, one row per parameter")
    covariance = np.array(model.covariance).reshape(n, n)
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scaled = covariance / np.outer(*[np.where(u > 0, u, 1.0)] * 2)  # parameters differ in unit and size
    lowest = np.linalg.eigvalsh(scaled).min(initial=0.0)
    if np.abs(scaled - scaled.T).max(initial=0.0) > 1e-9 or lowest < -1e-9:
        raise UserError(f"calibration {source}: covariance is not symmetric and positive")
