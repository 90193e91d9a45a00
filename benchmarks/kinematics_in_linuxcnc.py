"""The whole way in LinuxCNC's simulator: probing program, log, fit, kinematic parameters, tool point errors.

A machine with the axes of xyzac-trt-kins, whose lines of C and A are not those of its machine file. LinuxCNC runs the
probing program of `ncomp plan` against one sphere (`tests/clients/sim/sphere.py` closes the contact, by the real
lines); `ncomp touches` reads the log; location errors of the rotary axes are fitted; the exported HAL lines are set,
and the positions under them are compared with those under the real lines, at poses that were not measured.

    python benchmarks/kinematics_in_linuxcnc.py [ROTARY_POSITIONS]

The contact is closed by a process in user space: on a loaded computer the scatter of the contacts grows.
"""

import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from clients import linuxcnc_sim
from support import linuxcnc_trunnion as real_machine
from support.linuxcnc_spheres import config_of

import machines
from calibration.fit.fit import fit
from calibration.measurement.file import read_measurement
from calibration.simulation.true_model import model_of
from kinematics.effects import LocationError
from postproc.control_data.formats import formats_of
from postproc.control_data.parameters.export_parameters import export_parameters
from postproc.control_data.parameters.parameter_format import ParameterFormat

FORMATS = formats_of(ParameterFormat)

ROOT = Path(__file__).parents[1]
PLACE = (130.4, 19.7, 60.2)
"""Centre of the sphere, mm; it is stated as 130, 20, 60."""
SHORT = ("--feed", "60000", "--clearance", "2.5", "--probing-feed", "600", "--measuring-feed", "120")
"""Options for a short program."""


def ncomp(folder, *arguments):
    """Run a command in a folder; what it printed."""
    command = [sys.executable, "-c", "from postproc.cli import run; run()", *arguments]
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{arguments[0]}: {done.stderr}")
    return done.stdout


def measured(folder, count):
    """The sphere's centres by LinuxCNC: a measurement of the machine."""
    machine = machines.parse(real_machine.machine_file("A"), "mill")
    moved = {"C": real_machine.SHIFT_OF_C, "A": real_machine.SHIFT_OF_TILT}
    axes = [
        replace(axis, point=tuple((np.array(axis.point) + moved[axis.name]).tolist())) if axis.rotary else axis
        for axis in machine.axes
    ]
    (folder / "mill.toml").write_text(real_machine.machine_file("A"))
    ncomp(folder, "plan", "--machine", "mill.toml", "--instrument", "touch-probe", "--strategy", "grid", "--points",
          str(count), "--sphere", "s1=130,20,60", "--target", "probe=0,0,-150", "--range", "A=-60:30", *SHORT,
          "-o", "plan.csv", "--nc", "plan.ngc", "--json", "plan.json", "--dialect", "linuxcnc")  # fmt: skip
    log = f"ncomp{json.loads((folder / 'plan.json').read_text())['plan_id']}.txt"
    program = (folder / "plan.ngc").read_text().replace("\nM0\n", "\n")
    config = config_of(replace(machine, axes=tuple(axes)), [], [PLACE], (0.0, 0.0, -150.0), log)
    (folder / "log.txt").write_text(linuxcnc_sim.run(config, program, timeout=400.0).texts[log])
    told = json.loads(ncomp(folder, "touches", "log.txt", "--machine", "mill.toml", "--plan", "plan.csv",
                            "-o", "data.csv", "--json", "-"))  # fmt: skip
    print(f"{told['centres']} centres, scatter of the contacts {told['scatter_um']:.1f} um")
    return machine, read_measurement(folder / "data.csv", machine)


def main():
    """Print the tool point errors before and after."""
    with tempfile.TemporaryDirectory() as name:
        machine, data = measured(Path(name), int(sys.argv[1]) if sys.argv[1:] else 12)
    start = [LocationError(c, axis, 0.0) for axis, names in (("C", "XY"), ("A", "YZ")) for c in names]
    model = fit(data, model_of(machine, start)).model
    form = FORMATS["linuxcnc-kinematics"]
    found = export_parameters(machine, model, form, form.settings(), "correction", (0.0, 0.0, -150.0))
    for each in found.changes:
        print(f"{each.freedom.name}: {each.value:+.2f} um, U (k = 2) {2.0 * each.u:.2f} um")
    others = real_machine.unseen(12)
    right = real_machine.positions(linuxcnc_sim, "A", real_machine.real("A"), others)
    for file in (form.file_before, form.file):
        sent = real_machine.positions(linuxcnc_sim, "A", found.files[file].splitlines()[1:], others)
        error = np.linalg.norm((sent - right)[:, :3], axis=1) * 1e3
        print(f"{file}: {np.sqrt(np.mean(error**2)):.2f} um RMS, {error.max():.2f} um at most")


if __name__ == "__main__":
    main()
