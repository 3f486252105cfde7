"""usd.py FILE TABLE: Blender's own importer of USD puts every body where the table has it."""

import sys

import bpy
import table as tables
from mathutils import Matrix

file, path = sys.argv[1:]
table = tables.load(path)
bpy.ops.wm.read_factory_settings(use_empty=True)
assert bpy.ops.wm.usd_import(filepath=file) == {"FINISHED"}
scene = bpy.context.scene
assert scene.render.fps == table["fps"]
assert (scene.frame_start, scene.frame_end) == (0, len(table["frames"]) - 1)

# Blender is Z up: its importer turns the world, and leaves each prop's own frame. A body is a point, at which the prop's prim and all
# that is below it are shown.
turn = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
poses, shown = {}, {}
for frame in tables.frames(table):
    scene.frame_set(frame)
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if not instance.is_instance or instance.parent.name != "Bodies":
            continue
        body, thing = instance.persistent_id[1], instance.instance_object
        if thing.parent is None:
            poses[frame, body] = turn.inverted() @ instance.matrix_world
        elif thing.type == "MESH":
            shown.setdefault((frame, body), []).append(thing.name)
# It reads the rotations in half precision.
tables.compare(f"Blender {bpy.app.version_string}, USD", table, poses, tolerance=2e-3)

for frame in tables.frames(table):
    for body, entry in enumerate(table["bodies"]):
        assert len(shown[frame, body]) == (5 if "barrow" in entry["name"] else 1), entry["name"]
paint = next(material for material in bpy.data.materials if material.name.startswith("Paint"))
assert any(node.type == "TEX_IMAGE" and node.image.size[0] == 2 for node in paint.node_tree.nodes)
