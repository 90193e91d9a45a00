"""LinuxCNC's own BACKLASH, and ncomp's correction of the same backlash with BACKLASH off: the motors go the same way."""

import numpy as np
import pytest
from clients.linuxcnc_sim import Config
from scipy.spatial import cKDTree
from support.backlash_paths import play
from support.programs import correct, load, model_of, read

from kinematics.effects import Backlash
from postproc.motion.moves import Kind
from postproc.motion.segments import like

pytestmark = pytest.mark.statistical

GANTRY = load("gantry")
WIDTHS = {"X": 20.0, "Y": 40.0, "Z": 10.0}  # um; half of each is a whole number of 0.0001 mm
DWELL = "G4 P0.06\n"
CORNER = 3e-4
"""mm: LinuxCNC rounds corners by its spline (4000 mm/s2 * (1 ms)^2 / 12), and runs an arc as far as it takes per cycle."""
CHORD = 1e-4
"""mm: of the polylines of this test."""
PATH = """G1 X130 Y110 Z105
X120
X125 Y105
Y112 Z100
G2 X135 Y112 I5 J0
G3 X135 Y112 I-4 J0
G18 G2 X139 Z104 I4 K0
G19 G3 Y116 Z108 J0 K4
G17 G2 X143 Y120 I4 J0 Z104
G91 G1 X-2 Y1
G3 X-6 Y6 I-6 J0
G90 G0 X120 Y118
G1 X121 Y116 Z101
"""


def dwelling(text):
    """Each move followed by a dwell, for the ramp of LinuxCNC's correction to come to its end."""
    return "".join(line + "\n" + DWELL for line in text.splitlines())


def distance(points, ways):
    """Distances `(n,)` of points from the nearest of some polylines `(k, m, 3)`."""
    nearest = np.full(len(points), np.inf)
    for way in ways:
        _, at = cKDTree(way).query(points)
        for first in (np.maximum(at - 1, 0), np.minimum(at, len(way) - 2)):
            start, along = way[first], way[first + 1] - way[first]
            share = np.einsum("ij,ij->i", points - start, along) / np.einsum("ij,ij->i", along, along)
            apart = points - start - np.clip(share, 0.0, 1.0)[:, None] * along
            nearest = np.minimum(nearest, np.linalg.norm(apart, axis=1))
    return nearest


def stops(samples, places, columns):
    """Rows at which the machine stands at the places `(n, 3)`, mm, one after the other: late in each stand."""
    moved = np.abs(np.diff(samples.motor[:, columns], axis=0)).max(axis=1) > 1e-9
    last = np.flatnonzero(np.append(moved, True) & ~np.append(True, moved))
    found = []
    for row in last - 5:  # the axes are ahead of the motors
        if len(found) < len(places) and np.abs(samples.axis[row, columns] - places[len(found)]).max() < 1e-6:
            found.append(row)
    assert len(found) == len(places), f"{len(found)} of {len(places)} places reached"
    return np.array(found)


def test_motors_go_where_linuxcnc_s_own_backlash_takes_them(linuxcnc_sim):
    columns = [0, 1, 2]
    head = "G21 G90 G17 G61 F2400\nG0 X100 Y100 Z100\nX101 Y101 Z101\n"
    text = dwelling(head + PATH) + "M2\n"
    model = model_of(GANTRY, *(Backlash(axis, width) for axis, width in WIDTHS.items()))
    corrected = correct(text, GANTRY, model).text
    config = {"axes": "XYZ", "velocity": 200.0, "acceleration": 4000.0}
    own = linuxcnc_sim.run(Config(backlash={a: w * 1e-3 for a, w in WIDTHS.items()}, **config), text)
    ours = linuxcnc_sim.run(Config(**config), corrected)

    nominal, commanded = read(text, GANTRY), read(corrected, GANTRY)
    matched = like(nominal, commanded)
    ends = nominal.machine_target[1:, columns]
    last = ~commanded.intermediate
    at_own = stops(own, ends, columns)
    at_ours = stops(ours, commanded.machine_target[last][1:, columns], columns)
    difference = np.abs(own.motor[at_own] - ours.motor[at_ours])
    assert difference.max() <= 1e-6, "motors, mm, at the ends of the programmed moves"
    assert (commanded.kind == Kind.TAKE_UP).sum() > 10

    # the machine with backlash behind these motors
    first = at_ours[0]
    motors = ours.motor[first:, columns]
    places = np.column_stack(
        [play(np.append(ours.motor[0, i], motors[:, i]), WIDTHS["XYZ"[i]] * 1e-3)[1:] for i in columns]
    )
    assert np.abs(places[at_ours - first] - ends).max() <= 1e-6
    feed = np.isin(matched.kind, (Kind.LINE, Kind.ARC))
    feed[:2] = False
    ways = np.stack([matched.in_machine(matched.along(share))[feed] for share in np.linspace(0.0, 1.0, 501)], axis=1)
    moving = places[: at_ours[-1] - first + 1]
    rapid = int(np.flatnonzero((matched.kind == Kind.RAPID)[last])[-1]) - 1  # of `ends`; where it is on its way
    on_rapid = np.zeros(len(moving), bool)
    on_rapid[at_ours[rapid - 1] - first : at_ours[rapid] - first] = True
    assert distance(moving[~on_rapid], ways).max() <= CORNER + CHORD, "the machine with play, off the nominal path"
