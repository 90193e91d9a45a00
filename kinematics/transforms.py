"""Rigid transforms in batches: rotations `(n, 3, 3)` and translations `(n, 3)`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
AnyArray = TypeVar("AnyArray", bound=np.ndarray[Any, Any])

TURN_RAD = 2.0 * np.pi
ROUNDING_OF_DIRECTION = 1e-12
"""Component of a unit vector below which it is rounding."""
ROWS_OF_BLOCK = 4096
"""Rows of a block of a long column, so that the arrays of a block stay in the cache."""


def blocks(n: int) -> Iterator[slice]:
    """The rows 0 ... n - 1, in blocks."""
    return (slice(start, min(start + ROWS_OF_BLOCK, n)) for start in range(0, n, ROWS_OF_BLOCK))


def read_only(array: AnyArray) -> AnyArray:
    """The same array, read-only: for those that are kept and shared."""
    array.setflags(write=False)
    return array


class Pose(NamedTuple):
    """A batch of rigid transforms p -> rotation p + translation; either part may have one row for all."""

    rotation: Array
    translation: Array

    def __matmul__(self, other: Pose) -> Pose:
        """Compose: `(a @ b)` applies b first."""
        if _is_identity(self.rotation):
            return Pose(other.rotation, self.apply(other.translation))
        rotation = self.rotation if _is_identity(other.rotation) else self.rotation @ other.rotation
        return Pose(rotation, self.apply(other.translation))

    def apply(self, points: ArrayLike) -> Array:
        """Transform points `(n, 3)` or `(3,)`, mm."""
        return turn(self.rotation, points) + self.translation

    def inverse(self) -> Pose:
        """The transforms back."""
        back = np.swapaxes(self.rotation, 1, 2)
        return Pose(back, -turn(back, self.translation))


IDENTITY = Pose(read_only(np.eye(3)[None]), read_only(np.zeros((1, 3))))


def _is_identity(rotation: Array) -> bool:
    """True for the rotation of IDENTITY, which every linear axis has: products with it are not calculated."""
    return rotation is IDENTITY.rotation


def turn(rotation: Array, vectors: ArrayLike) -> Array:
    """Rotate vectors `(n, 3)` or `(3,)` by rotations `(n, 3, 3)`, row by row."""
    rows = np.atleast_2d(np.asarray(vectors, float))
    return rows if _is_identity(rotation) else np.asarray((rotation @ rows[..., None])[..., 0])


def by_turn(arms: Array) -> Array:
    """Derivatives `(..., 3, 3)`, per rad, of points by a small turn of their body; arms `(..., 3)` from its centre."""
    return np.cross(np.eye(3), arms[..., None, :]).swapaxes(-1, -2)


def rotation_about(direction: ArrayLike, angle: ArrayLike) -> Array:
    """Rotation matrices `(n, 3, 3)` about one unit direction `(3,)` by angles `(n,)`, rad (Rodrigues)."""
    d = np.asarray(direction, float)
    a = np.atleast_1d(np.asarray(angle, float))
    k = np.array([[0.0, -d[2], d[1]], [d[2], 0.0, -d[0]], [-d[1], d[0], 0.0]])
    s, versed = np.sin(a)[:, None, None], 2.0 * np.sin(a / 2.0)[:, None, None] ** 2
    return np.asarray(np.eye(3) + s * k + versed * (k @ k))


def rotation_vector_matrix(vectors: ArrayLike) -> Array:
    """Rotation matrices `(n, 3, 3)` of rotation vectors `(n, 3)`, rad; exact at and near zero."""
    v = np.atleast_2d(np.asarray(vectors, float))
    x, y, z = v.T
    angle = np.linalg.norm(v, axis=1)
    # numpy's sinc is sin(pi x)/(pi x)
    sine, versed = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    rotation = np.empty((len(v), 3, 3))
    for i, (row, column) in enumerate(((y, z), (x, z), (x, y))):
        rotation[:, i, i] = 1.0 - versed * (row**2 + column**2)
    for i, j, product, component in ((1, 0, x * y, z), (0, 2, x * z, y), (2, 1, y * z, x)):
        rotation[:, i, j], rotation[:, j, i] = versed * product + sine * component, versed * product - sine * component
    return rotation


def rotation_vector(rotation: Array) -> Array:
    """Rotation vectors `(n, 3)`, rad, of rotation matrices `(n, 3, 3)` with angles below pi."""
    r = np.asarray(rotation)
    sine = 0.5 * np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=1)
    s = np.linalg.norm(sine, axis=1)
    angle = np.arctan2(s, (np.trace(r, axis1=1, axis2=2) - 1.0) / 2.0)
    return np.asarray(sine / np.sinc(angle / np.pi)[:, None])
