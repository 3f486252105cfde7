"""The pile as it forms, drawn over the 3D View. Nothing of it is in the .blend or in the undo history."""

import bpy
import gpu
import numpy as np
from mathutils import Matrix

from . import axes, states

# Triangles that may be drawn at once, and of one body; beyond it bodies are drawn as boxes.
MAX_TRIANGLES = 120_000
MAX_BODY_TRIANGLES = 400
# Where the light comes from, and what the dark side still has.
LIGHT = np.array([0.4, -0.5, 0.77])
AMBIENT = 0.35
# Moves all depths to the nearest twentieth of their range.
NEAREST = Matrix(((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0.05, -0.95), (0, 0, 0, 1)))
COLORS = np.array([[0.80, 0.62, 0.38], [0.47, 0.63, 0.78], [0.70, 0.45, 0.42], [0.55, 0.70, 0.47], [0.68, 0.60, 0.76]])


class Preview:
    """Draws snapshots of a bake. `props`: triangles of each in its own frame, shape [t, 3, 3]."""

    def __init__(self, props, metres):
        self.metres = metres
        self.shapes = [tris if len(tris) <= MAX_BODY_TRIANGLES else box(tris) for tris in props]
        self.boxes = [box(tris) for tris in props]
        self.snapshot = None
        self.is_by_state = False
        self.arrays = self.batch = None
        self.handle = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_VIEW")

    def remove(self):
        if self.handle:
            bpy.types.SpaceView3D.draw_handler_remove(self.handle, "WINDOW")
            self.handle = None

    def update(self, snapshot):
        """Takes the latest. Whether there is anything new to draw."""
        if snapshot is None or (snapshot is self.snapshot and self.is_by_state == states.is_shown):
            return False
        self.snapshot, self.is_by_state = snapshot, states.is_shown
        self.arrays, self.batch = self._triangles(snapshot), None
        return True

    def _triangles(self, snapshot):
        here = snapshot.present
        props = snapshot.props[here]
        matrices = axes.matrices(
            axes.points_to_blender(snapshot.positions[here], self.metres),
            axes.rotations_to_blender(snapshot.rotations[here]),
            snapshot.scales[here],
        ).astype(np.float32)
        tints = states.COLORS[states.known(snapshot.states[here])] if states.is_shown else COLORS[props % len(COLORS)]
        counts = np.bincount(props, minlength=len(self.shapes))
        total = sum(count * len(shape) for count, shape in zip(counts, self.shapes))
        shapes = self.shapes if total <= MAX_TRIANGLES else self.boxes
        vertices, colors = [np.empty((0, 3), np.float32)], [np.empty((0, 4), np.float32)]
        for prop, shape in enumerate(shapes):
            placed = matrices[props == prop]
            points = shape.reshape(-1, 3).astype(np.float32)
            world = np.einsum("nij,pj->npi", placed[:, :, :3], points) + placed[:, None, :, 3]
            corners = world.reshape(-1, 3, 3)
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-20)
            shade = AMBIENT + (1 - AMBIENT) * np.clip(normals @ LIGHT, 0, 1)
            color = np.ones((len(corners), 4), np.float32)
            color[:, :3] = shade[:, None] * np.repeat(tints[props == prop], len(shape), axis=0)
            vertices.append(corners.reshape(-1, 3))
            colors.append(np.repeat(color, 3, axis=0))
        return np.concatenate(vertices), np.concatenate(colors)

    def _draw(self):
        if not self.arrays or not len(self.arrays[0]):
            return
        # Blender 4 has the same shader for two and three dimensions.
        shader = gpu.shader.from_builtin("3D_SMOOTH_COLOR" if bpy.app.version < (4, 0, 0) else "SMOOTH_COLOR")
        if self.batch is None:
            layout = gpu.types.GPUVertFormat()
            for name, size in (("pos", 3), ("color", 4)):
                layout.attr_add(id=name, comp_type="F32", len=size, fetch_mode="FLOAT")
            buffer = gpu.types.GPUVertBuf(layout, len(self.arrays[0]))
            for name, values in zip(("pos", "color"), self.arrays):
                buffer.attr_fill(name, np.ascontiguousarray(values, np.float32))
            self.batch = gpu.types.GPUBatch(type="TRIS", buf=buffer)
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(True)
        with gpu.matrix.push_pop_projection():
            # In front of the scene, since the control mesh is around the pile; but in its own order of depth.
            gpu.matrix.load_projection_matrix(NEAREST @ gpu.matrix.get_projection_matrix())
            self.batch.draw(shader)
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")


def box(triangles):
    """The box around triangles, as triangles [12, 3, 3]."""
    points = triangles.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    corners = np.array([[(low, high)[n >> axis & 1][axis] for axis in range(3)] for n in range(8)])
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return corners[[corner for a, b, c, d in faces for corner in (a, b, c, a, c, d)]].reshape(-1, 3, 3)


def redraw(context, only=None):
    """All 3D Views; or `only` their pictures ("WINDOW") or their sidebars ("UI")."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if only in (None, region.type):
                        region.tag_redraw()
