"""A task for workers that ends its process."""

import os
import signal
from pathlib import Path


def square(number: int, attempts: str) -> int:
    """The square of a number; the task of 3 adds a line to the file `attempts`, and is killed."""
    if number == 3:
        with Path(attempts).open("a", encoding="utf-8") as file:
            file.write("again\n")
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number
