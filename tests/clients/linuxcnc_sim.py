"""LinuxCNC's simulator, without a screen: its kinematics, compensation tables and backlash (Debian linuxcnc-uspace).

`at_rest` carries out MDI blocks and says where joints, motors and axes stand after each; `run` says where they are in
every servo cycle (1 ms) of an NC program. Each starts a machine of its own from a `Config`, homed where it stands at
zero, in mm and degrees, and ends it: 1 s on top of the moves, which take their real time.

    table = Table("0 0 0\\n500 0.01 0.02\\n", kind=1)
    config = Config("XYZ", tables={"Z": table}, backlash={"X": 0.02}, velocity=500.0, acceleration=2000.0)
    samples = run(config, "G1 X30 Z100 F3000\\nX0\\nM2\\n")
    samples.motor - samples.joint

What LinuxCNC 2.9~pre1 does, measured (`test_linuxcnc_sim.py` holds it to this):

- motor = joint + correction. After a reversal the correction reaches the motor through a ramp of half the joint's
  acceleration and velocity: 20 um in 10 cycles at 2000 mm/s2.
- BACKLASH b: the correction is +b/2 while the joint moves up and -b/2 while it moves down, so the motor gains b at a
  reversal from down to up. It is 0 from the start until the first move. A negative b is taken as it is.
- Table of type 1: the correction is column 2 on the way up, column 3 on the way down. Type 0: column 1 - column 2 and
  column 1 - column 3. Linear between rows, the end values outside. BACKLASH of that joint is ignored. The differences
  of type 0 are taken in double precision, then positions and corrections are kept in single (4e-9 mm in 0.03 mm).
- Direction is the sign of the joint's velocity, which can turn one cycle before its position does. At rest the
  correction is that of the last moving cycle: of a table, the value a little short of the target, by less the smaller
  the acceleration. `Config` accelerates very hard, for quick poses; give tables and backlash a real machine's values.
- At an exact stop `axis` passes through the corner; `joint` follows 2 cycles later as a spline and rounds it by
  acceleration * (1 ms)^2 / 12, unless the program dwells there (G4 P0.01).
"""

import contextlib
import fcntl
import functools
import json
import os
import re
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clients.rs274 import MODULES, SYSTEM_PYTHON

DISPLAY = Path(__file__).with_name("sim") / "display.py"
NOBODY = 65534  # LinuxCNC's real-time part refuses to run as root
GRACE = 20.0  # s for LinuxCNC to start and stop, on top of the time for its work
ISOLATED = ("unshare", "--mount", "--ipc", "--pid", "--net", "--fork", "--mount-proc", "--kill-child")
ATTEMPTS = 3
"""At a simulation in which LinuxCNC had a fault of its own."""
OWN_FAULTS = (
    "Segmentation fault",  # of its Python module, while it starts or stops
    "Queue is not empty after probing",  # a block is read before the move has begun: LinuxCNC issue 3650
)
SHARED_LOCK = Path("/tmp/linuxcnc.lock")  # LinuxCNC's own
CHATTER = re.compile(  # what it prints in every run
    r"$|task: |Note: Using POSIX|Running with fallback_uid|Machine configuration file|Starting LinuxCNC|Shutting down|"
    r"linuxcnc TPMOD|Found file|LinuxCNC terminated with|\s+/var/tmp/|and$|as well as in the output"
)
SAMPLER_DEPTH = 30_000  # servo cycles between start-up and the first look at the samples

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Table:
    """A compensation table: the text of a COMP_FILE and its COMP_FILE_TYPE."""

    text: str
    kind: int = 1


@dataclass(frozen=True)
class Config:
    """A machine: one joint per letter of `joints`, in the order of the kinematics module."""

    axes: str
    kinematics: str = "trivkins"
    hal: Sequence[str] = ()
    """HAL commands, to set and connect pins of the kinematics."""
    tables: Mapping[str, Table] = field(default_factory=dict)
    """Compensation tables by axis letter."""
    backlash: Mapping[str, float] = field(default_factory=dict)
    """BACKLASH by axis letter, mm or degrees; LinuxCNC ignores that of a joint with a table."""
    tools: Mapping[int, float] = field(default_factory=dict)
    """Tool lengths, mm, by number."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Further files beside the configuration, by name; those that begin with #! can be started by `hal`."""
    written: Sequence[str] = ()
    """Names of files that the program writes, as of a probe's log."""
    velocity: float = 20_000.0
    """Velocity of every axis and joint, in units of length or degrees, per second."""
    acceleration: float = 200_000.0
    gantry: str = ""
    """The letter of the axis that each joint moves, where two move one; otherwise `axes`."""
    unit: str = "mm"
    """LINEAR_UNITS: of all lengths here and in `Samples`."""
    of_joints: Mapping[int, str] = field(default_factory=dict)
    """Further lines of the section of a joint in the INI file."""

    @property
    def joints(self) -> str:
        """The letter of the axis that each joint moves."""
        return self.gantry or self.axes


@dataclass(frozen=True)
class Samples:
    """Positions in mm and degrees, one column per joint or axis in the order of `Config`, one row per instant."""

    joint: Array
    """Commands behind the kinematics, `joint.N.pos-cmd`."""
    motor: Array
    """Commands to the motors: joint + correction, the latter through a ramp. `joint.N.motor-pos-cmd`."""
    axis: Array
    """Commands in front of the kinematics, `axis.L.pos-cmd`: machine coordinates."""
    correction: Array
    """By table or backlash, before the ramp, `joint.N.backlash-corr`."""
    texts: Mapping[str, str] = field(default_factory=dict)
    """Files that the program has written, by name (`Config.written`)."""


class SimulatorError(Exception):
    """LinuxCNC did not do what was asked; the text is what it said."""


class OwnFault(SimulatorError):
    """A fault that LinuxCNC has now and then, whatever it is asked."""


def available() -> bool:
    """Whether the simulator is on this computer."""
    modules = (any(MODULES.glob(f"{name}.*.so")) for name in ("linuxcnc", "_hal"))
    return shutil.which("linuxcnc") is not None and all(modules) and Path(SYSTEM_PYTHON).exists()


def at_rest(config: Config, blocks: Sequence[str], *, timeout: float = 60.0) -> Samples:
    """Carry out MDI blocks one by one; one row for each, when the machine has come to rest."""
    return _simulate(config, timeout, {"blocks": list(blocks)})


def run(config: Config, program: str, *, feed_override: float = 1.0, timeout: float = 60.0) -> Samples:
    """Run an NC program in exact-stop mode (G61.1), unless it says otherwise; one row for each servo cycle of 1 ms.

    The first rows are from before the first move, the last ones from when everything, corrections included, is at rest.
    """
    job = {"program": "program.ngc", "feed_override": feed_override}
    return _simulate(config, timeout, job, {"program.ngc": program})


def _simulate(config: Config, timeout: float, job: dict[str, Any], files: Mapping[str, str] | None = None) -> Samples:
    """What LinuxCNC did. A run in which it had a fault of its own is repeated."""
    for _ in range(ATTEMPTS - 1):
        with contextlib.suppress(OwnFault):
            return _simulate_once(config, timeout, dict(job), files)
    return _simulate_once(config, timeout, dict(job), files)


def _simulate_once(config: Config, timeout: float, job: dict[str, Any], files: Mapping[str, str] | None) -> Samples:
    channels = _channels(config)
    columns = [len(pins) for pins in channels.values()]
    job |= {"channels": columns, "seconds": timeout}
    files = {**_files(config, channels), **(files or {}), "job.json": json.dumps(job)}
    with _workplace() as folder:
        for name, text in files.items():
            (folder / "config" / name).write_text(text, encoding="utf-8", newline="")
            (folder / "config" / name).chmod(0o755 if text.startswith("#!") else 0o644)
        shutil.copy(DISPLAY, folder / "config" / "display.py")
        (folder / "config" / "display.py").chmod(0o755)
        _execute(folder, timeout + GRACE)
        rows = np.fromfile(folder / "config" / "samples.bin").reshape(-1, sum(columns))
        texts = {name: _text(folder, name) for name in config.written}
    parts = np.split(rows, np.cumsum(columns)[:-1], axis=1)
    return Samples(**dict(zip(channels, parts, strict=True)), texts=texts)


def _text(folder: Path, name: str) -> str:
    """The text of a file that LinuxCNC has written somewhere in its folder."""
    (path,) = folder.rglob(name)
    return path.read_text(encoding="utf-8")


# --- the configuration


def _channels(config: Config) -> dict[str, list[str]]:
    """What is sampled: the HAL pins of each field of `Samples`."""
    joints = range(len(config.joints))
    return {
        "joint": [f"joint.{j}.pos-cmd" for j in joints],
        "motor": [f"joint.{j}.motor-pos-cmd" for j in joints],
        "axis": [f"axis.{letter.lower()}.pos-cmd" for letter in config.axes],
        "correction": [f"joint.{j}.backlash-corr" for j in joints],
    }


def _files(config: Config, channels: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """The files that LinuxCNC reads, by name."""
    tools = enumerate(sorted(config.tools.items()), 1)
    return {
        "sim.ini": _ini(config),
        "sim.hal": _hal(config, channels),
        "sim.tbl": "".join(f"T{number} P{pocket} Z{length!r}\n" for pocket, (number, length) in tools),
        "sim.var": "",
        **{f"{letter}.comp": table.text for letter, table in config.tables.items()},
        **config.files,
    }


def _ini(config: Config) -> str:
    kinematics = config.kinematics
    if kinematics == "trivkins":
        kinematics += f" coordinates={config.joints}" + (" kinstype=BOTH" if config.gantry else "")
    limits = (
        "MIN_LIMIT = -1e6\nMAX_LIMIT = 1e6\n"
        f"MAX_VELOCITY = {config.velocity!r}\nMAX_ACCELERATION = {config.acceleration!r}\n"
    )
    text = f"""\
[EMC]
VERSION = 1.1
[DISPLAY]
DISPLAY = ./display.py
MAX_FEED_OVERRIDE = 1000
[TASK]
TASK = milltask
CYCLE_TIME = 0.001
[RS274NGC]
PARAMETER_FILE = sim.var
[EMCMOT]
EMCMOT = motmod
SERVO_PERIOD = 1000000
[EMCIO]
EMCIO = io
CYCLE_TIME = 0.01
TOOL_TABLE = sim.tbl
[HAL]
HALFILE = sim.hal
[KINS]
KINEMATICS = {kinematics}
JOINTS = {len(config.joints)}
[TRAJ]
COORDINATES = {config.joints}
LINEAR_UNITS = {config.unit}
ANGULAR_UNITS = degree
NO_FORCE_HOMING = 1
MAX_LINEAR_VELOCITY = {config.velocity!r}
DEFAULT_LINEAR_VELOCITY = {config.velocity!r}
MAX_ANGULAR_VELOCITY = {config.velocity!r}
DEFAULT_ANGULAR_VELOCITY = {config.velocity!r}
"""
    text += "".join(f"[AXIS_{letter}]\n{limits}" for letter in config.axes)
    for joint, letter in enumerate(config.joints):
        text += f"[JOINT_{joint}]\n{limits}"
        text += f"TYPE = {'ANGULAR' if letter in 'ABC' else 'LINEAR'}\nFERROR = 1e6\nMIN_FERROR = 1e6\n"
        text += "HOME_SEQUENCE = 0\n"  # and no search velocity: homed where it stands
        if letter in config.backlash:
            text += f"BACKLASH = {config.backlash[letter]!r}\n"
        if letter in config.tables:
            text += f"COMP_FILE = {letter}.comp\nCOMP_FILE_TYPE = {config.tables[letter].kind}\n"
        text += config.of_joints.get(joint, "")
    return text


def _hal(config: Config, channels: Mapping[str, Sequence[str]]) -> str:
    samplers = range(len(channels))
    depth = ",".join([str(SAMPLER_DEPTH)] * len(channels))
    columns = ",".join("f" * len(pins) for pins in channels.values())
    lines = [
        "loadrt [KINS]KINEMATICS",
        "loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS",
        f"loadrt sampler depth={depth} cfg={columns}",
        "addf motion-command-handler servo-thread",
        "addf motion-controller servo-thread",
        *(f"addf sampler.{i} servo-thread" for i in samplers),
        "net enable iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in",
        "net tool-prepare iocontrol.0.tool-prepare => iocontrol.0.tool-prepared",
        "net tool-change iocontrol.0.tool-change => iocontrol.0.tool-changed",
    ]
    for sampler, (quantity, pins) in enumerate(channels.items()):
        for column, pin in enumerate(pins):
            feedback = f" joint.{column}.motor-pos-fb" if quantity == "motor" else ""
            lines.append(f"net {quantity}-{column} {pin} => sampler.{sampler}.pin.{column}{feedback}")
    return "\n".join([*lines, *config.hal, ""])


# --- running it


@contextlib.contextmanager
def _workplace() -> Iterator[Path]:
    """A folder of its own. Its path is short, for a socket in it, and not below /tmp, which an isolated run covers."""
    with tempfile.TemporaryDirectory(prefix="ncomp-sim-", dir="/var/tmp") as name:
        folder = Path(name)
        folder.chmod(0o755)
        for part, mode in {"config": 0o755, "home": 0o755, "fifo": 0o777, "tmp": 0o1777}.items():
            (folder / part).mkdir()
            (folder / part).chmod(mode)
        yield folder


@functools.cache
def _can_isolate() -> bool:
    """Whether a run may have its own processes, shared memory, network and /tmp."""
    try:
        return subprocess.run([*ISOLATED, "true"], capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        return False


def _execute(folder: Path, timeout: float) -> None:
    """Run LinuxCNC on the configuration in the folder; SimulatorError, with what it said, unless it did the job.

    Two LinuxCNC on one computer share a lock, shared memory, a port and the tool memory in HOME, and end each other by
    name. So each runs isolated from the others, or one at a time where that is not permitted.
    """
    environment = {
        "HOME": str(folder / "home"),
        "PATH": os.environ.get("PATH", os.defpath),
        "LC_ALL": "C.UTF-8",
        "RTAPI_FIFO_PATH": str(folder / "fifo" / "rtapi"),
    }
    if os.geteuid() == 0:
        environment["RTAPI_UID"] = str(NOBODY)
    command = ["linuxcnc", "-r", str(folder / "config" / "sim.ini")]
    if _can_isolate():
        # a servo thread that was kept waiting makes up for its cycles at once, too fast for other processes to react
        first = "{ echo -20 >/proc/self/autogroup; } 2>/dev/null"
        cover = f'{first}; mount --bind "$0" /tmp && exec "$@"'
        said, ended = _call([*ISOLATED, "sh", "-c", cover, str(folder / "tmp"), *command], environment, folder, timeout)
    else:
        with _alone():
            said, ended = _call(command, environment, folder, timeout)
    try:
        messages = json.loads((folder / "config" / "messages.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        messages = ["ended before its work was done" if ended else f"did not end within {timeout:.0f} s"]
    if messages:
        raise _error(messages, said)


def _error(messages: Sequence[str], said: str) -> SimulatorError:
    """Messages of the run and what LinuxCNC printed, as an error."""
    lines = (line.strip() for line in said.splitlines() if not CHATTER.match(line))
    text = "LinuxCNC: " + "\n  ".join(dict.fromkeys([*messages, *lines]))
    return OwnFault(text) if any(fault in text for fault in OWN_FAULTS) else SimulatorError(text)


def _call(command: Sequence[str], environment: Mapping[str, str], folder: Path, timeout: float) -> tuple[str, bool]:
    """What the command printed, and whether it ended in time. All it started has ended when this returns."""
    process = subprocess.Popen(
        command,
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        start_new_session=True,
    )
    with process:
        try:
            # LinuxCNC's servers hold the pipe too: it ends with the last of them.
            return process.communicate(timeout=timeout)[0], True
        except subprocess.TimeoutExpired:
            return _stopped(process, folder), False
        except BaseException:
            _stopped(process, folder)
            raise


def _stopped(process: subprocess.Popen[str], folder: Path) -> str:
    """Stop LinuxCNC and return what it has printed. One that is not isolated is asked to end its servers first."""
    if not _can_isolate():
        os.killpg(process.pid, signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.communicate(timeout=GRACE)[0]
    for environment in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):  # ended, or another user's
            if os.fsencode(folder) in environment.read_bytes():
                os.kill(int(environment.parent.name), signal.SIGKILL)
    with contextlib.suppress(subprocess.TimeoutExpired):
        return process.communicate(timeout=GRACE)[0]
    return ""


@contextlib.contextmanager
def _alone() -> Iterator[None]:
    """Wait for the other simulators of this user; refuse to run beside any other LinuxCNC, which would be ended."""
    with (Path(tempfile.gettempdir()) / f"ncomp-sim-{os.geteuid()}.lock").open("w", encoding="ascii") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if SHARED_LOCK.exists():
            raise SimulatorError(f"{SHARED_LOCK} says that LinuxCNC is running: end it, or remove a left-over lock")
        try:
            yield
        finally:
            SHARED_LOCK.unlink(missing_ok=True)
