"""The place where props are dropped: over the painted part of a mesh, given by weights of a vertex group."""

import numpy as np

from . import export
from .client import Fault

# Weight from which a point counts as painted, and the largest number of cells across the mesh.
PAINTED, MOST_CELLS = 0.5, 64


def cells(context, source, group, size):
    """Squares that are below or above painted faces, seen from above: the edge length, the corner next to the origin,
    and which squares exist, shape [x, y]. `size`: the wanted edge length, scene units."""
    if group not in source.vertex_groups:
        raise Fault(f"“{source.name}” has no vertex group “{group}”. Choose another region, or paint one.")
    corners, weights = _triangles(context, source, source.vertex_groups[group].index)
    of_paint = weights.max(axis=1, initial=0.0) >= PAINTED
    corners, weights = corners[of_paint][:, :, :2], weights[of_paint]
    if not len(corners):
        raise Fault(
            f"Nothing is painted in the vertex group “{group}” of “{source.name}”. Paint where props should fall."
        )
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    edge = max(size, float((high - low).max()) / MOST_CELLS)
    found = np.zeros(np.floor((high - low) / edge).astype(int) + 1, bool)
    for triangle, weight in zip((corners - low) / edge, weights):
        _fill(found, triangle, weight)
    return edge, low, found


def _triangles(context, source, index):
    """Corners [t, 3, 3] in the world and weights [t, 3], as the modifiers leave them."""
    with export.evaluated(context, [source]) as geometry:
        shown = geometry.shown(source)
        mesh = shown.to_mesh()
        try:
            mesh.calc_loop_triangles()
            weights = np.zeros(len(mesh.vertices))
            for vertex in mesh.vertices:
                for held in vertex.groups:
                    if held.group == index:
                        weights[vertex.index] = held.weight
            triangles = np.empty(len(mesh.loop_triangles) * 3, np.int32)
            mesh.loop_triangles.foreach_get("vertices", triangles)
            points = np.empty(len(mesh.vertices) * 3, np.float32)
            mesh.vertices.foreach_get("co", points)
        finally:
            shown.to_mesh_clear()
        place = np.array(geometry.matrix(source))
    world = points.reshape(-1, 3) @ place[:3, :3].T + place[:3, 3]
    triangles = triangles.reshape(-1, 3)
    return world[triangles], weights[triangles]


def _fill(found, triangle, weight):
    """Cells whose center is in the painted part of a triangle [3, 2], and the cells of its painted corners, so that
    no part is too small."""
    for corner in triangle[weight >= PAINTED]:
        found[tuple(np.minimum(corner.astype(int), np.array(found.shape) - 1))] = True
    first = np.floor(triangle.min(axis=0)).astype(int)
    last = np.minimum(np.floor(triangle.max(axis=0)).astype(int) + 1, found.shape)
    x, y = np.meshgrid(*(np.arange(a, b) + 0.5 for a, b in zip(first, last)), indexing="ij")
    (ax, ay), (bx, by), (cx, cy) = triangle
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if abs(area) < 1e-9:
        return
    second = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
    third = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
    shares = np.stack([1 - second - third, second, third], axis=-1)
    found[first[0] : last[0], first[1] : last[1]] |= (shares >= -1e-6).all(axis=-1) & (shares @ weight >= PAINTED)


def block(edge, corner, found, bottom, top):
    """A closed mesh over cells: vertices [n, 3] and triangles [m, 3]."""
    columns, rows = found.shape
    x, y = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1), indexing="ij")
    layer = np.stack([corner[0] + edge * x, corner[1] + edge * y], axis=-1).reshape(-1, 2)
    vertices = np.concatenate([np.column_stack([layer, np.full(len(layer), z)]) for z in (bottom, top)])
    quads, up = [], len(layer)
    is_there = np.pad(found, 1)
    # The corners of a cell, counterclockwise, and the neighbor beyond the edge from each corner to the next.
    around, beyond = ((0, 0), (1, 0), (1, 1), (0, 1)), ((0, -1), (1, 0), (0, 1), (-1, 0))
    for column, row in np.argwhere(found):
        a, b, c, d = ((column + dx) * (rows + 1) + row + dy for dx, dy in around)
        quads += [(a, d, c, b), (up + a, up + b, up + c, up + d)]
        for (dx, dy), (one, other) in zip(beyond, ((a, b), (b, c), (c, d), (d, a))):
            if not is_there[column + dx + 1, row + dy + 1]:
                quads.append((one, other, up + other, up + one))
    quads = np.array(quads, np.int32)
    used, triangles = np.unique(np.concatenate([quads[:, :3], quads[:, (0, 2, 3)]]), return_inverse=True)
    return vertices[used], triangles.reshape(-1, 3).astype(np.int32)
