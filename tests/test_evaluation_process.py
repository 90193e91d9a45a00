"""Processes beside the first one: the same results, the same refusals, and a whole output or none."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import strategies as st
from support.child_processes import children
from support.no_process import Here
from support.program_runs import corrected, job_of, programs
from support.programs import correct, load, model_of, random_model, setup_of, source_of
from support.tiers import drawn, quick

from kinematics.effects import LocationError
from kinematics.error_model.model import write_model
from kinematics.running.child_process import GIVES_WAY, ChildProcess, LostProcess
from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.evaluation.guard import Guard, WorseMove

GANTRY, DMU50 = load("gantry"), load("dmu50")
RUN = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from postproc.cli import run; run()"
"""The command; a shell's background processes ignore SIGINT, and so do those that they start."""
THREAD = "import threading; threading.Thread(target=threading.Event().wait, daemon=True).start(); "
"""Begin of a program with a second thread, which starts its processes as new interpreters instead of forks."""
HEAD = "G21 G90 G17 G54 G94\nG0 X100. Y100. Z100.\n"
LONG = HEAD + "G1 X200. F500\nX100.\nY300.\nX150.\nY100.\n" * 800_000 + "M30\n"
"""Many times longer in work than processes need to begin, on a machine with other work too."""
MOVES = "G1 X30. Y30. Z41. B5. C9. F100\nX20.\nX40. C30.\nG2 X45. I2.5 J0.\nG1 X30. Y31.\n"
ROOT = Path(__file__).parents[1]
PATIENCE_S = 300.0
"""Time after which a process hangs, also on a computer with much other work."""
NEEDS_PROC = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are found in /proc")


@pytest.fixture(name="always")
def _always(monkeypatch):
    """Programs of any size are evaluated in a second process."""
    monkeypatch.setattr("postproc.correct.pipeline.SECOND_PROCESS_BYTES", 0)


@drawn(
    4,
    20,
    300,
    program=programs(),
    seed=st.integers(0, 99),
    size=st.sampled_from([1, 7, 4096]),
    piece=st.sampled_from([1, 7, 100, 1 << 20]),
)
def test_the_results_are_those_of_one_process(program, seed, size, piece):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.execution.CHUNK_BLOCKS", size)
        alone = corrected(job_of(program, seed))
        patch.setattr("postproc.correct.pipeline.SECOND_PROCESS_BYTES", 0)
        patch.setattr("postproc.evaluation.evaluation_process.ChildProcess", Here)
        patch.setattr("postproc.read_ahead.ChildProcess", Here)
        patch.setattr("postproc.text.source.PIECE", piece)
        assert corrected(job_of(program, seed), processes=2) == alone


@drawn(4, 60, 300, program=programs(), seed=st.integers(0, 99))
def test_the_errors_before_are_those_that_the_correction_has_found(program, seed):
    with pytest.MonkeyPatch.context() as patch:
        found = corrected(job_of(program, seed))
        patch.setattr("postproc.correct.steps.correction.ErrorsBefore", SimpleNamespace(of=lambda _: None))
        assert corrected(job_of(program, seed)) == found


@pytest.mark.usefixtures("always")
@pytest.mark.parametrize("head", quick(["", "G43.4 H1\n"], ["G43.4 H1\n"]), ids=["axes", "tcp"])
def test_a_process_gives_the_results_of_one(head, monkeypatch):
    monkeypatch.setattr("postproc.execution.CHUNK_BLOCKS", 50)
    monkeypatch.setattr("postproc.text.source.PIECE", 300)
    text = f"{HEAD}T1 M6\nG0 X60 Y0 Z200 B0 C0\n{head}{MOVES * 40}"
    job = Job(source_of(text), find_dialect("iso", "", ""), DMU50, random_model(DMU50, 4), setup_of(DMU50, tools=["T1=80"]),
              travel_check=False, accepted=frozenset({"worse", "outside"}))  # fmt: skip
    alone = corrected(job)
    assert "text" in alone
    assert corrected(job, processes=2) == alone


@pytest.mark.usefixtures("always")
@pytest.mark.parametrize("size", [1, 2, 100])
@pytest.mark.parametrize("last", ["M30\n", "G1 X5. Q9 ?\n", "#1=#2+1\nX#1\n"], ids=["end", "unknown", "unresolved"])
def test_the_first_move_that_is_worse_is_refused(last, size, monkeypatch):
    """Before a later block that is refused as well, whenever its evaluation ends."""
    worse, check = {}, Guard.check_ends

    def found(guard, motions, lines, rows, errors):
        check(guard, motions, lines, rows, errors)
        for row in rows.tolist():
            if lines[row] in worse:
                raise WorseMove(int(motions.block[row]), worse[lines[row]])

    monkeypatch.setattr(Guard, "check_ends", found)
    monkeypatch.setattr("postproc.evaluation.evaluation_process.ChildProcess", Here)
    monkeypatch.setattr("postproc.read_ahead.ChildProcess", Here)
    monkeypatch.setattr("postproc.execution.CHUNK_BLOCKS", size)
    worse.update({4: "the first", 5: "the second"})
    text = f"{HEAD}G1 X200. F500\nX210.\nX220.\nX230.\n{last}"
    messages = []
    for processes in (1, 2):
        job = Job(source_of(text), find_dialect("iso", "", ""), GANTRY, model_of(GANTRY, LocationError("C", "Y", 90.0)),
                  setup_of(GANTRY))  # fmt: skip
        with pytest.raises(UserError) as refusal:
            Pipeline(job, processes=processes).run(_Nowhere(), lambda _: None)
        messages.append(str(refusal.value))
    assert messages[0] == messages[1]
    if size <= 2 or last == "M30\n":
        assert ":4: 'X210.': the first" in messages[0]


class _Nowhere:
    def write(self, data):
        return len(data)


# ---- the process itself


class Total:
    """Adds numbers; refuses those below zero, fails for a text, and ends its process at 13."""

    def __init__(self):
        self.sum = 0

    def __call__(self, number):
        if number == 13:
            os.kill(os.getpid(), signal.SIGKILL)
        if number < 0:
            raise UserError(f"{number} is below zero")
        self.sum += number
        return self.sum


@pytest.fixture(name="total")
def _total():
    process = ChildProcess(Total())
    yield process
    process.end()


def test_tasks_are_done_in_order_and_their_faults_come_back(total):
    for number in (1, 2, -4, "text", 5):
        total.give(number)
    assert total.answer() == 1
    assert total.answer() == 3
    with pytest.raises(UserError, match="-4 is below zero"):
        total.answer()
    with pytest.raises(TypeError, match="not supported") as fault:
        total.answer()
    assert any("__call__" in note for note in fault.value.__notes__)
    assert total.answer() == 8


def test_a_process_that_is_killed_is_lost(total):
    for number in (1, 13, 2):
        total.give(number)
    assert total.answer() == 1
    for _ in range(2):
        with pytest.raises(LostProcess):
            total.answer()
    total._process.join()
    with pytest.raises(LostProcess):
        total.give(3)


STOPPED_AT_THE_START = """
import multiprocessing.util, signal, sys
from kinematics.running.child_process import ChildProcess
spawn = multiprocessing.util.spawnv_passfds
def spawn_and_stop(*words):
    process = spawn(*words)
    if "spawn_main" in str(words):  # not the one that keeps account of resources
        signal.raise_signal(signal.SIGTERM)
    return process
multiprocessing.util.spawnv_passfds = spawn_and_stop
signal.signal(signal.SIGTERM, lambda number, _: sys.exit(3))
ChildProcess(len)
"""


STOPPED_AT_THE_FORK = """
import os, signal, sys
from kinematics.running.child_process import ChildProcess
fork = os.fork
def fork_and_stop():
    process = fork()
    if process:
        signal.raise_signal(signal.SIGTERM)
    return process
os.fork = fork_and_stop
signal.signal(signal.SIGTERM, lambda number, _: sys.exit(3))
ChildProcess(len)
"""


@pytest.mark.parametrize(
    "program",
    [THREAD + STOPPED_AT_THE_START, pytest.param(STOPPED_AT_THE_FORK, marks=NEEDS_PROC)],
    ids=["interpreter", "fork"],
)
def test_a_stop_while_the_process_starts_ends_both_without_a_traceback(program):
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False, cwd=ROOT)
    assert (ended.returncode, ended.stderr) == (3, b"")


ENDED_AT_ONCE = """
import os, signal, sys, time
from kinematics.running.child_process import ChildProcess
fork = os.fork
def slow_fork():
    process = fork()
    if not process:
        time.sleep(0.3)
    return process
os.fork = slow_fork
signal.signal(signal.SIGTERM, lambda number, _: sys.exit(3))
ChildProcess(len).end()
"""


@NEEDS_PROC
def test_a_process_that_has_just_begun_ends_at_once():
    """It still ignores the signal then."""
    words = [sys.executable, "-c", ENDED_AT_ONCE]
    ended = subprocess.run(words, capture_output=True, check=False, cwd=ROOT, timeout=PATIENCE_S)
    assert (ended.returncode, ended.stderr) == (0, b"")


# ---- killed


def evaluating(process: int) -> set[int]:
    """Those of them that evaluate moves."""
    found = set()
    for child in children(process):
        try:
            words = Path(f"/proc/{child}/cmdline").read_text()
        except (FileNotFoundError, ProcessLookupError):
            continue
        found |= {child} if "resource_tracker" not in words else set()
    return found


def begun(process: int) -> set[int]:
    """Those of them that wait for tasks already, which gives them a lower priority."""
    theirs = min(_niceness(process) + GIVES_WAY, 19)
    return {child for child in evaluating(process) if _niceness(child) == theirs}


def _niceness(process: int) -> int | None:
    with suppress(FileNotFoundError, ProcessLookupError):
        return int(Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[16])
    return None


def wait_until(true):
    end = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.fixture(name="started", params=["fork", "interpreter"])
def _started(request, tmp_path, monkeypatch):
    """A long program in work, with processes that read and evaluate, and some of the output written."""
    run = RUN if request.param == "fork" else THREAD + RUN
    write_model(model_of(GANTRY, LocationError("C", "Y", 100.0)), tmp_path / "cal.json")
    (tmp_path / "in.nc").write_text(LONG)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    words = [sys.executable, "-c", run, "in.nc", "-m", "gantry", "-c", "cal.json", "--set-up-zero", "-o", "out.nc",
             "--jobs", "2", "--json", "out.json"]  # fmt: skip
    with subprocess.Popen(words, stderr=subprocess.PIPE) as process:
        wait_until(lambda: len(begun(process.pid)) == 2)
        forked = {"spawn_main" not in Path(f"/proc/{child}/cmdline").read_text() for child in begun(process.pid)}
        assert forked == {request.param == "fork"}
        yield process
        process.kill()


def names() -> set[str]:
    return {path.name for path in Path().iterdir()}


@NEEDS_PROC
def test_a_lost_process_ends_the_run_with_a_message_and_without_an_output(started):
    for child in evaluating(started.pid):
        os.kill(child, signal.SIGKILL)
    assert started.wait(PATIENCE_S) == 2
    said = started.stderr.read().decode()
    assert "the process that evaluates the corrected moves was ended from outside" in said
    assert said.count("\n") == 1
    assert names() == {"in.nc", "cal.json"}


@NEEDS_PROC
@pytest.mark.parametrize("stop", quick([signal.SIGKILL, signal.SIGTERM, signal.SIGINT], [signal.SIGKILL]))
def test_the_process_ends_with_the_first_one(started, stop):
    family = children(started.pid)
    started.send_signal(stop)
    assert started.wait(PATIENCE_S) == (-stop if stop == signal.SIGKILL else 128 + stop)
    assert b"Traceback" not in started.stderr.read()
    wait_until(lambda: not any(Path(f"/proc/{child}/cmdline").exists() and _runs(child) for child in family))
    left = names() - {"in.nc", "cal.json"}
    assert not left if stop != signal.SIGKILL else not {"out.nc", "out.json"} & left


def _runs(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_a_short_program_starts_no_process(monkeypatch):
    monkeypatch.setattr("kinematics.running.child_process.ChildProcess.__init__", lambda *_: 1 / 0)
    assert correct(HEAD + MOVES.replace("B5. C9.", "").replace("C30.", ""), GANTRY, model_of(GANTRY)).text
