"""Virtual machines that are followed on the fly: the set-up of the fixed benchmark, paths, readings, programs."""

import itertools

import numpy as np

import machines
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Target
from calibration.on_the_fly.drive import PathDynamics
from calibration.on_the_fly.nominal_path import NominalPath
from calibration.on_the_fly.readings import Readings
from calibration.on_the_fly.virtual import Session, readings_of
from calibration.simulation.simulate import tracker_pose

FIXED_TOML = """
name = "fixed"
chain = "w b Y X Z t"
axes.X = { travel = [0, 600] }
axes.Y = { travel = [0, 600] }
axes.Z = { travel = [0, 450] }
"""
FIXED = machines.parse(FIXED_TOML, "fixed")
ONE = {"t": Target((0.0, 0.0, -100.0))}
AT = (-1500.0, -300.0, 200.0)
TRACKER = LaserTracker(u_range_um=1.0, u_angle_um=2.0, u_angle_um_per_m=1.0)


def path_of(machine, vertices, counts=None):
    """A path through vertices `(m, axes)` in mm and degrees, in the order of X, Y, Z, then the others by name."""
    names = sorted(machine.names, key=lambda name: ("XYZ".find(name) % 9, name))
    q = np.zeros((len(vertices), len(machine.axes)))
    q[:, [machine.index(name) for name in names]] = vertices
    q = q * machine.scale
    moves = np.diff(q, axis=0) / np.where(machine.rotary, machine.scale, 1.0)
    linear, turned = (np.linalg.norm(moves[:, mask], axis=1) for mask in (~machine.rotary, machine.rotary))
    way = np.concatenate([[0.0], np.cumsum(np.where(linear > 0, linear, turned))])
    return NominalPath(machine, q, way, np.ones(len(q), bool) if counts is None else counts, "path.nc")


def polyline(seed, vertices=24):
    """A path between random places on the faces of the fixed volume."""
    rng = np.random.default_rng(seed)
    size = np.array([600.0, 600.0, 450.0])
    places = rng.uniform(0, 1, (vertices, 3)) * size
    side = rng.integers(0, 3, vertices)
    places[np.arange(vertices), side] = np.where(rng.random(vertices) < 0.5, 0.0, size[side])
    return path_of(FIXED, places)


def diagonals():
    """Face and space diagonals, rapid moves from one to the next."""
    size, places, counts = np.array([600.0, 600.0, 450.0]), [], []
    for axes in ((0, 1), (0, 2), (1, 2), (0, 1, 2)):
        for corner in itertools.product((0.0, 1.0), repeat=3):
            if corner[axes[0]] == 0.0:
                other = np.array(corner)
                other[list(axes)] = 1.0 - other[list(axes)]
                places += [np.array(corner) * size, other * size]
                counts += [False, True]
    return path_of(FIXED, np.array(places), np.array(counts))


def followed(path, truth, *, targets=None, feeds=(5000.0,), rate=50.0, stations=(AT,), tracker=TRACKER, seed=0, **more):
    """Readings of a tracker, as read from a file, and what they were made from."""
    rng = np.random.default_rng(seed)
    poses = {f"s{k}": tracker_pose(place, rng) for k, place in enumerate(stations, start=1)}
    settings = [PathDynamics(feed, rate=rate) for feed in feeds]
    session = Session(path, settings, targets or ONE, poses, **{k: v for k, v in more.items() if k != "noise_scale"})
    made = readings_of(session, truth, tracker, rng, noise_scale=more.get("noise_scale", 1.0))
    return as_read(made), made


def as_read(made):
    """What a file of these readings would say."""
    state = made.state
    lines = np.arange(len(made)) + 5
    return Readings(
        made.instrument,
        made.targets,
        made.stands_on,
        state.time,
        made.observed,
        state.target,
        state.station,
        made.run,
        {},
        lines,
        "points.csv",
        "",
    )


def program(path, feed=2500.0):
    """An NC program, in machine coordinates, that goes along the path."""
    lines = ["%", "G21 G90 G94", "G49 G61"]
    for position, feeds in zip(path.positions / path.machine.scale, path.feed_move, strict=True):
        words = " ".join(f"{name}{value:.6f}" for name, value in zip(path.machine.names, position, strict=True))
        lines.append(f"G53 {'G1' if feeds else 'G0'} {words}" + (f" F{feed:.1f}" if feeds else ""))
    return "\n".join([*lines, "M30", "%", ""])
