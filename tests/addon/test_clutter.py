"""The loader of layouts shows each body where its line says."""

import importlib.util
import subprocess
import sys
import types

import bpy
import numpy as np
import pytest
from conftest import PROGRAM, ROOT, once
from mathutils import Matrix, Quaternion, Vector

CATALOG = ROOT / "examples/clutter/bin.toml"


def module(name, path):
    spec = importlib.util.spec_from_file_location(name, path)
    made = importlib.util.module_from_spec(spec)
    sys.modules[name] = made
    spec.loader.exec_module(made)
    return made


@pytest.fixture
def loader(monkeypatch):
    """The example, with the package's reader alone: it needs nothing but Python, and the add-on may have this name."""
    package = types.ModuleType("cairn")
    package.clutter = module("clutter", ROOT / "python/cairn/clutter.py")
    monkeypatch.setitem(sys.modules, "cairn", package)
    return module("with_blender", ROOT / "examples/clutter/with_blender.py")


def corners(root):
    """All corners of a body's meshes in the world. Shape [corner, 3]."""
    meshes = [item for item in root.children_recursive if item.type == "MESH"]
    return np.array([item.matrix_world @ corner.co for item in meshes for corner in item.data.vertices])


@once
def test_a_layout_is_shown(loader, tmp_path):
    command = [PROGRAM, "clutter", CATALOG, "-n", "2", "-o", tmp_path, "--sheet", "0", "--progress", "none"]
    subprocess.run(command, check=True)
    models = CATALOG.parent
    for layout in loader.cairn.clutter.read(tmp_path):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        objects = loader.load(layout, models)
        bpy.context.view_layer.update()
        assert [item["label"] for item in objects] == layout.labels
        assert [item["category_id"] for item in objects] == [body["prop"] + 1 for body in layout.bodies]
        for root, body in zip(objects, layout.bodies):
            # glTF's axes are turned here by a matrix of our own, not by the reader that the loader uses.
            turn = Matrix(((1, 0, 0), (0, 0, -1), (0, 1, 0))).to_4x4()
            x, y, z, w = body["rotation"]
            pose = Matrix.LocRotScale(Vector(body["position"]), Quaternion((w, x, y, z)), [body["scale"]] * 3)
            wanted = turn @ pose @ turn.inverted()
            assert np.abs(np.array(root.matrix_world) - np.array(wanted)).max() < 1e-5
            # The collision shape that came to rest is where the mesh is: both have about the same box.
            points = [point for solid in layout.prop(body)["solids"] for point in solid_corners(solid)]
            shape = np.array([turn @ pose @ Vector(point) for point in points])
            seen = corners(root)
            off = [np.abs(pick(shape, axis=0) - pick(seen, axis=0)).max() for pick in (np.min, np.max)]
            assert max(off) < 0.2 * np.ptp(seen, axis=0).max()


def solid_corners(solid):
    """Points of a solid of assets.json that reach as far as it does."""
    if solid["kind"] == "hull":
        return solid["points"]
    center = Vector(solid["center"])
    if solid["kind"] == "ball":
        return [center + sign * solid["radius"] * axis for axis in Matrix.Identity(3) for sign in (-1, 1)]
    x, y, z, w = solid["rotation"]
    half = solid["half"]
    signs = [(a, b, c) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
    return [center + Quaternion((w, x, y, z)) @ Vector([s * h for s, h in zip(sign, half)]) for sign in signs]
