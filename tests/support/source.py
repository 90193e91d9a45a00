"""The source of the product, as syntax trees."""

import ast
from collections.abc import Iterator

PARTS = ("body", "orelse", "handlers", "finalbody", "cases")
"""Fields of a statement with statements in them. Expressions, most of a tree, have none."""


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """The statements directly in a module or a statement, the branches of `try` and `match` among them."""
    for part in PARTS:
        yield from getattr(node, part, ())
