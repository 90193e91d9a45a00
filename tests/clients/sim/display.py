#!/usr/bin/python3
"""What LinuxCNC starts as its user interface: carry out `job.json`, write the samples beside it.

Run by `linuxcnc_sim.py`, from a copy in the folder of the configuration, under the Python that LinuxCNC's modules were
built for. The job is `{"blocks": [...]}` or `{"program": file name, "feed_override": factor}`, with `"seconds"` to live
and `"channels"`, the columns of each sampler. `samples.bin` gets rows of doubles: one per block, when the machine has
come to rest, or one per servo cycle of the program. `messages.json` gets LinuxCNC's error messages; it is missing when
this program did not get to its end.
"""

import faulthandler
import json
import sys
import time
from array import array
from pathlib import Path

sys.path.append("/usr/lib/python3/dist-packages")
import hal
import linuxcnc

AT_REST = 20  # equal servo cycles; "in position" comes up a few before the joints stop
PAUSE = 0.002  # s, between two looks
HANGING = 5  # s after the end of its time, this program ends wherever it is
ERRORS = (linuxcnc.NML_ERROR, linuxcnc.OPERATOR_ERROR)


class FailedError(Exception):
    """The job cannot be carried out; the arguments are the messages that say why."""


class Simulator:
    """LinuxCNC's task, and the samplers in its real-time part."""

    def __init__(self, channels, seconds):
        self.end = time.monotonic() + seconds
        component = hal.component("display")
        component.ready()
        keys = range(hal.sampler_base, hal.sampler_base + len(channels))
        self.samplers = [hal.stream(component, key, "f" * columns) for key, columns in zip(keys, channels, strict=True)]
        self.status, self.command, self.errors = linuxcnc.stat(), linuxcnc.command(), linuxcnc.error_channel()
        self.wait("LinuxCNC's task to start", self.poll)

    def poll(self):
        """Fetch the status; False while there is none."""
        try:
            self.status.poll()
        except linuxcnc.error:
            return False
        return True

    def check(self):
        """FailedError if LinuxCNC has reported errors."""
        messages = [text.strip() for kind, text in iter(self.errors.poll, None) if kind in ERRORS]
        if messages:
            raise FailedError(*messages)

    def wait(self, what, done):
        """Wait until `done()`."""
        while not done():
            self.check()
            if time.monotonic() > self.end:
                raise FailedError(f"out of time while waiting for {what}")
            time.sleep(PAUSE)

    def do(self, what, order, *arguments):
        """Give an order and wait until it is carried out."""
        order(*arguments)
        result = self.command.wait_complete(max(0.0, self.end - time.monotonic()))
        self.check()
        if result != linuxcnc.RCS_DONE:
            raise FailedError(f"{what}: {'refused' if result == linuxcnc.RCS_ERROR else 'out of time'}")

    def switch_on(self):
        self.do("estop reset", self.command.state, linuxcnc.STATE_ESTOP_RESET)
        self.do("machine on", self.command.state, linuxcnc.STATE_ON)
        self.do("homing", self.command.home, -1)
        self.wait("homing", lambda: self.poll() and all(self.status.homed[: self.status.joints]))

    def new_rows(self):
        """Rows of all samplers since the last call; the samplers run in step, from the first servo cycle on."""
        if any(sampler.num_overruns for sampler in self.samplers):
            raise FailedError("samples were lost: they were not read in time")
        rows = []
        while all(sampler.readable for sampler in self.samplers):
            rows.append([value for sampler in self.samplers for value in sampler.read()])
        return rows

    def idle(self):
        return self.poll() and self.status.interp_state == linuxcnc.INTERP_IDLE and self.status.inpos

    def rows_until_rest(self, what):
        """All rows from now to the one where nothing has changed for AT_REST servo cycles, corrections included."""
        rows = []
        equal = 0

        def at_rest():
            nonlocal equal
            idle = self.idle()
            for row in self.new_rows():
                equal = equal + 1 if idle and rows and row == rows[-1] else 0
                rows.append(row)
            return equal >= AT_REST

        self.wait(what, at_rest)
        return rows

    def blocks(self, blocks):
        """Carry out MDI blocks; one row for each, at rest."""
        self.do("MDI mode", self.command.mode, linuxcnc.MODE_MDI)
        rows = []
        for block in blocks:
            self.do(block, self.command.mdi, block)
            rows.append(self.rows_until_rest(block)[-1])
        return rows

    def program(self, path, feed_override):
        """Run a program; one row for each servo cycle, from before its first move to rest."""
        self.blocks(["G61.1"])
        self.do("AUTO mode", self.command.mode, linuxcnc.MODE_AUTO)
        self.command.feedrate(feed_override)
        self.command.program_open(path)
        self.rows_until_rest("a start from rest")
        self.command.auto(linuxcnc.AUTO_RUN, 0)
        return self.rows_until_rest("the end of the program")


def carry_out(folder, job):
    """Rows of samples; FailedError when there is anything wrong."""
    simulator = Simulator(job["channels"], job["seconds"])
    simulator.switch_on()
    if "program" in job:
        rows = simulator.program(str(folder / job["program"]), job["feed_override"])
    else:
        rows = simulator.blocks(job["blocks"])
    simulator.check()
    return rows


def main():
    folder = Path(__file__).parent
    job = json.loads((folder / "job.json").read_text(encoding="utf-8"))
    faulthandler.dump_traceback_later(job["seconds"] + HANGING, exit=True)
    messages, rows = [], []
    try:
        rows = carry_out(folder, job)
    except FailedError as failure:
        messages = failure.args
    with (folder / "samples.bin").open("wb") as file:
        for row in rows:
            array("d", row).tofile(file)
    (folder / "messages.json").write_text(json.dumps(messages), encoding="utf-8")


if __name__ == "__main__":
    main()
