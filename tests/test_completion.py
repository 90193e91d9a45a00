"""Completion in bash and zsh: commands, options and values, by the protocols of both shells."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LINES = {
    "ncomp thr": "three-points",
    "ncomp correct a.nc --machine dm": "dmu50",
    "ncomp a.nc --calib": "--calibration",
    "ncomp machines bzt": "bzt_pfu",
    "ncomp hook free": "freecad",
    "ncomp fit a.csv --noise e": "estimate",
}


def completed(line, shell):
    words = {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split()) - 1), "_TYPER_COMPLETE_ARGS": line}
    environment = {**os.environ, **words, "_NCOMP_COMPLETE": f"complete_{shell}", "PYTHONPATH": str(ROOT)}
    code = "import sys; sys.argv[0] = 'ncomp'; from postproc.cli import run; run()"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    return done.stdout


@pytest.mark.parametrize("line", LINES)
def test_bash(line):
    assert completed(line, "bash").split() == [LINES[line]]


def test_zsh():
    line = "ncomp correct a.nc --machine dm"
    assert f'"{LINES[line]}"' in completed(line, "zsh")
