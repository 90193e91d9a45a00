"""The scripts that write pages of the documentation, as modules."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]
MAKE = ROOT / "docs" / "make"


def script(path: Path) -> ModuleType:
    """The module of a script."""
    if str(MAKE) not in sys.path:
        sys.path.append(str(MAKE))
    name = f"docs_make_{path.parent.name}_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
