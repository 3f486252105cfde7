"""The add-on, installed from its zip as an artist does, with the real server; and a scene to bake."""

import importlib
import json
import os
import struct
from pathlib import Path

import bpy
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "target" / "release" / ("cairn.exe" if os.name == "nt" else "cairn")
# glTF's axes -> Blender's, written here once more, so that the add-on's own conversion is tested.
TURN = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)
# For what is the same in all versions of Blender, and takes long.
once = pytest.mark.skipif(bpy.app.version < (5, 0), reason="it is the same in all versions, and runs in the newest")


@pytest.fixture(scope="session")
def module():
    """The name that Blender gives the add-on."""
    archive = os.environ["CAIRN_ADDON"]
    if bpy.app.version >= (4, 2, 0):
        name = "bl_ext.user_default.cairn"
        bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True)
    else:
        name = "cairn"
        bpy.ops.preferences.addon_install(filepath=archive, overwrite=True)
        bpy.ops.preferences.addon_enable(module=name)
    assert name in bpy.context.preferences.addons
    bpy.context.preferences.addons[name].preferences.program = str(PROGRAM)
    yield name
    # Ends the server, too.
    bpy.ops.preferences.addon_disable(module=name)


@pytest.fixture
def addon(module):
    """Gives the add-on's modules by name: `addon("result")`. Begins with an empty file."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return lambda name: importlib.import_module(f"{module}.{name}")


def mesh_object(name, vertices, faces, collection=None):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    made = bpy.data.objects.new(name, mesh)
    (collection or bpy.context.scene.collection).objects.link(made)
    return made


def cuboid(name, size, collection=None, location=(0, 0, 0)):
    corners = [
        tuple(at + (edge if n >> axis & 1 else -edge) / 2 for axis, (edge, at) in enumerate(zip(size, location)))
        for n in range(8)
    ]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return mesh_object(name, corners, faces, collection)


class Desk:
    """A scene with a control mesh and props."""

    def __init__(self, addon):
        self.addon = addon
        self.props = bpy.data.collections.new("Props")
        bpy.context.scene.collection.children.link(self.props)
        self.control = cuboid("Heap", (0.8, 0.8, 0.5), location=(0, 0, 0.25))
        self.settings = bpy.context.scene.cairn
        self.settings.control_mesh = self.control
        self.settings.prop_collection = self.props
        self.settings.accuracy = "DRAFT"
        # Messages and requests of the add-on, for the tests to compare.
        self.motion = self.recipe = self.request = None

    def add_stick(self, name="Stick", size=(0.36, 0.14, 0.12)):
        return cuboid(name, size, self.props)

    def bake(self, **settings):
        """Bakes, and gives the result's collection."""
        for name, value in settings.items():
            setattr(self.settings, name, value)
        result, request = self.addon("result"), self.addon("request")
        build, taking = result.build, request.taking

        def build_and_keep(context, motion, recipe, record):
            self.motion, self.recipe = motion, recipe
            return build(context, motion, recipe, record)

        def take_and_keep(context):
            self.request = yield from taking(context)
            return self.request

        result.build, request.taking = build_and_keep, take_and_keep
        try:
            assert bpy.ops.cairn.bake() == {"FINISHED"}
        finally:
            result.build, request.taking = build, taking
        return result.existing(bpy.context.scene, self.control)

    def expected(self, frame):
        """World matrices [n, 4, 4] of the props' frames at a frame of the result, in Blender's space."""
        out = np.tile(np.eye(4), (len(self.motion.props), 1, 1))
        x, y, z, w = np.moveaxis(self.motion.rotations[frame].astype(float), -1, 0)
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        ).transpose(2, 0, 1)
        out[:, :3, :3] = (TURN @ turn @ TURN.T) * self.motion.scales[:, None, None]
        out[:, :3, 3] = self.motion.positions[frame].astype(float) @ TURN.T / self.recipe["metres"]
        return out

    def sent_vertices(self, prop):
        """The mesh of a prop as the server got it, in Blender's space and units."""
        uri = self.request.spec.scene.props[prop].path
        (sha256,) = [asset.sha256 for asset in self.request.spec.assets if asset.uri == uri]
        return points_of(self.request.contents[sha256]) / self.recipe["metres"]


def points_of(content):
    """The vertices of a model as it is sent, in Blender's axes, m."""
    (length,) = struct.unpack_from("<I", content, 12)
    document = json.loads(content[20 : 20 + length])
    count = document["accessors"][0]["count"]
    return np.frombuffer(content, "<f4", count * 3, 20 + length + 8).reshape(-1, 3).astype(float) @ TURN.T


@pytest.fixture
def desk(addon):
    return Desk(addon)


def shown_vertices():
    """World vertices of all evaluated meshes by the object that shows them: instances under their instancer."""
    graph = bpy.context.evaluated_depsgraph_get()
    found = {}
    for instance in graph.object_instances:
        if instance.object.type != "MESH":
            continue
        owner = instance.parent.original if instance.is_instance else instance.object.original
        # Points show many bodies, an empty shows one of many parts.
        is_point = instance.is_instance and owner.type != "EMPTY"
        key = owner.name, tuple(instance.persistent_id) if is_point else 0
        mesh = instance.object.data
        points = np.empty(len(mesh.vertices) * 3, np.float32)
        mesh.vertices.foreach_get("co", points)
        world = np.array(instance.matrix_world)
        found.setdefault(key, []).append(points.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3])
    return {key: np.concatenate(parts) for key, parts in found.items()}


def gap(first, second):
    """Largest distance from a point of either set to the other set."""
    distances = np.linalg.norm(first[:, None] - second[None], axis=2)
    return max(distances.min(axis=0).max(), distances.min(axis=1).max())


def count_blocks():
    kinds = ("objects", "meshes", "actions", "collections", "node_groups", "materials", "scenes")
    return {kind: len(getattr(bpy.data, kind)) for kind in kinds}
