"""The forming pile, drawn over the 3D View. It is not in the .blend or in the undo history."""

from dataclasses import dataclass

import bpy
import gpu
import numpy as np
from mathutils import Euler, Matrix, Vector

from . import aside, axes, outline, states, tints

# Triangles of one body, from fine to coarse; and the most triangles drawn at once. Many bodies are drawn coarser.
BODY_TRIANGLES = (300, 80, 12)
MAX_TRIANGLES = 190_000
# Direction of the light, and brightness of the dark side.
LIGHT = np.array([0.4, -0.5, 0.77])
AMBIENT = 0.35
# Moves all depths to the nearest twentieth of their range.
NEAREST = Matrix(((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0.05, -0.95), (0, 0, 0, 1)))
# View direction of thumbnails.
VIEW = Euler((1.15, 0.0, 0.6))
COLORS = np.array([[0.80, 0.62, 0.38], [0.47, 0.63, 0.78], [0.70, 0.45, 0.42], [0.55, 0.70, 0.47], [0.68, 0.60, 0.76]])


@dataclass(frozen=True)
class Drawn:
    """A prop for drawing: outlines from fine to coarse, and its color."""

    outlines: list
    tint: np.ndarray


def drawn(props):
    """A generator: makes the outlines of props, one after the other."""
    made = []
    for number, prop in enumerate(props):
        tint = tints.of(prop.source)
        outlines, mesh = [], (prop.vertices, prop.triangles)
        for most in BODY_TRIANGLES:
            mesh = outline.fewer(*mesh, most)
            outlines.append(outline.shaded(*mesh))
        made.append(Drawn(outlines, COLORS[number % len(COLORS)] if tint is None else tint))
        yield
    return made


class Preview:
    """Draws snapshots of a bake. `props`: as `drawn` makes them."""

    def __init__(self, props, metres, is_shown=True):
        self.props, self.metres = props, metres
        self.snapshot = None
        self.is_by_state = False
        self.arrays = self.batch = None
        # The triangles depend on the outlines and the bodies; they are rebuilt only when those change.
        self.faces_of, self.faces = None, None
        self.handle = None
        if is_shown:
            self.handle = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_VIEW")
            aside.begin(self)

    def remove(self):
        if self.handle:
            bpy.types.SpaceView3D.draw_handler_remove(self.handle, "WINDOW")
            self.handle = None
            aside.end(self)

    def update(self, snapshot):
        """Takes the latest snapshot. Returns whether there is anything new to draw."""
        if snapshot is None or (snapshot is self.snapshot and self.is_by_state == states.is_shown):
            return False
        self.snapshot, self.is_by_state = snapshot, states.is_shown
        self.arrays, self.batch = self._vertices(snapshot), None
        return True

    def _vertices(self, snapshot):
        """Positions [v, 3] and colors [v, 4], prop by prop."""
        here = snapshot.present
        props = snapshot.props[here]
        matrices = axes.matrices(
            axes.points_to_blender(snapshot.positions[here], self.metres),
            axes.rotations_to_blender(snapshot.rotations[here]),
            snapshot.scales[here],
        ).astype(np.float32)
        state = states.COLORS[states.known(snapshot.states[here])].astype(np.float32) if states.is_shown else None
        counts = np.bincount(props, minlength=len(self.props))
        outlines = self._outlines(counts)
        vertices, colors = [np.empty((0, 3), np.float32)], [np.empty((0, 4), np.float32)]
        for number, shape in enumerate(outlines):
            chosen = props == number
            placed = matrices[chosen]
            turns = placed[:, :, :3]
            world = shape.points @ turns.transpose(0, 2, 1) + placed[:, None, :, 3]
            # The light as each body sees it.
            light = LIGHT.astype(np.float32) @ turns
            light /= np.maximum(np.linalg.norm(light, axis=1, keepdims=True), 1e-20)
            shade = AMBIENT + (1 - AMBIENT) * np.clip(light @ shape.normals.T, 0, 1)
            tint = self.props[number].tint[None] if state is None else state[chosen]
            color = np.ones((*shade.shape, 4), np.float32)
            color[:, :, :3] = shade[:, :, None] * tint[:, None]
            vertices.append(world.reshape(-1, 3))
            colors.append(color.reshape(-1, 4))
        return np.concatenate(vertices), np.concatenate(colors)

    def _outlines(self, counts):
        """The finest outlines whose triangles are not too many; and these triangles."""
        for level in range(len(BODY_TRIANGLES)):
            outlines = [prop.outlines[level] for prop in self.props]
            if sum(count * len(shape.triangles) for count, shape in zip(counts, outlines)) <= MAX_TRIANGLES:
                break
        if self.faces_of != (level, *counts):
            self.faces_of, faces, first = (level, *counts), [np.empty((0, 3), np.int32)], 0
            for count, shape in zip(counts, outlines):
                starts = first + len(shape.points) * np.arange(count, dtype=np.int32)
                faces.append((starts[:, None, None] + shape.triangles).reshape(-1, 3))
                first += len(shape.points) * count
            self.faces = np.ascontiguousarray(np.concatenate(faces), np.int32)
        return outlines

    def _draw(self):
        if not self.arrays or not len(self.arrays[0]):
            return
        if self.batch is None:
            self.batch = batch_of(*self.arrays, self.faces)
        draw_in_front(self.batch)


def picture(props, metres, snapshot, size):
    """A pile as a small picture: shape [size, size, 4], from its lower left."""
    unseen = Preview(props, metres, is_shown=False)
    unseen.update(snapshot)
    vertices = unseen.arrays[0]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, radius = Vector((low + high) / 2), float(np.linalg.norm(high - low)) / 2
    view = VIEW.to_matrix().to_4x4().inverted() @ Matrix.Translation(-middle)
    # Orthographic: x and y from side to side, the farther the deeper.
    across = np.abs((vertices - np.array(middle)) @ np.array(VIEW.to_matrix())[:, :2]).max()
    projection = Matrix.Diagonal((1 / across, 1 / across, -1 / (2 * radius), 1.0))
    target = gpu.types.GPUOffScreen(size, size)
    try:
        with target.bind():
            frame = gpu.state.active_framebuffer_get()
            frame.clear(color=(0.0, 0.0, 0.0, 0.0), depth=1.0)
            with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
                gpu.matrix.load_matrix(view)
                gpu.matrix.load_projection_matrix(projection)
                draw_in_front(batch_of(*unseen.arrays, unseen.faces))
            buffer = frame.read_color(0, 0, size, size, 4, 0, "FLOAT")
    finally:
        target.free()
    buffer.dimensions = size * size * 4
    return np.array(buffer, np.float32).reshape(size, size, 4)


def shades(normals):
    """The brightness of a surface, shape [n, 3] -> [n]."""
    return AMBIENT + (1 - AMBIENT) * np.clip(normals @ LIGHT, 0, 1)


def batch_of(vertices, colors, faces):
    """Triangles to be drawn: vertices [v, 3], colors [v, 4], faces [t, 3]."""
    layout = gpu.types.GPUVertFormat()
    for name, size in (("pos", 3), ("color", 4)):
        layout.attr_add(id=name, comp_type="F32", len=size, fetch_mode="FLOAT")
    buffer = gpu.types.GPUVertBuf(layout, len(vertices))
    for name, values in (("pos", vertices), ("color", colors)):
        buffer.attr_fill(name, np.ascontiguousarray(values, np.float32))
    elements = gpu.types.GPUIndexBuf(type="TRIS", seq=np.ascontiguousarray(faces, np.int32))
    return gpu.types.GPUBatch(type="TRIS", buf=buffer, elem=elements)


def draw_in_front(batch):
    """Draws in front of the scene, because the control mesh is around the pile, but with its own depth order."""
    # Blender 4 has the same shader for two and three dimensions.
    shader = gpu.shader.from_builtin("3D_SMOOTH_COLOR" if bpy.app.version < (4, 0, 0) else "SMOOTH_COLOR")
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    with gpu.matrix.push_pop_projection():
        gpu.matrix.load_projection_matrix(NEAREST @ gpu.matrix.get_projection_matrix())
        batch.draw(shader)
    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")


def redraw(context, only=None):
    """All 3D Views; or `only` their pictures ("WINDOW") or their sidebars ("UI")."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if only in (None, region.type):
                        region.tag_redraw()
