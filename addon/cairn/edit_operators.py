"""Operators that edit a pile by hand."""

import bpy
from bpy.props import EnumProperty, IntProperty, StringProperty
from bpy.types import Operator, Panel

from mathutils import Matrix

from . import belongings, edit, parts, pointers, preferences, preview, request, result, running, visibility, weighing
from .client import Fault
from .following import Follows, explain, explaining, is_running
from .layouts import wrapped
from .panels import Pile


# Name of a new vertex group for painting.
REGION = "Drop Here"
SEED = "Another seed gives another result; 0: the seed of the settings"


def _pile(context):
    collection = result.chosen(context)
    return collection if edit.is_edited(collection) else None


def _selected(context, collection):
    return [body for body in collection.objects if body.select_get() and body.cairn.number]


class _Edits:
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context):
        return not is_running() and _pile(context) is not None


class CAIRN_OT_edit_pile(Operator):
    """Edit a copy of the final pose of this pile by hand. The pile itself stays, hidden"""

    bl_idname = "cairn.edit_pile"
    bl_label = "Edit Pile"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context):
        return not is_running() and result.chosen(context) is not None and _pile(context) is None

    def execute(self, context):
        collection = result.chosen(context)
        if collection.cairn.mode == "POINTS":
            remedy = "To edit this pile, bake it as Animated Objects or as Final Pose."
            return explain(self, Fault(f"Instanced points have no bodies to select. {remedy}"))
        edit.still_copy(context.scene, collection)
        return {"FINISHED"}


class CAIRN_OT_remove_bodies(_Edits, Operator):
    """Remove the selected bodies from the pile"""

    bl_idname = "cairn.remove_bodies"
    bl_label = "Remove"

    def execute(self, context):
        chosen = _selected(context, _pile(context))
        if not chosen:
            return explain(self, Fault("Select the bodies to remove."))
        bpy.data.batch_remove(chosen)
        return {"FINISHED"}


def _prop_items(_, context):
    """The pile's props. The list is kept here, because Blender does not keep it."""
    collection = _pile(context) if context else None
    recipe = running.recipe_of(collection) if collection else {"props": []}
    _prop_items.kept = [(str(number), prop["name"], "") for number, prop in enumerate(recipe["props"])]
    return _prop_items.kept or [("0", "–", "")]


class CAIRN_OT_replace_bodies(_Edits, Operator):
    """Replace each selected body by another prop"""

    bl_idname = "cairn.replace_bodies"
    bl_label = "Replace"
    bl_options = {"REGISTER", "UNDO"}

    prop: EnumProperty(name="By", description="Prop of the pile that replaces the selected bodies", items=_prop_items)

    def execute(self, context):
        with explaining(self):
            collection = _pile(context)
            chosen = _selected(context, collection)
            if not chosen:
                raise Fault("Select the bodies to replace.")
            recipe = running.recipe_of(collection)
            sources = result.sources_of(recipe, pointers.read(collection.cairn.pointers))
            number = int(self.prop)
            if sources[number] is None:
                raise Fault(f"The prop “{recipe['props'][number]['name']}” is not in the file any more.")
            local = Matrix(recipe["props"][number]["local"])
            (part,) = parts.make(context, [sources[number]], [local], as_collections=False)
            for body in chosen:
                made = part.body(f"{part.name} Body", body.cairn.size)
                made.location, made.rotation_quaternion = body.location, body.rotation_quaternion
                made.cairn.number, made.cairn.prop, made.cairn.size = body.cairn.number, number, body.cairn.size
                collection.objects.link(made)
                if body.parent is not None:
                    made.parent, made.matrix_parent_inverse = body.parent, body.matrix_parent_inverse
                belongings.mark(made)
            belongings.note_data(collection, [part])
            bpy.data.batch_remove(chosen)
            edit.carry(collection)
            return {"FINISHED"}
        return {"CANCELLED"}


class _Settles(Follows):
    bl_options = {"REGISTER", "UNDO"}
    added, over_painted = 0, ""

    @classmethod
    def poll(cls, context):
        return not is_running() and _pile(context) is not None

    def begin(self, context):
        server = preferences.server(context)
        end_painting(context)
        self.pile = _pile(context)
        bake = running.bake = running.Bake(server)
        yield
        over = _selected(context, self.pile)
        settling = edit.settling(context, self.pile, self.added, over, self.over_painted, self.seed)
        taken, self.objects, self.free = yield from settling
        same = {body.cairn.number for body, is_free in zip(self.objects, self.free) if not is_free}
        self.weighing = weighing.Weighing(server, taken, edit.settled(self.pile), same)
        pointers.ask(context.scene, taken.recipe["token"], taken.pointers)
        bake.ask(taken)
        return (yield from preview.drawn(taken.props))

    def make(self, context, bake):
        made = yield from edit.applied(
            context, self.pile, self.objects, self.free, bake.motion(), bake.recipe, bake.record()
        )
        self.weighing.begin(made.cairn.bake_id, edit.settled(made))
        while bpy.app.background and weighing.collect():
            yield request.WAITING
        return made


class CAIRN_OT_settle(_Settles, Operator):
    """Simulate the disturbed bodies until they come to rest again. All others keep their exact pose"""

    bl_idname = "cairn.settle"
    bl_label = "Settle Again"

    seed: IntProperty(name="Seed", description=SEED, default=0, min=0)


class CAIRN_OT_add_on_top(_Settles, Operator):
    """Drop more props from above: over the painted region, if one is chosen; over the selected bodies; or, with
    neither, over the whole pile"""

    bl_idname = "cairn.add_on_top"
    bl_label = "Add on Top"

    count: IntProperty(name="Count", description="How many props to drop", default=10, min=1, max=10000)

    seed: IntProperty(name="Seed", description=SEED, default=0, min=0)

    region: StringProperty(
        name="Region",
        description="Vertex group of the shape: props fall where its weights are 0.5 or more. If empty, props fall "
        "over the selected bodies, or the whole pile",
    )

    @property
    def added(self):
        return self.count

    @property
    def over_painted(self):
        return self.region


class CAIRN_OT_paint_region(Operator):
    """Paint on the shape where more props fall: they fall on red. Press again to stop painting"""

    bl_idname = "cairn.paint_region"
    bl_label = "Paint Region"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context):
        return not is_running() and _pile(context) is not None

    def execute(self, context):
        if end_painting(context):
            return {"FINISHED"}
        control, manager = _pile(context).cairn.control, context.window_manager
        if control is not None and control.type != "MESH":
            return explain(self, Fault("Only on meshes can be painted. Convert the shape to a mesh first."))
        if control is None or context.view_layer.objects.get(control.name) != control:
            return explain(self, Fault("The shape is not in this view layer. Bring it back to paint on it."))
        groups = control.vertex_groups
        group = groups.get(manager.cairn_add_region) or groups.get(REGION) or groups.new(name=REGION)
        groups.active_index, manager.cairn_add_region = group.index, group.name
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        for other in context.selected_objects:
            other.select_set(False)
        control.hide_viewport = False
        control.hide_set(False)
        control.select_set(True)
        context.view_layer.objects.active = control
        # The weights' colors are on the faces.
        control.display_type = "TEXTURED"
        bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
        return {"FINISHED"}


def end_painting(context):
    """Ends the painting of a region and shows the shape as wire again. Returns whether a region was being painted."""
    pile = _pile(context)
    if context.mode != "PAINT_WEIGHT" or pile is None or context.object != pile.cairn.control:
        return False
    bpy.ops.object.mode_set(mode="OBJECT")
    pile.cairn.control.display_type = visibility.thin(pile.cairn.control)
    return True


class CAIRN_PT_edit(Pile, Panel):
    bl_label = "Edit"
    bl_parent_id = "CAIRN_PT_pile"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return result.chosen(context) is not None

    def draw(self, context):
        layout, collection = self.layout, _pile(context)
        if collection is None:
            layout.operator("cairn.edit_pile", icon="GREASEPENCIL")
            return
        column = layout.column(align=True)
        row = column.row(align=True)
        row.operator("cairn.remove_bodies", icon="X")
        row.operator_menu_enum("cairn.replace_bodies", "prop", text="Replace By", icon="FILE_REFRESH")
        row = column.row(align=True)
        row.prop(context.window_manager, "cairn_add_count", text="")
        button = row.operator("cairn.add_on_top", icon="ADD")
        button.count, button.region = context.window_manager.cairn_add_count, context.window_manager.cairn_add_region
        if collection.cairn.control and collection.cairn.control.type == "MESH":
            row = column.row(align=True)
            row.prop_search(context.window_manager, "cairn_add_region", collection.cairn.control, "vertex_groups")
            is_painting = context.mode == "PAINT_WEIGHT"
            row.operator("cairn.paint_region", text="", icon="BRUSH_DATA", depress=is_painting)
        layout.operator("cairn.settle", icon="PHYSICS")
        report = running.report_of(collection)
        if "settled" in report:
            settled = report["settled"]
            wrapped(
                layout, context, f"{settled['moved']} released, {settled['kept']} untouched, {settled['added']} new"
            )
            if weighing.said(report):
                wrapped(layout, context, weighing.said(report))


CLASSES = [
    CAIRN_OT_edit_pile,
    CAIRN_OT_remove_bodies,
    CAIRN_OT_replace_bodies,
    CAIRN_OT_settle,
    CAIRN_OT_add_on_top,
    CAIRN_OT_paint_region,
    CAIRN_PT_edit,
]
