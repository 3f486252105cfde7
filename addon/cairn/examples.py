"""Five scenes to begin with: each has a shape, props and settings, and is ready to be baked."""

from math import pi

import bmesh
import bpy
from bpy.types import Operator
from mathutils import Matrix

from . import menus, starters

# Name -> form of the shape, its width and height (m); presets of heap and props; and props: form, size (m), color.
SCENES = {
    "Firewood": (
        ("WALL", 1.6, 0.9),
        "TIDIED",
        "WOOD",
        {"Log": ("ROD", (0.42, 0.1), (0.35, 0.2, 0.09)), "Split Log": ("BOX", (0.4, 0.11, 0.07), (0.55, 0.36, 0.18))},
    ),
    "Rubble": (
        ("MOUND", 1.6, 0.6),
        "DUMPED",
        "BRICK",
        {
            "Brick": ("BOX", (0.24, 0.115, 0.07), (0.5, 0.14, 0.08)),
            "Half Brick": ("BOX", (0.12, 0.115, 0.07), (0.45, 0.13, 0.09)),
            "Slab": ("BOX", (0.3, 0.2, 0.05), (0.4, 0.4, 0.38)),
        },
    ),
    "Oranges": (
        ("CONE", 0.7, 0.4),
        "MODELED",
        "FRUIT",
        {"Orange": ("BALL", (0.08,), (0.9, 0.38, 0.04)), "Lemon": ("BALL", (0.06,), (0.9, 0.8, 0.1))},
    ),
    "Books": (
        ("DRUM", 0.9, 0.7),
        "STACKED",
        "PAPER",
        {
            "Novel": ("BOX", (0.2, 0.13, 0.03), (0.15, 0.25, 0.5)),
            "Atlas": ("BOX", (0.3, 0.22, 0.025), (0.5, 0.1, 0.12)),
        },
    ),
    "Cans": (
        ("MOUND", 1.0, 0.5),
        "SETTLED",
        "STEEL",
        {"Can": ("ROD", (0.11, 0.07), (0.6, 0.62, 0.65)), "Small Can": ("ROD", (0.06, 0.07), (0.7, 0.55, 0.2))},
    ),
}
SIDES = 24
# How tidily logs are stacked.
STACK = 0.9


def add(name):
    """A new scene with a shape, props and settings."""
    (style, width, height), heap, material, props = SCENES[name]
    scene = bpy.data.scenes.new(name)
    scene.unit_settings.system = "METRIC"
    shape = bpy.data.objects.new(f"{name} Shape", menus.shape_mesh(style, width, height))
    scene.collection.objects.link(shape)
    collection = bpy.data.collections.new(f"{name} Props")
    scene.collection.children.link(collection)
    for number, (title, (form, size, color)) in enumerate(props.items()):
        made = bpy.data.objects.new(title, _mesh(title, form, size))
        made.location = (width, 0.4 * number, size[-1] / 2)
        look = bpy.data.materials.new(title)
        look.diffuse_color = (*color, 1.0)
        look.use_nodes = True
        shader = next(node for node in look.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
        shader.inputs["Base Color"].default_value = (*color, 1.0)
        made.data.materials.append(look)
        collection.objects.link(made)
    _light(scene, width)
    settings = scene.cairn
    settings.control_mesh, settings.prop_collection = shape, collection
    starters.set_heap(settings, heap)
    starters.set_prop(settings.prop_common, material)
    if heap == "TIDIED":
        # Logs lie side by side, and do not stand on their ends.
        settings.prop_common.up, settings.prop_common.turns, settings.arrangement.order = "Z", "NONE", STACK
    return scene


def _mesh(title, form, size):
    mesh, made = bpy.data.meshes.new(title), bmesh.new()
    if form == "BOX":
        bmesh.ops.create_cube(made, size=1.0)
        bmesh.ops.scale(made, verts=made.verts, vec=size)
    elif form == "BALL":
        bmesh.ops.create_icosphere(made, subdivisions=2, radius=size[0] / 2)
    else:
        # Its axis is X.
        length, width = size
        ends = {"radius1": width / 2, "radius2": width / 2, "depth": length}
        bmesh.ops.create_cone(made, cap_ends=True, segments=SIDES, **ends)
        bmesh.ops.rotate(made, verts=made.verts, matrix=Matrix.Rotation(pi / 2, 3, "Y"))
    made.to_mesh(mesh)
    made.free()
    return mesh


def _light(scene, width):
    """A sun, and a camera that sees the shape."""
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 4.0, (0.7, 0.2, 0.4)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.0, -3.2 * width, 1.3 * width), (0.4 * pi, 0.0, 0.0)
    for shown in (sun, camera):
        scene.collection.objects.link(shown)
    scene.camera = camera


class CAIRN_OT_add_examples(Operator):
    """Add five scenes to this file, each with a shape, props and settings, ready to be baked"""

    bl_idname = "cairn.add_examples"
    bl_label = "Add Example Scenes"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        made = [add(name) for name in SCENES]
        if context.window:
            context.window.scene = made[0]
        view = context.region_data
        if view:
            view.view_location, view.view_distance = (0.0, 0.0, 0.4), 3.6
        self.report({"INFO"}, "Five scenes were added. Choose one at the top of the window, and press Bake Pile")
        return {"FINISHED"}


CLASSES = [CAIRN_OT_add_examples]
