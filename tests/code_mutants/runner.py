"""Runs the tests of a module with a fault in it; no file is changed.

Each run is a fork of a process that has the large libraries: only ncomp and the tests are imported anew, and the
module with the fault comes from its changed syntax tree.
"""

from __future__ import annotations

import ast
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import CodeType, ModuleType
from typing import NamedTuple

import hypothesis
import pytest

from tests.code_mutants.operators import Mutant, tree_of

ROOT = Path(__file__).parents[2]
LIBRARIES = ("numpy", "scipy.optimize", "scipy.interpolate", "scipy.sparse.linalg", "scipy.stats", "sympy", "lark",
             "typer", "rich.console", "msgspec", "jinja2", "sqlalchemy", "xdist", "hypothesis.extra.numpy")  # fmt: skip
MOST_TIME = 2
"""Processor time of a run with a fault, in times of the run without: longer ones do not end."""
MORE_SECONDS = 20
TEST_SECONDS = 25
"""Processor time of one test, which takes a few seconds without a fault."""
MEMORY = 6 << 30
"""Address space of a run, bytes."""


class Run(NamedTuple):
    """How tests ended."""

    failed: bool
    how: str
    """The first test that failed; `time`, or the signal, where the run did not end by itself."""
    seconds: float
    """Processor time."""


class _Changed(importlib.machinery.SourceFileLoader):
    """Loads a module from a syntax tree."""

    def __init__(self, name: str, path: str, tree: ast.Module) -> None:
        super().__init__(name, path)
        self.tree = tree

    def get_code(self, _: str) -> CodeType:
        """The changed code."""
        return compile(self.tree, self.path, "exec")


class _Finder(importlib.abc.MetaPathFinder):
    """Finds the module with the fault before the true one."""

    def __init__(self, mutant: Mutant) -> None:
        path = Path(mutant.file)
        self.name = ".".join((path.parent if path.name == "__init__.py" else path.with_suffix("")).parts)
        self.file, self.tree = str(ROOT / path), tree_of(ROOT, mutant)

    def find_spec(
        self, name: str, _: Sequence[str] | None, __: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """The module with the fault."""
        if name != self.name:
            return None
        return importlib.util.spec_from_file_location(name, self.file, loader=_Changed(name, self.file, self.tree))


class _Limit:
    """A plug-in of pytest: the process ends where one test takes too long."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self) -> None:
        """The time of the next test; the signal that nobody handles ends the process."""
        signal.setitimer(signal.ITIMER_PROF, TEST_SECONDS)


def prepare() -> None:
    """Import the libraries, and let tests draw the same examples in each run; failures are not shrunk."""
    for name in LIBRARIES:
        importlib.import_module(name)
    phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
    hypothesis.settings.register_profile("mutants", deadline=None, derandomize=True, phases=phases)


def run(mutant: Mutant | None, tests: Iterable[str], seconds: float = 1200.0, plugins: Sequence[object] = ()) -> Run:
    """Run tests until one fails; without a fault where it is None."""
    with tempfile.TemporaryFile() as log:
        child = os.fork()
        if not child:
            _run_tests(mutant, tests, seconds, plugins, log.fileno())
        used, status = _ended(child, time.monotonic() + 10 * seconds)
        log.seek(0)
        shown = log.read().decode(errors="replace")
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        late = number in (signal.SIGXCPU, signal.SIGKILL, signal.SIGPROF)
        return Run(True, "time" if late else signal.Signals(number).name, used)
    failed = [line.removeprefix("FAILED ") for line in shown.splitlines() if line.startswith(("FAILED", "ERROR"))]
    last = shown.strip().rpartition("\n")[2]
    ended = os.WEXITSTATUS(status)
    return Run(ended not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED), (failed or [last])[0][:160], used)


def _ended(child: int, until: float) -> tuple[float, int]:
    """Processor time and status of a process, which is killed at a time."""
    while True:
        pid, status, used = os.wait4(child, os.WNOHANG)
        if pid:
            return used.ru_utime + used.ru_stime, status
        if time.monotonic() > until:
            os.killpg(child, signal.SIGKILL)
        time.sleep(0.05)


def _run_tests(
    mutant: Mutant | None, tests: Iterable[str], seconds: float, plugins: Sequence[object], log: int
) -> None:
    """The process of a run: it ends here."""
    options = ["-x", "-q", "--no-header", "-p", "no:cacheprovider", "-p", "no:xdist", "--hypothesis-profile=mutants"]
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
    status = 99
    try:
        os.setsid()
        for stream in (1, 2):
            os.dup2(log, stream)
        os.chdir(ROOT)
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 5))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        if mutant is not None:
            sys.meta_path.insert(0, _Finder(mutant))
        status = int(pytest.main([*options, "-m", "not statistical and not exam", *tests], [*plugins, _Limit()]))
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(status)


__all__ = ["MORE_SECONDS", "MOST_TIME", "Run", "prepare", "run"]
