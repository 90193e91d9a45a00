"""A machine with LinuxCNC's trunnion kinematics whose lines are not those of its machine file."""

import numpy as np
from clients.linuxcnc_sim import Config

PROBE = 150.0  # mm
POINT = np.array([3.0, -7.0, 11.0])  # on C
TILT = {"A": np.array([0.0, -20.0, -15.0]), "B": np.array([-20.0, 0.0, -15.0])}  # from there to A or B
SHIFT_OF_C = np.array([0.042, -0.031, 0.0])
SHIFT_OF_TILT = np.array([0.019, -0.004, -0.036])
"""mm: the lines of the real machine, from those of its machine file."""
SPHERES = {"s1": (130.0, 20.0, 60.0), "s2": (-110.0, 60.0, 50.0), "s3": (20.0, -130.0, 90.0)}
ANGLES = [(tilt, c) for tilt, start in ((-70.0, 0.0), (-35.0, 30.0), (0.0, 0.0), (30.0, 50.0)) for c in
          (start, start + 95.0, start + 190.0, start + 285.0)]  # fmt: skip


def pins(tilt, point, offset):
    """HAL lines of a trunnion table with C through a point and the tilting axis at an offset from it."""
    module = f"xyz{tilt.lower()}c-trt-kins"
    values = {f"{axis}-rot-point": v for axis, v in zip("xyz", point.tolist(), strict=True)}
    values |= {f"{axis}-offset": v for axis, v in zip("xyz", offset.tolist(), strict=True)}
    return [f"setp {module}.{pin} {value!r}" for pin, value in values.items()]


def config(tilt, lines):
    module = f"xyz{tilt.lower()}c-trt-kins"
    connect = f"net tool-length motion.tooloffset.z => {module}.tool-offset"
    return Config(f"XYZ{tilt}C", module, [*lines, connect], tools={1: PROBE})


def real(tilt):
    """HAL lines of the real machine: its lines are not those of the machine file."""
    along = 0 if tilt == "A" else 1
    moved = TILT[tilt] + SHIFT_OF_TILT - SHIFT_OF_C
    moved[along] = 0.0
    return pins(tilt, POINT + SHIFT_OF_C, moved)


def machine_file(tilt):
    against = [-1, 0, 0] if tilt == "A" else [0, -1, 0]
    return f"""
name = "mill"
chain = "w C {tilt} b X Y Z t"
axes.X = {{ travel = [-400, 400] }}
axes.Y = {{ travel = [-400, 400] }}
axes.Z = {{ travel = [-100, 700] }}
axes.C = {{ travel = [-inf, inf], point = {POINT.tolist()}, direction = [0, 0, -1] }}
axes.{tilt} = {{ travel = [-120, 60], point = {(POINT + TILT[tilt]).tolist()}, direction = {against} }}
"""


def positions(linuxcnc_sim, tilt, lines, points):
    """Joint positions `(n, 5)` under kinematics with these HAL lines, for points of the workpiece at angles."""
    blocks = ["T1 M6 G43"]
    for (x, y, z), (a, c) in points:
        blocks.append(f"G53 G0 X{x:.9f} Y{y:.9f} Z{z + PROBE:.9f} {tilt}{a:.9f} C{c:.9f}")
    return linuxcnc_sim.at_rest(config(tilt, lines), blocks).joint[1:]


def unseen(count):
    """Points of the workpiece and angles that were not measured."""
    rng = np.random.default_rng(7)
    return [
        (tuple(rng.uniform((-150, -150, 0), (150, 150, 150))), (rng.uniform(-70, 30), rng.uniform(0, 360)))
        for _ in range(count)
    ]
