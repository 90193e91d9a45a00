"""The gain of log evidence by columns that are added to what is present: by readings, and as expected without them."""

from __future__ import annotations

import numpy as np

from kinematics.error_model.priors import SIZES_IN_TYPICAL
from kinematics.transforms import Array


def log_gains(blocks: Array, along: Array, sizes: Array, factor: float) -> Array:
    """Log evidence `(b,)` gained by groups of columns, all of whose prior sizes are equally likely.

    blocks `(b, w, w)`: products of the columns of each group, less what is present explains of them. along `(b, w)`:
    their products with the residual. factor: the variance of the residual.
    """
    values, vectors = np.linalg.eigh(blocks)
    turned = (np.swapaxes(vectors, 1, 2) @ along[:, :, None])[:, :, 0]
    return log_gains_by_squares(np.maximum(values, 0.0), turned**2, sizes, factor)


def log_gains_by_squares(values: Array, squares: Array, sizes: Array, factor: float | Array) -> Array:
    """As `log_gains`, from the eigenvalues `(b, w)` of the products, and squares `(b, w)` along their eigenvectors.

    The squares may be those that are expected of a signal, with those of the noise, `factor` times the eigenvalues.
    """
    each = []
    for size in sizes:
        ratio = size**2 / factor
        each.append(0.5 * np.sum(ratio * squares / factor / (1.0 + ratio * values) - np.log1p(ratio * values), axis=-1))
    top = np.max(each, axis=0)
    return np.asarray(top + np.log(np.mean(np.exp(np.array(each) - top), axis=0)))


def expected_gain(block: Array, signal: Array) -> float:
    """Log evidence that columns are expected to gain from readings with a signal, in units of the noise.

    block `(w, w)`: products of the columns, less what is present explains of them. signal `(w,)`: their products with
    the signal, likewise.
    """
    values, vectors = np.linalg.eigh(block)
    values = np.maximum(values, 0.0)
    return float(log_gains_by_squares(values, (signal @ vectors) ** 2 + values, SIZES_IN_TYPICAL, 1.0))
