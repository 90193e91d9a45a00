"""LinuxCNC: lines `setp PIN VALUE` of a HAL file, of matrixkins and calibxyzkins."""

from __future__ import annotations

import itertools
import re

import numpy as np

from kinematics.effects import Effect
from postproc.control_data.readers.control_source import Source, numbers, refusal, refuse_cut

_LINE = re.compile(r"\s*setp\s+(\S+)\s+(\S+)\s*(?:#.*)?$")
_PARTS = 96
"""Straight parts, over thrice the travel, that stand for a parabola."""


def read_matrix(source: Source) -> list[Effect]:
    """The errors that joint = C axis corrects."""
    found = _settings(source, r"matrixkins\.C_([xyz])([xyz])", ())
    effects: list[Effect] = []
    for output, of in itertools.product("xyz", repeat=2):
        slope = found.get((output, of), 1.0 * (output == of)) - (output == of)
        if slope:
            effects.append(source.line(output.upper(), of.upper(), slope))
    return effects


def read_calibrated(source: Source) -> list[Effect]:
    """The errors that axis = A joint + B joint^2 + c corrects."""
    passed = ("calibxyzkins.tol", "calibxyzkins.max-iter")
    found = _settings(source, r"calibxyzkins\.calib-([abc])\.([xyz])([xyz]?)", passed)
    effects: list[Effect] = []
    for output, of in itertools.product("xyz", repeat=2):
        same = output == of
        a = found.get(("a", output, of), 1.0 * same) - same
        b = found.get(("b", output, of), 0.0)
        c = found.get(("c", output, ""), 0.0) if same else 0.0
        if a or b or c:
            unit, travel = source.unit(of.upper()), source.machine.axes[source.machine.index(of.upper())].travel
            low, high = travel[0] / unit, travel[1] / unit
            nodes = np.linspace(2 * low - high, 2 * high - low, _PARTS + 1)
            corrections = -source.sign("error") * (a * nodes + b * nodes**2 + c)
            effects.append(source.table(output.upper(), (of.upper(),), (nodes.tolist(),), corrections.tolist()))
    return effects


def _settings(source: Source, pattern: str, passed: tuple[str, ...]) -> dict[tuple[str, ...], float]:
    """Values by the letters of their pins; other lines of a HAL file are passed, other pins of the module refused."""
    module = pattern.partition("\\")[0]
    found: dict[tuple[str, ...], float] = {}
    for name, text in source.files.items():
        refuse_cut(name, text, rf"{module}\.")
        for line, row in enumerate(text.splitlines(), 1):
            if f"{module}." not in row.partition("#")[0]:
                continue
            setting = _LINE.match(row)
            if setting is None:
                raise refusal(name, line, row, "expected setp PIN VALUE with a number")
            source.used.add(name)
            known = re.fullmatch(pattern, setting[1])
            if known is None and setting[1] in passed:
                continue
            if known is None:
                raise refusal(name, line, row, f"a pin of {module} that ncomp does not know")
            if known.groups() in found:
                raise refusal(name, line, row, "this pin is set twice")
            found[known.groups()] = numbers([setting[2]], name, line, row)[0]
    return found
