"""The only writer of F-curves: the motion of many bodies, in bulk."""

import bpy
import numpy as np
from mathutils import Quaternion

_WAYS = bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items
LINEAR, CONSTANT = (np.array([_WAYS[name].value], np.intc) for name in ("LINEAR", "CONSTANT"))
# Blender 5 knows slots, layers and channel bags only; before 4.4 there are none.
HAS_SLOTS = hasattr(bpy.types, "ActionSlot")


def continuous(rotations):
    """Quaternions [f, n, 4], with signs such that no rotation takes the long path from frame to frame."""
    dots = np.einsum("fnc,fnc->fn", rotations[1:], rotations[:-1])
    signs = np.cumprod(np.where(dots < 0, -1, 1).astype(rotations.dtype), axis=0)
    out = rotations.copy()
    out[1:] *= signs[:, :, None]
    return out


def needed(positions, rotations):
    """Frames that need a key, shape [f, n]: all but those whose pose equals that of both neighbors. Between keys a
    curve is linear, and after the last it is constant, so that nothing is lost."""
    values = np.concatenate([positions, rotations], axis=2)
    changes = (values[1:] != values[:-1]).any(axis=2)
    keyed = np.zeros(values.shape[:2], bool)
    keyed[0] = True
    keyed[1:] |= changes
    keyed[:-1] |= changes
    return keyed


def in_mode(mode, rotations):
    """The property that an object of a rotation mode turns by, and its values for quaternions [k, 4] w x y z."""
    if mode == "QUATERNION":
        return "rotation_quaternion", rotations
    turns = [Quaternion(one) for one in rotations]
    if mode == "AXIS_ANGLE":
        pairs = [turn.to_axis_angle() for turn in turns]
        return "rotation_axis_angle", np.array([(angle, *axis) for axis, angle in pairs])
    made = [turns[0].to_euler(mode)]
    for turn in turns[1:]:
        made.append(turn.to_euler(mode, made[-1]))
    return "rotation_euler", np.array(made)


def write(body, name, frames, positions, rotations, hidden):
    """Gives an object an action. Frames: shape [k], where it is keyed; positions [k, 3]; rotations [k, 4] w x y z;
    `hidden`: None, or frames and whether it is hidden from then on."""
    action = bpy.data.actions.new(name)
    curves = _curves_of(action, body)
    linear = LINEAR.repeat(len(frames))
    coordinates = np.empty((len(frames), 2), np.float32)
    coordinates[:, 0] = frames
    for path, values in (("location", positions), in_mode(body.rotation_mode, rotations)):
        for index in range(values.shape[1]):
            coordinates[:, 1] = values[:, index]
            _key(curves.new(path, index), coordinates, linear)
    if hidden is not None:
        coordinates = np.stack(hidden, axis=1).astype(np.float32)
        for path in ("hide_viewport", "hide_render"):
            _key(curves.new(path, 0), coordinates, CONSTANT.repeat(len(coordinates)))


def retime(action, before, after):
    """Moves all keys of an action in time, from the frames `before` to the frames `after`, shape [n]."""
    for curve in _all_curves(action):
        points = curve.keyframe_points
        coordinates = np.empty(2 * len(points), np.float32)
        points.foreach_get("co", coordinates)
        frames = coordinates[::2].astype(float)
        moved = np.interp(frames, before, after)
        # Keys of others outside the range move along.
        moved += np.minimum(frames - before[0], 0) + np.maximum(frames - before[-1], 0)
        coordinates[::2] = moved
        points.foreach_set("co", coordinates)
        curve.update()


def is_plain(shown):
    """Whether `pose` knows all that an object's animation does."""
    data = shown.animation_data
    if data is None:
        return True
    if data.drivers or data.nla_tracks or (HAS_SLOTS and data.action and len(data.action.slots) > 1):
        return False
    curves = _all_curves(data.action) if data.action else ()
    return all(curve.data_path in shown.bl_rna.properties for curve in curves)


def freeze(body, frame):
    """Sets an object to its action's pose at a frame, and removes the action."""
    pose(body, body.animation_data.action, frame)
    body.animation_data_clear()


def move(giver, taker):
    """Gives an object the action of another one, in the place of its own."""
    taker.animation_data_clear()
    given = giver.animation_data
    if given is not None and given.action is not None:
        data = taker.animation_data_create()
        data.action = given.action
        if HAS_SLOTS:
            data.action_slot = given.action_slot


def pose(body, action, frame):
    """Sets an object without animation to the pose that an action has at a frame."""
    for curve in _all_curves(action):
        name, value = curve.data_path, curve.evaluate(frame)
        if name in body.bl_rna.properties:
            prop = body.bl_rna.properties[name]
            if getattr(prop, "is_array", False):
                getattr(body, name)[curve.array_index] = value
            else:
                setattr(body, name, bool(round(value)) if prop.type == "BOOLEAN" else value)


def digest(action, made):
    """Adds all keys of an action to a hash."""
    for curve in _all_curves(action):
        points = curve.keyframe_points
        coordinates, kinds = np.empty(2 * len(points), np.float32), np.empty(len(points), np.intc)
        points.foreach_get("co", coordinates)
        points.foreach_get("interpolation", kinds)
        made.update(f"{curve.data_path}{curve.array_index}".encode())
        made.update(coordinates.tobytes())
        made.update(kinds.tobytes())


def _all_curves(action):
    if not HAS_SLOTS:
        return list(action.fcurves)
    strips = [strip for layer in action.layers for strip in layer.strips]
    return [curve for strip in strips for bag in strip.channelbags for curve in bag.fcurves]


def _key(curve, coordinates, interpolation):
    """Keys of a curve: frames and values, [k, 2], and the interpolation after each, [k]."""
    points = curve.keyframe_points
    points.add(len(coordinates))
    points.foreach_set("co", coordinates.ravel())
    points.foreach_set("interpolation", interpolation)
    curve.update()


class _Flat:
    """An action's curves up to Blender 4.3."""

    def __init__(self, action):
        self.curves = action.fcurves

    def new(self, path, index):
        return self.curves.new(path, index=index, action_group=GROUPS.get(path, ""))


class _Bag:
    """An action's curves of one object from Blender 4.4 on."""

    def __init__(self, bag):
        self.curves = bag.fcurves
        self.groups = {}
        self.bag = bag

    def new(self, path, index):
        curve = self.curves.new(path, index=index)
        name = GROUPS.get(path)
        if name:
            if name not in self.groups:
                self.groups[name] = self.bag.groups.new(name)
            curve.group = self.groups[name]
        return curve


TURNS = ("rotation_quaternion", "rotation_euler", "rotation_axis_angle")
GROUPS = dict.fromkeys(("location", *TURNS), "Object Transforms")


def _curves_of(action, body):
    data = body.animation_data_create()
    data.action = action
    if not HAS_SLOTS:
        return _Flat(action)
    slot = action.slots.new("OBJECT", body.name)
    data.action_slot = slot
    strip = action.layers.new("Layer").strips.new(type="KEYFRAME")
    return _Bag(strip.channelbag(slot, ensure=True))
