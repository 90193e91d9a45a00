"""Answers to scenarios, each computed once for all tests and workers and stored by what it depends on."""

from __future__ import annotations

import fcntl
import hashlib
import json
import shlex
import tempfile
from contextlib import chdir
from functools import cache
from pathlib import Path
from typing import Any

from tests.scenarios import Scenario
from tests.support.command import run_command

ROOT = Path(__file__).parents[2]
PRODUCT = ("ncomp.py", "calibration", "grammars", "kinematics", "machines", "postproc", "rendering")
SUFFIXES = {".py", ".toml", ".lark", ".json", ".html", ".css", ".js"}


def answer(scenario: Scenario, cache_folder: Path) -> dict[str, Any]:
    """What `ncomp diagnose` writes as JSON; the shown text under `shown`.

    A file for each scenario holds its answer and the hash of the commands and of the product's source that gave it. It
    is written whole; a second worker waits for the first.
    """
    key = hashlib.sha256("\n".join([source_hash(), *scenario.commands]).encode()).hexdigest()
    cache_folder.mkdir(parents=True, exist_ok=True)
    file = cache_folder / f"{scenario.name.replace(' ', '_')}.json"
    with file.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        stored = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
        if stored.get("key") != key:
            stored = {"key": key, "answer": _computed(scenario)}
            new = file.with_suffix(".new")
            new.write_text(json.dumps(stored), encoding="utf-8")
            new.replace(file)
    found: dict[str, Any] = stored["answer"]
    return found


@cache
def source_hash() -> str:
    """Hash of the names and contents of the product's files."""
    digest = hashlib.sha256()
    for name in PRODUCT:
        top = ROOT / name
        for path in [top] if top.is_file() else sorted(top.rglob("*")):
            if path.suffix in SUFFIXES and path.is_file():
                digest.update(f"{path.relative_to(ROOT).as_posix()}\0".encode())
                digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _computed(scenario: Scenario) -> dict[str, Any]:
    """A diagnosis that is not accepted is an answer as well; any other refusal is none."""
    with tempfile.TemporaryDirectory() as name, chdir(name):
        for line in scenario.commands:
            done = run_command(*shlex.split(line))
            if done.status != 0 and not Path("diagnosis.json").is_file():
                raise RuntimeError(f"ncomp {line}: {done.shown}")
        found: dict[str, Any] = json.loads(Path("diagnosis.json").read_text(encoding="utf-8"))
        return {**found, "shown": done.shown}
