"""The tab "Pile" in the 3D View's sidebar."""

import math

from bpy.types import Panel, UIList

from . import action_panel, arrangement, estimates, preferences, presets, request, running, starters
from .estimates import bodies, preset_of
from .export import SOLID
from .following import is_running
from .layouts import signs_of, wrapped
from .schema import ACCURACIES, knows


# Width of a quality's button, of the panel's.
BUTTON = 0.4
# A range of the shape that is kept says nothing beyond this width: piles differ too much.
WIDE = 0.25


class Pile:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Pile"


class CAIRN_UL_props(UIList):
    """The list of props."""

    def draw_item(self, _context, layout, _data, item, _icon, _active_data, _active_name, _index):
        row = layout.row(align=True)
        row.prop(item, "object", text="", emboss=True)
        share = row.row(align=True)
        share.ui_units_x = 3
        share.prop(item, "weight", text="")


class CAIRN_PT_pile(Pile, Panel):
    bl_label = "Pile"

    def draw(self, context):
        layout = self.layout
        settings = context.scene.cairn
        estimates.shown(context)
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.enabled = not is_running()
        column.prop(settings, "control_mesh", text="Shape")
        active = context.object
        draw_container(column, settings)
        if settings.control_mesh is None and active and active.type in SOLID:
            column.operator("cairn.use_selected", text=f"Use “{active.name}”", icon="EYEDROPPER")
        draw_source(column, settings)
        action_panel.draw(layout, context, settings)


class _Settings(Pile):
    """Settings of the next bake."""

    bl_parent_id = "CAIRN_PT_pile"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.enabled = not is_running()
        self.draw_settings(layout, context, context.scene.cairn)


class CAIRN_PT_support(_Settings, Panel):
    bl_label = "Shape Support"

    @classmethod
    def poll(cls, _):
        return knows("Glue")

    def draw_settings(self, layout, _, settings):
        draw_kept_shape(layout, settings)


class CAIRN_PT_props(_Settings, Panel):
    bl_label = "Size and Order"

    def draw_settings(self, layout, _, settings):
        starters.draw(layout, starters.CAIRN_MT_heap_presets, "cairn.add_heap_preset")
        draw_sizes(layout, settings)
        draw_arrangement(layout, settings)


class CAIRN_PT_quality(_Settings, Panel):
    bl_label = "Simulation Quality"

    def draw_settings(self, layout, _, settings):
        draw_accuracies(layout, settings)
        layout.prop(settings, "seed")
        row = layout.row()
        row.use_property_split = False
        row.prop(settings, "use_replace")


class CAIRN_PT_around(_Settings, Panel):
    bl_label = "Ground and Colliders"

    def draw_settings(self, layout, _, settings):
        layout.prop(settings, "colliders")
        layout.prop(settings, "collider_friction")
        row = layout.row()
        row.use_property_split = False
        row.prop(settings, "use_piles")
        layout.row(heading="Ground").prop(settings, "use_ground", text="")
        if settings.use_ground:
            draw_optional(layout, settings, "ground_height", "Height")


def draw_kept_shape(layout, settings):
    """Draws the choice of how far the shape is kept."""
    column = layout.column()
    column.use_property_split = False
    column.column(align=True).prop(settings, "kept_shape", expand=True)
    if settings.kept_shape == "TACKY":
        column.prop(settings, "glue_strength", slider=True)
    lines = column.column(align=True)
    lines.active = not running.plan_is_old
    # Always two lines, so that nothing jumps once they are known.
    for line in (*effect_of(settings), "", "")[:2]:
        lines.label(text=line)


def effect_of(settings):
    """The expected effect of the choice on this pile, as lines."""
    known = running.plan or {"dots": {}, "kept": {}}
    low, high = known["kept"].get(preset_of(settings), (0.0, 0.0))
    # The range of eight bakes of ten; a pile that settles into the shape keeps a little more than all of it.
    low, high = (min(1.0, share) for share in (low, high))
    kept = f"about {high:.0%}" if f"{low:.0%}" == f"{high:.0%}" else f"{100 * low:.0f} to {high:.0%}"
    if high - low > WIDE:
        lines = ["Shape kept: known once baked"]
    else:
        lines = [f"Keeps {kept} of the shape"] if high > 0 else []
    if settings.kept_shape == "NATURAL":
        return [*lines, "No glue: overhangs fall"]
    if settings.kept_shape == "TACKY":
        return [*lines, "Bodies that need more fall"]
    dots = known["dots"].get(preset_of(settings), 0.0)
    # The plan's range begins at an eighth of this, which would leave it open.
    return [*lines, f"Up to {math.ceil(2 * dots)} dots of glue"] if dots >= 1 else lines


def draw_container(layout, settings):
    """Draws whether the shape is a container, and how far it is filled."""
    if not knows("Fill", "level") or settings.control_mesh is None:
        return
    row = layout.row()
    row.use_property_split = False
    row.prop(settings, "use_inside")
    if settings.use_inside:
        for name, heading in (("share", "Share"), ("level", "Level (m)"), ("heap", "Heap (°)")):
            draw_optional(layout, settings.fill, name, heading)


def draw_source(layout, settings):
    """Draws where the props come from."""
    # Across the whole width, so that nothing is cut.
    column = layout.column(align=True)
    column.label(text="Props From")
    row = column.row(align=True)
    row.use_property_split = False
    row.prop(settings, "prop_source", expand=True)
    if settings.prop_source == "COLLECTION":
        layout.prop(settings, "prop_collection", text="Props")
        return
    row = layout.row()
    row.template_list("CAIRN_UL_props", "", settings, "props", settings, "active_prop", rows=3)
    side = row.column(align=True)
    side.operator("cairn.add_props", text="", icon="ADD")
    side.operator("cairn.remove_prop", text="", icon="REMOVE")


def draw_sizes(layout, settings):
    """Draws how large the props are, and how many."""
    if settings.prop_source == "COLLECTION":
        item = settings.prop_common
    else:
        chosen = 0 <= settings.active_prop < len(settings.props)
        item = settings.props[settings.active_prop] if chosen else None
    if item:
        size = layout.column(align=True)
        size.prop(item, "scale_min", text="Size Min")
        size.prop(item, "scale_max", text="Max")
    if len(request.props_of(settings)) > 1:
        layout.prop(settings, "weigh_by")
    count = bodies(settings)
    value = draw_switch(layout, settings.fill, "count", "Count")
    if value.active:
        value.prop(settings.fill, "count", text="")
    else:
        value.label(text=f"about {count}" if count else "as many as fit")
        share = running.plan.get("match", 0.0) if running.plan else 0.0
        if share > 0.0:
            row = layout.row()
            row.active = not running.plan_is_old
            row.label(text=f"Match as filled: {action_panel.matching(share)}")
    if settings.prop_source == "COLLECTION":
        row = layout.row()
        row.use_property_split = False
        row.prop(settings, "use_rendered")


def draw_arrangement(layout, settings):
    """Draws how props lie: sliders with a word beside each, and where each of several props goes."""
    if not knows("Fill", "order"):
        return
    chosen = settings.arrangement
    column = layout.column()
    column.use_property_split = False
    column.label(text="How Props Lie")
    sliders = column.column(align=True)
    for name in arrangement.WORDS:
        row = sliders.split(factor=0.27, align=True)
        row.label(text=chosen.bl_rna.properties[name].name)
        value = row.split(factor=0.42, align=True)
        value.prop(chosen, name, text="", slider=True)
        value.label(text=arrangement.word(chosen, name))
    if len(request.props_of(settings)) < 2:
        return
    layout.prop(chosen, "layout")
    if arrangement.is_sorted(chosen):
        layout.prop(chosen, "sort_by")
    switches = layout.column()
    switches.use_property_split = False
    if arrangement.is_sorted(chosen):
        switches.prop(chosen, "descending", text=arrangement.BELOW[chosen.sort_by])
    switches.prop(chosen, "gaps")


def draw_accuracies(layout, settings):
    """Each accuracy with its expected cost, once the server has estimated it."""
    column = layout.column(align=True)
    column.use_property_split = False
    row = column.split(factor=BUTTON)
    row.label(text="")
    row.label(text=reliance())
    for name, *_ in ACCURACIES:
        row = column.split(factor=BUTTON, align=True)
        row.prop_enum(settings, "accuracy", name)
        costs = row.split(factor=0.52, align=True)
        costs.active = not running.plan_is_old
        if name != "AUTO":
            costs.label(text=expected(name))
            costs.label(text=overlap(name))
        elif settings.accuracy == "AUTO":
            # Across both columns: it would be cut.
            row.label(text=quality(preset_of(settings)))
    line = column.column()
    line.active = not running.plan_is_old
    line.label(text=others(preset_of(settings)))
    if settings.accuracy == "AUTO":
        row = layout.row()
        row.prop(settings, "goal", expand=True)
        layout.prop(settings, "goal_seconds" if settings.goal == "TIME" else "goal_overlap")


def others(accuracy):
    """What else is expected of a quality, in one line; empty before it is known."""
    known = running.plan["others"].get(accuracy) if running.plan else None
    if not known:
        return ""
    return f"{known[0]} bodies, {max(known[1], 1):.0f} CPU s"


def quality(name):
    """The label of a quality; empty for none."""
    return next((label for known, label, *_ in ACCURACIES if known == name), "")


def expected(accuracy):
    """The time that a bake of an accuracy hardly ever exceeds, as a short text; empty before it is known."""
    # The shortest that is expected is a seventh of it: a range would say nothing.
    most = running.plan["times"].get(accuracy) if running.plan else None
    if not most:
        return ""
    unit = "s"
    for larger in ("min", "h"):
        if most >= 90:
            most, unit = most / 60, larger
    return f"<{math.ceil(most)} {unit}"


def overlap(accuracy):
    """The expected overlap of props, as a length; empty before it is known."""
    expected = running.plan.get("overlaps", {}).get(accuracy, 0.0) if running.plan else 0.0
    # One digit: it is an estimate.
    return length(expected, 1) if expected > 0 else ""


def length(metres, digits=2):
    """A length as text, in a unit that suits it."""
    units = {"μm": 1e-6, "mm": 1e-3, "cm": 1e-2}
    unit = "μm" if metres < 1e-4 else "mm" if metres < 1e-2 else "cm"
    return f"{float(f'{metres / units[unit]:.{digits}g}'):g} {unit}"


def reliance():
    """A heading for the expected times and overlaps."""
    if not (running.plan and running.plan["times"]):
        return "Check shows the time" if estimates.is_too_much else ""
    return "Time / Overlap"


def draw_switch(layout, group, name, heading):
    """Draws the checkbox of an optional value. Returns the row for the value, active when it is set."""
    row = layout.row(heading=heading)
    row.prop(group, "use_" + name, text="")
    value = row.row()
    value.active = getattr(group, "use_" + name)
    return value


def draw_optional(layout, group, name, heading):
    """Draws an optional value."""
    draw_switch(layout, group, name, heading).prop(group, name, text="")


def draw_field(layout, context, group, field):
    """Draws a parameter that has the accuracy's value unless it is set: in one line, if it has room."""
    name = field["name"]
    title, is_set = group.bl_rna.properties[name].name, getattr(group, "use_" + name)
    known = presets.text(group, field)
    # Beside the label are a checkbox and, once it is set, a value of its own.
    room = signs_of(context, "CHECKBOX")
    longest = max((len(item[0]) for item in field.get("items", ())), default=6)
    if len(title) + 1 + max(len(known), longest + 2 if is_set else 0) <= room:
        row = layout.split(factor=(len(title) + 7) / (room + 7))
    else:
        row = layout.column(align=True)
    row.use_property_split = False
    row.prop(group, "use_" + name, text=title)
    value = row.row()
    if not is_set:
        value.enabled = False
        value.alignment = "RIGHT"
        value.label(text=known)
    elif field["kind"] == "bool":
        value.prop(group, name, text="On" if getattr(group, name) else "Off", toggle=True)
    else:
        value.prop(group, name, text="")


class CAIRN_PT_server(Pile, Panel):
    bl_label = "Server"
    bl_parent_id = "CAIRN_PT_pile"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        chosen = preferences.of(context)
        if chosen.server == "LOCAL":
            wrapped(layout, context, "This computer bakes. The server starts when it is needed.")
        else:
            wrapped(layout, context, f"{chosen.address or 'No address yet'} bakes.")
        layout.operator("cairn.test_server")
        layout.operator("cairn.preferences", icon="PREFERENCES")


CLASSES = [CAIRN_UL_props, CAIRN_PT_pile, CAIRN_PT_support, CAIRN_PT_props, CAIRN_PT_quality, CAIRN_PT_around]
# After all others.
LAST = [CAIRN_PT_server]
