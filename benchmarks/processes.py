"""Time and memory of a command with all processes that it starts."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

SAMPLED_S = 0.1
"""Between two samples of the memory, each of which takes a processor for some milliseconds from the command."""


class Spent(NamedTuple):
    """Time and memory of a command."""

    elapsed: float
    """Time from start to end, s."""
    processor: float
    """Time on processors, s, of all processes."""
    peak_mb: float
    """Largest memory of all processes together, MB; pages that several processes share count once."""


class Failed(Exception):
    """The command ended with a fault; its message."""


def spent(
    words: Sequence[str | Path], environment: Mapping[str, str] | None = None, folder: Path | None = None,
    accepted: Sequence[int] = (0,),
) -> Spent:  # fmt: skip
    """Run a command. Failed for an exit status that is not accepted."""
    start, largest, own, alone = time.perf_counter(), 0.0, 0.0, True
    with subprocess.Popen(
        [str(word) for word in words], env=environment, cwd=folder, stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        assert process.stderr is not None
        os.set_blocking(process.stderr.fileno(), False)
        said = b""
        while True:
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            said += process.stderr.read() or b""
            if pid:
                break
            family = _family(process.pid)
            alone = alone and len(family) == 1
            largest = max(largest, sum(_memory_mb(each, "smaps_rollup", "Pss:") for each in family))
            own = max(own, _memory_mb(process.pid, "status", "VmHWM:"))
            time.sleep(SAMPLED_S)
        process.returncode = os.waitstatus_to_exitcode(status)
    elapsed = time.perf_counter() - start
    if process.returncode not in accepted:
        raise Failed(f"{' '.join(map(str, words))}: status {process.returncode}: {said.decode(errors='replace')}")
    return Spent(elapsed, usage.ru_utime + usage.ru_stime, own if alone else largest)


def _family(process: int) -> list[int]:
    """A process and all that it has started."""
    found = [process]
    for each in found:
        with suppress(OSError):
            for path in Path(f"/proc/{each}/task").iterdir():
                found += map(int, (path / "children").read_text().split())
    return found


def _memory_mb(process: int, file: str, name: str) -> float:
    """A figure that the system has of a process; 0 for one that has ended."""
    with suppress(OSError):
        for line in Path(f"/proc/{process}/{file}").read_text().splitlines():
            if line.startswith(name):
                return int(line.split()[1]) / 1024
    return 0.0
