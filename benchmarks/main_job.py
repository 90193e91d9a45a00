"""Speed of the main job: `python benchmarks/main_job.py [blocks]`.

A generated five-axis program for the DMU 50 is corrected with the demonstration calibration; medians of several runs,
the share of each stage, and the ratio to reading and interpreting alone. Peak memory is that of the whole process.
"""

from __future__ import annotations

import io
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

import machines
from kinematics.effects import Backlash
from kinematics.error_model.model import ErrorModel, no_errors, read_model
from postproc.compensation.correction import correct
from postproc.control.setup import make_setup
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.notes import Notes
from postproc.text.source import open_source
from postproc.write.writer import Writer

RUNS = 3


def program(blocks: int) -> str:
    """A smooth five-axis path, every block naming all axes with three decimals, as CAM systems post it."""
    t = np.linspace(0.0, blocks / 400.0, blocks)
    x, y, z = 60 * np.cos(t), 60 * np.sin(1.1 * t), 200 + 20 * np.sin(0.7 * t)
    columns = (x, y, z, 20 + 10 * np.sin(0.3 * t), 180 + 90 * np.sin(0.2 * t))
    rows = zip(*(np.round(c, 3).tolist() for c in columns), strict=True)
    body = "".join(f"N{10 * i}G1X{x}Y{y}Z{z}B{b}C{c}\n" for i, (x, y, z, b, c) in enumerate(rows, start=1))
    return f"%\nO0001\nG21G90G54\nT1M6\nG0X0.Y0.Z300.B0.C0.\nG1F1000.\n{body}M30\n%\n"


def median(action: Callable[[], object]) -> float:
    """Median seconds of several runs."""
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def main(blocks: int) -> None:
    """Measure and print."""
    machine = machines.load("dmu50")
    path = machines.default_calibration(machine)
    assert path is not None
    model = read_model(path, machine)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "path.nc"
        file.write_text(program(blocks))
        source = open_source(str(file))
        dialect = find_dialect("auto", str(file), source.text_head)

        backlash = tuple(Backlash(axis, 20.0) for axis in "XYZ")
        played = msgspec.structs.replace(model, effects=(*model.effects, *backlash), covariance=None)

        def run(used: ErrorModel) -> None:
            job = Job(source, dialect, machine, used, make_setup(machine, zero=True))
            Pipeline(job).run(io.BytesIO(), lambda _: None)

        lines = list(source.lines())[:20_000]
        read = [dialect.read_block(*line) for line in lines]
        interpreted = dialect.interpreter(machine, make_setup(machine, zero=True), Notes()).read(read)
        corrected = correct(interpreted, model)
        stages = {
            "read": lambda: [dialect.read_block(*line) for line in lines],
            "interpret": lambda: dialect.interpreter(machine, make_setup(machine, zero=True), Notes()).read(read),
            "correct": lambda: correct(interpreted, model),
            "write": lambda: Writer(machine).write(interpreted, corrected),
        }
        print(f"{'stage':<12}{'us per block':>14}")
        for name, action in stages.items():
            print(f"{name:<12}{median(action) / len(lines) * 1e6:>14.2f}")
        whole, reading = median(lambda: run(model)), median(lambda: run(no_errors(machine)))
        directed = median(lambda: run(played))
    print(f"{blocks} blocks corrected in {whole:.2f} s: {blocks / whole:,.0f} blocks/s")
    print(f"with backlash of X Y Z in {directed:.2f} s: {blocks / directed:,.0f} blocks/s")
    print(f"ratio to reading and interpreting alone: {whole / reading:.2f}")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
