"""The button, the bake's progress and the problems, in one place, so that nothing moves under the pointer."""

from . import estimates, keeping, live, preferences, request, result, running, wording
from .following import is_running
from .layouts import draw_folded, draw_sentences, wrapped

TALL = 1.6
# A match with the shape below it is said, as the server's warning does.
POOR = 0.75
# A match below it is not known better before the bake.
LEAST_KNOWN = 0.6


def draw(layout, context, settings):
    layout.use_property_split = False
    bake = running.bake
    lacking, problem = request.missing(settings), ""
    if preferences.of(context).server == "LOCAL":
        problem = preferences.program_problem(preferences.of(context))
    row = layout.row(align=True)
    row.scale_y = TALL
    if bake and is_running():
        lines = _draw_running(row.row(align=True), bake)
        _draw_beside(row, context, False, False)
    elif bake:
        row.operator("cairn.keep", text=bake.kept_kind(), icon="CHECKMARK")
        row.operator("cairn.discard", text="", icon="X")
        lines = "Stopped. Keep this result,", "or restore the scene."
    elif running.left:
        row.operator("cairn.fetch", icon="IMPORT")
        row.operator("cairn.forget", text="", icon="X")
        lines = "A bake was running", "when this file was closed."
    else:
        lines = _draw_bake(row, context, settings, not lacking and not problem)
        keeping.draw(layout, settings.control_mesh and result.existing(context.scene, settings.control_mesh))
    if is_running() or not lacking:
        column = layout.column(align=True)
        # Always two lines.
        for line in lines:
            column.label(text=line)
    if is_running():
        # Not in the row above: what was pressed there may be pressed twice.
        layout.operator("cairn.stop", icon="CANCEL")
        layout.operator("cairn.enough", icon="CHECKMARK")
        return
    if lacking:
        wrapped(layout, context, lacking, "INFO")
        if not request.props_of(settings):
            layout.operator("cairn.add_examples", icon="SCENE_DATA")
    elif problem:
        wrapped(layout, context, problem, "ERROR")
        layout.operator("cairn.preferences", icon="PREFERENCES")
    elif running.problems:
        box = layout.box()
        box.label(text="Fix These Problems First")
        draw_sentences(box, context, problems())
    elif running.plan and (running.plan["warnings"] or poor_fit(running.plan)):
        column = layout.column()
        column.active = not running.plan_is_old
        draw_fit(column, context, running.plan, estimates.bodies(settings))
        draw_folded(column, context, wording.gathered(running.plan["warnings"], running.names))


def draw_fit(layout, context, plan, count):
    """Says how badly the props fit the shape, and offers the size that fits, with what it costs."""
    if poor_fit(plan):
        wrapped(layout, context, poor_fit(plan), "ERROR")
    scale = plan["fitting_scale"]
    if 0.0 < scale < 1.0:
        column = layout.column()
        # The scale of another scene would be wrong.
        column.enabled = not running.plan_is_old
        column.operator("cairn.fit_props", text=f"Scale Props to {scale:.0%}", icon="FULLSCREEN_EXIT").scale = scale
        wrapped(column, context, cost_of_fit(scale, count))


def poor_fit(plan):
    """What of the shape the props do not fill, in words; empty where they fit."""
    (parts, share), match = plan["thin"], plan["match"]
    # Of the filled shape: what falls then is not in it.
    expected = f"As filled, it matches {matching(match)}." if match > 0.0 else ""
    if not parts:
        return expected if match < POOR else ""
    what = "1 part of the shape" if parts == 1 else f"{parts} parts of the shape"
    is_thin = "is too thin: it stays" if parts == 1 else "are too thin: they stay"
    return f"{what} ({max(share, 0.01):.0%}) {is_thin} empty. {expected}"


def matching(share):
    """An expected match with the shape, in words. What is poor is not known better."""
    return f"about {share:.0%}" if share >= LEAST_KNOWN else f"less than {LEAST_KNOWN:.0%}"


def cost_of_fit(scale, count):
    """What the size that fits costs, in words. `count`: the bodies of now. The time of a bake grows as they do."""
    bodies, factor = (f"{float(f'{value:.2g}'):g}" for value in (count * scale**-3, scale**-3))
    return f"About {bodies} bodies instead of {count}: a bake takes {factor} times as long."


def problems():
    """The problems of the scene, each with the objects that it is about."""
    found = {}
    for problem in running.problems:
        about = [problem.about] if problem.about else []
        for text, things in [(problem.text, about)] if about else wording.gathered([problem.text], running.names):
            found.setdefault(text, []).extend(name for name in things if name not in found.get(text, ()))
    return list(found.items())


def _draw_running(row, bake):
    share = bake.share() if bake.written is None else bake.written
    title = bake.stage() if bake.written is None else "Making the objects"
    text = f"{title}  {share:.0%}" if bake.progress or bake.written is not None else title
    if hasattr(row, "progress"):
        row.progress(factor=share, text=text)
    else:
        row.label(text=text, icon="TIME")
    return bake.counts(2), bake.time_left()


def _draw_beside(row, context, may_check, may_live=True):
    """The buttons beside that of the bake, which keep their places while it runs."""
    check, follow = row.row(align=True), row.row(align=True)
    check.enabled, follow.enabled = may_check, may_live
    check.operator("cairn.check", text="", icon="VIEWZOOM")
    follow.prop(context.window_manager, "cairn_live", text="", icon="PAUSE" if live.is_on else "PLAY")


def _draw_bake(row, context, settings, may_bake):
    control = settings.control_mesh
    again = result.existing(context.scene, control) if control else None
    buttons = row.row(align=True)
    buttons.enabled = may_bake
    buttons.operator("cairn.bake", text="Bake Pile Again" if again else "Bake Pile", icon="PHYSICS")
    _draw_beside(row, context, may_bake)
    if live.is_on:
        first, _, second = live.status().partition("\n")
        return first or "Live", second
    if again is None:
        return "", ""
    place = result.replaced(context.scene, control, {"use_replace": settings.use_replace, "seed": settings.seed})
    if place is None:
        return f"“{again.name}” stays,", "hidden"
    again, report = place, running.report_of(place)
    what = "the pile" if report.get("is_whole") else f"the {report.get('body_count', 0)} bodies that were kept"
    return f"Replaces {what} in", f"“{again.name}”"
