"""What is known of rows, and residuals that depend on it."""

import numpy as np


def remembering(rng, n, d=3, memory=0.6):
    """Noise of variance 1 in which a row resembles the one before."""
    noise = rng.normal(size=(n, d))
    for i in range(1, n):
        noise[i] = memory * noise[i - 1] + np.sqrt(1.0 - memory**2) * noise[i]
    return noise


def logged(rng, n, grid=False):
    """What is known of n rows of a five-axis machine; temperature swings several times."""
    time = np.cumsum(rng.uniform(5.0, 20.0, n))
    axes = {axis: rng.uniform(0.0, 1.0, n) for axis in "XYZBC"}
    if grid:
        axes = {axis: np.round(position * 10.0) / 10.0 for axis, position in axes.items()}
    swing = np.sin(rng.uniform(12.0, 25.0) * time / time[-1] + rng.uniform(0.0, 6.0))
    temperature = swing + 0.05 * np.cumsum(rng.normal(size=n))
    return axes | {"time": time, "temperature": temperature, "way of X": np.sign(np.diff(axes["X"], prepend=-1.0))}


def joint(variables):
    """2 bump(X) bump(Z) sin(2 pi t / T), in three components."""
    bumps = [np.exp(-0.5 * ((variables[axis] - 0.5) / 0.2) ** 2) for axis in "XZ"]
    wave = np.sin(2.0 * np.pi * variables["time"] / variables["time"][-1])
    return 2.0 * np.outer(bumps[0] * bumps[1] * wave, [1.0, 1.0, -1.0])
