"""`ncomp serve` in a process of its own, and requests to it as browsers and others send them."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Mapping, Sequence
from http.client import HTTPConnection
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PATIENCE = 60.0
"""Time, s, in which a job is over."""


class Answer(NamedTuple):
    """The answer to a request."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def text(self) -> str:
        """The page."""
        return self.body.decode()


class Upload(NamedTuple):
    """A file of a form."""

    name: str
    content: bytes = b""


class Serving:
    """A server with a folder for its private one."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder = folder
        folder.mkdir(exist_ok=True)
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(folder), "XDG_DATA_HOME": str(folder)}
        words = [sys.executable, "-m", "ncomp", "serve", "--port", "0", *options]
        self.process = subprocess.Popen(words, env=environment, cwd=ROOT, stderr=subprocess.PIPE, text=True)
        assert self.process.stderr is not None
        self.line = self.process.stderr.readline()
        assert self.line.startswith("page: http://"), self.line + self.process.stderr.read()
        self.port = int(self.line.split("/")[2].rpartition(":")[2])
        self.host = f"127.0.0.1:{self.port}"
        self.cookie = ""

    @property
    def address(self) -> str:
        """The address of the page."""
        return f"http://{self.host}"

    def get(self, path: str, **headers: str) -> Answer:
        """Read a page; the path is sent as it is."""
        return self.send("GET", path, b"", headers)

    def send(self, method: str, path: str, body: bytes, headers: Mapping[str, str]) -> Answer:
        """Send a request with the host, the origin and the cookie of this server, unless headers has others."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        own = {"Host": self.host, "Origin": self.address, "Cookie": self.cookie} | dict(headers)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in own.items():
                if value:
                    connection.putheader(name.replace("_", "-"), value)
            connection.putheader("Content-Length", str(len(body)))
            connection.endheaders(body)
            answer = connection.getresponse()
            return Answer(answer.status, {n.lower(): v for n, v in answer.getheaders()}, answer.read())
        finally:
            connection.close()

    def post(self, path: str, fields: Sequence[tuple[str, str | Upload]] = (), **headers: str) -> Answer:
        """Send a form."""
        kind, body = form(fields)
        return self.send("POST", path, body, {"Content-Type": kind, **headers})

    def raw(self, data: bytes, *, after: Sequence[bytes] = (), pause: float = 0.0) -> bytes:
        """Send bytes, and others with pauses between them; the answer, or what there is of it."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE) as connection:
            try:
                connection.sendall(data)
                for each in after:
                    time.sleep(pause)
                    connection.sendall(each)
            except OSError:
                pass  # the server has answered, and does not listen any more
            answer = b""
            try:
                while part := connection.recv(1 << 16):
                    answer += part
            except OSError:
                pass
        return answer

    def start(self, task: str, *fields: tuple[str, str | Upload]) -> str:
        """Start a job; its address."""
        answer = self.post(f"/task/{task}", fields)
        assert answer.status == 303, answer.text
        return answer.headers["location"].partition("#")[0]

    def over(self, job: str) -> str:
        """Wait until a job is over; its state."""
        end = time.monotonic() + PATIENCE
        while not (state := json.loads(self.get(f"{job}/state").body))["over"]:
            assert time.monotonic() < end, state
            time.sleep(0.05)
        return str(state["state"])

    def files(self) -> list[str]:
        """Names of all files below the folder of the server."""
        return sorted(path.name for path in self.folder.rglob("*") if path.is_file())

    def close(self) -> int:
        """End the server as `kill` does; its exit status."""
        self.process.send_signal(signal.SIGTERM)
        status = self.process.wait(timeout=PATIENCE)
        assert self.process.stderr is not None
        self.process.stderr.close()
        return status


def form(fields: Sequence[tuple[str, str | Upload]]) -> tuple[str, bytes]:
    """The content type and the body of a form with files."""
    boundary, parts = uuid.uuid4().hex, []
    for name, value in fields:
        head = f'Content-Disposition: form-data; name="{name}"'
        if isinstance(value, Upload):
            quoted = value.name.replace("\\", "\\\\").replace('"', '\\"')
            head += f'; filename="{quoted}"\r\nContent-Type: text/plain'
        content = value.content if isinstance(value, Upload) else value.encode()
        parts.append(f"--{boundary}\r\n{head}\r\n\r\n".encode() + content + b"\r\n")
    return f"multipart/form-data; boundary={boundary}", b"".join(parts) + f"--{boundary}--\r\n".encode()
