"""The first pile, by somebody who has read nothing: run by Blender 3.4 in a window of 1366 x 768, as `ui.py` is.

At most five clicks; the button is seen without scrolling, at the sidebar's default width.
"""

import os
import sys

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from blocks import bodies_of
from hands import click, picture, sidebar, view, wait
from window import install, make_scene, start

# Where things are, in pixels from the window's left and its top: the tab, the shape's button, the props' field and its
# second row, and the button.
CLICKS = {
    "tab": (1114, 238),
    "shape": (1000, 150),
    "props": (1040, 217),
    "collection": (1038, 270),
    "bake": (975, 249),
}


def walk():
    from cairn import running

    area = sidebar()
    yield 1.0
    make_scene(area, stick_at=(1.5, 0, 0.2))
    settings, cone = bpy.context.scene.cairn, bpy.data.objects["Cone"]
    settings.control_mesh = settings.prop_collection = None
    with view(area):
        cone.select_set(True)
        bpy.context.view_layer.objects.active = cone
        bpy.ops.view3d.view_selected()
    yield 1.0
    for number, (name, place) in enumerate(CLICKS.items()):
        yield from click(*place)
        yield 1.0
        picture(f"first-{number}-{name}.png")
    assert settings.control_mesh == cone and settings.prop_collection.name == "Props"
    yield from wait(lambda: "Cone Pile" in bpy.data.collections and running.bake is None, "the pile")
    assert len(bodies_of(bpy.data.collections["Cone Pile"])) > 20
    yield 1.0
    picture("first-pile.png")
    print("1 passed, 0 failed", flush=True)


install()
start(walk())
