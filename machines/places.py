"""Folders of a user's own machines: `$NCOMP_MACHINES`, and `machines` in the user's configuration of ncomp."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

VARIABLE = "NCOMP_MACHINES"
"""Environment variable with folders, separated as in PATH."""


def folders() -> list[Path]:
    """The folders, also those that do not exist; the first one is that of new machines."""
    import platformdirs

    named = [Path(name) for name in os.environ.get(VARIABLE, "").split(os.pathsep) if name]
    return [*named, Path(platformdirs.user_config_dir("ncomp")) / "machines"]


def own() -> Iterator[Path]:
    """The machine files of the user, the first of each name, in the order of the folders and names."""
    seen = set()
    for folder in folders():
        for path in sorted(folder.glob("*.toml")) if folder.is_dir() else ():
            if path.stem not in seen:
                seen.add(path.stem)
                yield path
