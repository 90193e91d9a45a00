"""Writes docs/results.md: the keys and columns of the results for programs, from real runs.

    python docs/make/results.py

Every command that has `--json` runs once, on the files of the tutorial and simulated data. The keys, their types
and examples come from these runs; MEANINGS explains names.
"""

from __future__ import annotations

import csv
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lines import written

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "results.md"
INPUTS = ROOT / "postproc" / "tutorial"
CIRCLES = "--instrument ballbar --centre 300,200,150 --target t1=0,0,-120 --bar 100:0.5 --feed 1000"
STUDY = """machine = "gantry"
draws = 2
[instrument]
kind = "laser-tracker"
u_range_um_per_m = 0.5
u_angle_um = 3
[errors]
model = "table-1"
[[case]]
name = "grid"
strategy = "grid"
points = 40
tracker = [-1500, 1500, 300]
"""
TESTS = [("ranging", 2000, far, "", um) for far, um in ((4000, 0.9), (6000, -1.2), (10000, 1.4), (20000, 3.1))]
TESTS += [("length", far, "", 2300, um) for far, um in ((2000, 9), (4000, -14), (6000, 18), (10000, -31))]
TESTS += [("two-face", far, "", "", um) for far, um in ((2000, 14), (2000, 20), (5000, 30), (9000, 41))]
BEFORE = (
    f"ncomp simulate --machine mill.toml {CIRCLES} --effect backlash:axis=X,width=8 -o circles.csv",
    "ncomp simulate --machine mill.toml --strategy axes --spacing 100 --runs 3 --instrument interferometer -o runs.csv",
    "ncomp simulate-continuous --machine mill.toml --axis X --start-mm 0 --end-mm 450 --feed 5000 --rate 1000 --spacing 45 "
    "--both -o run.csv --quasistatic targets.csv",
)
RESULTS = {
    "correct": "ncomp part.nc --machine mill.toml -c true.json -o part_c.nc --json -",
    "batch": "ncomp batch posted corrected --machine mill.toml -c true.json --jobs 1 --json -",
    "verify": "ncomp verify part.nc part_c.nc --machine mill.toml -c true.json --json -",
    "check": "ncomp check part.nc --machine mill.toml --json -",
    "fit": "ncomp fit measured.csv --machine mill.toml -o first.json --json -",
    "diagnose": "ncomp diagnose measured.csv --machine mill.toml -o cal.json --json -",
    "predict": "ncomp predict points.csv --machine mill.toml -c cal.json -o predicted.csv --json -",
    "compare": "ncomp compare first.json cal.json --machine mill.toml --json -",
    "export": "ncomp export --machine mill.toml -c cal.json --format linuxcnc -o tables --json -",
    "export of kinematic parameters": "ncomp export --machine dmu50 --format fanuc-kinematics -o parameters --json -",
    "iso230": "ncomp iso230 runs.csv --machine mill.toml --json -",
    "ballbar": "ncomp ballbar circles.csv --machine mill.toml --json -",
    "continuous": "ncomp continuous run.csv targets.csv -o table.csv --json -",
    "study": "ncomp study study.toml -o results.csv --workers 1 --json -",
    "tracker": "ncomp tracker b89.csv --json -",
}
"""The run of each command; its JSON is the standard output."""
TABLES = {
    "plan": ("plan.csv", "ncomp plan --machine mill.toml --strategy random --points 20 -o plan.csv"),
    "simulate": ("data.csv", "ncomp simulate --machine mill.toml --strategy plan.csv -o data.csv"),
    "predict": ("predicted.csv", ""),
    "continuous": ("table.csv", ""),
    "study": ("results.csv", ""),
}
"""Files with columns, and the run that writes them, if none of RESULTS does."""
MEANINGS = {
    "detection_limits": "smallest sizes that these circles would show, of causes that were not found",
    "cause": "kind and axis of a cause",
    "smallest": "for the shape that is seen best",
    "waves": "largest number of waves on a turn",
    "by_feed": "decay of a reversal spike at each feed",
    "keeps": "time, way, both (not parted) or neither",
    "lines": "changes of the lines of rotary axes",
    "change": "size of the change",
    "work_offset_shift": "shift of work offsets with the new lines",
    "mm": "in X, Y and Z",
    "urad": "about X, Y and Z",
    "before_and_datum_shift": "without compensation, work offset touched off again",
    "after_parameters": "parameters in the control, old work offset",
    "after_parameters_and_datum_shift": "parameters in the control, work offset touched off again",
    "after_parameters_datum_shift_and_tables": "the same, with tables for the rest",
    "after_parameters_and_nc_correction_of_the_rest": "parameters, and programs corrected by the rest",
    "id": "id: the fingerprint of its file",
    "sha256": "first characters of the SHA-256 of the file",
    "chain": "chain of the machine, workpiece to tool",
    "age_days": "age, days",
    "demonstration": "true for a calibration that describes no real machine",
    "elapsed_s": "time since the start of the temperatures' log",
    "read": "number in the program",
    "changed": "number with another coordinate",
    "added": "number that ncomp added",
    "split": "number of moves that were split",
    "max": "largest value",
    "rms": "RMS",
    "count": "number of values",
    "accepted_reasons": "reasons that --accept lets pass",
    "before": "without the correction, or without the new causes",
    "after": "with the correction, or with the new causes",
    "rms_um": "RMS",
    "max_um": "largest value",
    "chi2_reduced": "chi2/dof by the noise of the fit ([glossary](glossary.md))",
    "heldout_rms_um": "RMS of rows that were left out of the fit",
    "noise_um": "noise of one observation",
    "n_observations": "number of observations",
    "n_parameters": "number of parameters",
    "rank": "number of independent directions that the data determine",
    "not_visible": "errors that these data cannot show",
    "accepted": "true if the new calibration was written",
    "reason": "why not, empty otherwise",
    "effects": "the causes, one entry each",
    "kind": "kind of the cause ([list](effects.md))",
    "where": "machine, tool, workpiece or instrument",
    "axis": "axis of the cause",
    "parameters": "sizes, by name with the unit",
    "u": "their standard uncertainties, k=1",
    "delta_bic": "change of the BIC: below -10 is strong evidence",
    "heldout_gain_um": "reduction of the held-out RMS",
    "share": "share of the squared residuals",
    "verdict": "strong, weak or tied",
    "alternatives": "causes with nearly the same signal",
    "cosine": "cosine of the two signals",
    "odds": "odds of the cause against the alternative",
    "unexplained": "the remaining dependence, or null",
    "next_measurement": "the proposed measurement",
    "dialect": "iso, siemens or heidenhain",
    "notes": "assumptions and remarks",
    "datum": "the touch-off of each work offset",
    "refused": "refused lines: line, text, reason",
    "line": "number of the line",
    "text": "text of the line",
    "state": "corrected, unchanged, already corrected, refused or failed",
    "points": "number of points",
    "corrected_blocks": "blocks with another coordinate",
    "changed_blocks": "blocks with another coordinate",
    "minutes": "duration, min",
    "time_s": "time of the row, s",
    "target": "name of the reflector",
    "run": "repeat of the sequence",
    "point": "name of the position",
    "x": "observed point in the frame of the instrument, mm",
    "y": "observed point in the frame of the instrument, mm",
    "z": "observed point in the frame of the instrument, mm",
    "dx_um": "deviation along x, workpiece frame",
    "dy_um": "deviation along y, workpiece frame",
    "dz_um": "deviation along z, workpiece frame",
    "position_mm": "position of the axis",
    "error_um": "error at the position, actual minus commanded",
    "u_um": "standard uncertainty (k=1)",
    "station": "position of the instrument",
    "name": "name",
    "X": "commanded position, mm",
    "Y": "commanded position, mm",
    "Z": "commanded position, mm",
    "a": "first calibration",
    "b": "second calibration",
    "U_a": "expanded uncertainty (k=2) of the first",
    "U_b": "expanded uncertainty (k=2) of the second",
    "U_difference": "expanded uncertainty (k=2) of the difference",
    "after_nc_correction": "programs corrected, no tables",
    "after_tables": "tables in the control, programs as they are",
    "after_tables_and_nc_correction_of_the_rest": "tables, and programs corrected by the rest",
    "aligned_um": "after the best rigid alignment",
    "assumed": "offsets and lengths that were assumed",
    "axes": "one entry for each axis",
    "backward": "approach in the negative direction",
    "forward": "approach in the positive direction",
    "basis": "basis of each error motion",
    "between_block_ends_after": "along the moves, after the correction",
    "between_positions": "uncertainty between few measured positions",
    "blind": "directions that the data do not determine",
    "bounds": "ends of the compared volume",
    "by_convention": "directions that belong to the frame",
    "cases": "one entry for each case",
    "causes": "share of each cause",
    "classes": "classes that are corrected",
    "common_shift": "uncertainty of a shift common to all positions",
    "conditions": "time and temperatures of the run",
    "confirmed": "true if the present calibration is confirmed",
    "continuous": "the runs in motion",
    "convention": "zero of the curve",
    "copies": "rows that are copies of others",
    "corrected": "number that were corrected",
    "corrected_lines": "lines that get a correction",
    "counts": "number of programs by state",
    "curves": "values over the range",
    "cyclic": "errors that repeat along the axis",
    "datum_shift": "shift of the datum by the tables",
    "depends_on": "dependences of the residuals",
    "design": "families of causes that this design can show",
    "dialect_evidence": "why the program was read so",
    "difference": "second minus first",
    "direction": "direction of the run",
    "disagreeing_share": "share of rows that disagree with the model",
    "doubtful": "true if these tests contradict the others",
    "draws": "number of draws",
    "earlier_output": "true if an output of an earlier run was replaced",
    "effective_parameters": "effective number of parameters",
    "error": "error motion",
    "error_motions": "one entry for each error motion",
    "errors": "remaining errors",
    "errors_relative_to": "datum, or work offset",
    "estimated_noise": "noise from the residuals",
    "exact_check": "draws that were fitted without linearisation, to compare",
    "failed_stations": "stations that were not used",
    "feed_mm_min": "feed, mm/min",
    "programmed_feed_mm_min": "programmed feed, mm/min",
    "figures": "the figures of the standard",
    "file": "name of the file",
    "files": "names of the written files",
    "finer": "axes with a finer basis than that of the automatic search",
    "first": "first position",
    "last": "last position",
    "forced": "reasons that an option overrode",
    "format": "format of the tables",
    "held_out": "the blocks that were left out in turn",
    "of": "kind of these blocks",
    "hint": "option that would describe it",
    "in": "direction of the error",
    "inputs": "fingerprints of the inputs (SHA-256, first characters), by their names",
    "provenance": "origin of the result",
    "instrument_factor": "residuals over the specification of the instrument",
    "jumps": "sudden steps",
    "lacks": "variable that the data lack",
    "largest": "largest value",
    "left_max": "largest error after the correction, um",
    "left_rms": "RMS error after the correction, um",
    "locations": "location errors",
    "log": "log of the temperatures",
    "log_evidence": "logarithm of the evidence",
    "machine_change": "change of the machine since the present calibration",
    "machine_coordinate_lines": "moves in machine coordinates",
    "machine_max": "largest error of the machine, um",
    "machine_rms": "RMS error of the machine, um",
    "made_at": "time at which it was made",
    "made_by": "program that made it",
    "min": "smallest value",
    "misfit": "errors that the model lacks, by axis, um or urad",
    "n": "number of tests",
    "nodes": "number of nodes",
    "noise_factor": "factor on the specification",
    "noise_from_repeats": "noise from positions measured again",
    "non_repeatability": "standard deviation from stop to stop, by axis, um or urad",
    "not_carried": "errors that the tables cannot hold",
    "not_compared": "error motions that only one has",
    "not_corrected": "lines that were not corrected, and why",
    "not_judged": "number of moves that were not evaluated",
    "not_run_lines": "lines that never run",
    "not_split": "moves that were not split, and why",
    "not_tested": "causes that were not tested",
    "obtained": "probed or true",
    "one_by_one": "each cause alone",
    "origin": "how the model was chosen",
    "outliers": "rows that were left out as outliers",
    "output": "name of the output, or null",
    "p95": "95 % quantile",
    "p_value": "probability of such a value by chance",
    "plane": "plane of the circle",
    "position": "position of the touch-off",
    "present": "size in the present calibration",
    "prior_order": "order of the smoothness prior",
    "prior_scale": "factor on the typical sizes",
    "prior_scale_rotary": "the same of rotary axes, or null where it is not another one",
    "probe_given": "true if the length of the probe was given",
    "programs": "one entry for each program",
    "range": "largest minus smallest value",
    "rank_registered": "rank with the position of the instrument fitted",
    "reference": "reference positions",
    "remedy": "measurement that would show it",
    "repeated_lines": "lines that run more than once",
    "result": "JSON of correct for the program",
    "reversal": "difference between the directions",
    "rms_difference": "RMS of the difference",
    "rows": "number of rows",
    "rows_left_out": "number of rows that were not used",
    "runs": "number of runs",
    "samples": "number of samples",
    "sanity": "remarks on the data",
    "seconds": "duration, s",
    "settled": "false if an adaptive study ended at its largest number of draws",
    "shape": "the fitted curve",
    "sign_confirmed": "true if the sign of the format is confirmed",
    "significant": "true if the difference exceeds its uncertainty",
    "unexplained_periods": "periods of waves that explain the remaining dependence equally, mm or degrees",
    "widened": "uncertainties of the calibration as a multiple of those that follow from the noise, with an unexplained error or with causes that the data neither name nor exclude",
    "significant_share": "share of the positions whose correction exceeds its uncertainty",
    "significant_share_of_improvement": "share of the improvement that exceeds its uncertainty",
    "significant_k": "coverage factor of significant_share",
    "size": "smallest size that would be visible",
    "source": "file and line",
    "standard_uncertainty_of_prediction": "uncertainty of the predicted error (k=1)",
    "statistic": "value of the test",
    "straightness": "reference line of straightness",
    "table": "the written table",
    "tables": "one entry for each table",
    "targets": "one entry for each target",
    "temperatures_degC": "temperatures, degC",
    "tests": "one entry for each test",
    "tied_with": "causes with nearly the same signal",
    "title": "name of the figure",
    "tools": "tool lengths",
    "unit": "unit of the values",
    "unsaid_lines": "moves before all axes are known",
    "values": "values by ISO 230-2",
    "values_are": "error or correction",
    "visible": "share of the signal that model and instrument cannot imitate",
    "visibility": "the same for causes that were not found",
    "vibrations": "periodic vibrations",
    "volume": "over the volume",
    "volume_um": "errors over the measured volume",
    "what": "variable",
    "whiteness": "tests of the residuals",
    "why": "reason",
    "work_offset": "name of the work offset",
    "work_offsets": "work offsets",
    "workers": "number of processes",
    "would_show_from": "sizes from which absent causes would be visible",
    "zeros": "zeros of runs and targets",
    "closure": "share of the residual beyond the noise that no error motion of an axis explains",
    "bound_to_time": "waves with a frequency, not with a period",
    "blocks": "blocks",
    "moves": "moves",
    "program": "program",
    "machine": "machine",
    "calibration": "calibration, or its id",
    "quasi_static": "the targets",
    "readings": "number of readings",
    "readings_inside": "number inside the segment",
    "degrees_of_freedom": "degrees of freedom",
    "noise_order": "order of the noise model",
    "noise_scale": "factor on the stated noise",
    "samples_left_out": "samples that were not used",
    "samples_missing": "samples that the record lacks",
    "not_carried_orientation_urad": "tilt of the tool that the tables leave",
}
UNITS = {"um": "um", "urad": "urad", "mm": "mm", "s": "s", "deg": "deg", "minutes": "min", "ppm": "ppm"}


def run(command: str, folder: Path) -> str:
    """Standard output of a command."""
    words = [sys.executable, "-m", "ncomp", *shlex.split(command)[1:]]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{command}: status {done.returncode}\n{done.stderr}")
    return done.stdout


def prepare(folder: Path) -> None:
    """The inputs of all runs."""
    for path in INPUTS.iterdir():
        shutil.copyfile(path, folder / path.name)
    (folder / "posted").mkdir()
    shutil.copyfile(INPUTS / "part.nc", folder / "posted" / "part.nc")
    (folder / "points.csv").write_text("X,Y,Z\n0,0,0\n300,200,225\n")
    (folder / "study.toml").write_text(STUDY)
    with (folder / "b89.csv").open("w") as file:
        csv.writer(file).writerows([("test", "range_mm", "range_2_mm", "length_mm", "error_um"), *TESTS])
    for command in BEFORE:
        run(command, folder)


def results(folder: Path) -> dict[str, Any]:
    """The JSON of each command."""
    return {name: json.loads(run(command, folder)) for name, command in RESULTS.items()}


def columns(folder: Path) -> dict[str, list[str]]:
    """The columns of each file; the files of RESULTS are there already."""
    found = {}
    for name, (file, command) in TABLES.items():
        if command:
            run(command, folder)
        head = next(line for line in (folder / file).read_text().splitlines() if not line.startswith("#"))
        found[name] = head.split(",")
    return found


def keys(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """The paths of all keys of a JSON value, with the first value of each; `[]` is any entry of a list."""
    if isinstance(value, dict):
        for key, inner in value.items():
            name = "NAME" if path.endswith("inputs") else key  # names of files
            own = f"{path}.{name}" if path else name
            yield own, inner
            yield from keys(inner, own)
    elif isinstance(value, list):
        for inner in value:
            if isinstance(inner, (dict, list)):
                yield from keys(inner, f"{path}[]")


def key_table(value: Any) -> dict[str, Any]:
    """The paths of keys, each once; keys below names of axes, errors or lines count once."""
    found: dict[str, Any] = {}
    for path, inner in keys(value):
        found.setdefault(general(path), inner)
    return found


def general(path: str) -> str:
    """A path with NAME for keys that are names: of axes, error motions, work offsets and the like."""
    named = re.compile(r"^(?:E_\w+|[A-Z]\d*|G\d+(?:\.\d+)?|\d[\w.-]*|[XYZABC]{2}|.*[ ,+/()-].*)$")
    return ".".join("NAME" if named.match(part.removesuffix("[]")) else part for part in path.split("."))


def kind(value: Any) -> str:
    """The type of a value in words."""
    names = {bool: "true or false", int: "number", float: "number", str: "text", list: "list", dict: "object"}
    return "null or a value" if value is None else names[type(value)]


def example(value: Any) -> str:
    """A short example of a value."""
    if isinstance(value, (dict, list)) or value is None:
        return ""
    text = f"{value:.4g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
    return f"`{text[:40]}`".replace("|", "\\|") if text != '""' else ""


def meaning(path: str) -> str:
    """The meaning of a key, with its unit."""
    name = path.rsplit(".", maxsplit=1)[-1].removesuffix("[]")
    unit = next((unit for end, unit in UNITS.items() if name.endswith(f"_{end}") or name == end), "")
    return ", ".join(filter(None, (MEANINGS.get(name, ""), unit)))


def page() -> str:
    """The whole page."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        found = results(folder)
        return written(_lines(found, columns(folder)))


def _lines(found: dict[str, Any], tables: dict[str, list[str]]) -> Iterator[str]:
    yield from (
        "# Results for programs: JSON and CSV",
        "",
        "Written by `python docs/make/results.py` from real runs; do not edit. A test compares the keys with new runs.",
        "",
        "`--json FILE` writes the result of a command for other programs, `--json -` to standard output. The unit is the "
        "end of a name: `_um`, `_urad`, `_mm`, `_s`. Uncertainties in JSON are standard uncertainties (k=1). A dot "
        "separates levels, `[]` is an entry of a list, and NAME is the name of an axis, an error motion, a work "
        "offset or a file.",
        "",
        "The keys of `diagnose` that are explained here, and the columns of measurement files, are a contract: they stay.",
        "",
    )
    for command, value in found.items():
        yield from (f"## JSON of {command}", "", f"    {RESULTS[command]}", "", "| key | type | example | meaning |")
        yield "|---|---|---|---|"
        for path, inner in key_table(value).items():
            yield f"| `{path}` | {kind(inner)} | {example(inner)} | {meaning(path)} |"
        yield ""
    yield from ("## Columns of CSV files", "")
    yield "Lines that begin with `#` are a header, `# key: value`. [Measurement files](measurements.md) have their own page."
    yield ""
    for command, names in tables.items():
        yield from (f"### {command}", "", "| column | meaning |", "|---|---|")
        yield from (f"| `{name}` | {meaning(name)} |" for name in names)
        yield ""


if __name__ == "__main__":
    PAGE.write_text(page())
