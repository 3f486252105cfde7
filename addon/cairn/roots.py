"""The empty that a pile's objects are parented to: moving, scaling, parenting or animating it moves all of them.

The bodies' own coordinates stay those of the bake: with the empty at home, they are the world's. Home is the middle of
the shape's base. It is a delta transform, so that clearing location, rotation and scale brings the pile back.
"""

import bpy
import numpy as np
from mathutils import Matrix, Vector

# Radius of the empty, relative to the shape's width.
SIZE = 0.6
# A pile counts as moved from here on, relative to the values at home.
MOVED = 1e-5


def of(pile):
    """The empty of a pile; None if it was removed."""
    found = [shown for shown in pile.objects if shown.cairn.is_root]
    return next((shown for shown in found if shown.name == shown.cairn.made_name), found[0] if found else None)


def make(name, corners):
    """A new empty, in no collection yet. `corners`: points around the pile, scene units."""
    made = bpy.data.objects.new(name, None)
    made.empty_display_type = "PLAIN_AXES"
    made.cairn.is_root, made.cairn.made_name = True, made.name
    settle(made, corners)
    return made


def settle(root, corners):
    """Sets the home of an empty that is at its home: below the middle of some points."""
    corners = [Vector(corner) for corner in corners]
    if not corners or not is_home(root):
        return
    low, high = (Vector(map(pick, zip(*corners))) for pick in (min, max))
    root.delta_location = root.cairn.home = ((low.x + high.x) / 2, (low.y + high.y) / 2, low.z)
    root.empty_display_size = max(SIZE * max(high.x - low.x, high.y - low.y), 1e-3)


def is_home(root):
    """Whether a pile is where it was baked."""
    still = Matrix.Translation(root.delta_location)
    off = max(abs(a - b) for one, other in zip(root.matrix_basis, still) for a, b in zip(one, other))
    is_moved = off > MOVED * (1.0 + Vector(root.delta_location).length) or root.parent or root.constraints
    return not is_moved and root.animation_data is None


def is_left_behind(root, control, place):
    """Whether a shape was moved since the bake, when its matrix was `place`, and its pile was not moved with it."""
    here, place = np.array(control.matrix_world), np.array(place)
    along = np.array(root.matrix_world @ Matrix.Translation(root.cairn.home).inverted()) @ place if root else place
    off = min(np.abs(here - place).max(), np.abs(here - along).max())
    return off > MOVED * (1.0 + np.abs(place).max())


def adopt(root, shown):
    """Parents an object to the empty. Its own coordinates stay those of the bake."""
    shown.parent = root
    shown.matrix_parent_inverse = Matrix.Translation(root.cairn.home).inverted()


def corners_of(control, positions):
    """Points around a pile: of its shape, or of its bodies."""
    if control is not None:
        return [control.matrix_world @ Vector(corner) for corner in control.bound_box]
    return [positions.min(axis=0), positions.max(axis=0)] if len(positions) else []
