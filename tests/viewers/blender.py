"""blender.py FILE TABLE: Blender's own importer puts every body where the table has it."""

import sys

import bpy
import table as tables
from mathutils import Matrix

file, path = sys.argv[1:]
table = tables.load(path)
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = round(table["fps"])
assert bpy.ops.import_scene.gltf(filepath=file) == {"FINISHED"}

# Blender is Z up: its importer turns both the world and each object's own frame.
turn = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
poses = {}
for frame in tables.frames(table):
    bpy.context.scene.frame_set(frame)
    for body, entry in enumerate(table["bodies"]):
        world = bpy.data.objects[entry["name"]].matrix_world
        poses[frame, body] = turn.inverted() @ world @ turn
tables.compare(f"Blender {bpy.app.version_string}", table, poses)

# Every body shows its prop: the meshes of the barrow stand below its node, and keep what artists gave them.
for entry in table["bodies"]:
    top = bpy.data.objects[entry["name"]]
    shown = [thing for thing in [top, *top.children_recursive] if thing.type == "MESH"]
    assert len(shown) == (5 if "barrow" in entry["name"] else 1), entry["name"]
barrow = next(thing for thing in bpy.data.objects if thing.name.startswith("Barrow"))
assert barrow["owner"] == "gardener"
paint = next(material for material in bpy.data.materials if material.name.startswith("Paint"))
assert paint["coats"] == 2
assert any(node.type == "TEX_IMAGE" and node.image.size[0] == 2 for node in paint.node_tree.nodes)
