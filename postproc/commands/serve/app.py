"""The pages and their addresses: forms that start jobs, jobs with their results, machines, and the log of a watch."""

from __future__ import annotations

import time
import traceback
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import rendering
from kinematics.user_error import UserError
from postproc.commands.serve.forms import TASKS, Task
from postproc.commands.serve.guard import WRONG_S, Guard, Limits, Message, Receive, Refused, Send
from postproc.commands.serve.jobs import WAITS, Job, Jobs
from postproc.commands.serve.machines_offered import Machines
from postproc.commands.serve.uploads import saved_job
from postproc.commands.serve.watched import watched

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response

HERE = Path(__file__).parent / "pages"
STATIC = {
    "page.css": (Path(rendering.__file__).parent / "page.css", "text/css"),
    "serve.css": (HERE / "serve.css", "text/css"),
    "serve.js": (HERE / "serve.js", "text/javascript"),
}
"""Files that pages load, and their types."""
RESULT = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline' blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:; connect-src data: blob:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'"
)
"""Content-Security-Policy of the page of a result: its scripts draw, and reach neither this server nor another one."""
WORDS = {
    "waiting": WAITS,
    "running": "in work",
    "done": "done",
    "refused": "refused",
    "failed": "failed",
    "stopped": "stopped",
}
"""The states of jobs for people."""
TYPES = {".html": "text/html", ".json": "application/json"}


@dataclass
class Site:
    """The pages of a server."""

    jobs: Jobs
    machines: Machines
    watch_log: Path | None
    limits: Limits
    guard: Guard | None = None

    @cached_property
    def _templates(self) -> Any:
        from jinja2 import Environment, FileSystemLoader, StrictUndefined

        return Environment(
            loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
            lstrip_blocks=True,
        )  # fmt: skip

    @cached_property
    def router(self) -> Any:
        """The functions by their addresses."""
        from starlette.routing import Route, Router

        def route(path: str, function: Callable[..., Awaitable[Response]], method: str = "GET") -> Route:
            return Route(path, function, methods=[method])

        return Router(
            [
                route("/", self.home),
                route("/task/{task}", self.form),
                route("/task/{task}", self.start, "POST"),
                route("/jobs", self.listed),
                route("/jobs/{job}", self.job),
                route("/jobs/{job}/state", self.state),
                route("/jobs/{job}/page", self.result),
                route("/jobs/{job}/files/{file}", self.file),
                route("/jobs/{job}/stop", self.stop, "POST"),
                route("/jobs/{job}/remove", self.remove, "POST"),
                route("/machines", self.list_machines),
                route("/watch", self.watch),
                route("/login", self.login, "POST"),
                route("/static/{file}", self.static),
            ],
            redirect_slashes=False,
        )

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer a request that the guard has let pass."""
        from starlette.exceptions import HTTPException
        from starlette.formparsers import MultiPartException
        from starlette.requests import ClientDisconnect

        scope["app"] = self  # then the router raises what it does not find
        try:
            await self.router(scope, receive, send)
        except UserError as fault:
            raise Refused(400, str(fault)) from None
        except MultiPartException as fault:
            raise Refused(400, f"The form cannot be read: {fault.message}") from None
        except HTTPException as fault:
            reason = "There is no such page here." if fault.status_code == 404 else fault.detail
            raise Refused(fault.status_code, reason) from None
        except (Refused, ClientDisconnect) as fault:
            if isinstance(fault, Refused):
                raise
        except Exception:
            traceback.print_exc()
            raise Refused(500, "internal fault: the terminal of ncomp serve shows it; please report it") from None

    def refusal(self, status: int, reason: str) -> Any:
        """The page of a request that is not answered."""
        answer = self._page("refused.html", status, reason=reason, login=status == 401)
        answer.headers["connection"] = "close"  # the rest of its body is not read
        return answer

    def _page(self, template: str, status: int = 200, **values: Any) -> Response:
        from starlette.responses import HTMLResponse

        watching = self.watch_log is not None
        text = self._templates.get_template(template).render(tasks=TASKS, words=WORDS, watching=watching, **values)
        return HTMLResponse(text.encode(errors="replace"), status)

    async def home(self, _: Request) -> Response:
        """The first form."""
        return _to("/task/program")

    async def form(self, request: Request) -> Response:
        """The form of a task."""
        name, task = self._task(request)
        offered = self.machines.offered(task)
        answer = self._page(
            "form.html", name=name, task=task, shown=task.fields(task.shown, offered),
            folded=task.fields(task.folded, offered), machines=offered["machine"](),
            chosen=request.query_params.get("machine", ""), largest=self.limits.size,
        )  # fmt: skip
        answer.headers["cache-control"] = "no-cache"  # a browser that goes back finds the form as it was filled in
        return answer

    async def start(self, request: Request) -> Response:
        """Start a job by a form."""
        _, task = self._task(request)
        async with request.form(max_files=20, max_fields=100, max_part_size=1 << 14) as form:
            job = await saved_job(task, form, self.machines.offered(task), self.jobs.folder, self.machines.words(task))
        self.jobs.start(job)
        return _to(f"/jobs/{job.id}#work")

    async def listed(self, _: Request) -> Response:
        """All jobs."""
        return self._page("jobs.html", jobs=self.jobs.latest(), now=time.time())

    async def job(self, request: Request) -> Response:
        """A job: its progress, or its result."""
        return self._page("job.html", job=self._job(request))

    async def state(self, request: Request) -> Response:
        """The progress of a job for the script of its page."""
        from starlette.responses import JSONResponse

        job = self._job(request)
        share, step = job.progress
        return JSONResponse({"state": job.state, "over": job.is_over, "share": share, "step": step})

    async def result(self, request: Request) -> Response:
        """The page of a result, which may run its own scripts and reaches nothing."""
        job = self._job(request)
        if not job.page:
            raise Refused(404, "This job has no page.")
        return _file(job.folder / job.page, "text/html", {"content-security-policy": RESULT})

    async def file(self, request: Request) -> Response:
        """A file of a job, to be saved."""
        job, name = self._job(request), request.path_params["file"]
        there = job.there()
        if name not in there:
            raise Refused(404, "This job has no such file.")
        saved = f"attachment; filename*=UTF-8''{quote(there[name], safe='', errors='replace')}"
        kind = TYPES.get(Path(name).suffix, "application/octet-stream")
        return _file(job.folder / name, kind, {"content-disposition": saved, "content-security-policy": RESULT})

    async def stop(self, request: Request) -> Response:
        """Stop a job."""
        job = self._job(request)
        self.jobs.stop(job)
        return _to(f"/jobs/{job.id}")

    async def remove(self, request: Request) -> Response:
        """Remove a job and its files."""
        self.jobs.remove(self._job(request))
        return _to("/jobs")

    async def list_machines(self, _: Request) -> Response:
        """The machines, and their lives."""
        return self._page("machines.html", rows=self.machines.rows(), with_history=self.machines.history is not None)

    async def watch(self, _: Request) -> Response:
        """The end of the log of `ncomp watch`."""
        if self.watch_log is None:
            raise Refused(404, "Start with --watch-log FILE, the log of ncomp watch, to see it here.")
        return self._page("watch.html", log=self.watch_log.name, watched=watched(self.watch_log))

    async def login(self, request: Request) -> Response:
        """Let a browser in that has sent the token."""
        import asyncio

        async with request.form(max_files=0, max_fields=1, max_part_size=1 << 10) as form:
            token = form.get("token")
        if self.guard is None or not isinstance(token, str) or not self.guard.is_token(token.strip()):
            await asyncio.sleep(WRONG_S)
            raise Refused(401, "The token is wrong: use the one that ncomp serve has printed.")
        return _to("/", {"set-cookie": self.guard.cookie()})

    async def static(self, request: Request) -> Response:
        """A file that pages load."""
        name = request.path_params["file"]
        if name not in STATIC:
            raise Refused(404, "There is no such file.")
        return _file(*STATIC[name])

    def _task(self, request: Request) -> tuple[str, Task]:
        name = request.path_params["task"]
        if name not in TASKS:
            raise Refused(404, "There is no such page here.")
        return name, TASKS[name]

    def _job(self, request: Request) -> Job:
        found = self.jobs.find(request.path_params["job"])
        if found is None:
            raise Refused(404, "This job is not here any more: results are removed after a time. Start it again.")
        return found


def _file(path: Path, kind: str, headers: Mapping[str, str] | None = None) -> Response:
    from starlette.responses import FileResponse

    return FileResponse(path, media_type=kind, headers=dict(headers or {}))


def _to(address: str, headers: Mapping[str, str] | None = None) -> Response:
    from starlette.responses import RedirectResponse

    return RedirectResponse(address, 303, dict(headers or {}))
