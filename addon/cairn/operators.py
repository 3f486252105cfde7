"""What the buttons do to a bake: start, fetch, stop. The same operators run without a window."""

import time
import traceback
from contextlib import contextmanager

import bpy
from bpy.types import Operator

from . import estimates, pending, preferences, preview, request, result, running
from .client import Fault

# How often news are looked at, and how long Blender may be kept from its user at a time, s.
TICK = 0.05
SLICE = 0.025
# How long a line stands at least, s: a person reads it, and presses the button beside it.
READ = 0.25
# Without a window, how often progress is printed, s.
PRINT = 2.0


def is_running():
    """Whether a bake runs, or its objects are being made; one that was stopped waits for a decision."""
    return running.bake is not None and running.bake.end != "stopped"


def explain(operator, fault):
    """A popup with what went wrong and what to do about it."""
    lines = ["This has to be put right first:", *(text for _, text in fault.problems)]
    operator.report({"ERROR"}, "\n".join(lines) if fault.problems else fault.message)
    return {"CANCELLED"}


@contextmanager
def explaining(operator):
    """Whatever goes wrong inside is told in a popup; a fault of the add-on's own is printed besides."""
    try:
        yield
    except Fault as fault:
        explain(operator, fault)
    except Exception as error:  # noqa: BLE001 an artist gets a sentence, whatever it is
        traceback.print_exc()
        explain(operator, Fault(f"The add-on has a fault; please report what the console shows: {error}"))


class _Bakes:
    """What baking and fetching have in common: following a bake with a window, or waiting for it without one."""

    bl_options = {"UNDO"}
    timer = preview = writer = workspace = None
    shown, shown_at = "", 0.0

    @classmethod
    def poll(cls, _):
        return not is_running()

    def begin(self, context):
        """Gives the bake, not started yet, and the preview's props."""
        raise NotImplementedError

    def invoke(self, context, _):
        with explaining(self):
            if bpy.app.background:
                return self.execute(context)
            bake, props = self.begin(context)
            running.bake = bake
            if props:
                self.preview = preview.Preview([prop.triangles for prop in props], bake.recipe["metres"])
            self.timer = context.window_manager.event_timer_add(TICK, window=context.window)
            context.window_manager.modal_handler_add(self)
            self.workspace = context.workspace
            bake.start()
            preview.redraw(context)
            return {"RUNNING_MODAL"}
        return {"CANCELLED"}

    def modal(self, context, event):
        with explaining(self):
            bake = running.bake
            if bake is None:
                # Another file was opened.
                return self._leave(context, {"CANCELLED"})
            if event.type in {"ESC", "RIGHTMOUSE"} and event.value == "PRESS":
                if bake.end != "stopped":
                    bake.stop()
            elif event.type != "TIMER":
                # While objects are made, what the artist did would end up between them.
                return {"PASS_THROUGH"} if self.writer is None else {"RUNNING_MODAL"}
            try:
                return self._tick(context, bake)
            except Exception:
                running.bake = None
                self._leave(context, None)
                raise
        return {"CANCELLED"}

    def _tick(self, context, bake):
        if self.writer and bake.end == "stopped":
            self.writer.close()
            self.writer = bake.written = None
        if self.writer:
            return self._write(context, bake)
        bake.poll()
        self._show(context, bake)
        if self.preview and self.preview.update(bake.job.latest):
            preview.redraw(context, "WINDOW")
        if bake.end == "failed":
            raise bake.fault
        if bake.end == "stopped":
            self._leave(context, None)
            if not bake.frame_count:
                running.bake = None
                self.report({"INFO"}, "Bake cancelled. The scene is as it was")
            else:
                context.window_manager.popup_menu(_draw_choice, title="Bake Stopped", icon="QUESTION")
            return {"CANCELLED"}
        if bake.has_all_frames:
            self.writer = result.build(context, bake.job.recording.motion(), bake.recipe, bake.told())
            bake.written = 0.0
        return {"RUNNING_MODAL"}

    def _write(self, context, bake):
        until = time.monotonic() + SLICE
        try:
            while time.monotonic() < until:
                share = next(self.writer)
                bake.written = share if share is not None else bake.written
        except StopIteration as end:
            running.bake = None
            self._leave(context, None)
            if not bake.end:
                running.wait_for_report(bake)
            return finished(self, context, end.value)
        self._show(context, bake)
        return {"RUNNING_MODAL"}

    def _show(self, context, bake):
        """How it goes, in the status bar and in the panel."""
        line = bake.line()
        now = time.monotonic()
        if line != self.shown and now > self.shown_at + READ:
            self.shown, self.shown_at = line, now
            self.workspace.status_text_set(f"Pile: {line}      Esc, Right Mouse: Cancel")
            preview.redraw(context, "UI")

    def _leave(self, context, answer):
        if self.workspace:
            self.workspace.status_text_set(None)
            self.workspace = None
        if self.timer:
            context.window_manager.event_timer_remove(self.timer)
            self.timer = None
        if self.preview:
            self.preview.remove()
            self.preview = None
        preview.redraw(context)
        return answer

    def cancel(self, context):
        """Blender ends the operator: a file is opened, or the window closes. The bake itself goes on."""
        if running.bake is not None:
            running.bake.job.detach()
            running.bake = None
        self._leave(context, None)

    def execute(self, context):
        with explaining(self):
            try:
                bake, _ = self.begin(context)
                running.bake = bake
                wait_for(bake)
                if bake.end == "failed":
                    raise bake.fault
                motion = bake.job.recording.motion()
                collection = result.finish(result.build(context, motion, bake.recipe, bake.told()))
            finally:
                running.bake = None
            return finished(self, context, collection)
        return {"CANCELLED"}


def wait_for(bake):
    """Waits to the end of a bake and prints how it goes."""
    bake.start()
    shown, line, stage = 0.0, "", ""
    try:
        while not bake.end:
            bake.poll(wait=0.2)
            now = time.monotonic()
            if bake.line() != line and (bake.stage() != stage or now - shown > PRINT):
                shown, line, stage = now, bake.line(), bake.stage()
                print(f"Cairn: {line}", flush=True)
    except KeyboardInterrupt:
        bake.stop()
        raise


def finished(operator, context, collection):
    told = running.report_of(collection)
    operator.report({"INFO"}, f"Pile of {told.get('body_count', 0)} bodies in “{collection.name}”")
    if bpy.app.background:
        # With a window, Blender does so before it draws.
        context.view_layer.update()
        for sentence in filter(None, (running.glue_of(told), *told.get("warnings", ()))):
            print(f"Cairn: {sentence}", flush=True)
    return {"FINISHED"}


def _draw_choice(self, _):
    count = running.bake.frame_count if running.bake else 0
    self.layout.operator("cairn.keep", text=f"Keep the {count} Frames So Far", icon="CHECKMARK")
    self.layout.operator("cairn.discard", icon="X")


class CAIRN_OT_bake(_Bakes, Operator):
    """Fill the shape with props, let them go, and make the pile. Baked again, it replaces the pile"""

    bl_idname = "cairn.bake"
    bl_label = "Bake Pile"

    def begin(self, context):
        server = preferences.server(context)
        estimates.stand_aside(context.scene)
        with start_frame(context):
            taken = request.take(context)
        return running.Bake(server, taken.recipe, taken), taken.props


class start_frame:  # noqa: N801 used as a function
    """The scene as it stands at the bake's start."""

    def __init__(self, context):
        self.scene = context.scene
        self.before = self.scene.frame_current, self.scene.frame_subframe
        self.moves = self.before != (self.scene.cairn.start_frame, 0.0)

    def __enter__(self):
        if self.moves:
            self.scene.frame_set(self.scene.cairn.start_frame)

    def __exit__(self, *_):
        if self.moves:
            self.scene.frame_set(self.before[0], subframe=self.before[1])


class CAIRN_OT_fetch(_Bakes, Operator):
    """Get the result of the bake that was under way when this file was closed, and make the pile"""

    bl_idname = "cairn.fetch"
    bl_label = "Fetch Result"

    def begin(self, context):
        note = pending.of_this_file()
        if note is None:
            raise Fault("No bake of this file was under way. Press Bake Pile.")
        running.left = None
        return running.Bake(preferences.server(context), note["recipe"], bake_id=note["bake_id"]), []


class CAIRN_OT_stop(Operator):
    """End the bake. What there is can be kept. Esc and the right mouse button do the same"""

    bl_idname = "cairn.stop"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, _):
        return is_running()

    def execute(self, _):
        running.bake.stop()
        return {"FINISHED"}


CLASSES = [CAIRN_OT_bake, CAIRN_OT_fetch, CAIRN_OT_stop]
