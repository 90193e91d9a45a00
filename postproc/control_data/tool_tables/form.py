"""A form of tables of tools, work offsets and datums."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from postproc.control.tool_table import ToolTable


class Form(NamedTuple):
    """How a control writes such tables; each module has its own as `FORM`."""

    is_it: Callable[[Path, str], bool]
    """True for a file of this form, by its path and text."""
    read: Callable[[Path, str], ToolTable]
    """The table of such a file; UserError with the line that is not understood."""
    has_unit: Callable[[str], bool] = lambda _: False
    """True for a text whose lengths have a known unit; those of others are in the unit of the control."""
