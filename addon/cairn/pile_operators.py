"""What the buttons do to a pile: keep what a stopped bake has, or not; delete one; take its settings up again."""

import bpy
from bpy.props import StringProperty
from bpy.types import Operator

from . import pending, preview, request, result, running
from .client import Fault
from .operators import explain, explaining, finished, is_running


class CAIRN_OT_keep(Operator):
    """Make the pile of the frames that were baked before it was cancelled"""

    bl_idname = "cairn.keep"
    bl_label = "Keep"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, _):
        return running.bake is not None and running.bake.end == "stopped"

    def execute(self, context):
        with explaining(self):
            bake, running.bake = running.bake, None
            motion = bake.job.recording.motion()
            collection = result.finish(result.build(context, motion, bake.recipe, bake.told()))
            return finished(self, context, collection)
        return {"CANCELLED"}


class CAIRN_OT_discard(Operator):
    """Forget the frames that were baked. The scene is as it was before"""

    bl_idname = "cairn.discard"
    bl_label = "Restore the Scene"

    @classmethod
    def poll(cls, _):
        return running.bake is not None and running.bake.end == "stopped"

    def execute(self, context):
        running.bake = None
        preview.redraw(context)
        return {"FINISHED"}


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
        request.from_dict(context.scene.cairn, running.recipe_of(collection)["settings"])
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
        pending.forget()
        running.left = None
        return {"FINISHED"}


CLASSES = [CAIRN_OT_keep, CAIRN_OT_discard, CAIRN_OT_delete, CAIRN_OT_restore_settings, CAIRN_OT_forget]
