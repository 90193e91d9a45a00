"""The faults of a module: one small change of its syntax tree each."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

SIGNS_AND_UNITS = ("sign", "unit")
"""Kinds that every test suite of a machine tool has to notice."""
UNITS = (10, 60, 90, 100, 180, 360, 1000, 60_000, 1_000_000, 0.1, 0.01, 0.001, 1e-6, 1e-9, 25.4)
"""Factors between units, among the numbers of the code."""
LETTERS = {"X": "Y", "Y": "Z", "Z": "X", "A": "B", "B": "C", "C": "A", "I": "J", "J": "K", "K": "I"}
COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.GtE, ast.GtE: ast.LtE, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
FUNCTIONS = {
    "sin": "cos", "cos": "sin", "min": "max", "max": "min", "floor": "ceil", "ceil": "floor", "minimum": "maximum",
    "maximum": "minimum", "deg2rad": "rad2deg", "rad2deg": "deg2rad", "radians": "degrees", "degrees": "radians",
    "any": "all", "all": "any", "argmin": "argmax", "argmax": "argmin", "negative": "positive",
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One fault in one module."""

    file: str
    """Path below the repository."""
    number: int
    """Place among the faults of the module."""
    kind: str
    """sign, unit, factor, order, index, letter, logic, function or number."""
    function: str
    """Qualified name of the function or class around it, empty in the module's own level."""
    in_module: bool
    """It lies outside of functions."""
    line: int
    before: str
    after: str

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What stays the same when lines are added above."""
        return self.file, self.function, self.before, self.after

    def text(self) -> str:
        """One line for people."""
        return f"{self.file}:{self.line} {self.function or 'module'} [{self.kind}] {self.before} -> {self.after}"


def mutants_of(root: Path, file: str) -> list[Mutant]:
    """All faults of a module, in the order of its text."""
    tree = ast.parse((root / file).read_text(encoding="utf-8"))
    found = []
    for number, (node, name, kind, change) in enumerate(_changes(tree)):
        other = deepcopy(node)
        change(other)
        found.append(
            Mutant(file, number, kind, name, _in_module(tree, name), node.lineno, ast.unparse(node), ast.unparse(other))
        )
    return found


def _in_module(tree: ast.Module, name: str) -> bool:
    """Whether a qualified name is empty, or that of a class."""
    body: list[ast.stmt] = tree.body
    for part in name.split(".") if name else []:
        found = [each for each in body if isinstance(each, ast.FunctionDef | ast.ClassDef) and each.name == part]
        if not found or isinstance(found[0], ast.FunctionDef):
            return False
        body = found[0].body
    return True


def tree_of(root: Path, mutant: Mutant) -> ast.Module:
    """The syntax tree of a module with the fault."""
    tree = ast.parse((root / mutant.file).read_text(encoding="utf-8"))
    for number, (node, _, _, change) in enumerate(_changes(tree)):
        if number == mutant.number:
            change(node)
            return tree
    raise ValueError(f"{mutant.file} has no fault {mutant.number}")


Change = Callable[[ast.AST], None]
Found = tuple[ast.expr | ast.AugAssign, str, str, Change]


def _changes(tree: ast.Module) -> Iterator[Found]:
    """Node, function, kind and change of each fault."""
    yield from _below(tree, "")


def _below(node: ast.AST, name: str) -> Iterator[Found]:
    """Faults below a node; messages, annotations and docstrings have none."""
    if isinstance(node, ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom):
        return
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        name = f"{name}.{node.name}" if name else node.name
    for kind, change in _of_node(node):
        assert isinstance(node, ast.expr | ast.AugAssign)
        yield node, name, kind, change
    skipped = ("annotation", "returns", "decorator_list", "type_params")
    for field, value in ast.iter_fields(node):
        if field not in skipped:
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and not _documents(child) and not _is_index(field, child):
                    yield from _below(child, name)


def _is_index(field: str, node: ast.AST) -> bool:
    """A constant index, which is changed with its brackets."""
    return field == "slice" and isinstance(node, ast.Constant) and isinstance(node.value, int)


def _documents(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _of_node(node: ast.AST) -> Iterator[tuple[str, Change]]:
    match node:
        case ast.BinOp() | ast.AugAssign():
            yield from _of_operation(node)
        case ast.UnaryOp(op=ast.USub()):
            yield "sign", _set(op=ast.UAdd())
        case ast.UnaryOp(op=ast.Not()):
            yield "logic", _without_not
        case ast.Compare(ops=[op]) if type(op) in COMPARISONS:
            yield "order", _set(ops=[COMPARISONS[type(op)]()])
        case ast.BoolOp():
            yield "logic", _set(op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
        case ast.Subscript(slice=ast.Constant(value=int(place))) if not isinstance(place, bool):
            yield "index", _set(slice=ast.Constant((place + 1) % 3 if place < 3 else place - 1))
        case ast.Constant(value=str(text)) if text in LETTERS:
            yield "letter", _set(value=LETTERS[text])
        case ast.Constant(value=float() | int() as number) if not isinstance(number, bool):
            yield ("unit", _set(value=number * 10)) if number in UNITS else ("number", _set(value=number + 1))
        case ast.Call(func=ast.Name(id=called)) if called in FUNCTIONS:
            yield "function", _set(func=ast.Name(FUNCTIONS[called], ast.Load()))
        case ast.Call(func=ast.Attribute(attr=called)) if called in FUNCTIONS:
            yield "function", _renamed(FUNCTIONS[called])


def _of_operation(node: ast.BinOp | ast.AugAssign) -> Iterator[tuple[str, Change]]:
    operands = (node.left, node.right) if isinstance(node, ast.BinOp) else (node.value,)
    if any(isinstance(each, ast.JoinedStr | ast.List | ast.Tuple | ast.Dict) or _is_text(each) for each in operands):
        return
    others = {ast.Add: ast.Sub(), ast.Sub: ast.Add(), ast.Mult: ast.Div(), ast.Div: ast.Mult()}
    other = others.get(type(node.op))
    if other is not None:
        factor = "unit" if any(map(_is_constant, operands)) else "factor"
        yield "sign" if isinstance(node.op, ast.Add | ast.Sub) else factor, _set(op=other)


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _is_constant(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) or (isinstance(node, ast.Name) and node.id.isupper() and len(node.id) > 1)


def _set(**fields: object) -> Change:
    def change(node: ast.AST) -> None:
        for name, value in fields.items():
            setattr(node, name, value)
        ast.fix_missing_locations(node)

    return change


def _renamed(name: str) -> Change:
    def change(node: ast.AST) -> None:
        assert isinstance(node, ast.Call)
        assert isinstance(node.func, ast.Attribute)
        node.func.attr = name

    return change


def _without_not(node: ast.AST) -> None:
    """`not x` becomes `not not x`."""
    assert isinstance(node, ast.UnaryOp)
    node.operand = ast.copy_location(ast.UnaryOp(ast.Not(), node.operand), node.operand)
