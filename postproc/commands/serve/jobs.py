"""Jobs: command lines in processes of their own, at most some at once, which can be stopped and are removed later."""

from __future__ import annotations

import asyncio
import os
import secrets
import shutil
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from kinematics.user_error import UserError
from postproc.commands.show.terminal import PROGRESS

MOST_JOBS = 50
"""Jobs that are kept at a time, with those that wait and run."""
JOB_GRACE_S = 3.0
"""Time, s, after which a process that was asked to end is ended in the midst of its work."""
MESSAGE = "ncomp: "
"""Begin of the last message of a command."""
WAITS = "waits for its turn"
State = Literal["waiting", "running", "done", "refused", "failed", "stopped"]


@dataclass
class Job:
    """Command lines, one after the other until one ends with an error, in a folder of their own."""

    title: str
    name: str
    """Names of the uploaded files as the user knows them, or of the machine."""
    folder: Path
    steps: Sequence[Sequence[str]] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    """Names for people of the files that may be fetched, by their names in the folder."""
    pages: Sequence[str] = ()
    """The page of each step."""
    state: State = "waiting"
    step: int = 0
    began: float = field(default_factory=time.time)
    process: asyncio.subprocess.Process | None = None

    @property
    def id(self) -> str:
        """Its name in addresses, which nobody can guess."""
        return self.folder.name

    @property
    def is_over(self) -> bool:
        """True where nothing more will happen."""
        return self.state not in ("waiting", "running")

    @property
    def progress(self) -> tuple[float | None, str]:
        """The share of the present step that is done, None where it is not known, and the name of the step."""
        share, step = "", " ".join(self.steps[self.step][:1])
        with suppress(OSError, ValueError):
            found, _, named = (self.folder / f"progress{self.step}").read_text(encoding="utf-8").partition("\t")
            share, step = found, named or step
        count = f"{self.step + 1} of {len(self.steps)}: " if len(self.steps) > 1 else ""
        return (float(share) if share else None), WAITS if self.state == "waiting" else count + step

    @property
    def message(self) -> str:
        """The last message of its commands; empty without one."""
        with suppress(OSError):
            text = (self.folder / "messages").read_text(encoding="utf-8", errors="replace")
            begin = text.rfind(f"\n{MESSAGE}")
            if begin >= 0 or text.startswith(MESSAGE):
                return text[begin + 1 :].removeprefix(MESSAGE).strip()
        return ""

    @property
    def page(self) -> str:
        """The page of the last step; empty where it has none."""
        name = self.pages[min(self.step, len(self.pages) - 1)] if self.pages else ""
        return name if self.is_over and name and (self.folder / name).is_file() else ""

    def there(self) -> dict[str, str]:
        """The files that may be fetched now."""
        return {name: shown for name, shown in self.files.items() if self.is_over and (self.folder / name).is_file()}


class Jobs:
    """The jobs of a server."""

    def __init__(self, folder: Path, at_once: int, keep_s: float) -> None:
        self._folder, self._keep_s = folder, keep_s
        self._free = asyncio.Semaphore(at_once)
        self._all: dict[str, Job] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}

    def folder(self) -> Path:
        """A new folder with a name of its own. UserError where there are too many jobs."""
        if len(self._all) >= MOST_JOBS:
            oldest = next((job for job in self._all.values() if job.is_over), None)
            if oldest is None:
                raise UserError(f"{MOST_JOBS} jobs wait or run already: wait until one has ended, or stop one")
            self.remove(oldest)
        made = self._folder / secrets.token_urlsafe(18)
        made.mkdir(mode=0o700)
        return made

    def start(self, job: Job) -> None:
        """Run a job as soon as a place is free."""
        self._all[job.id] = job
        self._tasks[job.id] = asyncio.create_task(self._live(job))

    def find(self, name: str) -> Job | None:
        """The job of a name."""
        return self._all.get(name)

    def latest(self) -> list[Job]:
        """All jobs, the last one first."""
        return list(reversed(self._all.values()))

    def stop(self, job: Job) -> None:
        """End a job that waits or runs."""
        if not job.is_over:
            job.state = "stopped"
            _signal(job, signal.SIGTERM)

    def remove(self, job: Job) -> None:
        """Forget a job and its files."""
        self._all.pop(job.id, None)
        task = self._tasks.pop(job.id)
        if task is not asyncio.current_task():
            task.cancel()
        _signal(job, getattr(signal, "SIGKILL", signal.SIGTERM))
        shutil.rmtree(job.folder, ignore_errors=True)

    def close(self) -> None:
        """Forget all jobs."""
        for job in self.latest():
            self.remove(job)

    async def _live(self, job: Job) -> None:
        """Run the steps of a job, and remove it after a time."""
        async with self._free:
            if job.state == "waiting":
                job.state = "running"
                for number, words in enumerate(job.steps):
                    job.step = number
                    try:
                        status = await self._run(job, words)
                    except OSError:  # no room for a process, or a line that is too long
                        status = 1
                    if job.is_over or status != 0:
                        break
                if job.state == "running":
                    job.state = "done" if status == 0 else "refused" if status == 2 else "failed"
        await asyncio.sleep(self._keep_s)
        self.remove(job)

    async def _run(self, job: Job, words: Sequence[str]) -> int:
        """The exit status of a command line."""
        own = {PROGRESS: str(job.folder / f"progress{job.step}"), "TMPDIR": str(job.folder)}
        with (job.folder / "messages").open("ab") as messages, (job.folder / "output").open("ab") as output:
            job.process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-P", "-m", "ncomp", *words), cwd=job.folder, env={**os.environ, **own},
                stdin=asyncio.subprocess.DEVNULL, stdout=output, stderr=messages, start_new_session=True,
            )  # fmt: skip
            ended = asyncio.create_task(job.process.wait())
            while not ended.done():
                await asyncio.wait([ended], timeout=JOB_GRACE_S)
                if job.is_over and not ended.done():
                    _signal(job, getattr(signal, "SIGKILL", signal.SIGTERM))
            return ended.result()


def _signal(job: Job, number: int) -> None:
    """Send a signal to the process of a job and to those that it has started."""
    if job.process is not None and job.process.returncode is None:
        with suppress(ProcessLookupError):
            if hasattr(os, "killpg"):
                os.killpg(job.process.pid, number)
            else:
                job.process.send_signal(number)
