"""Which test module runs which functions, and how long it takes: a fault is only tried where it is run."""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections.abc import Collection, Iterable
from concurrent.futures import ThreadPoolExecutor
from types import FrameType
from typing import NamedTuple

import pytest

from tests.code_mutants.operators import Mutant
from tests.code_mutants.runner import ROOT, Run, run

CACHE = ROOT / ".cache" / "code_mutants"


class Reach(NamedTuple):
    """One test module, without a fault."""

    test: str
    seconds: float
    """Processor time."""
    functions: Collection[tuple[str, str]]
    """File and qualified name of each function that it runs, also while it is imported."""

    def has(self, mutant: Mutant) -> bool:
        """Whether the code of a fault is run: its function, or its module for code outside of functions."""
        outer = {mutant.function[: m.start()] for m in re.finditer(r"\.", mutant.function)} | {mutant.function}
        return any((mutant.file, name) in self.functions for name in outer) or (
            mutant.in_module and any(file == mutant.file for file, _ in self.functions)
        )


def reach_of(tests: Iterable[str], files: Collection[str], jobs: int) -> list[Reach]:
    """What each test module runs of some files; AssertionError where its tests fail. Known ones from the cache."""
    code = hashlib.sha256(b"".join((ROOT / file).read_bytes() for file in sorted(files))).hexdigest()
    with ThreadPoolExecutor(jobs) as pool:
        return list(pool.map(lambda test: _reach(test, set(files), code), tests))


def _reach(test: str, files: set[str], code: str) -> Reach:
    name = hashlib.sha256((code + (ROOT / test).read_text()).encode()).hexdigest()[:24]
    path = CACHE / f"{name}.json"
    if not path.is_file():
        CACHE.mkdir(parents=True, exist_ok=True)
        recorder = Recorder(files, str(path))
        done: Run = run(None, [test], plugins=[recorder])
        assert not done.failed, f"{test} fails without a fault: {done.how}"
        content = json.loads(path.read_text())
        path.write_text(json.dumps({"test": test, "seconds": done.seconds, **content}))
    content = json.loads(path.read_text())
    return Reach(test, content["seconds"], {(file, function) for file, function in content["functions"]})


class Recorder:
    """A plug-in of pytest that writes which functions were run."""

    def __init__(self, files: set[str], path: str) -> None:
        self.files = {str(ROOT / file): file for file in files}
        self.path, self.found = path, set[tuple[str, str]]()

    def pytest_configure(self) -> None:
        """Look at each call from here on."""
        sys.setprofile(self._call)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self) -> None:
        """Again, where a test has its own profile."""
        sys.setprofile(self._call)

    def pytest_sessionfinish(self) -> None:
        """Write."""
        sys.setprofile(None)
        with open(self.path, "w") as out:  # noqa: PTH123
            json.dump({"functions": sorted(self.found)}, out)

    def _call(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename in self.files:
            name = re.sub(r"\.<(locals|lambda|listcomp|dictcomp|setcomp|genexpr)>", "", code.co_qualname)
            self.found.add((self.files[code.co_filename], name))
