"""ErrorModel: a machine, its effects, fitted parameters and their covariance; what a calibration file holds."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from kinematics.effects import INSTRUMENT, TOOL, Effect
from kinematics.errors import UserError
from kinematics.files import fingerprint, read_input, write_whole
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

ROUNDING = 1e-9
"""Positions, mm or degrees, come back from rad with an error far below this."""


class MachineReference(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The machine that a calibration belongs to; `chain_hash` holds its geometry to account."""

    name: str
    chain: str
    chain_hash: str


class Provenance(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where a calibration comes from: tool and version, time, sources and the fingerprints of its inputs."""

    made_by: str
    made_at: Annotated[datetime.datetime, msgspec.Meta(tz=True)]
    source: str = ""
    inputs: dict[str, str] = {}


class ErrorModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Contract 4.4, version 1."""

    machine: MachineReference
    effects: tuple[Effect, ...]
    provenance: Provenance
    demonstration: bool = False
    """True for a calibration that describes no real machine; announced on every run."""
    covariance: tuple[tuple[float, ...], ...] | None = None
    """Of all parameters in the order of the effects, um and urad; None when they are independent with their u."""
    ncomp_calibration: Literal[1] = 1

    @property
    def id(self) -> str:
        """Fingerprint of the content."""
        return fingerprint(msgspec.json.encode(self))

    @property
    def parameters(self) -> Array:
        """All parameters, um and urad, in the order of the effects."""
        return np.array([p for effect in self.effects for p in effect.parameters])

    def age_days(self, now: datetime.datetime) -> float:
        """Days since the calibration was made."""
        return (now - self.provenance.made_at).total_seconds() / 86400.0

    def errors(self, machine: Machine, state: State) -> Array:
        """Error motions `(n, axes + 1, 6)` at the state, mm and rad: of each axis in its error frame, then of the tool.

        Effects of the instrument have no part in it.
        """
        errors = np.zeros((len(state), len(machine.axes) + 1, 6))
        for effect in self.effects:
            for place, component, values in effect.contributions(machine, state):
                if place != INSTRUMENT:
                    errors[:, place, component] += values
        return errors

    def design(self, machine: Machine, state: State, transform: Array) -> Array:
        """Derivatives `(n, rows, parameters)` of `transform` `(n, rows, (axes + 1) * 6)` times the error motions."""
        blocks = [np.zeros((*transform.shape[:2], 0))]
        last = len(machine.axes)
        for effect in self.effects:
            block = np.zeros((*transform.shape[:2], len(effect.parameters)))
            for place, component, values in effect.columns(machine, state):
                if place != INSTRUMENT:
                    column = 6 * (last if place == TOOL else place) + component
                    block += transform[:, :, column, None] * values[:, None, :]
            blocks.append(block)
        return np.concatenate(blocks, axis=2)

    def standard_uncertainty(self, machine: Machine, state: State, transform: Array) -> Array:
        """Standard uncertainties (GUM, k = 1) `(n, rows)` of what `transform` makes of the error motions."""
        design = self.design(machine, state, transform)
        if self.covariance is not None:
            variance = np.einsum("nrp,pq,nrq->nr", design, np.array(self.covariance), design)
            return np.asarray(np.sqrt(np.maximum(variance, 0.0)))  # below zero by rounding only
        u = np.array([v for effect in self.effects for v in effect.uncertainties])
        return np.asarray(np.sqrt(np.einsum("nrp,p->nr", design**2, u**2)))

    def outside(self, machine: Machine, state: State) -> dict[str, float]:
        """Error motions asked for outside their interval, with how far (mm or degrees); they hold their end value."""
        beyond: dict[str, float] = {}
        for effect in self.effects:
            if effect.interval is not None:
                x, (low, high) = state.position(machine, effect.axes[0]), effect.interval
                excess = float(np.max(np.maximum(low - x, x - high), initial=0.0))
                if excess > ROUNDING:
                    beyond[effect.name] = max(excess, beyond.get(effect.name, 0.0))
        return beyond


def no_errors(machine: Machine) -> ErrorModel:
    """The machine without errors."""
    made = Provenance("ncomp", datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC))
    return ErrorModel(reference(machine), (), made)


def reference(machine: Machine) -> MachineReference:
    """What a calibration of this machine says about it."""
    return MachineReference(machine.name, machine.chain, machine.chain_hash)


def read_model(path: Path, machine: Machine) -> ErrorModel:
    """The calibration in a file, for use on `machine`; UserError when it is none, or another machine's."""
    data = read_input(path, "calibration")
    model = decode_model(data, str(path))
    if model.machine.chain_hash != machine.chain_hash:
        raise UserError(
            f"calibration {path} is of machine {model.machine.name} ({model.machine.chain}), "
            f"not of {machine.name} ({machine.chain}) with this geometry"
        )
    return model


def decode_model(data: bytes, source: str) -> ErrorModel:
    """The calibration in JSON; `source` names it in the UserError for anything that is wrong with it."""
    try:
        version = msgspec.json.decode(data, type=dict[str, msgspec.Raw]).get("ncomp_calibration")
        if version is None:
            raise UserError(f"calibration {source}: no ncomp calibration (it has no 'ncomp_calibration')")
        if bytes(version) != b"1":
            raise UserError(f"calibration {source}: version {bytes(version).decode()} is not one this ncomp reads (1)")
        model = msgspec.json.decode(data, type=ErrorModel)
    except msgspec.DecodeError as fault:
        raise UserError(f"calibration {source}: {fault}") from None
    except UnicodeDecodeError:
        raise UserError(f"calibration {source}: not UTF-8 text") from None
    _check(model, source)
    return model


def write_model(model: ErrorModel, path: Path) -> None:
    """Write the calibration as readable JSON."""
    write_whole(path, encode_model(model))


def encode_model(model: ErrorModel) -> bytes:
    """The calibration as JSON, one member a line."""
    return msgspec.json.format(msgspec.json.encode(model), indent=2) + b"\n"


def _check(model: ErrorModel, source: str) -> None:
    axes = set(model.machine.chain.split()) - {"w", "b", "t"}
    for effect in model.effects:
        if not axes.issuperset(effect.axes):
            raise UserError(f"calibration {source}: {effect.name} is of an axis that {model.machine.chain} lacks")
        if min(effect.uncertainties, default=0.0) < 0:
            raise UserError(f"calibration {source}: {effect.name} has a negative standard uncertainty u")
    if model.covariance is None:
        return
    n = len(model.parameters)
    if [len(row) for row in model.covariance] != [n] * n:
        raise UserError(f"calibration {source}: covariance is not {n} x {n}, one row per parameter")
    covariance = np.array(model.covariance).reshape(n, n)
    largest = np.abs(covariance).max(initial=0.0)
    lowest = np.linalg.eigvalsh(covariance).min(initial=0.0)
    if np.abs(covariance - covariance.T).max(initial=0.0) > 1e-9 * largest or lowest < -1e-9 * largest:
        raise UserError(f"calibration {source}: covariance is not symmetric and positive")
