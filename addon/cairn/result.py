"""Makes objects from a finished bake: a new collection that shares the props' data. Deletes it again."""

import json

import bpy
import numpy as np
from mathutils import Matrix

from . import (
    axes,
    belongings,
    keeping,
    keyframes,
    parts,
    pointers,
    points,
    prop_collections,
    roots,
    states,
    timing,
    visibility,
)
from .client import Fault

# Bodies up to which `AUTO` animates objects. More of them make Blender slow.
MAX_OBJECTS = 2000
# Bodies that are made, removed and named between two looks at the clock.
BATCH, REMOVED, NAMED = 4, 16, 64
# What `build` yields once the pile is in the scene: it only removes what the pile replaces, which cannot be stopped.
CLOSING = "closing"


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
        self.numbers = None if motion.numbers is None else motion.numbers[ever]
        self.positions = axes.points_to_blender(motion.positions[:, ever], metres)
        self.rotations = axes.rotations_to_blender(motion.rotations[:, ever])
        self.present, self.states = motion.present[:, ever], motion.states[:, ever]


def piles(scene, control):
    """The collections with piles of a control mesh in a scene, visible ones first."""
    inside = [c for c in scene.collection.children_recursive if c.cairn.is_result and c.cairn.control == control]
    return sorted(inside, key=lambda collection: not visibility.is_shown(scene, collection))


def existing(scene, control):
    """The collection with the visible pile of a control mesh in a scene, if there is one."""
    return next(iter(piles(scene, control)), None)


def replaced(scene, control, settings, is_whole=True):
    """The pile that a new one replaces; None if all stay. `settings`: as `to_dict` gives them. `is_whole`: whether the
    new one ran to its end."""
    # Piles edited by hand must not be lost, and another scene's piles are not this scene's to change. What was
    # stopped replaces nothing.
    found = [pile for pile in piles(scene, control) if not pile.cairn.settled and not visibility.others(scene, pile)]
    if not is_whole or not found:
        return None
    if settings.get("use_replace", True):
        return found[0]
    same = [pile for pile in found if seed_of(pile) == settings["seed"]]
    return next(iter(sorted(same, key=lambda pile: not pile.cairn.is_whole)), None)


def shares_of(collection):
    """For each of several props of a pile: its name, its weight as a share of all, its share of the bodies, and their
    count."""
    try:
        recipe, counts = json.loads(collection.cairn.settings), json.loads(collection.cairn.counts)
    except ValueError:
        return []
    weights = recipe.get("weights", ())
    total = sum(counts[: len(weights)])
    if len(weights) < 2 or not total:
        return []
    names = [prop["name"] for prop in recipe["props"]]
    return [(name, weight / sum(weights), count / total, count) for name, weight, count in zip(names, weights, counts)]


def seed_of(collection):
    """The seed of a pile; None if it is not known."""
    try:
        return json.loads(collection.cairn.settings)["settings"]["seed"]
    except (ValueError, KeyError):
        return None


def show_only(scene, collection):
    """Shows one of the piles of a control mesh."""
    for other in piles(scene, collection.cairn.control):
        prop_collections.show(scene, other, other == collection)


def chosen(context):
    """The pile that the panels show: that of the selected object, if it belongs to one; that of the control mesh."""
    control, active = context.scene.cairn.control_mesh, context.object
    if active and active.select_get():
        found = next((c for c in active.users_collection if c.cairn.is_result), None)
        found = found or (existing(context.scene, active) if active.cairn.is_veiled else None)
        if found is not None:
            return found
    return existing(context.scene, control) if control else None


def mode_of(recipe, body_count):
    """The output mode, with `AUTO` decided."""
    chosen = recipe["output_mode"]
    if chosen != "AUTO":
        return chosen
    return "POINTS" if body_count > MAX_OBJECTS else "ANIMATION"


def build(context, motion, recipe, record):
    """Makes the pile. A generator: now and then it yields how far it is, so that Blender stays awake; nothing of the
    pile is in the scene before all of it is made. `record`: what the collection remembers. Returns the collection."""
    scene, found = pointers.asked(recipe)
    scene = scene or context.scene
    control = found.get("control") or bpy.data.objects.get(recipe["control"])
    sources = sources_of(recipe, found)
    gone = [prop["name"] for prop, source in zip(recipe["props"], sources) if source is None]
    if gone:
        raise Fault(f"These props are not in the file any more: {', '.join(gone)}. Bring them back, or bake again.")
    locals_ = [Matrix(prop["local"]) for prop in recipe["props"]]
    moved = BodyMotion(motion, recipe)
    mode, labels = mode_of(recipe, len(moved.props)), keeping.labels(moved, recipe)
    name = f"{control.name if control else recipe['control']} Pile"
    yield 0.0

    before = replaced(scene, control, recipe.get("settings", {"seed": 0}), record.get("is_whole", True))
    root = before and roots.of(before)
    is_new = root is None
    corners = roots.corners_of(control, moved.positions[-1])
    if is_new:
        root = roots.make(name, corners)
    objects, made = [], []
    try:
        own, others = (yield from belongings.sorted_out(before)) if before else ([], [])
        made = parts.make(context, sources, locals_, as_collections=mode == "POINTS")
        if mode == "POINTS":
            objects += points.write(name, moved, _numbered(name, made), recipe["start_frame"])
            yield 1.0
        else:
            moved.rotations = keyframes.continuous(moved.rotations)
            for batch in range(0, len(moved.props), BATCH):
                for body in range(batch, min(batch + BATCH, len(moved.props))):
                    objects.append(_body(made, moved, body, mode, recipe["start_frame"], labels[body]))
                    roots.adopt(root, objects[-1])
                    belongings.mark(objects[-1])
                yield len(objects) / len(moved.props)
    except GeneratorExit:
        # Cancelled on the way.
        _remove([*objects, root] if is_new else objects, made)
        raise

    kept = keeping.objects_kept(before, own, others, objects, moved, mode) if before and recipe.get("keeps") else {}
    staying, changed = set(kept.values()), set(others)
    own, others = ([shown for shown in found if shown not in staying] for found in (own, others))
    if before:
        # Reported with the other notes of the bake.
        recipe["notes"] = [*recipe.get("notes", ()), *filter(None, [_taken_out(before, own, others, staying)])]
        roots.settle(root, corners)
    collection = before or _collection(scene, control, name, recipe, record)
    for place, old in kept.items():
        keeping.hand_over(old, objects[place], old in changed)
        own.append(objects[place])
        objects[place] = old
    # Slow for many one by one; and until here nobody has seen them.
    _link([shown for shown in ([root, *objects] if is_new else objects) if shown not in staying], collection)
    for shown in objects:
        # The empty may have a new home.
        roots.adopt(root, shown)
        if mode == "POINTS":
            belongings.mark(shown)
    _remember(scene, collection, recipe, record, mode, control)
    pointers.write(collection.cairn.pointers, found)
    belongings.note_data(collection, made if mode != "POINTS" else ())
    prop_collections.refresh(collection, sources)
    pointers.forget(recipe)
    timing.set_by_bake(collection, recipe["start_frame"], len(moved.positions))
    collection.cairn.left_out = json.dumps(moved.left_out)
    collection.cairn.labels = json.dumps(labels) if recipe.get("keeps") else ""
    collection.cairn.counts = json.dumps(np.bincount(moved.props, minlength=len(made)).tolist())
    collection.cairn.states = states.packed(moved.states, recipe["start_frame"])
    states.refresh(scene)
    named = [] if mode == "POINTS" else [(label, shown, shown in staying) for label, shown in zip(labels, objects)]
    closing = _closing(own, named, made)
    try:
        for _ in closing:
            yield CLOSING
    except GeneratorExit:
        # Blender closes the file, or ends.
        finish(closing)
        raise
    return collection


def _closing(own, named, made):
    """A generator: removes the bodies that were replaced, and names the new ones like them. `named`: as for
    `_naming`."""
    yield from _removing(own)
    yield from _naming(named, made)


def sources_of(recipe, found):
    """The props' objects; None where one is gone. `found`: as `pointers` has them."""
    named = enumerate(recipe["props"])
    return [found.get(f"props.{n}") or bpy.data.objects.get((prop["name"], prop.get("library"))) for n, prop in named]


def _link(objects, collection):
    for made_object in objects:
        collection.objects.link(made_object)


def _naming(named, made):
    """A generator: gives the bodies their numbers in their names. The pile that they replace is gone. `named`: for
    each body its number, its object, and whether that has its name already."""
    # Up to Blender 4.2, another block with the name would lose it.
    taken, used = set(bpy.data.objects.keys()), set(bpy.data.actions.keys())
    for number, (label, shown, has_name) in enumerate(named):
        if number % NAMED == 0:
            yield
        name = shown.name if has_name else _name(made[shown.cairn.prop], label, len(named))
        if not has_name and name not in taken:
            shown.name = name
        action = shown.animation_data.action if shown.animation_data else None
        if action and name not in used:
            action.name = name
        if not has_name:
            shown.cairn.made_name = shown.name


def _name(part, label, count):
    """The name of a body of so many. Its prop's name is without dots, which other programs' files do not have in
    names."""
    return f"{part.name.replace('.', '_')} Body {label:0{max(3, len(str(count)))}}"


def _body(made, moved, body, mode, start_frame, label):
    part = made[moved.props[body]]
    factor = float(moved.scales[body])
    shown = part.body(_name(part, label, len(moved.props)), factor)
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
    shown = _body(made, moved, body, "POSE", 0, body + 1)
    shown.cairn.number = number
    return shown


def _numbered(name, made):
    """A collection of the parts' collections, whose order, by name, is the props'."""
    outer = bpy.data.collections.new(f"{name} Parts")
    for number, part in enumerate(made):
        part.collection.name = f"{number:05} {part.name}"
        outer.cairn.is_part = True
        outer.children.link(part.collection)
    return outer


def _collection(scene, control, name, recipe, record):
    """The new, empty collection of a result."""
    if existing(scene, control):
        is_whole = record.get("is_whole", True)
        name += f" Seed {recipe['settings']['seed']}" if is_whole else " Unfinished"
    collection = bpy.data.collections.new(name)
    scene.collection.children.link(collection)
    return collection


def _remember(scene, collection, recipe, record, mode, control):
    note = collection.cairn
    note.is_result = True
    note.control = control
    note.mode = mode
    note.is_whole = record.get("is_whole", True)
    note.use_prop_collections = recipe.get("settings", {}).get("use_prop_collections", False)
    note.bake_id = record.get("bake_id", "")
    note.result_hash = record.get("result_hash", "")
    is_container = recipe.get("settings", {}).get("use_inside", False)
    if control and is_container:
        visibility.unveil(scene, control, stays=True)
        show_only(scene, collection)
    elif control:
        said = visibility.veil(scene, control)
        if said:
            recipe["notes"] = [*recipe.get("notes", ()), said]
        show_only(scene, collection)
    record["warnings"] = list(dict.fromkeys([*record.get("warnings", ()), *recipe.get("notes", ())]))
    note.settings = json.dumps(recipe)
    note.report = json.dumps(record)


def clear(collection):
    """Removes what the bake made in a pile and nobody changed, and the data that only that used; the pile's empty
    stays. Everything else is moved out: gives a sentence about it."""
    own, others = finish(belongings.sorted_out(collection))
    said = _taken_out(collection, own, others)
    _remove(own)
    return said


def _taken_out(collection, own, others, staying=frozenset()):
    """Takes everything but the pile's empty out of a pile's collection, and moves the artist's things beside it. Gives
    a sentence about those. `own`, `others`: as `belongings` sorts them, without bodies that go on (`staying`)."""
    states.restore()
    # Something may have come in since.
    mine, root = {*own, *staying}, roots.of(collection)
    others = [*others, *(shown for shown in collection.objects if shown != root and shown not in mine)]
    inner = _made_by(own)[4]
    strangers = [shown for held in prop_collections.of(collection) for shown in held.objects if shown not in mine]
    strangers += [shown for part in inner for shown in part.objects if not shown.cairn.is_part]
    others = list(dict.fromkeys([*others, *strangers]))
    theirs = [child for child in collection.children if not child.cairn.is_of_state]
    place = belongings.move_out(collection, others, theirs)
    freed = [child for child in belongings.let_children_be(own) if child not in others]
    prop_collections.remove(collection)
    said = belongings.said(collection.name, others, theirs, place, freed)
    collection.cairn.pointers.clear()
    for shown in own:
        if shown.name in collection.objects:
            collection.objects.unlink(shown)
    return said


def _remove(objects, made=()):
    """Removes objects that a bake made, and the data that only they used. `made`: parts that are not needed either."""
    finish(_removing(objects, made))


def _removing(objects, made=()):
    """The same as a generator, which yields now and then."""
    before = _made_by(objects, made)
    yield from _removing_all(objects)
    # Data that refers to other data comes first.
    for ids in before:
        yield from _removing_all([data for data in ids if data.users == 0])


def _removing_all(blocks):
    for batch in range(0, len(blocks), REMOVED):
        bpy.data.batch_remove(blocks[batch : batch + REMOVED])
        yield


def finish(generator):
    """Runs a generator to its end, and gives what it returns."""
    while True:
        try:
            next(generator)
        except StopIteration as end:
            return end.value


def delete(scene, collection):
    """Deletes a baked pile, and shows the control mesh as before. Gives a sentence about what stays."""
    control = collection.cairn.control
    elsewhere = visibility.others(scene, collection)
    if elsewhere:
        # The other scenes keep it.
        visibility.leave(scene, collection)
        said = f"“{collection.name}” stays in the scene “{elsewhere[0].name}”"
    else:
        said = clear(collection)
        root = roots.of(collection)
        if root is not None and (root.animation_data or root.constraints or root.parent or root.children):
            # The artist's work, or what such an object hangs on.
            belongings.move_out(collection, [root])
        elif root is not None:
            bpy.data.objects.remove(root)
        bpy.data.collections.remove(collection)
    rest = piles(scene, control) if control else []
    if rest:
        show_only(scene, rest[0])
    elif control:
        visibility.unveil(scene, control)
    states.refresh(scene)
    return said


def _made_by(objects, made=()):
    """Data blocks that a bake made for objects, in groups to be checked in this order once the objects are removed."""
    actions, groups, outer, tables = set(), set(), set(), set()
    meshes, inner = ({getattr(part, name) for part in made} - {None} for name in ("data", "collection"))
    for body in objects:
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
    # Props' own collections and meshes are the artist's.
    inner, outer = ({part for part in found if part.cairn.is_part} for found in (inner, outer))
    members = {member for part in inner for member in part.objects if member.cairn.is_part}
    tables = {table for table in tables if table.cairn.is_part}
    data = meshes | {shown.data for shown in (*tables, *members) if isinstance(shown.data, bpy.types.Mesh)}
    data = {mesh for mesh in data if isinstance(mesh, bpy.types.Mesh) and mesh.cairn_made}
    return actions, groups, tables, outer, inner, members, data
