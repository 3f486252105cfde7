"""Makes objects from a finished bake: a new collection that shares the props' data. Deletes it again."""

import json

import bpy
import numpy as np
from mathutils import Matrix

from . import axes, keyframes, parts, pointers, points, prop_collections, states, timing
from .client import Fault

# Bodies up to which `AUTO` animates objects. More of them make Blender slow.
MAX_OBJECTS = 2000
# Bodies that are made between two looks at the clock.
BATCH = 4


class BodyMotion:
    """The motion in Blender's space. Shapes: props [n], scales [n], positions [f, n, 3] in scene units, rotations
    [f, n, 4] w x y z, present and states [f, n]."""

    def __init__(self, motion, recipe):
        metres = recipe["metres"]
        # A body that was never there has no place, and one that stays as placed is in the scene already.
        is_shown = np.array([prop.get("is_shown", True) for prop in recipe["props"]])
        ever = motion.present.any(axis=0) & is_shown[motion.props]
        self.left_out = np.flatnonzero(~ever).tolist()
        ever = slice(None) if ever.all() else ever
        self.props, self.scales = motion.props[ever], motion.scales[ever]
        self.positions = axes.points_to_blender(motion.positions[:, ever], metres)
        self.rotations = axes.rotations_to_blender(motion.rotations[:, ever])
        self.present, self.states = motion.present[:, ever], motion.states[:, ever]


def piles(scene, control):
    """The collections with piles of a control mesh in a scene, visible ones first."""
    inside = [c for c in scene.collection.children_recursive if c.cairn.is_result and c.cairn.control == control]
    return sorted(inside, key=lambda collection: collection.hide_viewport)


def existing(scene, control):
    """The collection with the visible pile of a control mesh in a scene, if there is one."""
    return next(iter(piles(scene, control)), None)


def replaced(scene, control, settings):
    """The pile that a new one replaces; None if all stay. `settings`: as `to_dict` gives them."""
    found = piles(scene, control)
    if settings.get("use_replace", True) and found:
        return found[0]
    # Piles edited by hand must not be lost.
    same = [pile for pile in found if seed_of(pile) == settings["seed"] and not pile.cairn.settled]
    return next(iter(same), None)


def seed_of(collection):
    """The seed of a pile; None if it is not known."""
    try:
        return json.loads(collection.cairn.settings)["settings"]["seed"]
    except (ValueError, KeyError):
        return None


def show_only(scene, collection):
    """Shows one of the piles of a control mesh."""
    for other in piles(scene, collection.cairn.control):
        prop_collections.show(other, other == collection)


def chosen(context):
    """The pile that the panels show: that of the control mesh, or that of the active object."""
    control, active = context.scene.cairn.control_mesh, context.object
    found = existing(context.scene, control) if control else None
    if found is None and active:
        found = next((collection for collection in active.users_collection if collection.cairn.is_result), None)
    return found


def mode_of(recipe, body_count):
    """The output mode, with `AUTO` decided."""
    chosen = recipe["output_mode"]
    if chosen != "AUTO":
        return chosen
    return "POINTS" if body_count > MAX_OBJECTS else "ANIMATION"


def build(context, motion, recipe, record):
    """Makes the pile. A generator: now and then it yields how far it is, so that Blender stays awake; nothing of the
    pile is in the scene before the end. `record`: what the collection remembers. Returns the collection."""
    scene, found = pointers.asked(recipe)
    scene = scene or context.scene
    control = found.get("control") or bpy.data.objects.get(recipe["control"])
    sources = sources_of(recipe, found)
    gone = [prop["name"] for prop, source in zip(recipe["props"], sources) if source is None]
    if gone:
        raise Fault(f"These props are not in the file any more: {', '.join(gone)}. Bring them back, or bake again.")
    locals_ = [Matrix(prop["local"]) for prop in recipe["props"]]
    moved = BodyMotion(motion, recipe)
    mode = mode_of(recipe, len(moved.props))
    name = f"{control.name if control else recipe['control']} Pile"
    yield 0.0

    objects = []
    try:
        made = parts.make(context, sources, locals_, as_collections=mode == "POINTS")
        if mode == "POINTS":
            objects += points.write(name, moved, _numbered(name, made), recipe["start_frame"])
            yield 1.0
        else:
            moved.rotations = keyframes.continuous(moved.rotations)
            for batch in range(0, len(moved.props), BATCH):
                for body in range(batch, min(batch + BATCH, len(moved.props))):
                    objects.append(_body(made, moved, body, mode, recipe["start_frame"]))
                yield len(objects) / len(moved.props)
    except GeneratorExit:
        # Cancelled on the way.
        unwanted = bpy.data.collections.new(name)
        _link(objects, unwanted)
        clear(unwanted)
        bpy.data.collections.remove(unwanted)
        raise

    collection = _collection(scene, control, name, recipe.get("settings", {}))
    # Slow for many one by one; and until here nobody has seen them.
    _link(objects, collection)
    _remember(scene, collection, recipe, record, mode, control)
    pointers.write(collection.cairn.pointers, found)
    prop_collections.refresh(collection, sources)
    pointers.forget(recipe)
    timing.set_by_bake(collection, recipe["start_frame"], len(moved.positions))
    collection.cairn.left_out = json.dumps(moved.left_out)
    collection.cairn.states = states.packed(moved.states, recipe["start_frame"])
    states.refresh(scene)
    return collection


def sources_of(recipe, found):
    """The props' objects; None where one is gone. `found`: as `pointers` has them."""
    named = enumerate(recipe["props"])
    return [found.get(f"props.{n}") or bpy.data.objects.get((prop["name"], prop.get("library"))) for n, prop in named]


def _link(objects, collection):
    for made_object in objects:
        collection.objects.link(made_object)


def _body(made, moved, body, mode, start_frame):
    part = made[moved.props[body]]
    factor = float(moved.scales[body])
    shown = part.body(f"{part.name} Body", factor)
    shown.cairn.number, shown.cairn.prop, shown.cairn.size = body + 1, int(moved.props[body]), factor
    here = moved.present[:, body]
    # Where it is first or last seen.
    at = np.flatnonzero(here)[-1 if mode == "POSE" else 0]
    shown.location = moved.positions[at, body]
    shown.rotation_quaternion = moved.rotations[at, body]
    if mode == "POSE":
        shown.hide_viewport = shown.hide_render = not here[-1]
        return shown
    positions, rotations = moved.positions[here, body], moved.rotations[here, body]
    numbers = np.flatnonzero(here)
    keyed = keyframes.needed(positions[:, None], rotations[:, None])[:, 0]
    hidden = None
    if not here.all():
        changes = np.flatnonzero(np.concatenate([[True], here[1:] != here[:-1]]))
        hidden = changes + start_frame, ~here[changes]
    if keyed.sum() > 1 or hidden is not None:
        keyframes.write(shown, shown.name, numbers[keyed] + start_frame, positions[keyed], rotations[keyed], hidden)
    return shown


def still_body(made, moved, body, number):
    """Sets a body to its pose in the last frame."""
    shown = _body(made, moved, body, "POSE", 0)
    shown.cairn.number = number
    return shown


def _numbered(name, made):
    """A collection of the parts' collections, whose order, by name, is the props'."""
    outer = bpy.data.collections.new(f"{name} Parts")
    for number, part in enumerate(made):
        part.collection.name = f"{number:05} {part.name}"
        outer.children.link(part.collection)
    return outer


def _collection(scene, control, name, settings):
    """The empty collection of the result: the one that it replaces, or a new one."""
    collection, before = replaced(scene, control, settings), existing(scene, control)
    if collection:
        clear(collection)
    else:
        collection = bpy.data.collections.new(f"{name} Seed {settings['seed']}" if before else name)
        scene.collection.children.link(collection)
        if before:
            # The shape is wire already.
            note = collection.cairn
            note.is_result, note.control = True, control
            note.control_hide_render = before.cairn.control_hide_render
            note.control_display_type = before.cairn.control_display_type
    return collection


def _remember(scene, collection, recipe, record, mode, control):
    note = collection.cairn
    if control and not note.is_result:
        note.control_hide_render, note.control_display_type = control.hide_render, control.display_type
    note.is_result = True
    note.control = control
    note.mode = mode
    note.use_prop_collections = recipe.get("settings", {}).get("use_prop_collections", False)
    note.bake_id = record.get("bake_id", "")
    note.result_hash = record.get("result_hash", "")
    note.settings = json.dumps(recipe)
    note.report = json.dumps(record)
    if control:
        control.hide_render = True
        # The pile stands where the mesh is.
        control.display_type = "WIRE"
        show_only(scene, collection)


def clear(collection):
    """Deletes the bodies, and the data that only they use."""
    states.restore()
    prop_collections.remove(collection)
    before = _made_by(collection)
    bpy.data.batch_remove(list(collection.objects))
    # Data that only they used. Data that refers to other data comes first.
    for ids in before:
        unused = [data for data in ids if data.users == 0]
        bpy.data.batch_remove(unused)


def delete(collection):
    """Deletes a baked pile, and shows the control mesh as before."""
    note = collection.cairn
    others = [pile for pile in piles(bpy.context.scene, note.control) if pile != collection] if note.control else []
    if others:
        show_only(bpy.context.scene, others[0])
    elif note.control:
        note.control.hide_render = note.control_hide_render
        note.control.display_type = note.control_display_type or "TEXTURED"
    clear(collection)
    bpy.data.collections.remove(collection)
    states.refresh(bpy.context.scene)


def _made_by(collection):
    """Data blocks that the bodies use, in groups to be checked in this order after the bodies are deleted."""
    actions, groups, meshes, outer, inner, tables = set(), set(), set(), set(), set(), set()
    for body in collection.objects:
        if body.animation_data and body.animation_data.action:
            actions.add(body.animation_data.action)
        if body.data:
            meshes.add(body.data)
        if body.instance_collection:
            inner.add(body.instance_collection)
        for modifier in body.modifiers:
            if modifier.type == "NODES" and modifier.node_group:
                groups.add(modifier.node_group)
    for group in groups:
        for node in group.nodes:
            if node.bl_idname == "GeometryNodeObjectInfo" and node.inputs["Object"].default_value:
                tables.add(node.inputs["Object"].default_value)
            if node.bl_idname == "GeometryNodeCollectionInfo" and node.inputs["Collection"].default_value:
                outer.add(node.inputs["Collection"].default_value)
    for parts_collection in outer:
        inner.update(parts_collection.children)
    members = {member for parts_collection in inner for member in parts_collection.objects}
    data = meshes | {table.data for table in tables} | {member.data for member in members if member.data}
    return actions, groups, tables, outer, inner, members, data
