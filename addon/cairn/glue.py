"""The dots of glue of a pile: drawn in their places, listed with their loads, and bodies colored by load."""

import bpy
import numpy as np
from bpy.props import BoolProperty, IntProperty, StringProperty
from bpy.types import Operator
from mathutils import Matrix, Vector

from . import dots as glued
from . import outline, points, preview, result, running, timing

BROKEN = np.array([0.05, 0.05, 0.05])
# Radius of a dot, relative to a typical prop's diameter.
SIZE = 0.09

is_shown = False
_handle = None


def dots_of(collection):
    """The dots of a pile, the largest loads first."""
    return running.report_of(collection).get("dots", [])


def objects_of(collection):
    """The pile's objects by number."""
    return {shown.cairn.number: shown for shown in collection.objects if shown.cairn.number}


def places(collection):
    """Current positions of the dots: shape [n, 3]; missing bodies have none. Dots move with their bodies, also with
    those that were moved by hand."""
    where = _of_points(collection) if collection.cairn.mode == "POINTS" else _of_objects(collection)
    found = []
    for dot in dots_of(collection):
        matrix = where(glued.number_of(collection, dot["body"]))
        found.append((np.nan,) * 3 if matrix is None else tuple(matrix @ Vector(dot["at"])))
    return np.array(found).reshape(-1, 3)


def _of_objects(collection):
    """A function from a body's number to its pose: a matrix without scale, or None."""
    objects = objects_of(collection)

    def where(number):
        shown = objects.get(number)
        if shown is None:
            return None
        location, rotation, _ = shown.matrix_world.decompose()
        return Matrix.Translation(location) @ rotation.to_matrix().to_4x4()

    return where


def _of_points(collection):
    """The same of instanced points."""
    scene = bpy.context.scene
    frame = timing.number_at(collection, scene.frame_current + scene.frame_subframe)
    parts = [(first, shown, points.places(shown, frame)) for first, shown in objects_of(collection).items()]

    def where(number):
        for first, shown, inside in parts:
            if number is not None and first <= number < first + len(shown.data.vertices):
                matrix = inside(number - first)
                return None if matrix is None else shown.matrix_world @ matrix
        return None

    return where


def has_ended(collection):
    """Whether a collapse has ended the glue at the current frame."""
    frame = running.report_of(collection).get("collapse_frame")
    if frame is None:
        return False
    scene = bpy.context.scene
    is_still = not collection.cairn.frame_count or collection.cairn.mode == "POSE"
    return is_still or timing.number_at(collection, scene.frame_current + scene.frame_subframe) >= frame


class _Drawn:
    """The dots' balls, rebuilt after a body has moved."""

    ball = None
    key = batch = None

    def draw(self):
        collection = result.chosen(bpy.context)
        dots = dots_of(collection) if collection else []
        if not dots or collection.hide_viewport:
            return
        where, is_over = places(collection), has_ended(collection)
        key = collection.name, where.tobytes(), is_over
        if key != self.key:
            self.key, self.batch = key, self._made(collection, dots, where, is_over)
        if self.batch:
            preview.draw_in_front(self.batch)

    def _made(self, collection, dots, where, is_over):
        if self.ball is None:
            self.ball = _ball()
        here = np.isfinite(where).all(axis=1)
        if not here.any():
            return None
        metres = running.recipe_of(collection).get("metres", 1.0)
        size = SIZE * running.report_of(collection)["measures"]["prop_diameter"] / metres
        tints = np.array(
            [BROKEN if is_over or dot["broken"] else glued.COLORS[glued.level(dot["load"])] for dot in dots]
        )
        vertices = (where[here][:, None] + size * self.ball.points).reshape(-1, 3)
        shade = preview.shades(self.ball.normals)
        colors = np.ones((len(vertices), 4), np.float32)
        colors[:, :3] = (shade[None, :, None] * np.array(tints)[here][:, None]).reshape(-1, 3)
        starts = len(self.ball.points) * np.arange(here.sum())
        faces = (starts[:, None, None] + self.ball.triangles).reshape(-1, 3)
        return preview.batch_of(vertices, colors, faces)


def _ball():
    """A sphere of eight times four faces."""
    around, up = np.meshgrid(np.linspace(0, 2 * np.pi, 9), np.linspace(-np.pi / 2, np.pi / 2, 6), indexing="ij")
    points = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1).reshape(-1, 3)
    corner = np.arange(9 * 6).reshape(9, 6)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return outline.Outline(points.astype(np.float32), points.astype(np.float32), triangles.astype(np.int32))


def show(on):
    global is_shown, _handle
    is_shown = on
    if on and _handle is None:
        _handle = bpy.types.SpaceView3D.draw_handler_add(_Drawn().draw, (), "WINDOW", "POST_VIEW")
    elif not on and _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
    preview.redraw(bpy.context)


class CAIRN_OT_select_dot(Operator):
    """Select the bodies that this dot of glue joins"""

    bl_idname = "cairn.select_dot"
    bl_label = "Select Glued Bodies"
    bl_options = {"UNDO"}

    collection: StringProperty(name="Collection", description="The pile's collection")
    dot: IntProperty(name="Dot", description="Index of the dot; the first one carries most", min=0)

    def execute(self, context):
        collection = bpy.data.collections.get(self.collection)
        dots = dots_of(collection) if collection else []
        if self.dot >= len(dots):
            return {"CANCELLED"}
        objects, dot = objects_of(collection), dots[self.dot]
        chosen = [objects.get(glued.number_of(collection, body)) for body in (dot["body"], dot["other"])]
        for other in context.selected_objects:
            other.select_set(False)
        for shown in filter(None, chosen):
            shown.select_set(True)
            context.view_layer.objects.active = shown
        return {"FINISHED"}


CLASSES = [CAIRN_OT_select_dot]


def register():
    # Of this session, not of the file.
    bpy.types.WindowManager.cairn_glue = BoolProperty(
        name="Show Glue",
        description="Show the dots of glue of this pile through the bodies. Darker dots carry more; black dots are "
        "broken",
        get=lambda _: is_shown,
        set=lambda _, on: show(on),
    )


def unregister():
    show(False)
    del bpy.types.WindowManager.cairn_glue
