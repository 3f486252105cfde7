"""The button, the bake's progress and the problems, in one place, so that nothing moves under the pointer."""

from . import live, preferences, request, result, running, wording
from .following import is_running
from .layouts import draw_folded, draw_sentences, wrapped

TALL = 1.6


def draw(layout, context, settings):
    layout.use_property_split = False
    bake = running.bake
    lacking, problem = request.missing(settings), ""
    if preferences.of(context).server == "LOCAL":
        problem = preferences.program_problem(preferences.of(context))
    row = layout.row(align=True)
    row.scale_y = TALL
    if bake and is_running():
        lines = _draw_running(row, bake)
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
    if is_running() or not lacking:
        column = layout.column(align=True)
        # Always two lines.
        for line in lines:
            column.label(text=line)
    if is_running():
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
    elif running.plan:
        draw_folded(layout, context, wording.gathered(running.plan["warnings"], running.names))
        scale = running.plan.get("fitting_scale", 0.0)
        if 0.0 < scale < 1.0:
            layout.operator("cairn.fit_props", text=f"Scale Props to {scale:.0%}", icon="FULLSCREEN_EXIT").scale = scale


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
    row.operator("cairn.stop", text="", icon="CANCEL")
    return bake.counts(2), bake.time_left()


def _draw_bake(row, context, settings, may_bake):
    control = settings.control_mesh
    again = result.existing(context.scene, control) if control else None
    buttons = row.row(align=True)
    buttons.enabled = may_bake
    buttons.operator("cairn.bake", text="Bake Pile Again" if again else "Bake Pile", icon="PHYSICS")
    buttons.operator("cairn.check", text="", icon="VIEWZOOM")
    row.prop(context.window_manager, "cairn_live", text="", icon="PAUSE" if live.is_on else "PLAY")
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
