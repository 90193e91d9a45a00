"""CAM hooks: a hook that fails leaves nothing that looks like a corrected program."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from clients.freecad import FIVE_AXES, Post, macro_folder
from support.command import Done, succeed

from postproc.commands.programs.hook import HOOKS

NCOMP = str(Path(sys.executable).with_name("ncomp"))
SETUP = "--machine dmu50 --work-offset G54=-30,-20,150 --work-offset 0=-30,-20,150 --tool-length T1=80"
OLD = "(an older program of this name)\nM30\n"
STOCK = {
    "linuxcnc": "--no-header --precision=4",
    "grbl": "--no-header",
    "fanuc": "--no-header",
    "heidenhain": "",
    "mach3_mach4": "--no-header",
}
"""Stock posts of FreeCAD, with their arguments."""
LOW = f"--stock linuxcnc --ncomp {NCOMP} --machine dmu50 --work-offset G54=-30,-20,-40 --tool-length T1=80"
"""A part so low that Z reaches the clearance height only with a tool length, which FreeCAD programs after it."""
OUTSIDE = ("G0 X5000 Y0 Z60",)
FAULTS = {
    "refused program": (f"--stock linuxcnc --ncomp {NCOMP} {SETUP}", OUTSIDE, "X would go to 4970"),
    "clearance height without a tool": (LOW, (), "-14.0000 mm .* and no tool length in force"),
    "unknown machine": (f"--stock linuxcnc --ncomp {NCOMP} --machine nomill", (), "unknown machine 'nomill'"),
    "ncomp is missing": ("--stock linuxcnc --ncomp /nowhere/ncomp --machine dmu50", (), "cannot start /nowhere/ncomp"),
    "killed midway": ("--stock linuxcnc --ncomp KILLED --machine dmu50", (), "no program was written"),
    "unknown post": (f"--stock nopost --ncomp {NCOMP} {SETUP}", (), "unknown post 'nopost': FreeCAD has .*linuxcnc"),
    "calls itself": (f"--stock ncomp --ncomp {NCOMP} {SETUP}", (), "would call itself"),
    "argument of the stock post": (f"--stock heidenhain --ncomp {NCOMP} {SETUP} -- --nosuch", (), "does not accept"),
    "another output": (f"--stock grbl --ncomp {NCOMP} {SETUP} -o part.nc", (), "the output file is that of the Job"),
}
"""Arguments of the Job, lines of its custom operation, and the message, by fault."""


@pytest.fixture
def killed(tmp_path: Path) -> str:
    """A command that starts ncomp and kills it while it works."""
    return str(killer(tmp_path))


def killer(folder: Path) -> Path:
    """An ncomp that is killed soon after its start, and ends as a killed process does."""
    path = folder / "killed-ncomp"
    path.write_text(f'#!/bin/sh\n{NCOMP} "$@" &\nsleep 0.02\nkill -9 $!\nwait $!\n')
    path.chmod(0o755)
    return path


# ---- FreeCAD itself


@pytest.fixture(scope="module")
def posted(freecad: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str | None]]:
    """The folder of all posts below, made by one FreeCAD, and the fault of each."""
    home = tmp_path_factory.mktemp("freecad")
    succeed("hook", "freecad", "-o", macro_folder(home))
    posts = {}
    for name, arguments in STOCK.items():
        posts[f"stock {name}"] = Post(name, f"{arguments} --no-show-editor", f"{home}/stock_{name}.nc")
        ours = f"--stock {name} --ncomp {NCOMP} {SETUP} -- {arguments}"
        posts[name] = Post("ncomp", ours, f"{home}/{name}.nc")
    posts["five axes"] = Post("ncomp", f"--ncomp {NCOMP} {SETUP} -- --no-header", f"{home}/five.nc", FIVE_AXES)
    preamble = '--no-header "--preamble=G17 G54 G40 G80 G90 T1 M6 G43 H1"'  # as docs/cam/freecad.md has it
    posts["tool in the preamble"] = Post("ncomp", f"{LOW} -- {preamble}", f"{home}/low.nc")
    succeed("tutorial", home / "mill")
    options = "--machine mill.toml --calibration true.json -- --no-header"
    posts["relative paths"] = Post("ncomp", options, f"{home}/mill/block.nc")
    for name, (arguments, gcode, _) in FAULTS.items():
        output = home / f"{name}.nc"
        output.write_text(OLD)
        posts[name] = Post("ncomp", arguments.replace("KILLED", str(killer(home))), str(output), gcode or ("G0 Z60",))
    return home, dict(zip(posts, freecad.post_all(list(posts.values()), home), strict=True))


@pytest.mark.statistical
@pytest.mark.parametrize("name", STOCK)
def test_freecad_writes_the_corrected_program(posted: tuple[Path, dict[str, str | None]], name: str) -> None:
    folder, faults = posted
    assert faults[name] is None
    stock = folder / f"stock_{name}.nc"
    if not stock.exists():  # fanuc and heidenhain of FreeCAD 0.20 fail without the hook
        assert faults[f"stock {name}"] is not None
        assert "NCOMP" in (folder / f"{name}.nc").read_text()
        return
    (folder / "alone").mkdir(exist_ok=True)
    alone = folder / "alone" / f"{name}.nc"
    succeed(stock, "-o", alone, *SETUP.split())
    assert (folder / f"{name}.nc").read_bytes() == alone.read_bytes()
    assert alone.read_bytes() != stock.read_bytes()


def test_freecad_writes_five_axes(posted: tuple[Path, dict[str, str | None]]) -> None:
    folder, faults = posted
    assert faults["five axes"] is None
    assert re.search(r"^G1 X20\.\d+ Y\d+\.\d+ Z\d+\.\d+ B30\.125\d* C45\.5", (folder / "five.nc").read_text(), re.M)


def test_freecad_moves_to_the_clearance_height_with_a_tool_of_the_preamble(
    posted: tuple[Path, dict[str, str | None]],
) -> None:
    folder, faults = posted
    assert faults["tool in the preamble"] is None
    lines = (folder / "low.nc").read_text().splitlines()
    assert lines.index("G17 G54 G40 G80 G90 T1 M6 G43 H1") < next(i for i, each in enumerate(lines) if "Z" in each)


def test_freecad_finds_ncomp_and_files_beside_the_output(posted: tuple[Path, dict[str, str | None]]) -> None:
    folder, faults = posted
    assert faults["relative paths"] is None
    assert "(NCOMP " in (folder / "mill" / "block.nc").read_text()


@pytest.mark.statistical
@pytest.mark.parametrize("name", FAULTS)
def test_freecad_keeps_no_program_after_a_fault(posted: tuple[Path, dict[str, str | None]], name: str) -> None:
    folder, faults = posted
    assert re.search(FAULTS[name][2], faults[name] or "")
    left = folder / f"{name}.nc"
    assert not left.exists() or (left.read_text() == OLD and name in ("calls itself", "another output"))


# ---- NX, Fusion and the command for other CAMs, with the languages that they run in

POSTED = "G21 G90 G54\nT1 M6\nG43 H1\nG0 X10. Y10. Z5. B0 C0\nG1 X60. F500\nM30\n"
NX = """
proc MOM_end_of_program {{}} {{ puts $::file "M30"; set ::ended 1 }}
proc MOM_close_output_file {{ name }} {{ close $::file }}
proc MOM_abort {{ text }} {{ puts "ABORT $text"; exit 1 }}
proc MOM_output_to_listing_device {{ text }} {{ puts $text }}
proc PB_CMD_ncomp {{}} {{ source {hook} }}
PB_CMD_ncomp
set ncomp_command [list {ncomp}]
set ncomp_options [list {options}]
set mom_output_file_full_name {posted}
set file [open $mom_output_file_full_name w]
puts -nonewline $file [string map {{"M30\\n" ""}} {{{program}}}]
MOM_end_of_program
"""
FUSION = """
const fs = require("fs"), path = require("path"), child = require("child_process");
function error(text) {{ console.log("ERROR " + text); process.exit(1); }}
function getOutputPath() {{ return {posted!r}; }}
function execute(program, words, hide, folder) {{
  return child.spawnSync(program + " " + words, {{shell: true, stdio: "inherit"}}).status;
}}
const FileSystem = {{
  isFile: fs.existsSync, remove: fs.unlinkSync,
  replaceExtension: (name, extension) => name.slice(0, -path.extname(name).length) + "." + extension,
}};
let ended = 0, extension = "nc";
function onTerminate() {{ ended = 1; }}
{hook}
ncompCommand = {ncomp!r}; ncompOptions = {options!r};
if (extension != "posted") process.exit(3);
fs.writeFileSync(getOutputPath(), {program!r});
onTerminate();
if (!ended) process.exit(4);
"""


def run_nx(folder: Path, ncomp: str, options: str, program: str) -> subprocess.CompletedProcess[str]:
    """The procedures of NX that the hook calls, and a program of the post, in Tcl."""
    script = folder / "nx.tcl"
    text = NX.format(
        hook=folder / "ncomp_nx.tcl", ncomp=ncomp, options=options, posted=folder / "part.posted", program=program
    )
    script.write_text(text)
    return subprocess.run(["tclsh", str(script)], capture_output=True, text=True, check=False)


def run_fusion(folder: Path, ncomp: str, options: str, program: str) -> subprocess.CompletedProcess[str]:
    """The functions of the post engine that the hook calls, and a program of the post, in JavaScript."""
    hook = (folder / "ncomp_fusion.js").read_text()
    script = folder / "fusion.js"
    script.write_text(
        FUSION.format(hook=hook, ncomp=ncomp, options=options, posted=str(folder / "part.posted"), program=program)
    )
    return subprocess.run(["node", str(script)], capture_output=True, text=True, check=False)


def run_unix(folder: Path, ncomp: str, options: str, program: str) -> subprocess.CompletedProcess[str]:
    """The shell command, with a posted program."""
    (folder / "part.posted").write_text(program)
    environment = {**os.environ, "NCOMP": ncomp, "OPTIONS": options}
    command = [str(folder / "after_post.sh"), str(folder / "part.posted")]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


Run = Callable[[Path, str, str, str], subprocess.CompletedProcess[str]]
RUNS: dict[str, tuple[Run, str]] = {
    "nx": (run_nx, "tclsh"),
    "fusion": (run_fusion, "node"),
    "unix": (run_unix, "sh"),
}
"""How each hook is run here, and the language that this needs."""


@pytest.fixture(params=RUNS)
def hooked(request: pytest.FixtureRequest, tmp_path: Path) -> Run:
    """A hook in tmp_path, beside an older corrected program, and how to run it."""
    run, language = RUNS[request.param]
    if shutil.which(language) is None:
        pytest.skip(f"{language} is missing")
    succeed("hook", request.param, "-o", tmp_path)
    (tmp_path / "part.nc").write_text(OLD)
    return run


def test_a_posted_program_is_corrected(hooked: Run, tmp_path: Path) -> None:
    done = hooked(tmp_path, NCOMP, SETUP, POSTED)
    assert done.returncode == 0, done.stdout + done.stderr
    alone = tmp_path / "alone.nc"
    succeed(tmp_path / "part.posted", "-o", alone, *SETUP.split())
    assert (tmp_path / "part.nc").read_text() == alone.read_text()
    assert (tmp_path / "part.posted").read_text() == POSTED


@pytest.mark.parametrize(
    ("ncomp", "options", "program"),
    [
        pytest.param(NCOMP, SETUP, POSTED.replace("X60.", "X6000."), id="refused program"),
        pytest.param(NCOMP, "--machine nomill", POSTED, id="unknown machine"),
        pytest.param("/nowhere/ncomp", SETUP, POSTED, id="ncomp is missing"),
        pytest.param("KILLED", SETUP, POSTED, id="killed midway"),
    ],
)
def test_a_fault_leaves_no_program(
    hooked: Run, killed: str, tmp_path: Path, ncomp: str, options: str, program: str
) -> None:
    done = hooked(tmp_path, ncomp.replace("KILLED", killed), options, program)
    assert done.returncode != 0
    assert "no program was written" in done.stdout + done.stderr
    assert not (tmp_path / "part.nc").exists()
    assert (tmp_path / "part.posted").read_text() == program


def test_a_post_that_writes_the_name_of_the_output_is_refused(tmp_path: Path) -> None:
    succeed("hook", "unix", "-o", tmp_path)
    (tmp_path / "part.nc").write_text(POSTED)
    done = subprocess.run(
        [str(tmp_path / "after_post.sh"), str(tmp_path / "part.nc")], capture_output=True, check=False
    )
    assert (done.returncode, (tmp_path / "part.nc").read_text()) == (2, POSTED)


def test_a_posted_set_is_corrected_in_files_of_the_output_s_suffix(hooked: Run, tmp_path: Path) -> None:
    """The CAM posts a subprogram with the suffix of its main program; an earlier correction is no second file of it."""
    called = "O1000\nG1 X60. F500\nM99\n"
    for x in ("60.", "61."):
        (tmp_path / "O1000.posted").write_text(called.replace("60.", x))
        done = hooked(tmp_path, NCOMP, SETUP, POSTED.replace("G1 X60. F500", "M98 P1000"))
        assert done.returncode == 0, done.stdout + done.stderr
        assert "M98 P1000" in (tmp_path / "part.nc").read_text()
        ends = re.findall(r"^G1 X(\S+)", (tmp_path / "O1000.nc").read_text(), re.M)
        assert float(ends[-1]) == pytest.approx(float(x), abs=0.01)
    verified = succeed("verify", tmp_path / "part.posted", tmp_path / "part.nc", *SETUP.split(), "--json", "-")
    assert json.loads(verified.out)["block_ends_um"]["after"]["max"] < 0.3
    (tmp_path / "O1000.posted").write_text("O1000\nG31 X60.\nM99\n")
    done = hooked(tmp_path, NCOMP, SETUP, POSTED.replace("G1 X60. F500", "M98 P1000"))
    assert (done.returncode != 0, (tmp_path / "part.nc").exists()) == (True, False)
    assert "O1000.posted:2" in done.stdout + done.stderr


def test_a_long_program_that_is_killed_leaves_nothing(tmp_path: Path) -> None:
    succeed("hook", "unix", "-o", tmp_path)
    lines = (f"X{n % 90 + 0.5:.3f} Y{n % 70 + 0.25:.3f}\n" for n in range(400_000))
    (tmp_path / "part.posted").write_text("G21 G90 G54\nT1 M6\nG43 H1\nG0 Z5. B0 C0\nG1 F500\n" + "".join(lines))
    environment = {**os.environ, "NCOMP": NCOMP, "OPTIONS": SETUP}
    command = [str(tmp_path / "after_post.sh"), str(tmp_path / "part.posted")]
    running = subprocess.Popen(command, env=environment, start_new_session=True, stderr=subprocess.DEVNULL)
    while not any(path.name.endswith(".tmp") or ".part.nc" in path.name for path in tmp_path.iterdir()):
        assert running.poll() is None, "the program was complete before it was killed"
        time.sleep(0.01)
    os.killpg(running.pid, signal.SIGKILL)
    running.wait()
    assert not (tmp_path / "part.nc").exists()


def test_the_shell_command_finds_files_beside_it(tmp_path: Path) -> None:
    succeed("tutorial", tmp_path / "mill")
    succeed("hook", "unix", "-o", tmp_path / "mill")
    posted = tmp_path / "part.posted"
    shutil.copyfile(tmp_path / "mill" / "part.nc", posted)
    environment = {**os.environ, "OPTIONS": "--machine mill.toml --calibration true.json"}
    command = [str(tmp_path / "mill" / "after_post.sh"), "part.posted"]
    subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, check=True)
    assert "(NCOMP " in (tmp_path / "part.nc").read_text()


# ---- the command


def test_hooks_are_listed(command: Callable[..., Done]) -> None:
    listed = command("hook").out.decode()
    assert all(f"{name} " in listed for name in HOOKS)


def test_a_hook_is_shown(command: Callable[..., Done]) -> None:
    assert "ncomp_correct" in command("hook", "nx").out.decode()


def test_freecad_is_found(command: Callable[..., Done], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert "start it once" in command("hook", "freecad", "--install").err
    (tmp_path / "FreeCAD" / "v1-0").mkdir(parents=True)
    assert command("hook", "freecad", "--install").status == 0
    found = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.py"))
    assert found == ["FreeCAD/Macro/ncomp_post.py", "FreeCAD/v1-0/Macro/ncomp_post.py"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nosuch",), "unknown hook 'nosuch': there are freecad, fusion"),
        (("nx", "--install"), "--install is for freecad alone"),
    ],
)
def test_wrong_arguments(command: Callable[..., Done], arguments: tuple[str, ...], message: str) -> None:
    done = command("hook", *arguments)
    assert done.status == 2
    assert message in done.err
