"""Colors bodies by state or by load, while that is switched on. The .blend never has the colors: they are removed
before it is saved, and the handler that follows the frames is not part of it."""

import base64
import functools
import json
import zlib

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy.props import BoolProperty

from . import belongings, dots, points, running, timing

# By the number of `BodyState`: its label, and its color (sRGB) from a palette (Okabe and Ito's) that the
# color-blind can distinguish, too.
STATES = [
    ("Free", (0.93, 0.93, 0.93)),
    ("Waiting", (0.50, 0.50, 0.50)),
    ("Unstable", (0.84, 0.37, 0.00)),
    ("Candidate", (0.34, 0.71, 0.91)),
    ("Held", (0.00, 0.45, 0.70)),
    ("Outside the Region", (0.94, 0.89, 0.26)),
    ("Kept", (0.80, 0.47, 0.65)),
    # A light and a dark green: not the palette's own, which is too near to gray for some.
    ("Glued", (0.55, 0.85, 0.67)),
    ("Anchored", (0.00, 0.35, 0.25)),
]
COLORS = np.array([color for _, color in STATES])
# After these, the colors of loads.
ALL_COLORS = np.concatenate([COLORS, dots.COLORS])
# As Blender keeps colors of objects: linear, in single precision.
LINEAR = np.where(ALL_COLORS <= 0.04045, ALL_COLORS / 12.92, ((ALL_COLORS + 0.055) / 1.055) ** 2.4)
LINEAR = np.concatenate([LINEAR, np.ones((len(LINEAR), 1))], axis=1).astype(np.float32)
# States that the panel always lists: the others are rare.
USUAL = (1, 2, 3, 4)
# Edge of a color's icon, in pixels.
ICON = 16

is_shown = False
# By the load of the dots of glue, instead of by state.
is_by_load = False
_icons = None
# How the 3D Views were colored before, by what the colors are for.
_shadings = {}


def packed(states, start_frame):
    """The states of a pile's bodies, shape [f, n], as a text; empty where the control was off."""
    if not states.any():
        return ""
    # Body by body, a state lasts long.
    data = zlib.compress(np.ascontiguousarray(states.T, np.uint8).tobytes(), 1)
    return json.dumps({"start": start_frame, "frames": len(states), "data": base64.b64encode(data).decode()})


@functools.lru_cache(maxsize=4)
def _unpacked(text):
    content = json.loads(text)
    states = np.frombuffer(zlib.decompress(base64.b64decode(content["data"])), np.uint8)
    return content["start"], known(states).reshape(-1, content["frames"])


def known(states):
    """A newer server's further states are free, as far as is known here."""
    return np.where(states < len(STATES), states, 0)


def at(collection, frame):
    """The states or loads whose colors a pile's bodies have at a scene frame, shape [n]; None if there are none."""
    if is_by_load:
        count = count_of(collection)
        levels = dots.loads(collection, running.report_of(collection).get("dots", ()), count)
        return np.where(levels > 0, len(STATES) - 1 + levels, 0) if levels.any() else None
    if not collection.cairn.states:
        return None
    _, states = _unpacked(collection.cairn.states)
    last = states.shape[1] - 1
    number = last if collection.cairn.mode == "POSE" else _frame_of(collection, frame, last)
    return states[:, number]


def count_of(collection):
    """The largest body number of a pile, which exceeds the count if bodies were removed by hand."""
    is_points = collection.cairn.mode == "POINTS"
    ends = [
        shown.cairn.number + (len(shown.data.vertices) - 1 if is_points else 0)
        for shown in collection.objects
        if shown.cairn.number
    ]
    return max(ends, default=0)


def _frame_of(collection, frame, last):
    """Which frame of the result is shown."""
    if not collection.cairn.frame_count:
        return last
    number = np.searchsorted(timing.shown(collection), frame + 1e-3, side="right") - 1
    return int(min(max(number, 0), last))


def refresh(scene):
    """Sets the colors: those of the states, or the objects' own."""
    if not is_shown:
        restore()
        return
    for collection in scene.collection.children_recursive:
        now = at(collection, scene.frame_current) if collection.cairn.is_result else None
        if now is None:
            continue
        if collection.cairn.mode == "POINTS":
            for shown in belongings.bodies(collection):
                points.show_states(shown, now, LINEAR, _inside(collection))
        else:
            _color(collection.objects, now)
    shade(True)


def _inside(collection):
    """The collection of the objects that show a pile's states."""
    for child in collection.children:
        if child.cairn.is_of_state:
            return child
    made = bpy.data.collections.new(f"{collection.name} States")
    made.cairn.is_of_state = True
    collection.children.link(made)
    return made


def _color(objects, now):
    for body in objects:
        own = body.cairn
        if not 0 < own.number <= len(now):
            continue
        wanted = LINEAR[now[own.number - 1]]
        if not own.is_coloured:
            own.color, own.is_coloured = body.color, True
        elif np.array_equal(body.color, wanted):
            # Blender would redraw it.
            continue
        body.color = wanted


def restore():
    """Gives everything its own colors back."""
    colors = np.empty((len(bpy.data.objects), 4), np.float32)
    bpy.data.objects.foreach_get("color", colors.ravel())
    is_of_state = (colors[:, None] == LINEAR).all(axis=2).any(axis=1)
    for number in np.flatnonzero(is_of_state):
        body = bpy.data.objects[number]
        if body.cairn.is_coloured:
            body.color, body.cairn.is_coloured = body.cairn.color, False
    for collection in bpy.data.collections:
        if collection.cairn.is_result and collection.cairn.mode == "POINTS":
            last = _last(collection)
            for shown in belongings.bodies(collection):
                points.hide_states(shown, last)
    made = [collection for collection in bpy.data.collections if collection.cairn.is_of_state]
    parts = [part for collection in made for part in collection.objects if part.cairn.is_part]
    for collection in made:
        # What an artist put there comes into the pile's collection.
        for pile in (pile for pile in bpy.data.collections if collection.name in pile.children):
            for shown in collection.objects:
                if not shown.cairn.is_part and shown.name not in pile.objects:
                    pile.objects.link(shown)
    meshes = [part.data for part in parts]
    for unwanted in (parts, made, meshes):
        bpy.data.batch_remove(unwanted)
    shade(False)


def _last(collection):
    """The states in the last frame; all free where the pile has no states."""
    if collection.cairn.states:
        return _unpacked(collection.cairn.states)[1][:, -1]
    return np.zeros(count_of(collection), np.uint8)


def shade(by_object, user="states"):
    """Lets solid 3D Views show the objects' colors, or resets them. `user`: what the colors are for."""
    for screen in bpy.data.screens:
        for area in screen.areas:
            space = area.spaces.active
            if area.type != "VIEW_3D":
                continue
            key = user, space.as_pointer()
            if by_object and key not in _shadings:
                _shadings[key] = space.shading.color_type
                space.shading.color_type = "OBJECT"
            elif not by_object and key in _shadings:
                before = _shadings.pop(key)
                if space.shading.color_type == "OBJECT":
                    space.shading.color_type = before


def forget():
    """Another file is opened."""
    global is_shown, is_by_load
    is_shown = is_by_load = False
    _shadings.clear()
    _follow(False)


@persistent
def _on_frame(scene, *_):
    # A render has its own thread, in which no objects may be made.
    if not bpy.app.is_job_running("RENDER"):
        refresh(scene)


def _follow(on):
    # Before Blender evaluates the frame, so that it includes the colors.
    handlers = bpy.app.handlers.frame_change_pre
    if on and _on_frame not in handlers:
        handlers.append(_on_frame)
    elif not on and _on_frame in handlers:
        handlers.remove(_on_frame)


def show(on, by_load=False):
    """Switches the colors on or off."""
    global is_shown, is_by_load
    is_shown, is_by_load = on, on and by_load
    _follow(on)
    restore()
    refresh(bpy.context.scene)


def icon(state):
    return _icons[str(state)].icon_id


def register():
    global _icons
    from bpy.utils import previews

    _icons = previews.new()
    for number, color in enumerate(COLORS):
        made = _icons.new(str(number))
        made.icon_size = ICON, ICON
        made.icon_pixels_float = [*color, 1.0] * ICON * ICON
    # Of this session, not of the file.
    bpy.types.WindowManager.cairn_states = BoolProperty(
        name="Color by State",
        description="Color each body by its state at the current frame, in Solid shading. When switched off, all "
        "objects have their own colors again. The colors are never saved",
        get=lambda _: is_shown and not is_by_load,
        set=lambda _, on: show(on),
    )
    bpy.types.WindowManager.cairn_loads = BoolProperty(
        name="Color by Load",
        description="Color each body by the largest load of its glue dots, in prop weights, in Solid shading. When "
        "switched off, all objects have their own colors again. The colors are never saved",
        get=lambda _: is_by_load,
        set=lambda _, on: show(on, by_load=True),
    )


def unregister():
    show(False)
    del bpy.types.WindowManager.cairn_loads
    del bpy.types.WindowManager.cairn_states
    from bpy.utils import previews

    previews.remove(_icons)
