"""A draft while the artist shapes: after each change of the scene, once it stays unchanged, the pile is baked as a
draft, and its final pose is drawn over the view. The draft is not in the file. When off, there is no timer and no
handler."""

import time

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy.props import BoolProperty

from . import fingerprint, job, keeping, preferences, preview, request, running
from .client import Fault
from .messages import v1

# How often the scene is checked, and how long it has to stay unchanged, s.
TICK = 0.1
REST = 0.5
# Reading: time per slice, s.
SLICE = 0.01
MODES = {"OBJECT", "EDIT_MESH", "SCULPT"}

is_on = False
_draft = None


class _Draft:
    """The state of the scene, and the draft that is being made or shown."""

    def __init__(self):
        self.seen, self.changed_at = None, 0.0
        # Counts edits that the fingerprint does not show.
        self.edits = 0
        # The state of the scene that the draft is of.
        self.of = None
        self.slices = self.job = self.preview = None
        self.status = ""

    def look(self, context):
        """One tick of the timer."""
        if running.bake is not None or context.mode not in MODES:
            self.drop()
            self.hide()
            self.of, self.status = None, ""
            return
        now = (fingerprint.of(context.scene), self.edits)
        if now != self.seen:
            self.seen, self.changed_at = now, time.monotonic()
            self.drop()
        if self.job:
            self._follow(context)
        elif self.slices:
            self._read(context)
        elif now != self.of and time.monotonic() - self.changed_at >= REST:
            self.of = now
            self._begin(context)

    def _begin(self, context):
        lacking = request.missing(context.scene.cairn)
        if lacking or self.seen[0] is None:
            self.set_status(context, lacking or "The scene is too large for live drafts.")
            self.hide()
            return
        self.slices = self._steps(context)

    def _steps(self, context):
        taken = yield from request.taking(context, passive=True)
        drawn = yield from preview.drawn(taken.props)
        return taken, drawn

    def _read(self, context):
        until = time.monotonic() + SLICE
        try:
            next(self.slices)
            while time.monotonic() < until:
                next(self.slices)
        except StopIteration as end:
            self.slices = None
            taken, drawn = end.value
            taken.spec.scene.accuracy = v1.ACCURACY_DRAFT
            # Only what has changed since the pile was baked is filled again.
            keeping.ask(context, taken)
            request.leave_figures(v1, taken.spec.scene)
            # Only the final pose is drawn.
            taken.spec.scene.effects.frames = v1.SWITCH_OFF
            self.metres, self.drawn, running.names = taken.recipe["metres"], drawn, taken.recipe["names"]
            server = preferences.server(context)
            self.job = job.Job(server, taken.spec, taken.contents, taken.problems, has_fill=False)
            self.job.start()
            self.set_status(context, "Drafting…")
        except (Fault, ReferenceError):
            # The scene has changed meanwhile.
            self.slices = None

    def _follow(self, context):
        frames, is_done = self.job.recording.frames, False
        while not self.job.messages.empty() and not is_done:
            kind, what = self.job.messages.get()
            if kind == "failed":
                self.job, what = None, keeping.explained(what)
                running.problems = what.problems
                self.set_status(context, what.message if not what.problems else "Fix the problems listed here first.")
                self.hide()
                return
            # The draft does not wait for the figures.
            is_done = kind == "done" or (kind == "progress" and what.stage == v1.STAGE_MEASURE)
        if is_done and frames:
            self._show(context, frames[-1])
            self.job.stop()
            self.job = None

    def _show(self, context, snapshot):
        self.hide()
        running.problems = []
        self.preview = preview.Preview(self.drawn, self.metres)
        self.preview.update(snapshot)
        here = snapshot.states[snapshot.present]
        glued = np.isin(here, (v1.BODY_STATE_GLUED, v1.BODY_STATE_ANCHORED)).mean() if len(here) else 0.0
        self.set_status(context, f"Draft of {len(here)} bodies" + (f"\n{glued:.0%} of them glued" if glued else ""))
        preview.redraw(context)

    def set_status(self, context, text):
        self.status = text
        preview.redraw(context, "UI")

    def hide(self):
        if self.preview:
            self.preview.remove()
            self.preview = None
            preview.redraw(bpy.context, "WINDOW")

    def drop(self):
        """Ends the draft that is being made."""
        if self.slices:
            self.slices.close()
            self.slices = None
        if self.job:
            self.job.stop()
            self.job = None


def status():
    """The draft's progress, in two lines at most; empty while there is no draft."""
    return _draft.status if _draft else ""


def _look():
    try:
        _draft.look(bpy.context)
    except Fault as fault:
        _draft.set_status(bpy.context, fault.message)
    return TICK


@persistent
def _on_change(_, graph):
    """Counts edits of meshes, which the fingerprint does not see."""
    if any(update.is_updated_geometry for update in graph.updates):
        _draft.edits += 1


def show(on):
    global is_on, _draft
    if on == is_on:
        return
    is_on = on
    handlers = bpy.app.handlers.depsgraph_update_post
    if on:
        _draft = _Draft()
        handlers.append(_on_change)
        bpy.app.timers.register(_look, persistent=True)
    else:
        handlers.remove(_on_change)
        bpy.app.timers.unregister(_look)
        _draft.drop()
        _draft.hide()
        _draft = None


def register():
    # Of this session, not of the file.
    bpy.types.WindowManager.cairn_live = BoolProperty(
        name="Live",
        description="Show a draft of the pile while you shape. It is baked again after each change of shape, props "
        "or settings, once you pause. The draft is not saved in the file",
        get=lambda _: is_on,
        set=lambda _, on: show(on),
    )


def unregister():
    show(False)
    del bpy.types.WindowManager.cairn_live
