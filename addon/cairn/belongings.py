"""What a bake made, and what is the artist's. Only what a bake made and nobody changed is ever removed; everything else
in a pile's collections is moved out."""

import hashlib
import json
import re

import bpy
import numpy as np

from . import keyframes, pointers, roots

# Objects that are looked at between two pauses.
BATCH = 16
NUMBERED = re.compile(r"\.\d{3,}$")


def bodies(pile):
    """The objects that show a pile's bodies."""
    return [shown for shown in pile.objects if shown.cairn.number]


def number_copies(pile):
    """Gives copies of bodies, made by hand, numbers of their own."""
    found, seen = bodies(pile), set()
    last = max((body.cairn.number for body in found), default=0)
    for body in sorted(found, key=lambda body: body.name != body.cairn.made_name):
        if body.cairn.number in seen:
            last += 1
            body.cairn.number = last
        seen.add(body.cairn.number)


def mark(shown):
    """Remembers an object as the bake leaves it."""
    shown.cairn.made_name, shown.cairn.mark = shown.name, _digest(shown)


def mark_mesh(mesh):
    """Remembers a mesh that the bake made."""
    mesh.cairn_made = _mesh_digest(mesh)


def note_data(pile, parts):
    """Remembers the data that the bodies of a pile have. `parts`: as `parts.make` gives them."""
    known = {key: value for key, value in pointers.read(pile.cairn.pointers).items()}
    for data in (part.data or part.collection for part in parts):
        if data is not None and data not in known.values():
            known[f"data.{len(known)}"] = data
    pointers.write(pile.cairn.pointers, known)


class Unchanged:
    """Decides which of a pile's objects are as the bake left them."""

    def __init__(self, pile):
        found = pointers.read(pile.cairn.pointers)
        self.data = {value for key, value in found.items() if key.startswith("data.")}
        self.meshes = {}
        self.root = roots.of(pile)
        # Copies have the numbers of their originals.
        self.first = {}
        for shown in bodies(pile):
            before = self.first.get(shown.cairn.number)
            if before is None or (before.name != before.cairn.made_name and shown.name == shown.cairn.made_name):
                self.first[shown.cairn.number] = shown

    def __call__(self, shown):
        own = shown.cairn
        if not own.number or self.first[own.number] != shown:
            return False
        # A number at the end is Blender's.
        if NUMBERED.sub("", shown.name) != NUMBERED.sub("", own.made_name):
            return False
        data = shown.instance_collection if shown.type == "EMPTY" else shown.data
        is_mesh = isinstance(data, bpy.types.Mesh)
        # Of points, each object has a mesh of its own.
        if data not in self.data and not (is_mesh and data.cairn_made and "Pile" in shown.modifiers):
            return False
        if is_mesh and data.cairn_made and not self._is_same(data):
            return False
        return shown.parent == self.root and _digest(shown) == own.mark

    def _is_same(self, mesh):
        if mesh not in self.meshes:
            self.meshes[mesh] = _mesh_digest(mesh) == mesh.cairn_made
        return self.meshes[mesh]


def sorted_out(pile):
    """A generator that yields now and then: the objects of a pile that only the bake made, and the others, without the
    pile's own empty."""
    is_unchanged, own, others = Unchanged(pile), [], []
    for number, shown in enumerate(list(pile.objects)):
        if shown != is_unchanged.root:
            (own if is_unchanged(shown) else others).append(shown)
        if number % BATCH == 0:
            yield
    return own, others


def move_out(pile, others, collections=()):
    """Moves objects and collections of the artist from a pile's collections to one beside the pile. Gives that
    collection; None if there is nothing to move."""
    if not others and not collections:
        return None
    parents = [outer for outer in _all_collections() if pile.name in outer.children]
    inside = {pile, *(c for c in bpy.data.collections if c.cairn.of_pile == pile or c.cairn.is_of_state)}
    place = None

    def there():
        nonlocal place
        if place is None:
            place = _saved(pile, parents)
        return place

    for shown in others:
        if all(holder in inside or holder.cairn.is_part for holder in shown.users_collection):
            there().objects.link(shown)
        for holder in shown.users_collection:
            if holder in inside or holder.cairn.is_part:
                holder.objects.unlink(shown)
        # A copy of a body is not one.
        shown.cairn.number, shown.cairn.is_root = 0, False
    for holder in collections:
        if not [outer for outer in _all_collections() if outer not in inside and holder.name in outer.children]:
            there().children.link(holder)
        for outer in inside:
            if holder.name in outer.children:
                outer.children.unlink(holder)
    return place


def _saved(pile, parents):
    for found in bpy.data.collections:
        if found.cairn.saved_of == pile:
            return found
    made = bpy.data.collections.new(f"{pile.name} Saved")
    made.cairn.saved_of = pile
    for outer in parents:
        outer.children.link(made)
    return made


def _all_collections():
    return [*(scene.collection for scene in bpy.data.scenes), *bpy.data.collections]


def let_children_be(removed):
    """Objects whose parents are removed stay where they are. Gives those."""
    gone = set(removed)
    found = [child for child in bpy.data.objects if child.parent in gone and child not in gone]
    for child in found:
        place = child.matrix_world.copy()
        child.parent = None
        child.matrix_world = place
    return found


def said(pile_name, others, collections, place, freed=()):
    """A sentence about what was moved out; empty if nothing was."""
    names = [f"“{one.name}”" for one in (*others, *collections)]
    sentences = []
    if names:
        shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
        where = f"is in “{place.name}”" if place else "stays in its other collections"
        sentences.append(f"What you added to “{pile_name}” or changed in it {where}: {shown}")
    if freed:
        shown = ", ".join(f"“{one.name}”" for one in freed[:5])
        sentences.append(f"No longer parented to a body, but in the same place: {shown}")
    return ". ".join(sentences)


def _digest(shown):
    """A text that differs once an artist has changed the object. Visibility and display are not part of it."""
    own = shown.cairn
    motion = shown.animation_data
    is_animated = bool(motion and motion.action)
    custom = [
        (name, str(shown[name]))
        for name in sorted(shown.keys())
        if name not in shown.bl_rna.properties and not hasattr(shown[name], "keys")
    ]
    parts = [
        shown.type,
        [] if is_animated else [*shown.location, *shown.rotation_quaternion],
        [*shown.scale, *shown.delta_location, *shown.delta_scale],
        shown.rotation_mode,
        [(modifier.type, modifier.name) for modifier in shown.modifiers],
        [constraint.type for constraint in shown.constraints],
        [(slot.link, slot.material.name if slot.link == "OBJECT" and slot.material else "") for slot in _slots(shown)],
        [*(own.color if own.is_coloured else shown.color)],
        [shown.pass_index, custom, bool(motion and (motion.drivers or motion.nla_tracks))],
    ]
    made = hashlib.blake2b(repr(parts).encode(), digest_size=16)
    if is_animated:
        keyframes.digest(motion.action, made)
    for modifier in shown.modifiers:
        if modifier.type == "NODES" and modifier.node_group:
            made.update(_of_nodes(modifier.node_group).encode())
    return made.hexdigest()


def _slots(shown):
    return shown.material_slots if shown.data else ()


def _of_nodes(group):
    nodes = []
    for node in group.nodes:
        values = [getattr(entry, "default_value", None) for entry in node.inputs if not entry.is_linked]
        nodes.append((node.bl_idname, [value for value in values if isinstance(value, (int, float, str))]))
    return json.dumps([nodes, len(group.links)])


def _mesh_digest(mesh):
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    made = hashlib.blake2b(points.tobytes(), digest_size=16)
    materials = [material.name if material else "" for material in mesh.materials]
    layers = len(mesh.uv_layers), len(mesh.color_attributes)
    made.update(repr([len(mesh.edges), len(mesh.polygons), layers, materials]).encode())
    return made.hexdigest()
