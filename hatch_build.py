"""Build hooks: the addresses of the project, and the packages of this repository as packages of `ncomp` in the wheel.

In the repository they lie side by side (`kinematics`, `machines`, ...) and import one another by these names. In a
wheel such names would lie beside the packages of other people, so each goes below `ncomp/`, `ncomp.py` becomes
`ncomp/__init__.py`, and `kinematics` in an import becomes `ncomp.kinematics`. An editable installation keeps the
repository as it is.

The addresses are those of the repository that the checkout was cloned from: nothing else knows where it is published.
"""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

NAME = "ncomp"
PACKAGES = ("calibration", "grammars", "history", "kinematics", "machines", "postproc", "rendering")
MAIN = f'''"""`python -m {NAME}`: the command line."""

from {NAME}.postproc.cli import run

if __name__ == "__main__":
    run()
'''
LEFT_OUT = ("__pycache__", ".*")
PUBLIC = re.compile(
    r"(?:(?P<scheme>https?|ssh|git)://(?:[^@/]*@)?|[\w.-]+@)(?P<host>[\w-]+(?:\.[\w-]+)+)(?P<port>:\d+(?=/))?[:/]+"
    r"(?P<path>[^:]+?)(?:\.git)?/*"
)
"""A remote of git whose host has a dot. No user or password becomes public."""
PROJECT_URL = re.compile(r"^Project-URL: ([^,]+), (\S+)$", re.MULTILINE)
"""An address in the metadata of a source distribution."""


class Addresses(MetadataHookInterface):
    """Puts the addresses of the project into the metadata, as far as the checkout or source distribution has them."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add `urls` to the project table."""
        root = Path(self.root)
        known = root / "PKG-INFO"
        metadata["urls"] = (
            addresses(_remote(root)) if not known.exists() else dict(PROJECT_URL.findall(known.read_text()))
        )


def addresses(remote: str) -> dict[str, str]:
    """Addresses of the repository with this remote of git, by label; none for a folder or a host without a domain."""
    found = PUBLIC.fullmatch(remote.strip())
    if found is None:
        return {}
    port = found["port"] or "" if (found["scheme"] or "").startswith("http") else ""
    home = f"https://{found['host']}{port}/{found['path']}"
    return {"Homepage": home, "Source": home, "Issues": f"{home}/issues"}


def _remote(root: Path) -> str:
    """The address that the checkout was cloned from; empty without git or outside of a checkout."""
    if not (root / ".git").exists():
        return ""
    asked = ("git", "-C", str(root), "remote", "get-url", "origin")
    try:
        return subprocess.run(asked, capture_output=True, text=True, check=False).stdout
    except OSError:
        return ""


class BelowOneName(BuildHookInterface):  # type: ignore[type-arg]
    """Puts the packages below `ncomp` into a standard wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make the files of the wheel and its entry point."""
        if self.target_name != "wheel" or version == "editable":
            return
        self.folder = Path(tempfile.mkdtemp(prefix=f"{NAME}-wheel-"))
        write_package(Path(self.root), self.folder)
        self.build_config.set_exclude_all()
        build_data["force_include"][str(self.folder)] = NAME
        scripts = self.metadata.core.scripts
        scripts.update({name: f"{NAME}.{function}" for name, function in scripts.items()})

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove the files that the wheel was made of."""
        if folder := getattr(self, "folder", None):
            shutil.rmtree(folder)


def write_package(root: Path, folder: Path) -> None:
    """Write the package `ncomp` into an empty folder, from the packages in the repository `root`."""
    for package in PACKAGES:
        shutil.copytree(root / package, folder / package, ignore=shutil.ignore_patterns(*LEFT_OUT))
    shutil.copyfile(root / f"{NAME}.py", folder / "__init__.py")
    for path in folder.rglob("*.py"):
        path.write_bytes(renamed(path.read_bytes()))
    (folder / "__main__.py").write_text(MAIN)
    (folder / "py.typed").touch()


def renamed(source: bytes) -> bytes:
    """The UTF-8 source of a module with its imports of the packages below `ncomp`; lines keep their numbers."""
    nodes = [node for node in ast.walk(ast.parse(source)) if isinstance(node, (ast.Import, ast.ImportFrom))]
    lines = source.splitlines(keepends=True)
    for node in sorted(nodes, key=lambda node: (node.lineno, node.col_offset), reverse=True):
        text = lines[node.lineno - 1]
        before, after = text[: node.col_offset], text[node.col_offset :]
        if isinstance(node, ast.ImportFrom):
            if node.level == 0 and node.module and _ours(node.module):
                lines[node.lineno - 1] = before + re.sub(rb"from\s+", rb"\g<0>ncomp.", after, count=1)
        elif any(_ours(alias.name) for alias in node.names):
            if node.end_lineno != node.lineno or node.end_col_offset is None:
                raise ValueError(f"line {node.lineno}: an import of several lines is not understood")
            rest = text[node.end_col_offset :]
            lines[node.lineno - 1] = before + "; ".join(map(_import, node.names)).encode() + rest
    return b"".join(lines)


def _ours(module: str) -> bool:
    return module.partition(".")[0] in PACKAGES


def _import(alias: ast.alias) -> str:
    """The statements that bind the name of `import alias` to the module below `ncomp`."""
    as_name = f" as {alias.asname}" if alias.asname else ""
    if not _ours(alias.name):
        return f"import {alias.name}{as_name}"
    if as_name:
        return f"import {NAME}.{alias.name}{as_name}"
    package, dot, _ = alias.name.partition(".")
    return f"from {NAME} import {package}" + (f"; import {NAME}.{alias.name}" if dot else "")
