"""Objects of the scene -> models for the server, evaluated: modifiers, instances and transforms applied."""

from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix, Vector

from . import axes, client, glb, nodes
from .client import Problem

FINENESS = ("resolution", "resolution_u", "resolution_v")
SOLID = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
# Deviation from a diagonal, relative to the largest entry, from which a matrix counts as sheared. Rounding in Blender's
# single precision stays below it.
SHEAR = 1e-4
# A mesh without depth: its smallest extent over its largest.
FLAT = 1e-6


@dataclass
class Model:
    """A mesh for the server."""

    # Its name in the server's messages.
    uri: str
    content: bytes
    sha256: str


@dataclass(eq=False)
class Prop:
    """A prop, and the data to make its bodies in Blender."""

    model: Model
    # The object; with everything below it, if it has children or is an instance of a collection.
    source: bpy.types.Object
    # From the source's local space to the prop's own frame, which has the source's origin and rotation and the scene's
    # scale: for most objects, their scale.
    local: Matrix
    # Where the own frame's origin is, from the source's: not there where that is far from the mesh, since a body turns
    # about its own origin between two frames.
    middle: Vector
    # From the prop's own frame to the world.
    frame: Matrix
    # Vertices [v, 3] in the prop's own frame, Blender's axes and units, and triangles [t, 3]: for the preview.
    vertices: np.ndarray
    triangles: np.ndarray


OWN = "OWN"
"""Frames about the meshes, where the sources' origins are far from them."""


def middles_of(recipe):
    """The middles of an earlier bake's props. Older files have none."""
    return [prop.get("middle", (0, 0, 0)) for prop in recipe["props"]]


def _middle(vertices):
    """The middle of a mesh whose origin is outside of the sphere around it; else the origin."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = (low + high) / 2
    is_far = np.linalg.norm(middle) > np.linalg.norm(high - low) / 2
    return Vector(middle) if is_far else Vector()


def metres(scene):
    """Metres per scene unit."""
    units = scene.unit_settings
    return 1.0 if units.system == "NONE" else units.scale_length


class Exporter:
    """Exports models of the current scene, object by object: the generators yield in between, so that Blender stays
    responsive. `passive`: nothing is changed, even if hidden objects are then exported without their modifiers."""

    def __init__(self, context, passive=False):
        # An object in Edit Mode counts as it is seen.
        for source in context.objects_in_mode_unique_data if context.mode.startswith("EDIT") and not passive else ():
            source.update_from_editmode()
        self.context = context
        self.passive = passive
        self.metres = metres(context.scene)
        self.contents = {}
        # Problems of the scene: all are reported at once.
        self.problems = []
        self.uris = set()
        self.known = {}

    def region(self, source):
        """A mesh in the world. None, and a problem, if it has no faces."""
        with evaluated(self.context, [source], self.passive) as geometry:
            meshes = geometry(source)
            if source.type in ("FONT", "CURVE") and meshes and all(map(is_flat, meshes)):
                text = f"“{source.name}” is flat. Give it depth: “Extrude” in its properties, Geometry."
                self.problems.append(Problem(text, source.name))
                return None
            if meshes:
                return self._model(source.name, meshes, Matrix())
        self.problems.append(Problem(f"“{source.name}” has no faces. Choose a closed mesh.", source.name))
        return None

    def mesh(self, name, vertices, triangles):
        """A mesh without an object: in the world, as arrays."""
        return self._model(name, [Mesh(vertices, triangles, Matrix())], Matrix())

    def together(self, name, sources):
        """One mesh in the world of several objects; None if they have no faces."""
        with evaluated(self.context, sources, self.passive) as geometry:
            meshes = [mesh for source in sources for mesh in geometry(source)]
            return self._model(name, meshes, Matrix()) if meshes else None

    def scenery(self, sources):
        """Meshes in the world, one of each object that has faces, with the object."""
        models = []
        for source in sources:
            with evaluated(self.context, [source], self.passive) as geometry:
                meshes = geometry(source)
                if meshes:
                    models.append((source, self._model(source.name, meshes, Matrix())))
            yield
        return models

    def props(self, sources, middles=None):
        """Meshes in their own frames, of each object with everything below it. Those without faces are problems.
        `middles`: of the frames, as in `Prop.middle`, where they are known; else the sources' origins. `OWN`: found."""
        props = []
        for number, source in enumerate(sources):
            family = [source, *source.children_recursive]
            with evaluated(self.context, family, self.passive) as geometry:
                meshes = [mesh for member in family for mesh in geometry(member)]
                place = geometry.matrix(source)
            if meshes:
                location, rotation, _ = place.decompose()
                frame = Matrix.Translation(location) @ rotation.to_matrix().to_4x4()
                if middles == OWN:
                    middle = _middle(joined(meshes, frame.inverted())[0])
                else:
                    middle = Vector(middles[number]) if middles else Vector()
                frame = frame @ Matrix.Translation(middle)
                model = self._model(source.name, meshes, frame.inverted())
                vertices, triangles = joined(meshes, frame.inverted())
                props.append(Prop(model, source, frame.inverted() @ place, middle, frame, vertices, triangles))
            else:
                message = f"The prop “{source.name}” has no faces. Remove it from the props, or give it faces."
                self.problems.append(Problem(message, source.name))
            yield
        return props

    def _model(self, name, meshes, matrix):
        # Rounding differs from place to place, but each mesh should be sent once.
        key = tuple((mesh.digest(), _key(matrix @ mesh.matrix)) for mesh in meshes)
        if key not in self.known:
            vertices, triangles = joined(meshes, matrix)
            content = glb.write("model", axes.points_to_server(vertices, self.metres), triangles)
            self.known[key] = client.digest(content)
            self.contents[self.known[key]] = content
        sha256 = self.known[key]
        return Model(self._uri(name), self.contents[sha256], sha256)

    def _uri(self, name):
        """A name for the server's messages: the object's, without characters that have a meaning in paths."""
        base = name.translate(str.maketrans("/\\#", "___")).strip(". ") or "object"
        uri, number = base, 1
        while uri in self.uris:
            number += 1
            uri = f"{base} ({number})"
        self.uris.add(uri)
        return uri


@dataclass
class Mesh:
    """Arrays of one mesh in its own space: vertices [n, 3], triangles [m, 3]; and its matrix to the world."""

    vertices: np.ndarray
    triangles: np.ndarray
    matrix: Matrix

    def digest(self):
        return client.digest(self.vertices.tobytes() + self.triangles.tobytes())


def is_flat(mesh):
    """Whether a mesh has no depth: text and curves before they are extruded."""
    extents = np.ptp(mesh.vertices, axis=0)
    return extents.min() <= FLAT * extents.max()


def joined(meshes, matrix):
    """Several meshes as one, in the space to which `matrix` transforms from the world."""
    vertices, triangles, count = [], [], 0
    for mesh in meshes:
        place = np.array(matrix @ mesh.matrix)
        vertices.append(mesh.vertices @ place[:3, :3].T + place[:3, 3])
        turned = mesh.triangles[:, ::-1] if np.linalg.det(place[:3, :3]) < 0 else mesh.triangles
        triangles.append(turned + count)
        count += len(mesh.vertices)
    return np.concatenate(vertices), np.concatenate(triangles)


def is_sheared(matrix):
    """Whether the matrix is sheared: no location, rotation and scale give it."""
    entries = np.array(matrix)[:3, :3]
    off = entries - np.diag(np.diag(entries))
    return np.abs(off).max() > SHEAR * np.abs(entries).max()


def _key(matrix):
    return tuple(round(value, 6) for row in matrix for value in row)


@contextmanager
def evaluated(context, sources, passive=False, realized=()):
    """Gives a function from an object to its evaluated meshes, with `.matrix(object)` for its place. Blender does not
    evaluate objects that are hidden or outside the view layer, nor for the render: copies in a separate scene
    replace them. `passive`: there are no copies, and hidden objects are exported without modifiers. `realized`: objects
    whose instances become part of their meshes."""
    unseen = [source for source in sources if context.view_layer.objects.get(source.name) != source]
    unseen += [source for source in sources if source not in unseen and not source.visible_get()]
    if passive:
        yield Geometry([context.evaluated_depsgraph_get()], sources, {}, unseen)
        return
    copied = unseen + [source for source in sources if source not in unseen and differs_in_render(source)]
    copied += [source for source in realized if source not in copied]
    scratch, copies, groups, data = None, {}, [], []
    try:
        if copied:
            scratch = bpy.data.scenes.new("Cairn export")
            scratch.frame_set(context.scene.frame_current)
            for source in copied:
                copy, fine = source.copy(), finer(source)
                if fine:
                    copy.data = copy.data.copy()
                    # Metaballs of one name have one fineness.
                    copy.name = copy.data.name = "Cairn export"
                    data.append(copy.data)
                for name, value in fine.items():
                    setattr(copy.data, name, value)
                copy.hide_viewport = False
                as_rendered(copy)
                if source in realized:
                    groups.append(realize(copy))
                copies[source] = copy
                scratch.collection.objects.link(copy)
            scratch.view_layers[0].update()
        graphs = [context.evaluated_depsgraph_get(), scratch and scratch.view_layers[0].depsgraph]
        yield Geometry([graph for graph in graphs if graph], sources, copies)
    finally:
        for copy in copies.values():
            bpy.data.objects.remove(copy)
        for group in groups:
            bpy.data.node_groups.remove(group)
        bpy.data.batch_remove(data)
        if scratch:
            bpy.data.scenes.remove(scratch)


def may_have_instances(source):
    """Whether an object may show instances: to check all instances of a large scene takes long."""
    kinds = {modifier.type for modifier in source.modifiers}
    return source.instance_type != "NONE" or not kinds.isdisjoint({"NODES", "PARTICLE_SYSTEM"})


def is_realizable(source):
    """Whether nodes can make the instances of an object part of its mesh: particles and children are not theirs."""
    is_of_nodes = any(modifier.type == "NODES" for modifier in source.modifiers)
    others = any(modifier.type == "PARTICLE_SYSTEM" for modifier in source.modifiers)
    return is_of_nodes and not others and source.instance_type == "NONE" and source.type in SOLID


def realize(copy):
    """Makes the instances of an object part of its mesh. Gives the node group for that."""
    group = bpy.data.node_groups.new("Cairn export", "GeometryNodeTree")
    incoming, outgoing = nodes.interface(group)
    node = group.nodes.new("GeometryNodeRealizeInstances")
    group.links.new(incoming, node.inputs[0])
    group.links.new(node.outputs[0], outgoing)
    copy.modifiers.new("Cairn export", "NODES").node_group = group
    return group


def finer(source):
    """The names of the fineness of a curve, text or metaball in the view, and their values in the render."""
    if source.type == "META":
        base = source.name.partition(".")[0]
        # Metaballs that flow together are one surface, which a copy of one of them does not have.
        balls = [other for other in bpy.context.scene.objects if other.type == "META" and other != source]
        if any(other.name.partition(".")[0] == base for other in balls):
            return {}
    if source.type not in SOLID - {"MESH"}:
        return {}
    names = [name for name in FINENESS if hasattr(source.data, name)]
    values = {name: getattr(source.data, f"render_{name}") for name in names}
    # 0: as in the view.
    return {name: value for name, value in values.items() if value and value != getattr(source.data, name)}


def differs_in_render(source):
    """Whether the render has other modifiers, or more of them, than the view, or is finer."""
    return bool(finer(source)) or any(
        modifier.show_viewport != modifier.show_render
        or getattr(modifier, "levels", 0) != getattr(modifier, "render_levels", getattr(modifier, "levels", 0))
        for modifier in source.modifiers
    )


def as_rendered(copy):
    for modifier in copy.modifiers:
        modifier.show_viewport = modifier.show_render
        if hasattr(modifier, "render_levels"):
            modifier.levels = modifier.render_levels


class Geometry:
    """Evaluated meshes, each data block read once."""

    def __init__(self, graphs, sources, copies, unseen=()):
        self.graphs = graphs
        self.copies = copies
        # Of these, the data in the file is used.
        self.unseen = set(unseen)
        self.known = {}
        # By object: its instances, with matrices to the world.
        self.instances = {copies.get(source, source): [] for source in sources}
        # Blender lists the meshes of curves, texts and metaballs, too, as if these had instances.
        may_instance = {copies.get(source, source) for source in sources if may_have_instances(source)}
        own = {source: self._digest(source) for source in may_instance if source.type in SOLID - {"MESH"}}
        for graph in graphs if may_instance else ():
            for instance in graph.object_instances:
                if instance.is_instance and instance.object.type in SOLID:
                    source = instance.parent.original
                    if source in may_instance:
                        # Read at once: Blender may use the same object for the next instance.
                        arrays, matrix = self._read(instance.object), instance.matrix_world.copy()
                        if source not in own or Mesh(*arrays, matrix).digest() != own[source]:
                            self.instances[source].append((arrays, matrix))

    def _digest(self, source):
        """Of an object's own mesh, without its instances."""
        graph = self.graphs[-1] if source in self.copies.values() else self.graphs[0]
        return Mesh(*triangles_of(source.evaluated_get(graph)), Matrix()).digest()

    def has_instances(self, source):
        """Whether an object shows instances."""
        return bool(self.instances[self.copies.get(source, source)] or source.instance_collection)

    def matrix(self, source):
        return self.shown(source).matrix_world.copy()

    def new_mesh(self, source):
        """A mesh data block as evaluated, with materials and all layers."""
        graph = self.graphs[-1] if source in self.copies else self.graphs[0]
        mesh = bpy.data.meshes.new_from_object(self.shown(source), preserve_all_data_layers=True, depsgraph=graph)
        if source.name not in bpy.data.meshes:
            mesh.name = source.name
        return mesh

    def shown(self, source):
        """An object as it is evaluated."""
        if source in self.unseen:
            return source
        stand_in = self.copies.get(source)
        return stand_in.evaluated_get(self.graphs[-1]) if stand_in else source.evaluated_get(self.graphs[0])

    def __call__(self, source):
        """All meshes of an object, its instances' included."""
        shown = self.shown(source)
        pairs = [(self._read(shown), shown.matrix_world.copy())] if shown.type in SOLID else []
        pairs += self.instances[self.copies.get(source, source)]
        if source in self.unseen and source.instance_collection:
            inward = source.matrix_world @ Matrix.Translation(-source.instance_collection.instance_offset)
            inside = [member for member in source.instance_collection.all_objects if member.type in SOLID]
            pairs += [(self._read(member), inward @ member.matrix_world) for member in inside]
        return [Mesh(*arrays, matrix) for arrays, matrix in pairs if len(arrays[1])]

    def _read(self, shown):
        # Only meshes are the same for all objects that share them: the conversion of a curve depends on the object.
        key = shown.data.as_pointer() if shown.type == "MESH" else shown.original
        if key not in self.known:
            self.known[key] = triangles_of(shown)
        return self.known[key]


def triangles_of(shown):
    """Vertices [n, 3] and triangles [m, 3] of an evaluated object."""
    mesh = shown.to_mesh()
    if mesh is None:
        return np.empty((0, 3)), np.empty((0, 3), np.int32)
    try:
        mesh.calc_loop_triangles()
        vertices = np.empty(len(mesh.vertices) * 3, np.float32)
        mesh.vertices.foreach_get("co", vertices)
        triangles = np.empty(len(mesh.loop_triangles) * 3, np.int32)
        mesh.loop_triangles.foreach_get("vertices", triangles)
        return vertices.reshape(-1, 3).astype(float), triangles.reshape(-1, 3)
    finally:
        shown.to_mesh_clear()
