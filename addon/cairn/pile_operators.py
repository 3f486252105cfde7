"""Operators of a pile: delete it, restore its settings."""

import bpy
from bpy.props import StringProperty
from bpy.types import Operator

from . import pending, pointers, request, result, roots, running
from .client import Fault
from .following import explaining, is_running


class OfPile:
    """Common part of operators on a pile: the named one, or that of the shape."""

    bl_options = {"UNDO"}

    collection: StringProperty(
        name="Collection", description="Collection of the pile. If empty, uses the pile of the selected shape"
    )

    def execute(self, context):
        with explaining(self):
            collection = bpy.data.collections.get(self.collection) if self.collection else result.chosen(context)
            if collection is None or not collection.cairn.is_result:
                raise Fault("There is no baked pile of this shape. Choose the shape that the pile was baked of.")
            self.change(context, collection)
            return {"FINISHED"}
        return {"CANCELLED"}

    def change(self, context, collection):
        raise NotImplementedError


class CAIRN_OT_delete(OfPile, Operator):
    """Delete the pile with its animation, and show the shape as it was before the bake"""

    bl_idname = "cairn.delete"
    bl_label = "Delete Bake"

    @classmethod
    def poll(cls, _):
        return not is_running()

    def change(self, context, collection):
        said = result.delete(context.scene, collection)
        if said:
            self.report({"WARNING"}, said)


class CAIRN_OT_select_pile(OfPile, Operator):
    """Select the empty that the whole pile hangs on: move, turn, scale, parent or animate it"""

    bl_idname = "cairn.select_pile"
    bl_label = "Select Pile"
    bl_options = {"REGISTER", "UNDO"}

    def change(self, context, collection):
        root = roots.of(collection)
        if root is None or context.view_layer.objects.get(root.name) != root:
            raise Fault("The pile's empty is not in this view layer. Bake again to get one.")
        for other in context.selected_objects:
            other.select_set(False)
        root.select_set(True)
        context.view_layer.objects.active = root


class CAIRN_OT_restore_settings(OfPile, Operator):
    """Restore all settings of this pile, including its seed, so that a new bake gives the same pile"""

    bl_idname = "cairn.restore_settings"
    bl_label = "Restore These Settings"

    def change(self, context, collection):
        found = pointers.read(collection.cairn.pointers)
        request.from_dict(context.scene.cairn, running.recipe_of(collection)["settings"], found, "settings.")


class CAIRN_OT_forget(Operator):
    """Discard the bake that was running when this file was closed"""

    bl_idname = "cairn.forget"
    bl_label = "Discard Bake"

    def execute(self, _):
        pending.give_up()
        running.left = pending.of_this_file()
        return {"FINISHED"}


CLASSES = [CAIRN_OT_delete, CAIRN_OT_select_pile, CAIRN_OT_restore_settings, CAIRN_OT_forget]
