"""`ncomp serve`: what it does is what the commands do, and what it does not do for requests that mean harm."""

import json
import re
import sys
import time
from pathlib import Path

import pytest
from support.command import run_command, succeed
from support.serving import Serving, Upload

from postproc.commands.serve.forms import TASKS, field_of

BOX = Path(__file__).parents[1] / "examples" / "box.nc"
SET_UP = (("machine", "dmu50"), ("work_offset", "G54=-30,-20,150"), ("tool_length", "T1=80"))
REFUSED = b"G21 G90 G54\nG234 (<script>alert;</script>)\nG0 X1 Y1 Z1\nM30\n"
SCRIPT = '<script>alert("name")</script>.nc'
TOKEN = "a-token-of-the-tests"
NAMES = {
    "a path up": "../../../../tmp/evil.nc",
    "a path of Windows": "..\\..\\evil.nc",
    "an absolute path": "/etc/passwd",
    "a script": SCRIPT,
    "a quote": 'a"; filename="b.nc',
    "a long one": "n" * 200 + ".nc",
    "another suffix": "evil.nc.py",
    "no suffix": ".nc",
    "right to left": "a\u202ecn.exe",
}


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    made = Serving(tmp_path_factory.mktemp("served"), "--largest-mb", "1", "--upload-s", "1")
    yield made
    assert made.close() == 0
    assert made.files() == []


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    """A server with a token, a history and a log."""
    folder = tmp_path_factory.mktemp("guarded")
    life, log = folder / "life.sqlite", folder / "watch.log"
    check = ("--check", "squareness X-Y=12 +- 3 um/m", "--db", life)
    for month in range(1, 5):
        succeed("history", "add", "gantry", *check, "--at", f"2026-0{month}-01")
    log.write_text(
        "2026-11-30 10:00:00 watching posted\n2026-11-30 10:00:01 refused: <script>x</script>:4: G234\nits cure\n"
    )
    made = Serving(folder / "private", "--token", TOKEN, "--db", str(life), "--watch-log", str(log))
    made.cookie = f"ncomp_token={TOKEN}"
    yield made
    made.close()


@pytest.fixture(scope="module")
def corrected(server):
    """The address of a job that has corrected a program."""
    job = server.start("program", ("input", Upload("box.nc", BOX.read_bytes())), *SET_UP)
    assert server.over(job) == "done", server.get(job).text
    return job


def test_a_program_is_corrected_as_by_the_command(server, corrected, tmp_path):
    done = server.get(f"{corrected}/files/output.nc")
    options = ("--machine", "dmu50", "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80")
    succeed(BOX, *options, "-o", tmp_path / "out.nc")
    assert done.body == (tmp_path / "out.nc").read_bytes()
    assert done.headers["content-disposition"] == "attachment; filename*=UTF-8''box_c.nc"
    results = json.loads(server.get(f"{corrected}/files/result-correct.json").body)
    assert results["predicted_error_um"]["anywhere"]["after"] < results["predicted_error_um"]["anywhere"]["before"]
    page = server.get(f"{corrected}/page").text
    assert "Errors on the part" in page
    assert "box.nc" in page


def test_a_program_is_corrected_by_an_uploaded_calibration(server, corrected, tmp_path):
    """Only the correction takes it: with a program, the check before it has no use for one."""
    shipped = Path(__file__).parents[1] / "machines" / "calibrations" / "dmu50.json"
    calibration = tmp_path / "now.json"
    calibration.write_text(shipped.read_text().replace("2026-11-21T", "2026-11-22T"))
    upload = ("calibration", Upload("now.json", calibration.read_bytes()))
    job = server.start("program", ("input", Upload("box.nc", BOX.read_bytes())), upload, *SET_UP)
    assert server.over(job) == "done", server.get(job).text
    options = ("--machine", "dmu50", "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80")
    succeed(BOX, *options, "--calibration", calibration, "-o", tmp_path / "out.nc")
    done = server.get(f"{job}/files/output.nc").body
    assert done == (tmp_path / "out.nc").read_bytes() != server.get(f"{corrected}/files/output.nc").body


def test_a_program_that_is_refused_shows_its_lines_and_their_cure(server):
    job = server.start("program", ("input", Upload("part.nc", REFUSED)), ("machine", "gantry"))
    assert server.over(job) == "refused"
    page = server.get(f"{job}/page").text
    assert "--pass-through G234" in page
    assert "<script>alert" not in page
    assert server.get(f"{job}/files/output.nc").status == 404
    assert not list(server.folder.rglob(f"{job.rpartition('/')[2]}/output.nc"))


@pytest.mark.statistical
def test_measured_data_are_fitted_as_by_the_command(server, tmp_path):
    data, options = tmp_path / "run.csv", ("--machine", "gantry", "--basis", "legendre:2")
    succeed("simulate", "--machine", "gantry", "--strategy", "grid", "--points", "125", "-o", data)
    job = server.start(
        "fit", ("input", Upload("run.csv", data.read_bytes())), ("machine", "gantry"), ("basis", "legendre:2")
    )
    steps = set()
    while not (state := json.loads(server.get(f"{job}/state").body))["over"]:
        steps.add(state["step"])
        time.sleep(0.02)
    assert state["state"] == "done", server.get(job).text
    assert steps - {"waits for its turn", "fit"}, "no step was shown while it ran"
    succeed("fit", data, *options, "-o", tmp_path / "cal.json")
    found = server.get(f"{job}/files/output.json")
    assert json.loads(found.body)["effects"] == json.loads((tmp_path / "cal.json").read_text())["effects"]
    assert found.headers["content-disposition"] == "attachment; filename*=UTF-8''run_fit.json"


def test_measured_data_that_cannot_be_read_are_refused_in_words(server):
    data = b"# instrument: <script>alert(1)</script>\ntime_s,X\n0,1\n"
    job = server.start("diagnose", ("input", Upload("a.csv", data)), ("machine", "gantry"))
    assert server.over(job) == "refused"
    page = server.get(job).text
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert server.get(f"{job}/page").status == 404


@pytest.mark.parametrize("kind", NAMES)
def test_the_name_of_an_upload_reaches_no_folder(server, kind):
    before = set(server.files())
    job = server.start("program", ("input", Upload(NAMES[kind], REFUSED)), ("machine", "gantry"))
    assert set(server.files()) - before <= {"program1.nc", "head.toml", "messages", "output", "progress0"}
    assert {path.parent.name for path in server.folder.rglob("program1.nc")} >= {job.rpartition("/")[2]}
    shown = server.get(job).text
    assert "<script>alert" not in shown
    assert "../" not in shown
    assert server.post(f"{job}/remove").status == 303
    assert server.get(job).status == 404


@pytest.mark.parametrize(
    "path",
    [
        "/static/../serve.py", "/static/..%2fserve.py", "/static/%2e%2e/app.py", "//etc/passwd", "/etc/passwd",
        "/static//etc/passwd", "/jobs/..", "/jobs/../../etc/passwd", "/jobs/%2e%2e/page", "/task/../machines",
        "/task/correct", "/jobs/.", "/static/serve.css%00.html", "/docs", "/openapi.json",
    ],
)  # fmt: skip
def test_a_path_leads_to_pages_only(server, path):
    answer = server.get(path)
    assert answer.status == 404
    assert "There is no such" in answer.text or "not here any more" in answer.text


@pytest.mark.parametrize("file", ["..%2f..%2fetc%2fpasswd", "program1.nc", "head.toml", "messages", "../state", ""])
def test_only_results_of_a_job_are_read(server, corrected, file):
    assert server.get(f"{corrected}/files/{file}").status == 404


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example:{}", "", "[::1", "10.0.0.1:{}"]
)
def test_another_name_of_this_computer_is_not_answered(server, host):
    answer = server.get("/task/program", Host=host.format(server.port))
    assert answer.status == (400 if not host else 421)
    assert b"NC program" not in answer.body


def test_the_names_of_this_computer_are_answered(server):
    assert server.get("/task/program", Host=f"localhost:{server.port}").status == 200


@pytest.mark.parametrize(
    "origin", ["https://evil.example", "null", "", "http://127.0.0.1:1", "http://127.0.0.1.evil.example"]
)
def test_the_form_of_another_page_does_nothing(server, origin):
    before = server.files()
    fields = (("input", Upload("box.nc", BOX.read_bytes())), *SET_UP)
    answer = server.post("/task/program", fields, Origin=origin)
    assert answer.status == 403
    assert "another site" in answer.text
    assert server.files() == before


def test_an_upload_that_is_too_large_is_refused(server):
    before = server.files()
    answer = server.post("/task/program", (("input", Upload("box.nc", bytes(2_000_000))), *SET_UP))
    assert answer.status == 413
    assert "larger than 1 MB" in answer.text
    chunk = b"100000\r\n" + b"x" * 0x100000 + b"\r\n"
    begin = head(server, "Transfer-Encoding: chunked", "Content-Type: multipart/form-data; boundary=b")
    part = b'--b\r\nContent-Disposition: form-data; name="input"; filename="a.nc"\r\n\r\n'
    sent = begin + b"%x\r\n%b\r\n" % (len(part), part)
    assert b" 413 " in server.raw(sent, after=[chunk, chunk, chunk])[:20]
    assert server.files() == before


def test_an_upload_that_is_too_slow_is_refused(server):
    begun = time.monotonic()
    sent = head(server, "Content-Length: 500000", "Content-Type: multipart/form-data; boundary=b")
    answer = server.raw(sent + b"--b\r\n", after=[b"x"] * 8, pause=0.25)
    assert b" 408 " in answer[:20]
    assert time.monotonic() - begun < 10.0


def head(server, *lines):
    """The head of a request that sends a form."""
    own = ("POST /task/program HTTP/1.1", f"Host: {server.host}", f"Origin: {server.address}", *lines, "", "")
    return "\r\n".join(own).encode()


@pytest.mark.parametrize(
    ("kind", "body", "status"),
    [
        ("application/json", b"{}", 415),
        ("text/plain", b"input=x", 415),
        ("", b"input=x", 415),
        ("multipart/form-data", b"--b--", 400),
        ("multipart/form-data; boundary=b", b"no part at all", 400),
        ("multipart/form-data; boundary=b", b'--b\r\nContent-Disposition: form-data; name="%b"' % (b"n" * 5000), 400),
        ("multipart/form-data; boundary=b", b"--b\r\nContent-Disposition: form-data\r\n\r\n\r\n--b--\r\n", 400),
        ("application/x-www-form-urlencoded", b"input=/etc/passwd&machine=gantry", 400),
    ],
)
def test_another_body_is_refused(server, kind, body, status):
    answer = server.send("POST", "/task/program", body, {"Content-Type": kind})
    assert answer.status == status, answer.text
    assert 'role="alert"' in answer.text


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "TRACE", "PATCH"])
def test_another_method_is_refused(server, method):
    assert server.send(method, "/task/program", b"", {}).status == 405


@pytest.mark.parametrize("machine", ["/etc/passwd", "../mill.toml", "none", "", "dmu50\0", "-m", "--plugin=x"])
def test_a_machine_is_one_of_the_list(server, machine):
    answer = server.post("/task/program", [("input", Upload("a.nc", REFUSED)), ("machine", machine)])
    if machine:
        assert answer.status == 400
        assert "Machine: choose one of" in answer.text
    else:
        job = answer.headers["location"].partition("#")[0]
        assert server.over(job) == "refused"
        assert "--machine NAME is missing" in server.get(job).text


def test_what_the_form_does_not_have_is_not_passed_on(server, tmp_path):
    """Options that name files take uploads only, and values cannot become options."""
    target = tmp_path / "written"
    unknown = [
        (name, str(target)) for name in ("output", "json", "report", "subprograms", "plugin", "height_map", "db")
    ]
    others = [("calibration", "/etc/passwd"), ("tool_table", "/etc/passwd"), ("work_offset", f"--output={target}")]
    job = server.start("program", ("input", Upload("a.nc", REFUSED)), ("machine", "gantry"), *unknown, *others)
    assert server.over(job) == "refused"
    shown = server.get(job).text
    assert f"--work-offset --output={target}: " in shown
    assert "passwd" not in shown
    assert "root:" not in shown
    assert not target.exists()


@pytest.mark.parametrize("task", TASKS)
def test_no_text_of_a_form_names_a_file(task):
    fields = TASKS[task].fields((*TASKS[task].shown, *TASKS[task].folded), {"machine": lambda: ["gantry"]})
    assert [
        each.name
        for each in fields
        if each.kind in ("text", "lines") and (each.declared.field.metadata.get("reads") or each.declared.writes)
    ] == []
    assert {field_of(TASKS[task].declared[each.name], {}).kind for each in fields if each.kind == "file"} <= {"file"}


def test_a_program_of_another_folder_is_not_read(server):
    (server.folder / "secret.ngc").write_text("o<secret> sub\nG1 X123 F100\no<secret> endsub\nM2\n")
    for called in ("../secret", "../../secret", str(server.folder / "secret")):
        program = f"G21 G90 G54\nG0 X0 Y0 Z0\no<{called}> call\nM2\n".encode()
        job = server.start("program", ("input", Upload("a.ngc", program)), ("machine", "gantry"), ("set_up_zero", "on"))
        assert server.over(job) == "refused"
        assert "X123" not in server.get(f"{job}/page").text
    (server.folder / "secret.ngc").unlink()


def test_every_answer_forbids_scripts_of_others(server, corrected):
    for path in ("/task/program", "/nothing", "/static/serve.js", corrected, f"{corrected}/state"):
        headers = server.get(path).headers
        policy = headers["content-security-policy"]
        assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self';")
        assert "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["cross-origin-resource-policy"] == "same-origin"
        assert "access-control-allow-origin" not in headers
        assert "server" not in headers
    for path in (f"{corrected}/page", f"{corrected}/files/result-correct.html"):
        policy = server.get(path).headers["content-security-policy"]
        assert policy.startswith("sandbox allow-scripts allow-downloads; default-src 'none';")
    page = server.get("/task/program").text
    assert re.findall(r"<script(?! src=)|<style| style=| on\w+=|https?:", page) == []


def test_a_job_is_stopped_with_its_process(server):
    program = b"G21 G90 G54\nT1 M6\n" + b"".join(b"G1 X%d Y%d Z0 F500\n" % (k % 60, k % 50) for k in range(45_000))
    job = server.start("program", ("input", Upload("long.nc", program + b"M30\n")), *SET_UP)
    while json.loads(server.get(f"{job}/state").body)["state"] == "waiting":
        time.sleep(0.02)
    end = time.monotonic() + 20.0
    while not (running := processes_in(server.folder / job.rpartition("/")[2])) and time.monotonic() < end:
        time.sleep(0.02)
    assert running
    assert server.post(f"{job}/stop").status == 303
    assert "Stopped: nothing was written." in server.get(job).text
    while processes_in(server.folder / job.rpartition("/")[2]) and time.monotonic() < end:
        time.sleep(0.05)
    assert processes_in(server.folder / job.rpartition("/")[2]) == []
    assert not list(server.folder.rglob(f"{job.rpartition('/')[2]}/output.nc"))


def processes_in(folder):
    """The processes whose present folder has this name."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if (process / "cwd").readlink().name == folder.name:
                found.append(process.name)
        except OSError:
            continue
    return found


@pytest.mark.statistical
def test_results_are_removed_after_a_time_and_all_at_the_end(tmp_path):
    server = Serving(tmp_path, "--keep-minutes", "0.01", "--jobs", "1")
    job = server.start("program", ("input", Upload("a.nc", REFUSED)), ("machine", "gantry"))
    end = time.monotonic() + 30.0
    while server.get(job).status == 200 and time.monotonic() < end:
        time.sleep(0.1)
    assert server.get(job).status == 404
    assert server.files() == []
    server.start("program", ("input", Upload("a.nc", REFUSED)), ("machine", "gantry"))
    assert server.close() == 0
    assert list(tmp_path.iterdir()) == []


def test_without_the_token_nothing_is_shown(guarded):
    for path in ("/", "/task/program", "/machines", "/watch", "/jobs", "/static/serve.js", "/nothing"):
        answer = guarded.get(path, Cookie="")
        assert answer.status == 401
        assert "This page needs the token" in answer.text
    assert (
        guarded.post("/task/program", [("machine", "gantry")], Cookie="ncomp_token=wrong-token-of-somebody").status
        == 401
    )
    assert guarded.get("/task/program?token=wrong-token-of-somebody", Cookie="").status == 401
    assert TOKEN not in guarded.get("/", Cookie="").text


def test_the_token_opens_the_page(guarded):
    answer = guarded.get(f"/task/program?token={TOKEN}", Cookie="")
    assert (answer.status, answer.headers["location"]) == (303, "/task/program")
    assert answer.headers["set-cookie"] == f"ncomp_token={TOKEN}; HttpOnly; SameSite=Strict; Path=/"
    answer = guarded.post("/login", [("token", TOKEN)], Cookie="")
    assert answer.headers["set-cookie"].startswith(f"ncomp_token={TOKEN};")
    assert guarded.post("/login", [("token", "wrong")], Cookie="").status == 401
    assert guarded.get(f"//evil.example/?token={TOKEN}", Cookie="").headers["location"] == "/evil.example/"
    assert guarded.get("/task/program").status == 200


def test_other_computers_need_a_token(tmp_path):
    server = Serving(tmp_path, "--host", "0.0.0.0")
    token = server.line.split("token=")[1].split()[0]
    assert len(token) >= 32
    assert server.get("/task/program").status == 401
    server.cookie = f"ncomp_token={token}"
    assert server.get("/task/program").status == 200
    assert server.get("/task/program", Host="evil.example:80").status == 421
    server.close()


@pytest.mark.statistical
def test_the_trend_of_a_machine(guarded):
    assert "4, 2026-01-01 to 2026-04-01" in guarded.get("/machines").text
    assert guarded.post("/task/history", [("machine", "dmu50")]).status == 400
    job = guarded.start("history", ("machine", "gantry"), ("limit", "squareness X-Y=0.02mm/300mm"))
    assert guarded.over(job) == "done", guarded.get(job).text
    page = guarded.get(f"{job}/page").text
    assert "Measure squareness X-Y again" in page or "stays within" in page


def test_the_log_of_a_watch(guarded):
    page = guarded.get("/watch").text
    assert "1 refused; last line 2026-11-30 10:00:01." in " ".join(page.split())
    assert "&lt;script&gt;x&lt;/script&gt;:4: G234\nits cure" in page
    assert page.index("10:00:01") < page.index("watching posted")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--token", "short"), "--token: expected 16 letters, digits, - and _ or more"),
        (("--machines", "nowhere"), "--machines nowhere: there is no such folder"),
        (("--host", "203.0.113.7"), "--host 203.0.113.7: this is no address of this computer"),
        (("--db", "none.sqlite"), "history none.sqlite: there is no such database"),
    ],
)
def test_what_cannot_be_served_is_refused_with_its_cure(command, options, message):
    done = command("serve", "--port", "0", *options)
    assert done.status == 2
    assert message in done.err


def test_a_port_in_use_is_named(server, command):
    done = command("serve", "--port", str(server.port))
    assert done.status == 2
    assert f"--port {server.port}: another program uses this port" in done.err
    assert "--port 0 takes a free one" in done.err


def test_a_missing_package_is_named(command, monkeypatch):
    monkeypatch.setitem(sys.modules, "starlette", None)
    done = command("serve")
    assert done.status == 2
    assert "ncomp serve needs the package starlette: pip install 'ncomp[serve]'" in done.err


@pytest.mark.statistical
def test_progress_is_written_for_other_programs(tmp_path, monkeypatch):
    monkeypatch.setenv("NCOMP_PROGRESS", str(tmp_path / "progress"))
    data = tmp_path / "data.csv"
    succeed("simulate", "--machine", "gantry", "--strategy", "grid", "--points", "125", "-o", data)
    assert (
        run_command("fit", data, "--machine", "gantry", "--basis", "legendre:2", "-o", tmp_path / "c.json").status == 0
    )
    share, _, step = (tmp_path / "progress").read_text().partition("\t")
    assert step
    assert not share or 0.0 <= float(share) <= 1.0
