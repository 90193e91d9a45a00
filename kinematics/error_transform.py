"""The first-order error transform of any machine: deviation = J(q, tool) . errors.

Evaluates the NumPy source that `kinematics.derive` makes of a chain: shipped beside this module in `derived` for the
shipped machines, and kept in the user's cache folder, by chain hash, for all others. sympy is imported only when such
a chain is met for the first time.
"""

from __future__ import annotations

import importlib
from contextlib import suppress
from functools import cache
from importlib import resources
from pathlib import Path
from types import ModuleType
from typing import Protocol, cast

import numpy as np
import platformdirs
from numpy.typing import ArrayLike

from kinematics.derived import MODULES
from kinematics.deviation import Deviation, in_blocks
from kinematics.effects import COMPONENTS
from kinematics.files import fingerprint, write_whole
from kinematics.forward import forward
from kinematics.machine import Machine
from kinematics.transforms import Array, by_turn, turn
from kinematics.user_error import UserError


class Derived(Protocol):
    """A derived module. Shapes: q `(n, axes)` or `(axes,)`, mm and rad; tool `(n, 3)` or `(3,)`, mm."""

    CHAIN_HASH: str

    def tool_point(self, q: ArrayLike, tool: ArrayLike) -> Array:
        """Nominal tool points `(n, 3)`, mm, workpiece frame."""

    def tool_axis(self, q: ArrayLike) -> Array:
        """Nominal tool axes `(n, 3)`, unit vectors from the tip to the spindle, workpiece frame."""

    def slopes(self, q: ArrayLike, tool: ArrayLike) -> Array:
        """Derivatives `(n, 6, axes)` of the nominal pose by the axis positions."""

    def error_transform(self, q: ArrayLike, tool: ArrayLike) -> Array:
        """J `(n, 6, axes * 6)`."""

    def deviation(self, q: ArrayLike, tool: ArrayLike, errors: ArrayLike) -> tuple[Array, Array]:
        """J . errors, positions and rotation vectors `(n, 3)`, without building J."""


def error_names(machine: Machine) -> list[str]:
    """Names, by ISO 230-1, of the columns of J: E_XC, E_YC, ... axis by axis in chain order."""
    return [f"E_{component}{axis}" for axis in machine.names for component in COMPONENTS]


def pose_slopes(machine: Machine, q: ArrayLike, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Derivatives `(n, 6, axes)` of the nominal pose by the axis positions, per mm and rad, workpiece frame.

    Rows: tool point x y z (mm), then rotation vector (rad); q and tool as `error_transform` takes them.
    """
    return derived(machine).slopes(q, tool)


def error_transform(machine: Machine, q: ArrayLike, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """J `(n, 6, axes * 6)`: rows position x y z (mm), then rotation vector (rad), in the workpiece frame.

    q: axis positions `(n, axes)` or `(axes,)` in chain order, mm and rad. tool: `(3,)` or `(n, 3)`, mm, from the tool
    reference point. Columns as in `error_names`: E_X E_Y E_Z per mm, E_A E_B E_C per rad. In memory the rows of one
    entry lie next to each other: `J[:, i, j]` is contiguous.
    """
    return derived(machine).error_transform(q, tool)


def place_transform(machine: Machine, q: ArrayLike, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """J `(n, 6, (axes + 1) * 6)`: as `error_transform`, and behind it the columns of a displacement of the tool."""
    rotation = forward(machine, q).rotation
    tips = np.broadcast_to(np.atleast_2d(np.asarray(tool, float)), (len(rotation), 3))
    own = np.zeros((len(rotation), 6, 6))
    own[:, :3, :3] = own[:, 3:, 3:] = rotation
    own[:, :3, 3:] = rotation @ by_turn(tips)
    return np.concatenate([error_transform(machine, q, tool), own], axis=2)


def place_names(machine: Machine) -> list[str]:
    """Names of the columns of `place_transform`."""
    return [*error_names(machine), *(f"tool {component}" for component in COMPONENTS)]


def first_order_deviation(
    machine: Machine, q: ArrayLike, errors: ArrayLike, tool: ArrayLike = (0.0, 0.0, 0.0)
) -> Deviation:
    """J . errors of error motions `(n, axes, 6)`, `(axes, 6)` or, with the tool behind them, `(n, axes + 1, 6)`.

    mm and rad; otherwise as `error_transform`. J is not built. Differs from `exact_deviation` by products of two
    errors.
    """
    module, axes = derived(machine), len(machine.axes)

    def first_order(q: Array, errors: Array, tool: Array) -> Deviation:
        """Of the axes by the derived module, and of the tool behind them."""
        deviation = Deviation(*module.deviation(q, tool, errors[:, :axes]))
        if not errors[:, axes:].any():
            return deviation
        rotation = forward(machine, q).rotation
        shift, turned = errors[:, axes, :3], errors[:, axes, 3:]
        displaced = turn(rotation, shift + np.cross(turned, tool))
        return Deviation(deviation.position + displaced, deviation.orientation + turn(rotation, turned))

    return in_blocks(first_order, q, errors, tool)


def derived(machine: Machine) -> Derived:
    """The derived module of the machine's chain: shipped, from the user's cache, or derived now and put there."""
    if machine.chain_hash in MODULES:
        return _shipped(MODULES[machine.chain_hash])
    if machine.chain_hash not in _loaded:
        _loaded[machine.chain_hash] = _from_cache(machine) or _newly_derived(machine)
    return _loaded[machine.chain_hash]


_loaded: dict[str, Derived] = {}
"""Modules of other than shipped chains met in this process, by chain hash."""


@cache
def _shipped(name: str) -> Derived:
    return cast(Derived, importlib.import_module(f"kinematics.derived.{name}"))


def _from_cache(machine: Machine) -> Derived | None:
    """The module in the cache; None when there is none, or it is damaged, another chain's or an older deriver's."""
    try:
        first, source = _cache_file(machine).read_text(encoding="utf-8").split("\n", 1)
    except (OSError, ValueError):
        return None
    if first != _seal(source):
        return None
    module = _load(source, machine)
    return module if machine.chain_hash == module.CHAIN_HASH else None


def _newly_derived(machine: Machine) -> Derived:
    """The module derived now, and put into the cache if that can be written."""
    from kinematics import derive  # it takes sympy

    source = derive.source(machine)
    path = _cache_file(machine)
    # a cache that can't be written costs the time of a derivation only
    with suppress(OSError, UserError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, f"{_seal(source)}\n{source}".encode())
    return _load(source, machine)


def _load(source: str, machine: Machine) -> Derived:
    """The module with this source."""
    module = ModuleType(f"kinematics.derived.{machine.chain_hash}")
    exec(compile(source, str(_cache_file(machine)), "exec"), module.__dict__)
    return cast(Derived, module)


def _cache_file(machine: Machine) -> Path:
    return Path(platformdirs.user_cache_dir("ncomp")) / "derived" / f"{machine.chain_hash}.py"


def _seal(source: str) -> str:
    """First line of a cached module: vouches for its text and for the deriver that wrote it."""
    return f"# deriver {_deriver()} source {fingerprint(source.encode())}"


@cache
def _deriver() -> str:
    """Fingerprint of the deriver's own code: any change of it makes the cached modules stale."""
    return fingerprint(resources.files("kinematics").joinpath("derive.py").read_bytes())
