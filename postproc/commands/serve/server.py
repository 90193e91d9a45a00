"""The server: it waits for requests, and removes everything when it ends."""

from __future__ import annotations

import asyncio
import os
import secrets
import socket
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from postproc.commands.serve.app import Site
from postproc.commands.serve.guard import Guard, Limits, is_loopback
from postproc.commands.serve.jobs import Jobs
from postproc.commands.serve.machines_offered import Machines
from postproc.commands.show.terminal import say

CONNECTIONS = 100
"""Connections at a time; more are answered that the server is busy."""


@dataclass(frozen=True)
class Server:
    """A server at a bound socket."""

    socket: socket.socket
    host: str
    token: str | None
    history: str | None
    watch_log: Path | None
    limits: Limits
    at_once: int
    keep_s: float

    def run(self) -> None:
        """Serve until Ctrl-C or SIGTERM."""
        with self.socket, tempfile.TemporaryDirectory(prefix="ncomp-serve-", ignore_cleanup_errors=True) as folder:
            tempfile.tempdir = os.environ["TMPDIR"] = folder  # also for parts of large uploads
            with suppress(KeyboardInterrupt, SystemExit):
                asyncio.run(self._serve(Path(folder)))

    async def _serve(self, folder: Path) -> None:
        import uvicorn

        jobs = Jobs(folder, self.at_once, self.keep_s)
        site = Site(jobs, Machines(self.history), self.watch_log, self.limits)
        port: int = self.socket.getsockname()[1]
        token = self.token or ("" if is_loopback(self.host) else secrets.token_urlsafe(24))
        site.guard = Guard(site, site.refusal, self.host, port, token, self.limits)
        config = uvicorn.Config(
            site.guard, log_level="warning", access_log=False, proxy_headers=False, server_header=False, ws="none",
            lifespan="off", limit_concurrency=CONNECTIONS, timeout_graceful_shutdown=1,
        )  # fmt: skip
        say("page", f"{_address(self.host, port)}{f'?token={token}' if token else ''}  Ctrl-C ends")
        try:
            await uvicorn.Server(config).serve(sockets=[self.socket])
        finally:
            jobs.close()


def _address(host: str, port: int) -> str:
    """The address of the page; that of this computer in the network where it is served at all of them."""
    name = socket.gethostname() if host in ("0.0.0.0", "::") else host
    return f"http://{f'[{name}]' if ':' in name else name}:{port}/"
