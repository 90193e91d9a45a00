"""One name, one thing: no name of a number stands for one thing in one module and for another in the next."""

from __future__ import annotations

import ast
import collections
from collections.abc import Iterator
from pathlib import Path

from support.source import statements

ROOT = Path(__file__).parents[1]
PACKAGES = ("calibration", "grammars", "history", "kinematics", "machines", "postproc", "rendering")
PARTS = (ast.Constant, ast.UnaryOp, ast.BinOp, ast.Tuple, ast.List, ast.Name, ast.Attribute, ast.Call)


def numbers(node: ast.expr) -> bool:
    """True for an expression of numbers only."""
    parts = [part for part in ast.walk(node) if isinstance(part, ast.expr)]
    literals = [part.value for part in parts if isinstance(part, ast.Constant)]
    return (
        all(isinstance(part, PARTS) for part in parts)
        and bool(literals)
        and all(isinstance(each, int | float) for each in literals)
    )


def constants(module: Path) -> Iterator[str]:
    """Names of the numbers that a module defines at its top."""
    for node in statements(ast.parse(module.read_text())):
        if isinstance(node, ast.Assign):
            targets, value = node.targets, node.value
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            targets, value = [node.target], node.value
        else:
            continue
        names = [name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]
        yield from (name for name in names if name.isupper() and not name.startswith("_") and numbers(value))


def test_a_name_of_a_number_stands_in_one_module() -> None:
    """A constant that two modules need is imported; two that differ have names that say how."""
    modules = collections.defaultdict(list)
    for package in PACKAGES:
        for module in sorted((ROOT / package).rglob("*.py")):
            for name in constants(module):
                modules[name].append(str(module.relative_to(ROOT)))
    assert len(modules) > 1000
    assert {name: found for name, found in modules.items() if len(found) > 1} == {}
