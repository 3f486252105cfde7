"""Menus, where an artist looks for them: Object, Add, and by a shortcut. What is in a menu is also found by F3."""

import bmesh
import bpy
from bpy.props import EnumProperty, FloatProperty
from bpy.types import Menu, Operator
from bpy_extras.object_utils import AddObjectHelper, object_data_add

# Proposed shortcut of the menu, in the 3D View.
SHORTCUT = {"type": "P", "value": "PRESS", "ctrl": True, "alt": True}
# Sides of a round shape, and the width of a mound's top and of a wall, relative to their base.
SIDES, TOP, THICK = 48, 0.35, 0.3

_keys = []


def shape_mesh(style, width, height):
    """A closed mesh that stands on its origin."""
    mesh, made = bpy.data.meshes.new("Heap"), bmesh.new()
    if style == "WALL":
        bmesh.ops.create_cube(made, size=1.0)
        bmesh.ops.scale(made, verts=made.verts, vec=(width, THICK * width, height))
    else:
        radius = width / 2
        top = radius * {"MOUND": TOP, "CONE": 0.05, "DRUM": 1.0}[style]
        bmesh.ops.create_cone(made, cap_ends=True, segments=SIDES, radius1=radius, radius2=top, depth=height)
    bmesh.ops.translate(made, verts=made.verts, vec=(0, 0, height / 2))
    made.to_mesh(mesh)
    made.free()
    return mesh


class CAIRN_OT_add_shape(AddObjectHelper, Operator):
    """Add a closed mesh to be filled, and choose it as the shape of the pile"""

    bl_idname = "cairn.add_shape"
    bl_label = "Pile Shape"
    bl_options = {"REGISTER", "UNDO"}

    style: EnumProperty(
        name="Style",
        description="Form of the shape",
        items=[
            ("MOUND", "Mound", "A cone with a wide top"),
            ("CONE", "Cone", "A cone with a narrow top"),
            ("DRUM", "Drum", "Upright sides, as if props were in a drum"),
            ("WALL", "Wall", "A wall"),
        ],
    )
    width: FloatProperty(
        name="Width", description="Width of the shape's base", default=1.2, min=0.001, soft_max=100.0, unit="LENGTH"
    )
    height: FloatProperty(
        name="Height", description="Height of the shape", default=0.7, min=0.001, soft_max=100.0, unit="LENGTH"
    )

    def execute(self, context):
        mesh = shape_mesh(self.style, self.width, self.height)
        shown = object_data_add(context, mesh, operator=self)
        context.scene.cairn.control_mesh = shown
        return {"FINISHED"}


class CAIRN_MT_pile(Menu):
    bl_label = "Pile"

    def draw(self, context):
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("cairn.use_selected", text="Use Active as Shape, Others as Props", icon="EYEDROPPER")
        layout.operator("cairn.bake", icon="PHYSICS")
        layout.operator("cairn.check", text="Check the Scene", icon="VIEWZOOM")
        layout.operator("cairn.enough", icon="CHECKMARK")
        layout.operator("cairn.stop", icon="CANCEL")
        layout.separator()
        layout.operator("cairn.select_pile", icon="RESTRICT_SELECT_OFF")
        layout.operator("cairn.edit_pile", icon="GREASEPENCIL")
        layout.operator("cairn.remove_bodies", text="Remove Bodies")
        layout.operator_menu_enum("cairn.replace_bodies", "prop", text="Replace Bodies By")
        layout.operator("cairn.add_on_top")
        layout.operator("cairn.settle")
        layout.separator()
        layout.operator("cairn.try_seeds")
        layout.operator("cairn.fit_timing", text="Fit Collapse to Scene Range")
        layout.operator("cairn.keep_pose", text="Keep Final Pose Only")
        layout.separator()
        layout.operator("cairn.export_pile")
        layout.operator("cairn.mark_asset", text="Mark Pile as Asset")
        layout.operator("cairn.restore_settings", text="Restore the Pile's Settings")
        layout.operator("cairn.delete", text="Delete Pile", icon="TRASH")
        layout.separator()
        layout.operator("cairn.add_examples")


def _in_object(self, _):
    self.layout.separator()
    self.layout.menu("CAIRN_MT_pile", icon="PHYSICS")


def _in_add(self, _):
    self.layout.separator()
    self.layout.operator("cairn.add_shape", icon="PHYSICS")


CLASSES = [CAIRN_OT_add_shape, CAIRN_MT_pile]


def register():
    bpy.types.VIEW3D_MT_object.append(_in_object)
    bpy.types.VIEW3D_MT_add.append(_in_add)
    # Without a window, there is none.
    keys = bpy.context.window_manager.keyconfigs.addon
    if keys:
        keymap = keys.keymaps.new(name="Object Mode", space_type="EMPTY")
        item = keymap.keymap_items.new("wm.call_menu", **SHORTCUT)
        item.properties.name = "CAIRN_MT_pile"
        _keys.append((keymap, item))


def unregister():
    for keymap, item in _keys:
        keymap.keymap_items.remove(item)
    _keys.clear()
    bpy.types.VIEW3D_MT_add.remove(_in_add)
    bpy.types.VIEW3D_MT_object.remove(_in_object)
