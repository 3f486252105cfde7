"""The panel of a pile's timing, and its button."""

import bpy
from bpy.props import StringProperty
from bpy.types import Operator, Panel

from . import result, states, timing
from .client import Fault
from .following import explain
from .panels import Pile


class CAIRN_OT_fit_timing(Operator):
    """Let the pile collapse within the scene's range of frames, from its first to its last"""

    bl_idname = "cairn.fit_timing"
    bl_label = "Fit to Scene Range"
    bl_options = {"UNDO"}

    collection: StringProperty(name="Collection", description="The pile's collection. Empty: that of the shape")

    def execute(self, context):
        collection = bpy.data.collections.get(self.collection) or result.chosen(context)
        if collection is None or not collection.cairn.frame_count:
            return explain(self, Fault("There is no baked pile of this shape. Choose the shape of the one you mean."))
        scene, note = context.scene, collection.cairn
        room = scene.frame_end - scene.frame_start - note.timing_hold
        if room < 1:
            return explain(self, Fault("The scene's range has no room for the hold. Make the hold shorter."))
        note.timing_speed = max(note.frame_count - 1, 1) / room
        note.timing_start = scene.frame_start
        return {"FINISHED"}


class CAIRN_OT_keep_pose(Operator):
    """Keep only the pose that the pile ends with: its animation is removed, and it is at rest at every frame"""

    bl_idname = "cairn.keep_pose"
    bl_label = "Final Pose Only"
    bl_options = {"UNDO"}

    collection: StringProperty(name="Collection", description="The pile's collection. Empty: that of the shape")

    def execute(self, context):
        collection = bpy.data.collections.get(self.collection) or result.chosen(context)
        if collection is None or not collection.cairn.frame_count or collection.cairn.mode == "POSE":
            return explain(self, Fault("There is no pile of this shape that moves."))
        states.restore()
        timing.keep_end(collection)
        states.refresh(context.scene)
        return {"FINISHED"}


class CAIRN_PT_timing(Pile, Panel):
    bl_label = "Timing"
    bl_parent_id = "CAIRN_PT_pile"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        collection = result.chosen(context)
        return collection is not None and collection.cairn.frame_count > 1 and collection.cairn.mode != "POSE"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        collection = result.chosen(context)
        for name in ("timing_start", "timing_hold", "timing_speed", "timing_ease"):
            layout.prop(collection.cairn, name)
        layout.label(text=f"At rest from frame {timing.end_of(collection)} on")
        layout.operator("cairn.fit_timing").collection = collection.name
        layout.operator("cairn.keep_pose").collection = collection.name


CLASSES = [CAIRN_OT_fit_timing, CAIRN_OT_keep_pose, CAIRN_PT_timing]
