"""Operators of a bake: start, fetch, stop, keep. They also run without a window."""

from bpy.types import Operator

from . import estimates, export, keeping, pending, pointers, preferences, preview, request, running, walls
from .client import Fault
from .following import Follows, is_running, start_frame


class CAIRN_OT_bake(Follows, Operator):
    """Fill the shape with props, release them, and make the pile. A new bake replaces the pile"""

    bl_idname = "cairn.bake"
    bl_label = "Bake Pile"

    def begin(self, context):
        server = preferences.server(context)
        lacking = request.missing(context.scene.cairn)
        if lacking:
            raise Fault(lacking)
        estimates.stand_aside(context.scene)
        bake = running.bake = running.Bake(server)
        yield
        with start_frame(context):
            taken = yield from request.taking(context)
        keeping.ask(context, taken)
        pointers.ask(context.scene, taken.recipe["token"], taken.pointers)
        bake.ask(taken)
        return (yield from preview.drawn(taken.props))

    def make(self, context, bake):
        frames = bake.recording.frames or [bake.latest]
        bake.recipe["notes"] += yield from walls.notes(context.scene, frames, bake.recipe["metres"])
        thrown = [f"“{one.name}”" for one in request.objects_of(context.scene.cairn.impact) if not one.hide_render]
        if thrown:
            bake.recipe["notes"] += [f"A copy is thrown, and {', '.join(thrown[:3])} is rendered, too. Hide it"]
        return (yield from Follows.make(self, context, bake))


class CAIRN_OT_fetch(Follows, Operator):
    """Get the result of the bake that was running when this file was closed, and make the pile"""

    bl_idname = "cairn.fetch"
    bl_label = "Fetch Result"

    def begin(self, context):
        note = pending.of_this_file()
        if note is None:
            raise Fault("No bake of this file was running. Press Bake Pile.")
        bake = running.Bake(preferences.server(context))
        bake.resume(note["recipe"], note["bake_id"])
        # Another Blender may have had a bake of the same file: it is offered next.
        running.bake, running.left = bake, pending.of_this_file(besides=note["recipe"]["token"])
        yield
        return (yield from seen_props(context, note["recipe"]))


def seen_props(context, recipe):
    """A generator: the props of an earlier bake, for the preview; None if they are missing."""
    from . import result

    _, found = pointers.asked(recipe)
    sources = result.sources_of(recipe, found)
    if None in sources:
        return None
    exporter = export.Exporter(context)
    props = yield from exporter.props(sources, export.middles_of(recipe))
    return None if exporter.problems else (yield from preview.drawn(props))


class CAIRN_OT_stop(Operator):
    """Stop the bake. You can keep the unfinished result. Esc over the 3D View does the same, after a question"""

    bl_idname = "cairn.stop"
    bl_label = "Stop Baking"

    @classmethod
    def poll(cls, _):
        return is_running() and not running.bake.is_closing

    def execute(self, _):
        running.bake.stop()
        return {"FINISHED"}


class CAIRN_OT_enough(Operator):
    """End the bake here: the frames so far are the pile, because it rests enough. The report has no measures then"""

    bl_idname = "cairn.enough"
    bl_label = "It Rests Enough"

    @classmethod
    def poll(cls, _):
        return is_running() and running.bake.may_be_enough()

    def execute(self, _):
        running.bake.be_enough()
        return {"FINISHED"}


class CAIRN_OT_go_on(Operator):
    """Close this question, and let the bake continue"""

    bl_idname = "cairn.go_on"
    bl_label = "Continue"

    def execute(self, _):
        return {"FINISHED"}


class CAIRN_OT_keep(Follows, Operator):
    """Make a pile of the unfinished result: its frames, or the bodies at their place in the fill"""

    bl_idname = "cairn.keep"
    bl_label = "Keep"

    @classmethod
    def poll(cls, _):
        return running.bake is not None and running.bake.end == "stopped"

    def begin(self, _):
        running.bake.keep()
        yield


class CAIRN_OT_discard(Operator):
    """Discard the unfinished result. The scene does not change"""

    bl_idname = "cairn.discard"
    bl_label = "Restore the Scene"

    @classmethod
    def poll(cls, _):
        return running.bake is not None and running.bake.end == "stopped"

    def execute(self, context):
        running.end()
        preview.redraw(context)
        return {"FINISHED"}


CLASSES = [
    CAIRN_OT_bake,
    CAIRN_OT_fetch,
    CAIRN_OT_stop,
    CAIRN_OT_enough,
    CAIRN_OT_go_on,
    CAIRN_OT_keep,
    CAIRN_OT_discard,
]
