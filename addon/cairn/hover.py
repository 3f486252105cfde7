"""Inspect: what the analysis found of the object under the mouse, in the header of its view."""

from bpy.types import Operator
from bpy_extras import view3d_utils

from . import analysis

# Sentences at most, so that they fit into the header.
MOST = 3


def hit(context, origin, direction):
    """The analyzed object that a ray meets first; None where it meets another, or nothing."""
    found, _, _, _, source, _ = context.scene.ray_cast(context.view_layer.depsgraph, origin, direction)
    source = source.original if found else None
    # A part of an object stands for all of it.
    while source and analysis.FIGURES not in source:
        source = source.parent
    return source


def under(context, event):
    """The view under the mouse, and the analyzed object there."""
    for area in context.window.screen.areas:
        for region in area.regions if area.type == "VIEW_3D" else ():
            place = event.mouse_x - region.x, event.mouse_y - region.y
            if region.type != "WINDOW" or not (0 <= place[0] < region.width and 0 <= place[1] < region.height):
                continue
            eye = area.spaces.active.region_3d
            origin = view3d_utils.region_2d_to_origin_3d(region, eye, place)
            return area, hit(context, origin, view3d_utils.region_2d_to_vector_3d(region, eye, place))
    return None, None


def said(source):
    """The text of an object; a hint where there is none."""
    if source is None:
        return "Move the mouse over an analyzed object; click to select it, Esc to stop"
    return " ".join(analysis.lines(analysis.figures(source))[:MOST])


class CAIRN_OT_inspect(Operator):
    """Show what was found of the object under the mouse; click selects it, Esc stops"""

    bl_idname = "cairn.inspect"
    bl_label = "Inspect"

    @classmethod
    def poll(cls, context):
        return bool(analysis.analysed(context.scene)) and context.mode == "OBJECT"

    def invoke(self, context, event):
        self.area = None
        context.window_manager.modal_handler_add(self)
        self.show(context, event)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type in {"ESC", "RIGHTMOUSE"} or not analysis.analysed(context.scene):
            self.cancel(context)
            return {"FINISHED"}
        if event.type == "MOUSEMOVE":
            self.show(context, event)
        elif event.type == "LEFTMOUSE" and event.value == "PRESS":
            _, source = under(context, event)
            if source:
                for other in context.selected_objects:
                    other.select_set(False)
                source.select_set(True)
                context.view_layer.objects.active = source
                return {"RUNNING_MODAL"}
        return {"PASS_THROUGH"}

    def show(self, context, event):
        area, source = under(context, event)
        if self.area and self.area != area:
            self.area.header_text_set(None)
        self.area = area
        if area:
            area.header_text_set(said(source))

    def cancel(self, context):
        if self.area:
            self.area.header_text_set(None)
        self.area = None


CLASSES = [CAIRN_OT_inspect]
