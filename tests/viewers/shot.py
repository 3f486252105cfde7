"""shot.py SHOT TABLE: a shot in centimetres, Z up, from 1001 on, into which a result is referenced that refers to a published asset:
Blender's own importer puts every body where the table has it, with the asset's mesh and material."""

import sys

import bpy
import table as tables
from mathutils import Matrix

file, path = sys.argv[1:]
table = tables.load(path)
bpy.ops.wm.read_factory_settings(use_empty=True)
assert bpy.ops.wm.usd_import(filepath=file) == {"FINISHED"}
scene = bpy.context.scene
assert (scene.frame_start, scene.frame_end) == (1001, 1048)

# The shot moves the pile by a metre. A brick's own axes are those of its file, Z up; the table has the prop as glTF, Y up.
turn = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
place = Matrix.Translation((1, 0, 0)) @ turn
poses, meshes = {}, 0
for frame in tables.frames(table):
    scene.frame_set(1001 + frame)
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if not instance.is_instance or instance.parent.name != "Bodies" or instance.instance_object.type != "MESH":
            continue
        # From centimetres to metres: the importer scales the stage.
        unscaled = Matrix.LocRotScale(*instance.matrix_world.decompose()[:2], None)
        poses[frame, instance.persistent_id[1]] = place.inverted() @ unscaled @ turn
        corners = [corner[0] for corner in instance.instance_object.bound_box]
        assert abs(instance.matrix_world.to_scale()[0] * (max(corners) - min(corners)) - 0.24) < 1e-3
        meshes += 1
assert meshes == len(poses) > 10
tables.compare(f"Blender {bpy.app.version_string}, a shot in USD", table, poses, tolerance=2e-3)
assert any(material.name.startswith("clay") for material in bpy.data.materials)
