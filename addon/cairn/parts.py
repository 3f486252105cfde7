"""The data of a body in Blender: the prop's own data, shared by all bodies of the same prop."""

from dataclasses import dataclass

import bpy
from mathutils import Matrix

from .export import SOLID, evaluated, is_sheared

PLAIN_EMPTY_SIZE = 0.1


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
    with evaluated(context, [member for family in families for member in family]) as geometry:
        made = []
        for source, family, local in zip(sources, families, locals_):
            is_simple = len(family) == 1 and not is_sheared(local)
            if as_collections or not is_simple:
                made.append(Part(source.name, collection=_collection(geometry, source, family, local)))
            elif source.type == "EMPTY" and source.instance_collection:
                made.append(Part(source.name, collection=source.instance_collection, scale=_diagonal(local)))
            elif geometry.instances.get(geometry.copies.get(source, source)):
                made.append(Part(source.name, collection=_collection(geometry, source, family, local)))
            else:
                made.append(_single(geometry, source, local))
            made[-1].source = source
        return made


def _diagonal(matrix):
    return tuple(matrix[i][i] for i in range(3))


def _single(geometry, source, local):
    data = source.data
    if source.modifiers or source.type != "MESH" or data.shape_keys:
        data = geometry.new_mesh(source)
        materials = {}
    else:
        materials = {n: slot.material for n, slot in enumerate(source.material_slots) if slot.link == "OBJECT"}
    return Part(source.name, data, _diagonal(local), materials)


def _collection(geometry, source, family, local):
    """A collection that is in no scene, with the family standing in the prop's frame."""
    collection = bpy.data.collections.new(source.name)
    # From the world to the prop's frame.
    inward = local @ geometry.matrix(source).inverted()
    for member in family:
        if member.type not in SOLID and not member.instance_collection:
            continue
        place = inward @ geometry.matrix(member)
        copy = member.copy()
        copy.parent = None
        copy.constraints.clear()
        copy.animation_data_clear()
        copy.hide_viewport = copy.hide_render = False
        if is_sheared(place) and member.type in SOLID:
            copy.modifiers.clear()
            copy.data = geometry.new_mesh(member)
            copy.data.transform(place)
            place = Matrix()
        copy.matrix_parent_inverse = Matrix()
        copy.matrix_basis = place
        copy.delta_location, copy.delta_scale = (0, 0, 0), (1, 1, 1)
        copy.delta_rotation_euler, copy.delta_rotation_quaternion = (0, 0, 0), (1, 0, 0, 0)
        collection.objects.link(copy)
    return collection
