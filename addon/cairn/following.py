"""Common part of the operators that bake: following a bake with a window, or waiting for it without one."""

import gc
import time
import traceback
from contextlib import contextmanager

import bpy

from . import keeping, plainly, preferences, preview, request, result, running, timing, wording
from .client import Fault

# How often messages are read, and how long Blender may be busy at a time, s.
TICK = 0.05
SLICE = 0.025
# Shortest time that a line is shown, s: long enough to read it, and to press the button beside it.
READ = 0.25
# Without a window, how often progress is printed, s.
PRINT = 2.0


def is_running():
    """Whether a bake runs, or its objects are being made. A stopped bake does not count: it waits for a decision."""
    return running.bake is not None and running.bake.end != "stopped"


def explain(operator, fault):
    """Shows a popup with the fault and its remedy. The panel keeps it, with buttons."""
    fault = keeping.explained(fault)
    running.problems = list(fault.problems)
    lines = ["Fix these problems first:", *(wording.said(problem.text) for problem in fault.problems)]
    operator.report({"ERROR"}, "\n".join(lines) if fault.problems else fault.message)
    return {"CANCELLED"}


@contextmanager
def explaining(operator):
    """Shows any fault inside in a popup; a fault of the add-on itself is also printed."""
    try:
        yield
    except Fault as fault:
        explain(operator, fault)
    except Exception as error:  # noqa: BLE001 an artist gets a sentence, whatever it is
        known = plainly.fault_of(error, preferences.folder())
        if known is None:
            traceback.print_exc()
        text = "The add-on has a fault. Please report the message in the console"
        explain(operator, known or Fault(f"{text}: {error}"))


class start_frame:  # noqa: N801 used as a function
    """The scene at the bake's start frame."""

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


class Follows:
    """From the button to the pile, in three parts: take the request, follow the bake, make the objects."""

    bl_options = {"UNDO"}
    timer = preview = slices = writer = made = workspace = None
    shown, shown_at = "", 0.0

    @classmethod
    def poll(cls, _):
        return not is_running()

    def begin(self, context):
        """A generator that yields now and then, with a bake in `running`. Returns the preview's props, or None."""
        raise NotImplementedError

    def make(self, context, bake):
        """A generator: makes the pile of the bake, and returns its collection."""
        return result.build(context, bake.motion(), bake.recipe, bake.record())

    def invoke(self, context, _):
        if bpy.app.background:
            return self.execute(context)
        with explaining(self):
            running.problems = []
            self.slices = self.begin(context)
            # Missing settings are reported at once.
            next(self.slices, None)
            self.timer = context.window_manager.event_timer_add(TICK, window=context.window)
            context.window_manager.modal_handler_add(self)
            self.workspace = context.workspace
            # A pass of Python's garbage collection over all that is in Blender takes longer than a slice, and frames
            # and bodies would cause it. Until the end it only looks at what is new.
            gc.freeze()
            preview.redraw(context)
            return {"RUNNING_MODAL"}
        running.end()
        return {"CANCELLED"}

    def modal(self, context, event):
        with explaining(self):
            bake = running.bake
            if bake is None:
                # Another file was opened.
                return self._leave(context, {"CANCELLED"})
            if event.type == "ESC" and event.value == "PRESS" and self._is_meant(context, event):
                context.window_manager.popup_menu(_draw_question, title="Stop the Bake?", icon="QUESTION")
                return {"RUNNING_MODAL"}
            if event.type != "TIMER":
                # While the scene is read or objects are made, edits of the artist would fall between them.
                is_free = self.slices is None and self.writer is None and self.made is None
                may_press = _is_in_sidebar(context, event) and not bake.is_closing
                return {"PASS_THROUGH"} if is_free or may_press else {"RUNNING_MODAL"}
            try:
                return self._tick(context, bake)
            except Exception as error:
                running.end()
                self._leave(context, None)
                if isinstance(error, ReferenceError):
                    raise Fault("An undo took away what was being made. Press the button again.") from error
                raise
        return {"CANCELLED"}

    def _is_meant(self, context, event):
        """Whether Esc means this bake: not a playback, nor an operation in another editor."""
        region, _ = region_at(context, event)
        return bool(region) and not context.screen.is_animation_playing and not running.bake.is_closing

    def _tick(self, context, bake):
        if bake.end == "stopped" and not self.made:
            return self._stopped(context, bake)
        if self.slices:
            return self._take(context, bake)
        if self.writer:
            return self._write(context, bake)
        if self.made:
            return self._end(context, bake)
        bake.poll()
        self._show(context, bake)
        if self.preview and self.preview.update(bake.job.latest):
            preview.redraw(context, "WINDOW")
        if bake.end == "failed":
            raise bake.fault
        if bake.end == "stopped":
            return self._stopped(context, bake)
        if bake.has_all_frames:
            self.writer = self.make(context, bake)
            bake.written = 0.0
        return {"RUNNING_MODAL"}

    def _take(self, context, bake):
        until = time.monotonic() + SLICE
        try:
            while time.monotonic() < until:
                next(self.slices)
        except StopIteration as end:
            self.slices = None
            if end.value:
                self.preview = preview.Preview(end.value, bake.recipe["metres"])
            bake.start()
        self._show(context, bake)
        return {"RUNNING_MODAL"}

    def _stopped(self, context, bake):
        for generator in (self.slices, self.writer):
            if generator:
                generator.close()
        self.slices = self.writer = bake.written = None
        drawn, self.preview = self.preview, None
        self._leave(context, None)
        # What is drawn stays until the artist decides.
        bake.preview = drawn
        if bake.kept_kind():
            context.window_manager.popup_menu(_draw_choice, title="Bake Stopped", icon="QUESTION")
        else:
            running.end()
            self.report({"INFO"}, "Bake cancelled. The scene is unchanged")
        return {"CANCELLED"}

    def _write(self, context, bake):
        until = time.monotonic() + SLICE
        try:
            while time.monotonic() < until:
                share = next(self.writer)
                bake.is_closing = share == result.CLOSING
                bake.written = bake.written if share is None or bake.is_closing else share
        except StopIteration as end:
            # Blender adds the new objects before the frame changes: each takes a moment.
            self.writer, self.made = None, end.value
            self._put_away()
        self._show(context, bake)
        return {"RUNNING_MODAL"}

    def _end(self, context, bake):
        # A fault, if it was undone between two ticks of the timer.
        mode = self.made.cairn.mode
        running.bake = None
        self._leave(context, None)
        if not bake.end:
            running.wait_for_report(bake)
        if mode != "POSE":
            # Where the preview was.
            context.scene.frame_set(timing.end_of(self.made))
        return finished(self, context, self.made)

    def _show(self, context, bake):
        """Shows the progress in the status bar and in the panel."""
        line = bake.line()
        now = time.monotonic()
        if line != self.shown and now > self.shown_at + READ:
            self.shown, self.shown_at = line, now
            self.workspace.status_text_set(f"Pile: {line}      Esc over the 3D View: Stop")
            preview.redraw(context, "UI")

    def _leave(self, context, answer):
        gc.unfreeze()
        if self.workspace:
            self.workspace.status_text_set(None)
            self.workspace = None
        if self.timer:
            context.window_manager.event_timer_remove(self.timer)
            self.timer = None
        self._put_away()
        preview.redraw(context)
        return answer

    def _put_away(self):
        if self.preview:
            self.preview.remove()
            self.preview = None
        if running.bake is not None:
            running.bake.hide()

    def cancel(self, context):
        """Blender ends the operator, because a file is opened or the window closes. The bake itself continues."""
        for generator in (self.slices, self.writer):
            if generator:
                generator.close()
        if running.bake is not None:
            running.bake.job.detach()
            running.bake = None
        self._leave(context, None)

    def execute(self, context):
        with explaining(self):
            try:
                request.finish(self.begin(context))
                bake = running.bake
                wait_for(bake)
                if bake.end == "failed":
                    raise bake.fault
                collection = request.finish(self.make(context, bake))
            finally:
                running.end()
            return finished(self, context, collection)
        return {"CANCELLED"}


def wait_for(bake):
    """Waits for the end of a bake and prints its progress."""
    # Without a window, the forming pile is not shown.
    bake.job.has_fill = False
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
    report = running.report_of(collection)
    said = [f"Pile of {report.get('body_count', 0)} bodies in “{collection.name}”"]
    hanging = int(report.get("measures", {}).get("hanging_visible") or 0)
    if hanging:
        said.append("1 body hangs in the air" if hanging == 1 else f"{hanging} bodies hang in the air")
    beyond = timing.beyond(collection, context.scene)
    if beyond:
        said.append(beyond)
    operator.report({"WARNING" if len(said) > 1 else "INFO"}, ". ".join(said))
    if bpy.app.background:
        # With a window, Blender does so before it draws.
        context.view_layer.update()
        names = running.recipe_of(collection).get("names", {})
        warnings = [text for text, _ in wording.gathered(report.get("warnings", ()), names)]
        for sentence in filter(None, (running.glue_of(report), *warnings)):
            print(f"Cairn: {sentence}", flush=True)
    return {"FINISHED"}


def region_at(context, event):
    """The region of a 3D View that the pointer is in, and its kind; None, "" elsewhere."""
    for area in context.screen.areas:
        for region in area.regions if area.type == "VIEW_3D" else ():
            x, y = event.mouse_x - region.x, event.mouse_y - region.y
            if 0 <= x < region.width and 0 <= y < region.height and region.type != "WINDOW":
                return region, region.type
        if area.type == "VIEW_3D" and 0 <= event.mouse_x - area.x < area.width:
            if 0 <= event.mouse_y - area.y < area.height:
                return area.regions[-1], "WINDOW"
    return None, ""


def _is_in_sidebar(context, event):
    return region_at(context, event)[1] == "UI"


def _draw_question(self, _):
    self.layout.operator("cairn.stop", icon="CANCEL")
    self.layout.operator("cairn.go_on", icon="PLAY")


def _draw_choice(self, _):
    if running.bake:
        self.layout.operator("cairn.keep", text=running.bake.kept_kind(), icon="CHECKMARK")
        self.layout.operator("cairn.discard", icon="X")
