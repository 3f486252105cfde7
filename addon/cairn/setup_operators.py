"""Operators on the settings: choose props, check the scene, select objects, test the server."""

import concurrent.futures
import time

import bpy
from bpy.props import EnumProperty, FloatProperty, StringProperty
from bpy.types import Operator

from . import estimates, job, preferences, preview, request, running
from .client import Fault
from .export import SOLID
from .following import explain, explaining, is_running, start_frame
from .schema import GROUPS

# How often to poll for the server's answer, the time per slice for reading the scene, and how long the preferences wait
# for an answer, s.
TICK = 0.05
SLICE = 0.025
PATIENCE = 20.0


class CAIRN_OT_use_selected(Operator):
    """Use the active object as the shape of the pile, and the other selected objects as its props"""

    bl_idname = "cairn.use_selected"
    bl_label = "Use Selected"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return context.object is not None and context.object.type in SOLID

    def execute(self, context):
        settings = context.scene.cairn
        settings.control_mesh = context.object
        others = new_props(context)
        if others:
            settings.prop_source = "LIST"
            for source in others:
                settings.props.add().object = source
        return {"FINISHED"}


def new_props(context):
    """The selected objects that are no props yet."""
    settings = context.scene.cairn
    known = {item.object for item in settings.props} | {settings.control_mesh}
    chosen = set(context.selected_objects)
    return [
        source
        for source in context.selected_objects
        if source.type in request.PLACED | request.RIGS
        and source.parent not in chosen
        and source not in known
        and not request.is_bare(source)
        and not source.cairn.number
        and not source.cairn.is_root
    ]


class CAIRN_OT_add_props(Operator):
    """Add the selected objects to the props. Children belong to their parents"""

    bl_idname = "cairn.add_props"
    bl_label = "Add Selected"
    bl_options = {"UNDO"}

    def execute(self, context):
        settings = context.scene.cairn
        new = new_props(context)
        if not new:
            return explain(self, Fault("Select the objects to use as props, then press this button."))
        settings.prop_source = "LIST"
        for source in new:
            settings.props.add().object = source
        settings.active_prop = len(settings.props) - 1
        return {"FINISHED"}


class CAIRN_OT_remove_prop(Operator):
    """Remove the prop from the list. The object stays"""

    bl_idname = "cairn.remove_prop"
    bl_label = "Remove Prop"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context):
        return len(context.scene.cairn.props) > 0

    def execute(self, context):
        settings = context.scene.cairn
        settings.props.remove(settings.active_prop)
        settings.active_prop = max(0, min(settings.active_prop, len(settings.props) - 1))
        return {"FINISHED"}


class _Waits:
    """Common part of operators that poll for an answer while Blender continues."""

    timer = answer = None

    def _wait(self, context):
        self.timer = context.window_manager.event_timer_add(TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def _leave(self, context):
        if self.timer:
            context.window_manager.event_timer_remove(self.timer)
            self.timer = None
        preview.redraw(context)

    def cancel(self, context):
        if self.answer:
            self.answer.cancel()
        self._leave(context)


class CAIRN_OT_fit_props(Operator):
    """Scale all props by this factor: so large, they also fill the parts of the shape that are too thin for them now"""

    bl_idname = "cairn.fit_props"
    bl_label = "Scale Props"
    bl_options = {"REGISTER", "UNDO"}

    scale: FloatProperty(name="Scale", default=1.0, min=0.01, max=100.0)

    def execute(self, context):
        settings = context.scene.cairn
        for item in settings.props if settings.prop_source == "LIST" else [settings.prop_common]:
            item.scale_min, item.scale_max = item.scale_min * self.scale, item.scale_max * self.scale
        return {"FINISHED"}


class CAIRN_OT_check(_Waits, Operator):
    """Validate the scene and estimate the bake, without simulating it"""

    bl_idname = "cairn.check"
    bl_label = "Check"

    slices = None

    @classmethod
    def poll(cls, _):
        return not is_running()

    def _ask(self, context):
        """A generator: reads the scene, and asks."""
        with start_frame(context):
            taken = yield from request.taking(context)
        running.problems, running.names = [], taken.recipe["names"]
        estimates.asked(context)
        self.answer = job.plan(preferences.server(context), taken.spec, taken.contents, taken.problems)

    def invoke(self, context, _):
        with explaining(self):
            if bpy.app.background:
                return self.execute(context)
            self.slices = self._ask(context)
            # Missing settings are reported at once.
            self._read()
            return self._wait(context)
        return {"CANCELLED"}

    def _read(self):
        if not request.advance(self.slices, SLICE, lambda _: None):
            self.slices = None

    def modal(self, context, event):
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            return {"CANCELLED"}
        if event.type != "TIMER":
            # While the scene is read, edits of the artist would fall between its parts.
            return {"RUNNING_MODAL"} if self.slices else {"PASS_THROUGH"}
        with explaining(self):
            if self.slices:
                self._read()
            elif self.answer.done():
                self._leave(context)
                return self._take()
            return {"PASS_THROUGH"}
        self.cancel(context)
        return {"CANCELLED"}

    def cancel(self, context):
        if self.slices:
            self.slices.close()
            self.slices = None
        _Waits.cancel(self, context)

    def execute(self, context):
        with explaining(self):
            request.finish(self._ask(context))
            return self._take()
        return {"CANCELLED"}

    def _take(self):
        try:
            answer = self.answer.result()
        except Fault as fault:
            running.plan = None
            return explain(self, fault)
        estimates.take(answer)
        plan = answer.plan
        if bpy.app.background:
            print(f"Cairn: about {plan.expected_body_count} bodies, {plan.expected_step_count} steps", flush=True)
        return {"FINISHED"}


class CAIRN_OT_select(Operator):
    """Select the object that this message is about"""

    bl_idname = "cairn.select"
    bl_label = "Select Object"
    bl_options = {"UNDO"}

    object: StringProperty(name="Object", description="Name of the object")

    def execute(self, context):
        found = context.view_layer.objects.get(self.object)
        if found is None:
            return explain(self, Fault(f"“{self.object}” is not in this view layer any more."))
        for other in context.selected_objects:
            other.select_set(False)
        if not found.visible_get():
            return explain(self, Fault(f"“{self.object}” is hidden. Show it in the outliner to select it."))
        found.select_set(True)
        context.view_layer.objects.active = found
        return {"FINISHED"}


class CAIRN_OT_test_server(_Waits, Operator):
    """Connect to the server, starting it if it is on this computer, and show its version"""

    bl_idname = "cairn.test_server"
    bl_label = "Test Server"

    def _ask(self, context):
        self.answer = job.ask(preferences.server(context), "GetServerInfo")
        self.end = time.monotonic() + PATIENCE

    def invoke(self, context, _):
        with explaining(self):
            if bpy.app.background:
                return self.execute(context)
            self._ask(context)
            return self._wait(context)
        return {"CANCELLED"}

    def modal(self, context, event):
        if event.type != "TIMER" or not (self.answer.done() or time.monotonic() > self.end):
            return {"PASS_THROUGH"}
        self._leave(context)
        return self._show_answer(0.0)

    def execute(self, context):
        with explaining(self):
            self._ask(context)
            return self._show_answer(PATIENCE)
        return {"CANCELLED"}

    def _show_answer(self, patience):
        try:
            info = self.answer.result(patience)
        except Fault as fault:
            return explain(self, fault)
        except concurrent.futures.TimeoutError:
            self.answer.cancel()
            return explain(self, Fault("The server does not answer. Check its address."))
        count = info.limits.worker_count
        bakes = "1 bake" if count == 1 else f"{count} bakes"
        self.report({"INFO"}, f"Cairn {info.versions.cairn} is ready ({bakes} at a time)")
        return {"FINISHED"}


class CAIRN_OT_preferences(Operator):
    """Open the add-on's preferences: the program, or the server's address and token"""

    bl_idname = "cairn.preferences"
    bl_label = "Preferences"

    def execute(self, _):
        bpy.ops.preferences.addon_show(module=__package__)
        return {"FINISHED"}


class CAIRN_OT_clear_parameters(Operator):
    """Reset all parameters of this group to the values of the accuracy"""

    bl_idname = "cairn.clear_parameters"
    bl_label = "Reset"
    bl_options = {"UNDO"}

    group: EnumProperty(
        name="Group",
        description="Group of parameters to reset",
        items=[(name, name.title(), "") for name in GROUPS.values()],
    )

    def execute(self, context):
        group = getattr(context.scene.cairn, self.group)
        for prop in group.bl_rna.properties:
            if prop.identifier.startswith("use_"):
                setattr(group, prop.identifier, False)
        return {"FINISHED"}


CLASSES = [
    CAIRN_OT_use_selected,
    CAIRN_OT_add_props,
    CAIRN_OT_remove_prop,
    CAIRN_OT_fit_props,
    CAIRN_OT_check,
    CAIRN_OT_select,
    CAIRN_OT_test_server,
    CAIRN_OT_preferences,
    CAIRN_OT_clear_parameters,
]
