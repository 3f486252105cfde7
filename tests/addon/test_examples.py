"""The five scenes to begin with can be baked as they are."""

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import once
from mathutils import Vector

NAMES = ("Firewood", "Rubble", "Oranges", "Books", "Cans")


# Every Blender makes them; what they are baked to is the same.
@pytest.mark.parametrize("name", ["Books", *(pytest.param(name, marks=once) for name in NAMES if name != "Books")])
def test_an_example_is_baked(addon, name):
    assert bpy.ops.cairn.add_examples() == {"FINISHED"}
    assert set(NAMES) <= set(bpy.data.scenes.keys())
    scene = bpy.data.scenes[name]
    assert addon("request").missing(scene.cairn) == "" and scene.camera
    scene.cairn.accuracy, scene.cairn.output_mode = "DRAFT", "POSE"
    # The bottom of the pile does, and takes less time.
    scene.cairn.fill.use_count, scene.cairn.fill.count = True, 80
    with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0]):
        assert bpy.ops.cairn.bake() == {"FINISHED"}
    pile = addon("result").existing(scene, scene.cairn.control_mesh)
    bodies = bodies_of(pile)
    props = {body.cairn.prop for body in bodies}
    assert len(bodies) > 30 and props == set(range(len(scene.cairn.prop_collection.objects)))
    if name == "Firewood":
        # Logs lie side by side: nine of ten along the wall.
        along = [abs((body.matrix_world.to_3x3() @ Vector((1, 0, 0))).x) for body in bodies]
        assert np.percentile(along, 10) > 0.9
    # It stands on the ground, about where its shape is.
    places = np.array([body.location for body in bodies])
    assert places[:, 2].min() > 0 and np.abs(np.median(places[:, :2], axis=0)).max() < 0.3
