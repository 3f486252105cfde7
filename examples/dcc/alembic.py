"""A pile as Alembic, by Blender without a window:

blender --background --python-exit-code 1 --python examples/dcc/alembic.py -- pile.glb pile.abc

Each body is an object of its own with its name (points as underscores) and its motion. Metres, Z up.
"""

import json
import struct
import sys

import bpy


def clock(path):
    """Frames per second and the number of frames, which the node `pile` of a result states."""
    with open(path, "rb") as file:
        _, _, _, length, _ = struct.unpack("<4sIIII", file.read(20))
        nodes = json.loads(file.read(length))["nodes"]
    extras = next(node["extras"] for node in nodes if node.get("name") == "pile")
    return extras["fps"], extras["frames"]


result, output = sys.argv[sys.argv.index("--") + 1 :]
fps, frames = clock(result)
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
# Before the import: it turns seconds into frames. Blender has whole frames per second over a divisor.
scene.render.fps = round(fps)
scene.render.fps_base = round(fps) / fps
bpy.ops.import_scene.gltf(filepath=result)
scene.frame_start, scene.frame_end = 0, frames - 1
bpy.ops.wm.alembic_export(filepath=output, start=0, end=frames - 1, flatten=False, export_custom_properties=False)
print(f"{output}: {sum(thing.type == 'MESH' for thing in scene.objects)} meshes, {frames} frames")
