"""A simple mesh for drawing a prop many times: few triangles that keep its outline. Does not import Blender."""

from dataclasses import dataclass

import numpy as np

# Cells along each side of the prop's box, from the finest tried to the coarsest.
CELLS = (9, 7, 5, 4, 3)
# Cosine up to which a corner has its face's own normal: an edge is sharp.
SMOOTH = 0.7


@dataclass(frozen=True)
class Outline:
    """Points and normals [v, 3], triangles [t, 3]."""

    points: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray


def fewer(points, triangles, most):
    """A mesh of at most `most` triangles: nearby points are merged."""
    if len(triangles) <= most:
        return points, triangles
    for cells in CELLS:
        made = clustered(points, triangles, cells)
        if 0 < len(made[1]) <= most:
            return made
    return box(points)


def clustered(points, triangles, cells):
    """The points of each cell of a grid as one, in their middle."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.where(high > low, high - low, 1.0)
    places = np.minimum(((points - low) / size * cells).astype(int), cells - 1)
    cell = np.ravel_multi_index(tuple(places.T), (cells, cells, cells))
    count = np.bincount(cell, minlength=cells**3)
    used = np.flatnonzero(count)
    middles = np.stack([np.bincount(cell, points[:, axis], cells**3)[used] / count[used] for axis in range(3)], axis=1)
    number = np.full(cells**3, -1)
    number[used] = np.arange(len(used))
    faces = number[cell[triangles]]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    a, b, c = np.sort(faces, axis=1).T
    _, first = np.unique((a * len(used) + b) * len(used) + c, return_index=True)
    return middles, faces[np.sort(first)]


def shaded(points, triangles):
    """Adds normals: smooth, except at sharp edges."""
    corners = points[triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.zeros_like(points)
    for corner in range(3):
        np.add.at(sums, triangles[:, corner], across)
    flat, smooth = _unit(across), _unit(sums)
    is_smooth = np.einsum("tcx,tx->tc", smooth[triangles], flat) > SMOOTH
    # Corners on an edge are points of their own, after the others.
    sharp = np.argwhere(~is_smooth)
    faces = triangles.copy()
    faces[~is_smooth] = len(points) + np.arange(len(sharp))
    own = triangles[~is_smooth]
    return Outline(
        np.concatenate([points, points[own]]).astype(np.float32),
        np.concatenate([smooth, flat[sharp[:, 0]]]).astype(np.float32),
        faces.astype(np.int32),
    )


def _unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-20)


def box(points):
    """The box around points, as a mesh of twelve triangles."""
    low, high = points.min(axis=0), points.max(axis=0)
    corners = np.array([[(low, high)[n >> axis & 1][axis] for axis in range(3)] for n in range(8)])
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return corners, np.array([corner for a, b, c, d in faces for corner in ((a, b, c), (a, c, d))])
