"""The panels below the button that show a pile: the states of its bodies, and how the bake went."""

import numpy as np
from bpy.types import Panel

from . import dots, glue, keeping, panels, result, roots, running, states, timing, wording
from .layouts import draw_folded, wrapped
from .panels import Pile

# Figures of the report, by their names there: what the panel calls them, and how they are shown.
FIGURES = [
    # With the shape as it was drawn, in its place: kept is only what the release left of the match before it.
    ("shape_iou", "Shape Match", "{:.1%}"),
    ("kept_shape", "Kept Shape", "{:.1%}"),
    # Only where something disturbed the pile once it rested.
    ("shape_iou_after", "Shape Match", "{:.1%}"),
    ("at_rest_fraction", "At Rest", "{:.1%}"),
    ("unsupported_fraction", "Unsupported", "{:.1%}"),
    # Of the meshes, where bodies meet: 95 of 100 are smaller.
    ("visible_depth_p95", "Visible Overlap", panels.length),
    ("visible_gap_p95", "Visible Gap", panels.length),
    ("entrance_guided_impulse", "Guided Momentum", "{:.1%}"),
]

# Dots of glue that are listed: those that carry most.
LISTED = 12
# Frames per second that differ by less, relative, are the same.
SAME_RATE = 1e-3


class CAIRN_PT_states(Pile, Panel):
    bl_label = "States"
    bl_parent_id = "CAIRN_PT_pile"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return running.bake is not None or result.chosen(context) is not None

    def draw(self, context):
        layout = self.layout
        layout.prop(context.window_manager, "cairn_states")
        if not states.is_shown or states.is_by_load:
            return
        if running.bake:
            latest = running.bake.job.latest
            now = None if latest is None else states.known(latest.states[latest.present])
        else:
            now = states.at(result.chosen(context), context.scene.frame_current)
        if now is None:
            text = "No bodies yet." if running.bake else "The control was off, or the server does not report states."
            wrapped(layout, context, text, "INFO")
            return
        column = layout.column(align=True)
        counts = np.bincount(now, minlength=len(states.STATES))
        for number, (title, _) in enumerate(states.STATES):
            if counts[number] or number in states.USUAL:
                row = column.split(factor=0.75)
                row.label(text=title, icon_value=states.icon(number))
                row.label(text=str(counts[number]))
        draw_shading(layout, context)


def draw_shading(layout, context):
    """Offers the settings that the view needs to show the colors."""
    shading = context.space_data.shading
    if shading.type != "SOLID":
        layout.prop_enum(shading, "type", "SOLID", text="Colors Need Solid Shading")
    elif shading.color_type != "OBJECT":
        layout.prop_enum(shading, "color_type", "OBJECT", text="Show Object Colors")


class CAIRN_PT_report(Pile, Panel):
    bl_label = "Report"
    bl_parent_id = "CAIRN_PT_pile"

    @classmethod
    def poll(cls, context):
        return result.chosen(context) is not None

    def draw(self, context):
        layout = self.layout
        collection = result.chosen(context)
        report = running.report_of(collection)
        if not report.get("is_whole"):
            wrapped(layout, context, "This bake was cancelled. The pile is incomplete.", "INFO")
        elif any(made.job.bake_id == report["bake_id"] for made in running.measuring):
            layout.label(text="Measuring…", icon="TIME")
        column = layout.column(align=True)
        for title, text in figures_of(collection):
            if text:
                draw_figure(column, title, text)
            else:
                column.label(text=title)
        draw_shares(layout, collection)
        glue = running.glue_of(report)
        if glue:
            wrapped(layout, context, glue)
        for line in changed_since(context.scene, collection):
            wrapped(layout, context, line, "INFO")
        names = running.recipe_of(collection).get("names", {})
        texts = wording.with_bodies(report.get("warnings", ()), collection)
        draw_folded(layout, context, wording.gathered(texts, names))
        if keeping.said(report):
            wrapped(layout, context, f"Of the pile before: {keeping.said(report)}.")
        if collection.cairn.mode != "POINTS":
            layout.prop(collection.cairn, "display")
        layout.operator("cairn.select_pile", icon="EMPTY_AXIS").collection = collection.name
        row = layout.row(align=True)
        row.operator("cairn.export_pile", text="Export", icon="EXPORT").collection = collection.name
        row.operator("cairn.mark_asset", text="Asset", icon="ASSET_MANAGER").collection = collection.name
        row = layout.row(align=True)
        row.operator("cairn.restore_settings", icon="FILE_REFRESH").collection = collection.name
        row.operator("cairn.delete", text="", icon="TRASH").collection = collection.name


def figures_of(collection):
    """The figures of a pile: pairs of a title and a text, which a heading has not."""
    report = running.report_of(collection)
    measures, found = report.get("measures", {}), [("Bodies", str(report.get("body_count", 0)))]
    # A pose has none, however many the bake took to it.
    if collection.cairn.mode != "POSE":
        found.append(("Frames", str(report.get("frame_count", 0))))
    event = "the Collapse" if "collapse_frame" in report else "It Was Disturbed"
    headings = {"shape_iou": f"Before {event}", "shape_iou_after": "At the End"}
    for name, title, form in FIGURES:
        value = measures.get(name)
        if value is not None:
            # A pile that settles into its shape measures a little more than all of it.
            value = min(value, 1.0) if name == "kept_shape" else value
            found += [(headings[name], "")] if name in headings and "shape_iou_after" in measures else []
            found.append((title, form(value) if callable(form) else form.format(value)))
    if report.get("accuracy"):
        found.append(("Quality", panels.quality(report["accuracy"])))
    if "seconds" in report:
        found.append(("Time", running.duration(report["seconds"])))
    return found


def changed_since(scene, collection):
    """What of the scene has changed since the bake, so that the pile does not fit it any more, as sentences."""
    note, found = collection.cairn, []
    place = running.recipe_of(collection).get("place")
    if note.control and place and roots.is_left_behind(roots.of(collection), note.control, place):
        found.append(f"“{note.control.name}” was moved since this bake. Bake again to follow it.")
    beyond = timing.beyond(collection, scene)
    if beyond:
        found.append(f"{beyond}.")
    rate, now = running.report_of(collection).get("frame_rate", 0.0), scene.render.fps / scene.render.fps_base
    is_played = note.mode != "POSE" and note.frame_count > 1 and note.timing_speed == 1.0
    if is_played and rate and abs(now / rate - 1.0) > SAME_RATE:
        found.append(
            f"Baked for {rate:.4g} frames per second, and the scene has {now:.4g}: the pile moves {now / rate:.3g} "
            f"times as fast as things fall. Bake again, or set Speed in the panel Timing to {rate / now:.3g}."
        )
    return found


def draw_shares(layout, collection):
    """Draws the weights of several props, as wanted and as reached: large props may not fit as often."""
    shares = result.shares_of(collection)
    if not shares:
        return
    by_volume = running.recipe_of(collection)["settings"].get("weigh_by") == "VOLUME"
    column = layout.column(align=True)
    column.label(text="Bodies of Each Prop" if by_volume else "Shares: Reached (Wanted)")
    for name, wanted, reached, count in shares:
        draw_figure(column, name, str(count) if by_volume else f"{percent(reached)} ({percent(wanted)})", 0.55)


def percent(share):
    """Not 0% of what is there."""
    return "<1%" if 0 < share < 0.005 else f"{share:.0%}"


class CAIRN_PT_holds(Pile, Panel):
    bl_label = "What Holds It"
    bl_parent_id = "CAIRN_PT_pile"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        collection = result.chosen(context)
        return collection is not None and bool(glue.dots_of(collection))

    def draw(self, context):
        layout, manager = self.layout, context.window_manager
        collection = result.chosen(context)
        listed = glue.dots_of(collection)
        layout.prop(manager, "cairn_glue")
        layout.prop(manager, "cairn_loads")
        if states.is_by_load:
            draw_shading(layout, context)
        collapses = "collapse_frame" in running.report_of(collection)
        when = " before the collapse, which ends all glue" if collapses else ""
        wrapped(layout, context, f"Bodies that a dot of glue joins, and its load in weights of a typical prop{when}:")
        column = layout.column(align=True)
        for number, dot in enumerate(listed[:LISTED]):
            names = [_called(collection, body) for body in (dot["body"], dot["other"])]
            row = column.split(factor=0.78, align=True)
            button = row.operator("cairn.select_dot", text=" – ".join(names), icon="RESTRICT_SELECT_OFF")
            button.collection, button.dot = collection.name, number
            row.label(text="broke" if dot["broken"] else _said(dot["load"]))
        if len(listed) > LISTED:
            layout.label(text=f"and {len(listed) - LISTED} more that carry less")


def _said(load):
    if 0 < load < 0.01:
        return "<0.01"
    return f"{load:.0f}" if load >= 10 else f"{load:.2g}"


def _called(collection, body):
    """A body by its number, with which its name ends."""
    if body is None:
        return "Ground"
    number = dots.number_of(collection, body)
    return "–" if number is None else f"{keeping.label_of(collection, number):03}"


def draw_figure(layout, title, value, factor=0.7):
    split = layout.split(factor=factor)
    split.label(text=title)
    split.label(text=value)


CLASSES = [CAIRN_PT_states, CAIRN_PT_report, CAIRN_PT_holds]
