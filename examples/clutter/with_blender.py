"""Shows a layout of `cairn clutter` in Blender or BlenderProc: blender --python with_blender.py -- layouts 3 models

`models` is the folder of the catalogue, from which the files of the models are.
"""

import sys
from pathlib import Path

import bpy
import cairn
from mathutils import Quaternion


def load(layout, models):
    """The objects of the bodies, in their order; with `label` and `category` for masks."""
    place = layout.place
    bpy.ops.import_scene.gltf(filepath=str(Path(models) / place["file"]))
    objects = []
    for number, body in enumerate(layout.bodies):
        bpy.ops.import_scene.gltf(filepath=str(Path(models) / layout.prop(body)["file"]))
        position, rotation = cairn.clutter.z_up(body["position"], body["rotation"], models_too=True)
        root = bpy.data.objects.new(f"body{number}", None)
        bpy.context.scene.collection.objects.link(root)
        for item in bpy.context.selected_objects:
            if item.parent is None:
                item.parent = root
        root.location, root.rotation_mode = position, "QUATERNION"
        root.rotation_quaternion, root.scale = Quaternion(rotation), [body["scale"]] * 3
        root["label"], root["category_id"] = body["label"], body["prop"] + 1
        objects.append(root)
    return objects


if __name__ == "__main__":
    folder, number, models = sys.argv[sys.argv.index("--") + 1 :]
    load(next(layout for layout in cairn.clutter.read(folder) if layout.number == int(number)), models)
