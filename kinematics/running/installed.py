"""The installed versions of ncomp, Python and the libraries."""

from __future__ import annotations

import re
from collections.abc import Iterator

from kinematics.version import VERSION

LIBRARIES = ("numpy", "scipy", "sympy", "lark", "typer", "rich", "msgspec", "platformdirs", "jinja2", "threadpoolctl")
"""Libraries of ncomp where it runs without being installed."""


def requirements() -> Iterator[tuple[str, str, str | None]]:
    """Name, least version and installed version of each library that ncomp needs; None for one that is missing."""
    from importlib.metadata import PackageNotFoundError, requires, version

    try:
        needed = requires("ncomp") or []
    except PackageNotFoundError:
        needed = list(LIBRARIES)
    for line in needed:
        match = re.match(r"([\w.-]+)\s*(?:>=\s*([\d.]+))?", line)
        if match is None or "extra ==" in line:
            continue
        try:
            yield match[1], match[2] or "0", version(match[1])
        except PackageNotFoundError:
            yield match[1], match[2] or "0", None


def versions() -> dict[str, str | None]:
    """Versions by name."""
    import platform

    own = {"ncomp": VERSION, "python": platform.python_version(), "platform": platform.platform()}
    return own | {name: present for name, _, present in sorted(requirements())}
