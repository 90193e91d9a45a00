"""A second process that is none, for tests of its users."""

import pickle
from collections import deque

from kinematics.running.child_process import BUFFERS


class Here:
    """Does the tasks at once; tasks and answers are copied as if they were sent."""

    def __init__(self, work):
        self._work, self._answers = pickle.loads(pickle.dumps(work)), deque()

    def give(self, task):
        try:
            self._answers.append((True, sent(self._work(sent(task)))))
        except Exception as fault:
            self._answers.append((False, sent(fault)))

    def answer(self):
        done, answer = self._answers.popleft()
        if not done:
            raise answer
        return answer

    def answers_within(self, seconds):  # noqa: ARG002
        return bool(self._answers)

    def end(self):
        """Nothing to end."""


def sent(item):
    """A copy."""
    buffers = []
    text = pickle.dumps(item, BUFFERS, buffer_callback=buffers.append)
    return pickle.loads(text, buffers=[bytes(buffer.raw()) for buffer in buffers])
