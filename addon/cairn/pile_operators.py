"""What the buttons do to a pile: delete it; take its settings up again."""

import bpy
from bpy.props import StringProperty
from bpy.types import Operator

from . import pending, pointers, request, result, running
from .client import Fault
from .following import explain, is_running


class CAIRN_OT_delete(Operator):
    """Take the pile away, with its animation, and show the shape as it was before the bake"""

    bl_idname = "cairn.delete"
    bl_label = "Delete Bake"
    bl_options = {"UNDO"}

    collection: StringProperty(name="Collection", description="The pile's collection. Empty: that of the shape")

    @classmethod
    def poll(cls, _):
        return not is_running()

    def execute(self, context):
        collection = _chosen(context, self.collection)
        if collection is None:
            return explain(
                self, Fault("There is no baked pile of this shape. Choose the shape of the one that you mean.")
            )
        result.delete(collection)
        return {"FINISHED"}


class CAIRN_OT_restore_settings(Operator):
    """Set everything as it was for this pile, seed included: baked again, it gives the same"""

    bl_idname = "cairn.restore_settings"
    bl_label = "Use Its Settings"
    bl_options = {"UNDO"}

    collection: StringProperty(name="Collection", description="The pile's collection. Empty: that of the shape")

    def execute(self, context):
        collection = _chosen(context, self.collection)
        if collection is None:
            return explain(
                self, Fault("There is no baked pile of this shape. Choose the shape of the one that you mean.")
            )
        found = pointers.read(collection.cairn.pointers)
        request.from_dict(context.scene.cairn, running.recipe_of(collection)["settings"], found, "settings.")
        return {"FINISHED"}


def _chosen(context, name):
    if name:
        collection = bpy.data.collections.get(name)
        return collection if collection and collection.cairn.is_result else None
    return result.chosen(context)


class CAIRN_OT_forget(Operator):
    """Do not get the result of the bake that was under way when this file was closed"""

    bl_idname = "cairn.forget"
    bl_label = "Forget It"

    def execute(self, _):
        pending.give_up()
        running.left = pending.of_this_file()
        return {"FINISHED"}


CLASSES = [CAIRN_OT_delete, CAIRN_OT_restore_settings, CAIRN_OT_forget]
