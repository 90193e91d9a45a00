"""The first-order error transform of any machine: deviation = J(q, tool) . errors.

Evaluates the NumPy source that `kinematics.derive` makes of a chain: shipped beside this module in `derived` for the
shipped machines, and kept in the user's cache folder, by chain hash, for all others. sympy is imported only when such
a chain is met for the first time.
"""

from __future__ import annotations

import importlib
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from kinematics.derived import MODULES
from kinematics.effects.base import COMPONENTS, own_motion
from kinematics.files import fingerprint, write_whole
from kinematics.forward import forward
from kinematics.machine import Machine
from kinematics.transforms import Array, by_turn
from kinematics.user_error import UserError


def error_names(machine: Machine) -> list[str]:
    """Names, by ISO 230-1, of the columns of J: E_XC, E_YC, ... axis by axis in chain order."""
    return [f"E_{component}{axis}" for axis in machine.names for component in COMPONENTS]


def error_transform(machine: Machine, q: ArrayLike, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """J `(n, 6, axes * 6)`: rows position x y z (mm), then rotation vector (rad), in the workpiece frame.

    q: axis positions `(n, axes)` or `(axes,)` in chain order, mm and rad. tool: `(3,)` or `(n, 3)`, mm, from the tool
    reference point. Columns as in `error_names`: E_X E_Y E_Z per mm, E_A E_B E_C per rad. In memory the rows of one
    entry lie next to each other: `J[:, i, j]` is contiguous.
    """
    J: Array = derived(machine).error_transform(q, tool)
    return J


def pose_slopes(machine: Machine, q: ArrayLike, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Derivatives `(n, 6, axes)` of the nominal pose by the axis positions, per mm and rad, workpiece frame.

    Rows and arguments as `error_transform`. A step along, or about, its own line is the positioning error of an axis.
    """
    own = [own_motion(machine, name) for name in machine.names]
    columns = [len(COMPONENTS) * i + component for i, component, _ in own]
    return np.asarray(error_transform(machine, q, tool)[:, :, columns] * [forward for *_, forward in own])


def error_transform_with_tool(machine: Machine, q: ArrayLike, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """J `(n, 6, (axes + 1) * 6)`: as `error_transform`, and behind it the columns of a displacement of the tool."""
    rotation = forward(machine, q).rotation
    tips = np.broadcast_to(np.atleast_2d(np.asarray(tool, float)), (len(rotation), 3))
    own = np.zeros((len(rotation), 6, 6))
    own[:, :3, :3] = own[:, 3:, 3:] = rotation
    own[:, :3, 3:] = rotation @ by_turn(tips)
    return np.concatenate([error_transform(machine, q, tool), own], axis=2)


def error_names_with_tool(machine: Machine) -> list[str]:
    """Names of the columns of `error_transform_with_tool`."""
    return [*error_names(machine), *(f"tool {component}" for component in COMPONENTS)]


def derived(machine: Machine) -> ModuleType:
    """The derived module of the machine's chain: shipped, from the user's cache, or derived here and put there."""
    if machine.chain_hash in MODULES:
        return importlib.import_module(f".derived.{MODULES[machine.chain_hash]}", __package__)
    if machine.chain_hash not in _loaded:
        _loaded[machine.chain_hash] = _from_cache(machine) or _newly_derived(machine)
    return _loaded[machine.chain_hash]


_loaded: dict[str, ModuleType] = {}
"""Modules of other than shipped chains met in this process, by chain hash."""


def _from_cache(machine: Machine) -> ModuleType | None:
    """The module in the cache; None when there is none, or it is damaged, another chain's or an older deriver's."""
    try:
        first, source = _cache_file(machine).read_text(encoding="utf-8").split("\n", 1)
    except (OSError, ValueError):
        return None
    if first != _seal(source):
        return None
    module = _load(source, machine)
    return module if machine.chain_hash == module.CHAIN_HASH else None


def _newly_derived(machine: Machine) -> ModuleType:
    """The module, derived here, and put into the cache if that can be written."""
    from kinematics import derive  # it takes sympy

    source = derive.source(machine)
    path = _cache_file(machine)
    # a cache that cannot be written costs the time of a derivation only
    with suppress(OSError, UserError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, f"{_seal(source)}\n{source}".encode())
    return _load(source, machine)


def _load(source: str, machine: Machine) -> ModuleType:
    """The module with this source."""
    module = ModuleType(f"kinematics.derived.{machine.chain_hash}")
    exec(compile(source, str(_cache_file(machine)), "exec"), module.__dict__)
    return module


def _cache_file(machine: Machine) -> Path:
    import platformdirs

    return Path(platformdirs.user_cache_dir("ncomp")) / "derived" / f"{machine.chain_hash}.py"


def _seal(source: str) -> str:
    """First line of a cached module: vouches for its text and for the deriver that wrote it."""
    return f"# deriver {_deriver()} source {fingerprint(source.encode())}"


@cache
def _deriver() -> str:
    """Fingerprint of the deriver's own code: any change of it makes the cached modules stale."""
    return fingerprint(Path(__file__).with_name("derive.py").read_bytes())
