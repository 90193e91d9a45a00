"""CEAD's interpreter of Siemens programs (`nc-gcode-interpreter` on PyPI), in the environment that `.ci/run` makes for it.

It needs Python 3.12 or later, so it has a virtual environment of its own: `.nc_gcode` in the root.
"""

from __future__ import annotations

import json
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

PYTHON = Path(__file__).parents[2] / ".nc_gcode" / "bin" / "python"
SCRIPT = Path(__file__).with_name("nc_gcode_rows.py")


class RefusedError(Exception):
    """The interpreter does not take the program."""


def available() -> bool:
    """True if the environment is there."""
    return PYTHON.is_file()


def rows(program: str) -> list[dict[str, Any]]:
    """What each executed block sets, by the names of the interpreter's table: `X`, `F`, `gg01_motion`, `comment`, ..."""
    server = _server()
    assert server.stdin is not None
    assert server.stdout is not None
    server.stdin.write(json.dumps(program) + "\n")
    server.stdin.flush()
    answer = json.loads(server.stdout.readline())
    if isinstance(answer, str):
        raise RefusedError(answer)
    return list(answer)


@cache
def _server() -> subprocess.Popen[str]:
    return subprocess.Popen([PYTHON, SCRIPT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
