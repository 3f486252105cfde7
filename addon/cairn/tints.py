"""The average color of a prop, sRGB: of its material, with the mean of its texture."""

import numpy as np

# Pixels of the largest texture that is read: more would be noticeable.
MOST_PIXELS = 2048 * 2048

_means = {}


def of(source):
    """The color of the most frequent material of an object or its children; None if there is none."""
    for member in (source, *source.children_recursive):
        if member.type == "EMPTY" and member.instance_collection:
            inside = (tint for tint in map(of, member.instance_collection.all_objects) if tint is not None)
            return next(inside, None)
        material = _most_frequent(member)
        if material:
            return _of_material(material)
    return None


def _most_frequent(source):
    slots = [slot.material for slot in source.material_slots]
    if len(slots) > 1 and source.type == "MESH" and len(source.data.polygons):
        indices = np.empty(len(source.data.polygons), np.int32)
        source.data.polygons.foreach_get("material_index", indices)
        return slots[min(int(np.bincount(indices).argmax()), len(slots) - 1)]
    return next(filter(None, slots), None)


def _of_material(material):
    tree = material.node_tree if material.use_nodes else None
    shader = next((node for node in tree.nodes if node.type == "BSDF_PRINCIPLED"), None) if tree else None
    if shader is None:
        return _displayed(material.diffuse_color)
    socket = shader.inputs["Base Color"]
    if not socket.is_linked:
        return _displayed(socket.default_value)
    mean = _mean(_image_before(socket))
    return _displayed(material.diffuse_color) if mean is None else mean


def _image_before(socket):
    """The first texture on the way to a socket."""
    nodes, seen = [link.from_node for link in socket.links], set()
    while nodes:
        node = nodes.pop(0)
        if node.name in seen:
            continue
        seen.add(node.name)
        if node.type == "TEX_IMAGE" and node.image:
            return node.image
        nodes += [link.from_node for entry in node.inputs for link in entry.links]
    return None


def _mean(image):
    if image is None or not 0 < image.size[0] * image.size[1] <= MOST_PIXELS:
        return None
    key = image.name_full, image.filepath, tuple(image.size)
    if key not in _means:
        values = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
        image.pixels.foreach_get(values)
        color = values.reshape(-1, image.channels)[:, :3].mean(axis=0)
        _means[key] = np.resize(color, 3)
    return _means[key]


def _displayed(linear):
    linear = np.clip(np.array(linear[:3]), 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
