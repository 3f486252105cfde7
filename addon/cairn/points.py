"""A pile as one object: points that Geometry Nodes make instances of, from a table of motion in one other mesh.

The table has a row, which is a vertex, for each body and frame at which the body moves: its position, and its X and Z
axes as attributes. Blender alone plays it: no handler, no add-on; subframes and so motion blur are between the rows.
"""

import bpy
import numpy as np
from mathutils import Matrix, Vector

from . import belongings, nodes

# Whole numbers up to here are exact in the nodes' single precision: rows of one table.
MAX_ROWS = 1 << 24
AXES = ("axis_x", "axis_z")
# A body that is not there has axes of length 0.
THERE = 0.5
# Rows per batch.
BLOCK = 1 << 14
# Names of nodes that are looked up later: frames since the start; since the body moves; the fraction between rows.
TIME, SINCE, RETIME = "Time", "Since", "Retime"
# Attributes of each body that the nodes read.
READ = {"first": np.intc, "count": np.intc, "offset": np.intc, "prop": np.intc, "size": np.float32}


def write(name, motion, parts_collection, start_frame):
    """Gives a list of objects, in no collection yet, that show the motion; one, but for piles beyond `MAX_ROWS`."""
    first, count = spans(motion)
    made, begin = [], 0
    bodies = len(count)
    while begin < bodies:
        rows = np.cumsum(count[begin:])
        end = begin + max(1, int(np.searchsorted(rows, MAX_ROWS, side="right")))
        part = slice(begin, end)
        made.append(_object(name, motion, part, first[part], count[part], parts_collection, start_frame))
        begin = end
    return made


def spans(motion):
    """For each body the first frame of its rows, and their number: before and after, the body stands still."""
    changes = motion.present[1:] != motion.present[:-1]
    for values in (motion.positions, motion.rotations):
        # Component by component: many times faster than a sum over the few components of each.
        for component in range(values.shape[2]):
            changes |= values[1:, :, component] != values[:-1, :, component]
    moves = changes.any(axis=0)
    frames = len(changes)
    if not frames:
        return np.zeros(len(moves), int), np.ones(len(moves), int)
    first = np.where(moves, changes.argmax(axis=0), 0)
    last = np.where(moves, frames - changes[::-1].argmax(axis=0), 0)
    return first, last - first + 1


def _object(name, motion, part, first, count, parts_collection, start_frame):
    frames = np.arange(len(motion.positions))[:, None]
    # Shape [n, f]: rows go body by body.
    kept = ((frames >= first) & (frames < first + count)).T
    is_whole = kept.all()

    def rows(values):
        by_body = values[:, part].swapaxes(0, 1)
        return by_body.reshape(-1, *by_body.shape[2:]) if is_whole else by_body[kept]

    present = rows(motion.present)
    table = bpy.data.meshes.new(f"{name} Motion")
    _fill(table, rows(motion.positions))
    for key, axis in zip(AXES, axes_of(rows(motion.rotations))):
        if not present.all():
            axis *= present[:, None]
        _attribute(table, key, "FLOAT_VECTOR", "vector", axis)
    table_object = bpy.data.objects.new(table.name, table)
    table_object.cairn.is_part = True
    belongings.mark_mesh(table)

    mesh = bpy.data.meshes.new(name)
    _fill(mesh, motion.positions[-1, part])
    _attribute(mesh, "first", "INT", "value", first)
    _attribute(mesh, "count", "INT", "value", count)
    _attribute(mesh, "offset", "INT", "value", np.cumsum(count) - count)
    _attribute(mesh, "prop", "INT", "value", motion.props[part])
    # For materials, as an attribute of the instancer: the state in the last frame.
    _attribute(mesh, "state", "INT", "value", motion.states[-1, part])
    _attribute(mesh, "size", "FLOAT", "value", motion.scales[part])
    belongings.mark_mesh(mesh)
    shown = bpy.data.objects.new(name, mesh)
    shown.cairn.number = part.start + 1
    modifier = shown.modifiers.new("Pile", "NODES")
    modifier.node_group = _nodes(name, table_object, parts_collection, start_frame)
    return shown


def keep_end(shown):
    """Keeps only the last row of each body in the table."""
    table = _table(shown)
    if table is None:
        return
    last = _values(shown.data, "offset", np.intc) + _values(shown.data, "count", np.intc) - 1
    positions = np.empty((len(table.vertices), 3), np.float32)
    table.vertices.foreach_get("co", positions.ravel())
    axes = {}
    for key in AXES:
        axes[key] = np.empty_like(positions)
        table.attributes[key].data.foreach_get("vector", axes[key].ravel())
    table.clear_geometry()
    _fill(table, positions[last])
    for key, axis in axes.items():
        _attribute(table, key, "FLOAT_VECTOR", "vector", axis[last])
    belongings.mark_mesh(table)
    count = len(last)
    for name, values in (("first", np.zeros(count)), ("count", np.ones(count)), ("offset", np.arange(count))):
        _set(shown.data, name, values)
    table.update()


def places(shown, number):
    """A function from the index of a body, counted from 0, to its pose in the object's own space: a matrix without
    scale; None if the body is missing. `number`: the frame of the result, which may be fractional."""
    table = _table(shown)
    if table is None:
        return lambda _: None
    spans = [shown.data.attributes[name].data for name in ("first", "count", "offset")]
    axis_x, axis_z = (table.attributes[key].data for key in AXES)

    def where(index):
        first, count, offset = (data[index].value for data in spans)
        row = min(max(number - first, 0.0), count - 1.0)
        low, high, share = offset + int(row), offset + min(int(row) + 1, count - 1), row - int(row)
        place = table.vertices[low].co.lerp(table.vertices[high].co, share)
        x, z = (Vector(axis[low].vector).lerp(Vector(axis[high].vector), share) for axis in (axis_x, axis_z))
        if x.length < THERE:
            return None
        # As the nodes do: Z first.
        z.normalize()
        y = z.cross(x).normalized()
        return Matrix.Translation(place) @ Matrix((y.cross(z), y, z)).transposed().to_4x4()

    return where


def _table(shown):
    """The mesh with an object's motion; None if it was changed by hand."""
    modifier = shown.modifiers.get("Pile")
    group = modifier and modifier.node_group
    for node in group.nodes if group else ():
        if node.bl_idname == "GeometryNodeObjectInfo" and node.inputs["Object"].default_value:
            is_whole = {*READ} <= {*shown.data.attributes.keys()}
            return node.inputs["Object"].default_value.data if is_whole else None
    return None


def retime(shown, last, start, hold, speed, ease):
    """Shows the frames at the times of `timing.times`."""
    modifier = shown.modifiers.get("Pile")
    group = modifier and modifier.node_group
    time = group and group.nodes.get(TIME)
    since = group and group.nodes.get(SINCE)
    if not (time and since):
        # Changed by hand.
        return
    for node in [node for node in group.nodes if node.name.startswith(RETIME)]:
        group.nodes.remove(node)
    time.inputs[1].default_value = float(start + hold)
    now = time.outputs[0]
    last = float(max(last, 1))
    # From the frame of the scene to that of the result.
    steps = [("MAXIMUM", 0.0), ("MULTIPLY", speed / last), ("POWER", 2.0**ease), ("MULTIPLY", last)]
    for number, (operation, value) in enumerate(steps if (speed, ease) != (1.0, 0.0) else ()):
        node = group.nodes.new("ShaderNodeMath")
        node.operation, node.name = operation, f"{RETIME} {number}"
        node.inputs[1].default_value = value
        group.links.new(now, node.inputs[0])
        now = node.outputs[0]
    group.links.new(now, since.inputs[0])


def show_states(shown, states, colors, collection):
    """Shows bodies in their states' colors. Instances have the color of their instancer, so that each state gets its
    own instancer in `collection`, which is not rendered."""
    now = _of(shown, states)
    if now is None:
        return
    own, modifier = shown.cairn, shown.modifiers["Pile"]
    if own.is_coloured and np.array_equal(_values(shown.data, "state", np.intc), now):
        return
    if not own.is_coloured:
        own.is_coloured, own.was_shown, modifier.show_viewport = True, modifier.show_viewport, False
    _set(shown.data, "state", now)
    values = {name: _values(shown.data, name, kind) for name, kind in READ.items()}
    made = {part.cairn.number: part for part in collection.objects if part.parent == shown}
    for state in {*made, *(1 + np.flatnonzero(np.bincount(now)))}:
        part = made.get(state) or _of_state(shown, int(state), colors[state - 1], collection)
        here = now == state - 1
        part.data.clear_geometry()
        _fill(part.data, np.zeros((here.sum(), 3)))
        for name, kind in READ.items():
            number = ("INT", "value") if kind is np.intc else ("FLOAT", "value")
            _attribute(part.data, name, *number, values[name][here])
        part.data.update()


def hide_states(shown, last):
    """Undoes that, except in the collection. `last`: the states in the last frame."""
    own = shown.cairn
    if own.is_coloured:
        own.is_coloured = False
        if "Pile" in shown.modifiers:
            shown.modifiers["Pile"].show_viewport = own.was_shown
        now = _of(shown, last)
        if now is not None:
            _set(shown.data, "state", now)


def _of(shown, states):
    """The states of an object's own bodies; None if the object was changed by hand and shows no bodies."""
    count = len(shown.data.vertices) if shown.type == "MESH" else 0
    now = states[shown.cairn.number - 1 :][:count] if shown.cairn.number else ()
    is_whole = "Pile" in shown.modifiers and {*READ, "state"} <= {*shown.data.attributes.keys()}
    return now if is_whole and 0 < count == len(now) else None


def _of_state(shown, number, color, collection):
    name = f"{shown.name} State {number - 1}"
    part = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    part.parent, part.cairn.number, part.color = shown, number, color
    part.cairn.is_part = True
    part.hide_render = part.hide_select = True
    part.modifiers.new("Pile", "NODES").node_group = shown.modifiers["Pile"].node_group
    collection.objects.link(part)
    return part


def _values(mesh, name, kind):
    values = np.empty(len(mesh.vertices), kind)
    mesh.attributes[name].data.foreach_get("value", values)
    return values


def _set(mesh, name, values):
    mesh.attributes[name].data.foreach_set("value", np.ascontiguousarray(values, np.intc))
    mesh.update()


def axes_of(rotations):
    """The X and the Z axis of quaternions [n, 4], w x y z."""
    along_x, along_z = (np.empty((len(rotations), 3), rotations.dtype) for _ in range(2))
    # Block by block, so that intermediate values stay in the processor's cache.
    for begin in range(0, len(rotations), BLOCK):
        w, x, y, z = rotations[begin : begin + BLOCK].T
        part_x, part_z = along_x[begin : begin + BLOCK].T, along_z[begin : begin + BLOCK].T
        part_x[:] = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)
        part_z[:] = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
    return along_x, along_z


def _fill(mesh, positions):
    mesh.vertices.add(len(positions))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(positions, np.float32).ravel())


def _attribute(mesh, name, kind, key, values):
    number = np.intc if kind == "INT" else np.float32
    mesh.attributes.new(name, kind, "POINT").data.foreach_set(key, np.ascontiguousarray(values, number).ravel())


class _Tree:
    """A node group, built node by node."""

    def __init__(self, name):
        self.group = bpy.data.node_groups.new(name, "GeometryNodeTree")

    def math(self, operation, first, second):
        made = self.group.nodes.new("ShaderNodeMath")
        made.operation = operation
        for socket, value in zip(made.inputs, (first, second)):
            if isinstance(value, bpy.types.NodeSocket):
                self.group.links.new(value, socket)
            else:
                socket.default_value = value
        return made.outputs[0]

    def attribute(self, name, kind):
        made = self.group.nodes.new("GeometryNodeInputNamedAttribute")
        made.data_type = kind
        made.inputs["Name"].default_value = name
        return _enabled(made.outputs, "Attribute")


def _enabled(sockets, name):
    """Up to 3.6 a node has a socket of each type under one name, and one of them is in use."""
    return next(socket for socket in sockets if socket.name == name and socket.enabled)


def _nodes(name, table_object, parts_collection, start_frame):
    tree = _Tree(name)
    links, add = tree.group.links, tree.group.nodes.new
    incoming, outgoing = nodes.interface(tree.group)

    # The two rows of the body around the frame.
    time = tree.math("SUBTRACT", add("GeometryNodeInputSceneTime").outputs["Frame"], float(start_frame))
    time.node.name = TIME
    last = tree.math("SUBTRACT", tree.attribute("count", "INT"), 1.0)
    since = tree.math("SUBTRACT", time, tree.attribute("first", "INT"))
    since.node.name = SINCE
    place = tree.math("MINIMUM", tree.math("MAXIMUM", since, 0.0), last)
    low = tree.math("FLOOR", place, 0.0)
    high = tree.math("MINIMUM", tree.math("ADD", low, 1.0), last)
    share = tree.math("SUBTRACT", place, low)
    offset = tree.attribute("offset", "INT")
    rows = [tree.math("ADD", offset, number) for number in (low, high)]

    info = add("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = table_object

    def between(field):
        """The field's value between the two rows."""
        mix = add("ShaderNodeMix")
        mix.data_type = "VECTOR"
        sockets = {socket.identifier: socket for socket in mix.inputs}
        links.new(share, sockets["Factor_Float"])
        for row, end in zip(rows, ("A_Vector", "B_Vector")):
            sample = add("GeometryNodeSampleIndex")
            sample.data_type = "FLOAT_VECTOR"
            links.new(info.outputs["Geometry"], sample.inputs["Geometry"])
            links.new(field, _enabled(sample.inputs, "Value"))
            links.new(row, sample.inputs["Index"])
            links.new(_enabled(sample.outputs, "Value"), sockets[end])
        return next(socket for socket in mix.outputs if socket.identifier == "Result_Vector")

    move = add("GeometryNodeSetPosition")
    links.new(incoming, move.inputs["Geometry"])
    links.new(between(add("GeometryNodeInputPosition").outputs["Position"]), move.inputs["Position"])
    x, z = (between(tree.attribute(key, "FLOAT_VECTOR")) for key in AXES)
    upright = _align(tree, "Z", "AUTO", z, None)
    turned = _align(tree, "X", "Z", x, upright)

    length = add("ShaderNodeVectorMath")
    length.operation = "LENGTH"
    links.new(x, length.inputs[0])
    parts = add("GeometryNodeCollectionInfo")
    parts.inputs["Collection"].default_value = parts_collection
    parts.inputs["Separate Children"].default_value = True
    instances = add("GeometryNodeInstanceOnPoints")
    instances.inputs["Pick Instance"].default_value = True
    links.new(move.outputs["Geometry"], instances.inputs["Points"])
    links.new(tree.math("GREATER_THAN", length.outputs["Value"], THERE), instances.inputs["Selection"])
    links.new(parts.outputs[0], instances.inputs["Instance"])
    links.new(tree.attribute("prop", "INT"), instances.inputs["Instance Index"])
    links.new(turned, instances.inputs["Rotation"])
    links.new(tree.attribute("size", "FLOAT"), instances.inputs["Scale"])
    links.new(instances.outputs["Instances"], outgoing)
    return tree.group


def _align(tree, axis, pivot, vector, rotation):
    made = tree.group.nodes.new("FunctionNodeAlignEulerToVector")
    made.axis, made.pivot_axis = axis, pivot
    tree.group.links.new(vector, made.inputs["Vector"])
    if rotation:
        tree.group.links.new(rotation, made.inputs["Rotation"])
    return made.outputs["Rotation"]
