"""A Klartext program run on a machine inside a test."""

import re

import numpy as np

import machines
from postproc.control.setup import make_setup
from postproc.heidenhain.blocks import join_lines, read_block
from postproc.heidenhain.interpreter import HeidenhainInterpreter
from postproc.heidenhain.statements import labels
from postproc.motion.moves import Known
from postproc.text.block_values import straight
from postproc.text.flow import Flow
from postproc.text.notes import Notes
from support.thesis_kinematics import thesis_forward


def numbered_lines(text):
    return list(enumerate(re.findall(r"[^\n]*\n|[^\n]+", text), 1))


def blocks_of(text):
    return [read_block(line, part) for line, part in join_lines(numbered_lines(text))]


class Run:
    """A program run on a machine, up to the end or to the refusal."""

    def __init__(self, text, machine="dmu50", offsets=(), lengths=("T1=100",)):
        self.machine = machines.load(machine) if isinstance(machine, str) else machine
        self.setup = make_setup(self.machine, offsets, lengths, zero=True)
        self.notes = Notes()
        self.interpreter = HeidenhainInterpreter(self.machine, self.setup, self.notes)
        blocks = blocks_of(text)
        scope = self.interpreter.scope
        if any(block.code is not None and block.code.turns for block in blocks):
            flow = Flow(blocks, scope, labels)
            running = (block for _, block in flow.run(self.interpreter))
        else:
            running = straight(blocks, scope)
        self.motions = self.interpreter.read(running)

    def program(self, names="XYZ"):
        """Programmed targets of all moves, mm and degrees."""
        return self.motions.target[:, [self.machine.index(name) for name in names]]

    def axes(self, names="XYZ"):
        """Machine positions after all moves, mm and degrees."""
        q = self.motions.machine_target / self.machine.scale
        return q[:, [self.machine.index(name) for name in names]]

    def known(self, name):
        return Known(self.interpreter.recorder.known[self.machine.index(name)])


HEAD = "0 BEGIN PGM T MM\n1 TOOL CALL 1 Z S1000\n2 L X+10 Y+20 Z+50 B+0 C+0 R0 FMAX M3\n"
TOOLS = ("T1=100",)


def tips(program, rows):
    """Tool tip and axis in the workpiece frame, mm, by the thesis' kinematics of the DMU 50."""
    X, Y, Z, B, C = program.axes("XYZBC")[rows].T
    tip, axis = thesis_forward(X, Y, Z, np.radians(B), np.radians(C))
    return tip - 100 * axis, axis
