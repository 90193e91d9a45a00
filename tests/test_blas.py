"""BLAS has one thread in every process that imports ncomp, without settings from outside, unless the user sets another number."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.tiers import quick

from kinematics.running.blas import LIMITS

SHOW = """
import json, numpy, scipy.linalg
from threadpoolctl import threadpool_info
print(json.dumps([pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]))
"""


def threads(code: str, **environment: str) -> list[int]:
    """Threads of each BLAS library of a process that runs `code`, then loads NumPy and SciPy."""
    free = {name: value for name, value in os.environ.items() if name not in (*LIMITS, "OMP_NUM_THREADS")}
    free["PYTHONPATH"] = str(Path(__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", code + SHOW], env=free | environment, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


ENTRIES = [
    "import postproc.cli",
    "import calibration.study.chunks",  # the module that a worker, of this machine or of Dask, unpickles
    "import kinematics.effects",
    "import machines",
    "import numpy, scipy.linalg, calibration.fit.calibrate",  # a host that has loaded BLAS already
    "import numpy, postproc.cli",
]


@pytest.mark.parametrize("entry", quick(ENTRIES, [ENTRIES[0], ENTRIES[4]]))
def test_one_thread_whatever_comes_first(entry):
    assert set(threads(entry)) == {1}


def test_what_the_user_sets_holds():
    assert set(threads("import postproc.cli", OPENBLAS_NUM_THREADS="2")) == {2}


def test_a_limit_of_open_mp_is_none_of_blas():
    assert set(threads("import postproc.cli", OMP_NUM_THREADS="2")) == {1}


def test_processes_that_it_starts():
    show = "import subprocess, sys, postproc.cli\nsubprocess.run([sys.executable, '-c', {!r}], check=True)\n"
    free = threads(show.format(SHOW) + "raise SystemExit\n")
    assert set(free) == {1}


def test_the_tests_themselves():
    from threadpoolctl import threadpool_info

    if "OPENBLAS_NUM_THREADS" in os.environ and os.environ["OPENBLAS_NUM_THREADS"] != "1":
        pytest.skip("OPENBLAS_NUM_THREADS is set by the user")
    assert {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"} <= {1}
