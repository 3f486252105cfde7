"""The data of a body in Blender: the prop's own data, shared by all bodies of the same prop."""

from dataclasses import dataclass

import bpy
from mathutils import Matrix

from . import belongings
from .export import SOLID, evaluated, is_realizable, is_sheared, may_have_instances

PLAIN_EMPTY_SIZE = 0.1
# A displacement below this, relative to the largest scale, is rounding.
CENTERED = 1e-6


@dataclass
class Part:
    """Makes bodies of one prop: from data with a scale, or from a collection to be instanced."""

    name: str
    data: bpy.types.ID = None
    scale: tuple = (1.0, 1.0, 1.0)
    # Materials that belong to the source object, not to its data: slot -> material.
    materials: dict = None
    collection: bpy.types.Collection = None
    # The prop itself, from which bodies copy more data.
    source: bpy.types.Object = None

    def body(self, name, factor):
        """A new object, in no collection yet. Factor: the body's scale."""
        made = bpy.data.objects.new(name, self.data)
        made.rotation_mode = "QUATERNION"
        made.scale = [factor * value for value in self.scale]
        for slot, material in (self.materials or {}).items():
            made.material_slots[slot].link = "OBJECT"
            made.material_slots[slot].material = material
        if self.collection:
            made.instance_type = "COLLECTION"
            made.instance_collection = self.collection
            made.empty_display_size = PLAIN_EMPTY_SIZE
        if self.source:
            carry(self.source, made)
        return made


def carry(source, made):
    """Copies the data that pipelines use: pass index and custom properties."""
    made.pass_index = source.pass_index
    for name in source.keys():
        # Properties of add-ons are not copied.
        if name not in source.bl_rna.properties:
            made[name] = source[name]


def make(context, sources, locals_, as_collections):
    """A part for each source object. `locals_`: matrices from the sources' local spaces to the props' frames."""
    families = [[source, *source.children_recursive] for source in sources]
    members = [member for family in families for member in family]
    instancers = {member for member in members if may_have_instances(member)}
    if instancers:
        with evaluated(context, members) as geometry:
            instancers = {member for member in instancers if geometry.has_instances(member)}
    # Instances of nodes become part of a mesh, so that exporters have them.
    realized = [member for member in instancers if is_realizable(member)]
    with evaluated(context, members, realized=realized) as geometry:
        made = []
        for source, family, local in zip(sources, families, locals_):
            inward = local @ geometry.matrix(source).inverted()
            solids = [member for member in family if member.type in SOLID]
            rest = [member for member in family if member in instancers and member not in realized]
            if as_collections:
                made.append(Part(source.name, collection=_collection(geometry, source, family, inward, rest)))
            elif len(solids) == 1 and not rest:
                made.append(_single(geometry, solids[0], inward @ geometry.matrix(solids[0])))
                made[-1].name = source.name
            elif family == rest == [source] and source.instance_collection and not is_sheared(local):
                made.append(Part(source.name, collection=source.instance_collection, scale=_diagonal(local)))
            else:
                made.append(Part(source.name, collection=_collection(geometry, source, family, inward, rest)))
            made[-1].source = source
        return made


def _diagonal(matrix):
    return tuple(matrix[i][i] for i in range(3))


def _is_diagonal(matrix):
    return not is_sheared(matrix) and matrix.translation.length <= CENTERED * max(map(abs, _diagonal(matrix)))


def _single(geometry, source, place):
    """A part of one mesh. `place`: from the source's local space to the prop's frame."""
    scale = _diagonal(place) if _is_diagonal(place) else (1.0, 1.0, 1.0)
    if source.type == "MESH" and not source.modifiers and not source.data.shape_keys and _is_diagonal(place):
        materials = {n: slot.material for n, slot in enumerate(source.material_slots) if slot.link == "OBJECT"}
        return Part(source.name, source.data, scale, materials)
    return Part(source.name, _own_mesh(geometry, source, None if _is_diagonal(place) else place), scale)


def _own_mesh(geometry, source, place):
    """A new mesh of an object as it is evaluated, transformed by `place`."""
    mesh = geometry.new_mesh(source)
    for number, slot in enumerate(source.material_slots):
        if slot.link == "OBJECT" and number < len(mesh.materials):
            mesh.materials[number] = slot.material
        elif slot.link == "OBJECT":
            mesh.materials.append(slot.material)
    if place is not None:
        mesh.transform(place)
        if place.determinant() < 0:
            mesh.flip_normals()
    belongings.mark_mesh(mesh)
    return mesh


def _collection(geometry, source, family, inward, instancers):
    """A collection that is in no scene, with the family standing in the prop's frame. `inward`: from the world."""
    collection = bpy.data.collections.new(source.name)
    collection.cairn.is_part = True
    for member in family:
        if member.type not in SOLID and member not in instancers:
            continue
        place = inward @ geometry.matrix(member)
        if member in instancers:
            made = _instancer(member)
        else:
            part = _single(geometry, member, Matrix() if not is_sheared(place) else place)
            place = place if not is_sheared(place) else Matrix()
            made = part.body(member.name, 1.0)
        made.cairn.is_part = True
        made.matrix_basis = place
        collection.objects.link(made)
    return collection


def _instancer(member):
    """A copy of an object that shows instances."""
    if member.type == "EMPTY":
        made = bpy.data.objects.new(member.name, None)
        made.instance_type, made.instance_collection = "COLLECTION", member.instance_collection
        carry(member, made)
        return made
    made = member.copy()
    made.parent = None
    made.constraints.clear()
    made.animation_data_clear()
    made.hide_viewport = made.hide_render = False
    made.matrix_parent_inverse = Matrix()
    made.delta_location, made.delta_scale = (0, 0, 0), (1, 1, 1)
    made.delta_rotation_euler, made.delta_rotation_quaternion = (0, 0, 0), (1, 0, 0, 0)
    return made
