"""Machines with backlash, random paths, and the path that such a machine follows, worked out by itself."""

import math
import random
import re

import numpy as np

from kinematics.effects import Backlash
from postproc.motion.moves import Kind
from postproc.motion.segments import like
from support.programs import model_of, random_model, read


def played(machine, **widths):
    """The machine with backlash of so many um."""
    return model_of(machine, *(Backlash(axis, width) for axis, width in widths.items()))


HEAD = "G21 G90 G17 F500\nG0 X100 Y100 Z100\nX110 Y110 Z110\n"


def play(commands, width):
    """Where the axis is `(n,)` that is pushed from either end of a gap of `width`, starting in the middle of it.

    A gap below 0 is one that the commands jump over by themselves: the axis is ahead.
    """
    place, found, low, high = commands[0], [], -abs(width) / 2, abs(width) / 2
    for command in commands:
        place = min(max(place, command + low), command + high)
        found.append(place if width > 0 else 2 * command - place)
    return np.array(found)


def physical(commanded, widths, points=40):
    """Axis positions `(moves, points, axes)`, mm and rad, of the machine with backlash along the commanded moves."""
    shares = (np.arange(points) + 1) / points
    commands = np.stack([commanded.in_machine(commanded.along(share)) for share in shares], axis=1)
    places = commands.copy()
    for axis, width in widths.items():
        i = commanded.machine.index(axis)
        places[:, :, i] = play(commands[:, :, i].ravel(), width * 1e-3).reshape(commands.shape[:2])
    return shares, places


def largest_error(text, corrected, machine, widths, **setup):
    """Farthest, um, that the machine with play is from the nominal ends, and from the nominal ways of feed moves."""
    nominal, commanded = read(text, machine, **setup), read(corrected, machine, **setup)
    matched = like(nominal, commanded)
    shares, places = physical(commanded, widths)
    # the first two blocks go to a known place, from a known side
    rows = np.arange(len(matched)) >= 2
    ends = np.abs(places[:, -1] - matched.machine_target)[rows & ~matched.intermediate].max(initial=0.0) * 1e3
    feed = rows & np.isin(matched.kind, (Kind.LINE, Kind.ARC))
    along = [
        np.abs(places[feed, i] - matched.in_machine(matched.along(share))[feed]).max(initial=0.0)
        for i, share in enumerate(shares)
    ]
    return ends, max(along) * 1e3


LETTERS = {"G17": ("X", "Y", "I", "J", "Z"), "G18": ("Z", "X", "K", "I", "Y"), "G19": ("Y", "Z", "J", "K", "X")}


class Path:
    """A random program of moves from where the program has put the axes."""

    def __init__(self, seed):
        self.rng = random.Random(seed)
        self.at = {"X": 110.0, "Y": 110.0, "Z": 110.0}
        self.lines, self.incremental, self.timed, self.codes = [], False, False, ""

    def text(self, blocks):
        steps = [self.line, self.line, self.arc, self.arc, self.radius, self.circle, self.rapid, self.switch]
        for _ in range(blocks):
            self.rng.choice(steps)()
        return HEAD + "\n".join(self.lines) + "\nM30\n"

    def emit(self, code, targets, more=""):
        words = [f"{a}{v - (self.at[a] if self.incremental else 0.0):.4f}" for a, v in targets.items()]
        feed = " F30" if self.timed and code != "G0" else ""
        if "G94" in self.codes:
            feed = " F500"
        self.lines.append(self.codes + " ".join([code, *words]) + more + feed)
        self.codes = ""
        for axis, value in targets.items():
            self.at[axis] = round(value, 4)

    def near(self, axis):
        return round(self.at[axis] + self.rng.choice((0.0002, 0.003, 0.3, 5)) * self.rng.uniform(-1, 1), 4)

    def line(self):
        axes = self.rng.sample("XYZ", self.rng.randint(1, 3))
        self.emit("G1", {axis: self.near(axis) for axis in axes})

    def rapid(self):
        self.emit("G0", {axis: self.near(axis) for axis in self.rng.sample("XYZ", 2)})

    def switch(self):
        what = self.rng.choice(("distance", "time"))
        if what == "distance":
            self.incremental = not self.incremental
            self.say("G91" if self.incremental else "G90")
        else:
            self.timed = not self.timed
            self.say("G93" if self.timed else "G94")

    def say(self, code):
        if self.codes:  # codes come into force in the order in which they were drawn
            self.lines.append(self.codes.strip())
            self.codes = ""
        if self.rng.random() < 0.5:
            self.lines.append(code + (" F500" if code == "G94" else ""))
        else:
            self.codes = code + " "

    def geometry(self):
        plane = self.rng.choice(list(LETTERS))
        first, second, i, j, normal = LETTERS[plane]
        radius = self.rng.choice((0.02, 1, 10)) * self.rng.uniform(0.5, 1)
        start = self.rng.choice((self.rng.uniform(0, 6.28), self.rng.randrange(4) * math.pi / 2))
        offset = round(-radius * math.cos(start), 4), round(-radius * math.sin(start), 4)
        self.lines.append(plane)
        return first, second, i, j, normal, offset

    def arc(self):
        first, second, i, j, normal, offset = self.geometry()
        sense, turn = self.rng.choice((2, 3)), self.rng.uniform(0.3, 5.9)
        angle = math.atan2(-offset[1], -offset[0]) + turn * (1 if sense == 3 else -1)
        radius = math.hypot(*offset)
        targets = {
            first: self.at[first] + offset[0] + radius * math.cos(angle),
            second: self.at[second] + offset[1] + radius * math.sin(angle),
        }
        if self.rng.random() < 0.3:
            targets[normal] = self.near(normal)
        self.emit(f"G{sense}", targets, f" {i}{offset[0]:.4f} {j}{offset[1]:.4f}")

    def circle(self):
        _, _, i, j, normal, offset = self.geometry()
        more = f" {i}{offset[0]:.4f} {j}{offset[1]:.4f}"
        targets = {normal: self.near(normal)} if self.rng.random() < 0.3 else {}
        self.emit(self.rng.choice(("G2", "G3")), targets, more)

    def radius(self):
        first, second, _, _, _, _ = self.geometry()
        way = [self.rng.uniform(-3, 3), self.rng.uniform(1, 3)]
        radius = math.hypot(*way) * self.rng.uniform(0.6, 2) * self.rng.choice((1, -1))
        targets = {first: self.at[first] + way[0], second: self.at[second] + way[1]}
        self.emit(self.rng.choice(("G2", "G3")), targets, f" R{radius:.4f}")


TOO_SMALL = re.compile("rounding would (reverse this arc|exchange this arc|leave this arc without a radius)")
"""Why arcs are refused that are smaller than the play: their ends, or one of them and the centre, may fall together."""
ROUNDING = 0.1
BAND = 0.5
ARC_RADIUS_UM = 1.5
"""The test's arcs are no better circles: four decimals on a short radius, a radius to four decimals."""


def with_backlash(machine, seed):
    model, rng = random_model(machine, seed), np.random.default_rng(seed)
    plays = [Backlash(axis.name, float(rng.uniform(2, 40)), float(rng.uniform(-9, 9))) for axis in machine.axes]
    return model_of(machine, *model.effects, *plays)
