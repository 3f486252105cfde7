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

# Blender is Z up: its importer turns the world, and leaves each prop's own frame.
turn = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
poses = {}
for frame in tables.frames(table):
    scene.frame_set(frame)
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.is_instance and instance.parent.name == "Bodies":
            print(frame, instance.object.name, list(instance.persistent_id)[:4], instance.matrix_world.translation)
