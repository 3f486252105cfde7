"""Out and back: other programs' files with the names and the motion, one clip, an asset with a picture."""

import json
import struct

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import count_blocks

CLOSE = 1e-3


def spelled(name):
    """A name as files without spaces have it."""
    return name.replace(" ", "_")


def poses(objects, frames):
    found = {}
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        graph = bpy.context.evaluated_depsgraph_get()
        for name, shown in objects.items():
            found[frame, name] = np.array(shown.evaluated_get(graph).matrix_world.translation)
    return found


@pytest.mark.parametrize("form", ["USD", "ALEMBIC", "GLTF"])
def test_every_name_comes_back_with_its_motion(desk, addon, form, tmp_path):
    if form not in addon("outgoing").forms():
        pytest.skip(f"this Blender writes no {form}")
    desk.add_stick()
    desk.add_stick("Red.Block", (0.2, 0.2, 0.2))
    pile = desk.bake(kept_shape="NATURAL", start_frame=3)
    scene, last = bpy.context.scene, 2 + len(desk.motion.positions)
    scene.frame_end = 999
    frames = (3, (3 + last) // 2, last)
    before = poses({spelled(body.name): body for body in bodies_of(pile)}, frames)
    selected, current = list(bpy.context.selected_objects), scene.frame_current
    path, blocks = str(tmp_path / "pile"), count_blocks()
    assert bpy.ops.cairn.export_pile(form=form, filepath=path) == {"FINISHED"}
    assert list(bpy.context.selected_objects) == selected and count_blocks() == blocks
    assert (scene.frame_start, scene.frame_end, scene.frame_current) == (1, 999, current)
    path += addon("outgoing").ENDINGS[form][0]
    if form == "GLTF":
        with open(path, "rb") as file:
            (length,) = struct.unpack_from("<I", file.read(20), 12)
            document = json.loads(file.read(length))
        assert len(document["animations"]) == 1, "one clip"
        names = {spelled(node["name"]) for node in document["nodes"]}
        assert {name for _, name in before} <= names
        return
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if form == "USD":
        assert bpy.ops.wm.usd_import(filepath=path) == {"FINISHED"}
    else:
        assert bpy.ops.wm.alembic_import(filepath=path, as_background_job=False) == {"FINISHED"}
    names = {name for _, name in before}
    objects = {spelled(shown.name): shown for shown in bpy.data.objects}
    assert names <= set(objects), sorted(names - set(objects))[:5]
    after = poses({name: objects[name] for name in names}, frames)
    assert max(np.abs(after[key] - before[key]).max() for key in before) < CLOSE


def test_a_pile_is_an_asset_with_a_picture(desk, addon, tmp_path):
    stick = desk.add_stick()
    red = bpy.data.materials.new("Red")
    red.use_nodes = True
    red.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.8, 0.02, 0.02, 1)
    stick.data.materials.append(red)
    desk.control.location = (4, 0, 0)
    bpy.context.view_layer.update()
    pile = desk.bake(output_mode="POSE")
    assert bpy.ops.cairn.mark_asset() == {"FINISHED"}
    assert pile.asset_data is not None and "bodies" in pile.asset_data.description
    size = addon("outgoing").THUMBNAIL
    assert tuple(pile.preview.image_size) == (size, size)
    pixels = np.array(pile.preview.image_pixels_float[:]).reshape(size, size, 4)
    seen = pixels[..., 3] > 0.5
    assert 0.2 < seen.mean() < 0.9 and pixels[seen][:, 0].mean() > 3 * pixels[seen][:, 2].mean()
    # From a library, it stands where it is put.
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {pile}, fake_user=True)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True, assets_only=True) as (inside, wanted):
        assert inside.collections == ["Heap Pile"]
        wanted.collections = ["Heap Pile"]
    instance = bpy.data.objects.new("Pile", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", wanted.collections[0]
    bpy.context.scene.collection.objects.link(instance)
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    places = [
        i.matrix_world.translation[:2] for i in graph.object_instances if i.is_instance and i.object.type == "MESH"
    ]
    assert len(places) > 5 and np.abs(np.median(np.array(places), axis=0)).max() < 0.3
