"""The panel of a pile's timing, and its buttons."""

from bpy.types import Operator, Panel

from . import result, states, timing
from .client import Fault
from .panels import Pile
from .pile_operators import OfPile


class CAIRN_OT_fit_timing(OfPile, Operator):
    """Set start and speed so that the pile collapses within the scene's frame range"""

    bl_idname = "cairn.fit_timing"
    bl_label = "Fit to Scene Range"

    def change(self, context, collection):
        scene, note = context.scene, collection.cairn
        if not note.frame_count:
            raise Fault("There is no animated pile of this shape.")
        room = scene.frame_end - scene.frame_start - note.timing_hold
        if room < 1:
            raise Fault("The scene's range has no room for the start delay. Make it shorter.")
        note.timing_speed = max(note.frame_count - 1, 1) / room
        note.timing_start = scene.frame_start


class CAIRN_OT_keep_pose(OfPile, Operator):
    """Keep only the final pose: the pile's animation is removed, and the pile is at rest at every frame"""

    bl_idname = "cairn.keep_pose"
    bl_label = "Final Pose Only"

    def change(self, context, collection):
        if not collection.cairn.frame_count or collection.cairn.mode == "POSE":
            raise Fault("There is no animated pile of this shape.")
        states.restore()
        timing.keep_end(collection)
        states.refresh(context.scene)


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
        layout.label(text=f"At Rest from Frame {timing.end_of(collection)}")
        layout.operator("cairn.fit_timing").collection = collection.name
        layout.operator("cairn.keep_pose").collection = collection.name


CLASSES = [CAIRN_OT_fit_timing, CAIRN_OT_keep_pose, CAIRN_PT_timing]
