"""Writes docs/session.ipynb: a session of Python from a plan to a corrected program, with its outputs.

python docs/make/session.py
"""

from __future__ import annotations

import ast
import contextlib
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[2] / "docs" / "session.ipynb"


def outputs(source: str, names: dict[str, Any]) -> list[dict[str, Any]]:
    """Run a cell with these names, as Jupyter does: what it prints, and the value of a last expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), names)
        value = None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)  # type: ignore[attr-defined]
    made: list[dict[str, Any]] = []
    if printed.getvalue():
        made.append({"output_type": "stream", "name": "stdout", "text": printed.getvalue().splitlines(keepends=True)})
    if value is not None:
        data = {"text/plain": repr(value).splitlines(keepends=True)}
        if html := getattr(value, "_repr_html_", lambda: None)():
            data["text/html"] = [html]
        made.append({"output_type": "execute_result", "metadata": {}, "execution_count": None, "data": data})
    return made


def run(notebook: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The cells of a notebook with the outputs of the present program."""
    names: dict[str, Any] = {}
    count = 0
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            yield cell
            continue
        count += 1
        made = outputs("".join(cell["source"]), names)
        for each in made:
            if "execution_count" in each:
                each["execution_count"] = count
        yield {**cell, "execution_count": count, "outputs": made}


def renewed(text: str) -> str:
    """The notebook with the outputs of the present program."""
    notebook = json.loads(text)
    return json.dumps({**notebook, "cells": list(run(notebook))}, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
