"""The panels below the button, closed at first: parameters, and objects placed by hand."""

import bpy
from bpy.types import Panel

from . import placed, starters
from .following import is_running
from .layouts import wrapped
from .panels import Pile, draw_field, draw_optional
from .schema import GROUPS, OF_CONTAINERS, fields_of, knows


# Fields of the result that only measure it; and fields that other panels draw.
MEASURED = {("Output", "free_standing"), ("Output", "free_pour")}
DRAWN = {("Fill", "count"), ("Fill", "shell"), *OF_CONTAINERS, *MEASURED}


class _Parameters(Pile):
    """Parameters of some of the schema's groups."""

    bl_parent_id = "CAIRN_PT_pile"
    bl_options = {"DEFAULT_CLOSED"}
    messages = ()

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.enabled = not is_running()
        self.draw_more(layout, context.scene.cairn)
        for message in self.messages:
            group = getattr(context.scene.cairn, GROUPS[message], None)
            for field in fields_of(message) if group else ():
                if (message, field["name"]) not in DRAWN:
                    draw_field(layout, context, group, field)

    def draw_more(self, layout, settings):
        pass


def draw_whole(layout, group, name):
    """Draws a value across the whole width: beside it, its label would be cut."""
    row = layout.row()
    row.use_property_split = False
    row.prop(group, name)


class CAIRN_PT_material(_Parameters, Panel):
    bl_label = "Prop Physics"

    def draw_more(self, layout, settings):
        starters.draw(layout, starters.CAIRN_MT_prop_presets, "cairn.add_prop_preset")
        is_common = settings.prop_source == "COLLECTION"
        items = [settings.prop_common] if is_common else settings.props
        for item in items:
            column = layout.column(align=True)
            if not is_common and item.object:
                column.label(text=item.object.name)
            draw_whole(column, item, "density")
            for name in ("friction", "restitution"):
                column.prop(item, name)
            if knows("Prop", "tilt_max"):
                column.prop(item, "tilt")
            if knows("Prop", "turns"):
                for name in ("up", "turns", "skew"):
                    column.prop(item, name)


class CAIRN_PT_advanced(_Parameters, Panel):
    bl_label = "Advanced"

    def draw_more(self, layout, settings):
        wrapped(layout, bpy.context, "The simulation quality sets these values, unless you tick them.")


class _Advanced(_Parameters):
    bl_parent_id = "CAIRN_PT_advanced"


class CAIRN_PT_fill(_Advanced, Panel):
    bl_label = "Fill"
    messages = ("Fill", "Base")

    def draw_more(self, layout, settings):
        if not knows("Fill", "shell"):
            return
        column = layout.column()
        column.use_property_split = False
        column.prop(settings.fill, "use_shell", text="Only Near the Surface")
        depth = column.row()
        depth.active = settings.fill.use_shell
        depth.prop(settings.fill, "shell", text="Depth (Sizes)")


class CAIRN_PT_release(_Advanced, Panel):
    bl_label = "Release"
    messages = ("Release", "Hold")


class CAIRN_PT_control(_Advanced, Panel):
    bl_label = "Control"
    messages = ("Control",)


class CAIRN_PT_glue(_Advanced, Panel):
    bl_label = "Glue"
    messages = ("Glue",)

    @classmethod
    def poll(cls, _):
        return knows("Glue")


class CAIRN_PT_physics(_Advanced, Panel):
    bl_label = "Simulation"
    messages = ("Physics",)

    def draw_more(self, layout, settings):
        draw_whole(layout, settings, "use_gravity")
        own = layout.column()
        own.active = settings.use_gravity
        draw_whole(own, settings, "gravity")


class CAIRN_PT_effects(_Advanced, Panel):
    bl_label = "Solver Features"
    messages = ("Effects",)

    @classmethod
    def poll(cls, _):
        return knows("Effects")


class CAIRN_PT_figures(_Advanced, Panel):
    bl_label = "Measures"
    messages = ("Figures",)

    @classmethod
    def poll(cls, _):
        return knows("Figures")

    def draw_more(self, layout, settings):
        draw_whole(layout, settings, "use_report")
        for field in fields_of("Output"):
            if ("Output", field["name"]) in MEASURED:
                draw_field(layout, bpy.context, settings.output, field)


class CAIRN_PT_keep(_Parameters, Panel):
    bl_label = "Build Around"

    @classmethod
    def poll(cls, _):
        return knows("Body")

    def draw_more(self, layout, settings):
        layout.prop(settings, "keep", text="Objects")


class CAIRN_PT_drop(_Parameters, Panel):
    bl_label = "Drop and Impact"

    @classmethod
    def poll(cls, _):
        return knows("Body") and knows("Emitter")

    def draw_more(self, layout, settings):
        column = layout.column()
        column.prop(settings, "drop_mesh")
        details = column.column()
        details.active = settings.drop_mesh is not None
        for name in ("drop_frame", "drop_rate", "drop_count"):
            details.prop(settings, name)
        draw_whole(details, settings, "drop_velocity")
        layout.separator()
        column = layout.column()
        column.prop(settings, "impact")
        details = column.column()
        details.active = settings.impact is not None
        details.prop(settings, "impact_frame")
        draw_whole(details, settings, "impact_velocity")
        draw_optional(details, settings, "impact_mass", "Mass (kg)")


class CAIRN_PT_region(_Parameters, Panel):
    bl_label = "Region"

    @classmethod
    def poll(cls, _):
        return knows("Body")

    def draw_more(self, layout, settings):
        layout.prop(settings, "region")


class CAIRN_PT_entrance(_Parameters, Panel):
    bl_label = "Entrance"
    messages = ("Entrance",)

    @classmethod
    def poll(cls, _):
        return knows("Entrance")

    def draw(self, context):
        super().draw(context)
        settings = context.scene.cairn
        column = self.layout.column()
        if placed.comes_from_a_place(settings):
            column.prop(settings, "entrance_source")
        if placed.follows_a_line(settings):
            column.prop(settings, "entrance_curve")


class CAIRN_PT_collapse(_Parameters, Panel):
    bl_label = "Collapse"

    @classmethod
    def poll(cls, _):
        return knows("Collapse")

    def draw_more(self, layout, settings):
        draw_whole(layout, settings, "use_collapse")
        details = layout.column()
        details.active = settings.use_collapse
        draw_whole(details, settings, "collapse_angle")
        draw_optional(details, settings, "collapse_first", "First Body")
        draw_optional(details, settings, "collapse_frame", "Frame")


class CAIRN_PT_output(_Parameters, Panel):
    bl_label = "Output"
    messages = ("Output",)

    def draw_more(self, layout, settings):
        layout.prop(settings, "output_mode")
        besides = layout.row()
        besides.active = settings.output_mode != "POINTS"
        draw_whole(besides, settings, "use_prop_collections")
        layout.prop(settings, "start_frame")
        draw_optional(layout, settings, "frame_count", "Frames")


CLASSES = [
    CAIRN_PT_material,
    CAIRN_PT_keep,
    CAIRN_PT_drop,
    CAIRN_PT_region,
    CAIRN_PT_entrance,
    CAIRN_PT_collapse,
    CAIRN_PT_output,
    CAIRN_PT_advanced,
    CAIRN_PT_fill,
    CAIRN_PT_release,
    CAIRN_PT_control,
    CAIRN_PT_glue,
    CAIRN_PT_physics,
    CAIRN_PT_effects,
    CAIRN_PT_figures,
]
