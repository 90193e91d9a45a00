"""The packages of the repository by the names that they have in the wheel: `ncomp.kinematics` is `kinematics`.

In the repository they lie in the folder of `ncomp.py`; in the wheel, below the package `ncomp`. A script that imports
`ncomp.kinematics.state` runs with both.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType


class BelowOneName:
    """A finder and loader of modules below a module that is no package: they are the modules in the same folder."""

    def __init__(self, name: str) -> None:
        self._prefix = f"{name}."
        self._specs: dict[str, ModuleSpec | None] = {}

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,  # noqa: ARG002
        target: ModuleType | None = None,  # noqa: ARG002
    ) -> ModuleSpec | None:
        """The module of this name, if it is below the own one; ModuleNotFoundError for another one that it imports."""
        if not fullname.startswith(self._prefix):
            return None
        own = fullname.removeprefix(self._prefix)
        try:
            import_module(own)
        except ModuleNotFoundError as missing:
            if f"{own}.".startswith(f"{missing.name}."):
                return None
            raise
        return ModuleSpec(fullname, self)  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """The module of the repository: there is one of each, under both names."""
        module = sys.modules[spec.name.removeprefix(self._prefix)]
        self._specs[spec.name] = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Give the module its own name back; it has run already."""
        assert module.__spec__ is not None
        module.__spec__ = self._specs.pop(module.__spec__.name)
