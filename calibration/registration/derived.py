"""Columns that a function derives from a measurement alone: calculated once, and kept with the measurement."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import is_dataclass
from functools import wraps
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from kinematics.transforms import read_only

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement

T = TypeVar("T")


def derived(derive: Callable[[Measurement], T]) -> Callable[[Measurement], T]:
    """A function of a measurement alone, calculated once for each measurement, which keeps the result.

    It is for what belongs to another module. All callers share the result, whose arrays are read-only.
    """

    @wraps(derive)
    def kept(measurement: Measurement) -> T:
        results = measurement._derived
        if kept not in results:
            results[kept] = unchangeable(derive(measurement))
        result: T = results[kept]
        return result

    return kept


def unchangeable(result: T) -> T:
    """The same result; its arrays are read-only."""
    if isinstance(result, np.ndarray):
        read_only(result)
    elif isinstance(result, Mapping | tuple):
        for each in result.values() if isinstance(result, Mapping) else result:
            unchangeable(each)
    elif is_dataclass(result):
        unchangeable(vars(result))
    return result
