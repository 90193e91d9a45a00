"""The gain of log evidence by columns that are added to what is present."""

from __future__ import annotations

import numpy as np

from kinematics.transforms import Array


def log_gains(blocks: Array, along: Array, sizes: Array, factor: float) -> Array:
    """Log evidence `(b,)` gained by groups of columns, all of whose prior sizes are equally likely.

    blocks `(b, w, w)`: products of the columns of each group, less what is present explains of them. along `(b, w)`:
    their products with the residual. factor: the variance of the residual.
    """
    values, vectors = np.linalg.eigh(blocks)
    values = np.maximum(values, 0.0)
    turned = (np.swapaxes(vectors, 1, 2) @ along[:, :, None])[:, :, 0]
    each = []
    for size in sizes:
        ratio = size**2 / factor
        each.append(
            0.5 * np.sum(ratio * turned**2 / factor / (1.0 + ratio * values) - np.log1p(ratio * values), axis=1)
        )
    top = np.max(each, axis=0)
    return np.asarray(top + np.log(np.mean(np.exp(np.array(each) - top), axis=0)))
