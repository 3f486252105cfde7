"""Operators of variants: try seeds, show one, keep one, delete one."""

import json

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty
from bpy.types import Operator

from . import job, pointers, preferences, preview, request, running, variants
from .client import Fault
from .following import Follows, explain, explaining, is_running
from .messages import v1
from .properties import KEPT_SHAPES


TITLES = {name: title for name, title, *_ in KEPT_SHAPES}
# Amounts of glue that may be tried besides the scene's own, by the names of the scene's choices.
BUDGETS = [(name, title, about) for name, title, about, *_ in KEPT_SHAPES if name != "TACKY"]


class CAIRN_OT_try_seeds(Operator):
    """Bake the pile with several seeds, to choose one of them. The scene does not change until you keep one"""

    bl_idname = "cairn.try_seeds"
    bl_label = "Try Seeds"

    count: IntProperty(
        name="Seeds", description="How many seeds to try, starting with the scene's seed", default=4, min=1, max=32
    )
    is_with_glue: BoolProperty(
        name="Vary Glue",
        description="Try each seed with several amounts of glue: those chosen here, and the glue set in the scene",
    )
    kept_shapes: EnumProperty(
        name="Glue Amounts",
        description="Amounts of glue to try with each seed",
        items=BUDGETS,
        options={"ENUM_FLAG"},
        default={"AS_MODELLED", "NATURAL"},
    )
    strengths: StringProperty(
        name="Glue Strengths",
        description="Strengths of Tacky to try with each seed, in weights of a typical prop, separated by commas, "
        "such as 1, 5, 20",
    )

    @classmethod
    def poll(cls, _):
        return not is_running() and not variants.is_trying()

    def execute(self, context):
        with explaining(self):
            lacking = request.missing(context.scene.cairn)
            if lacking:
                raise Fault(lacking)
            wanted = list(self._wanted(context.scene.cairn))
            preferences.server(context)
            running.problems = []
            variants.begin(context.scene, wanted)
            if bpy.app.background:
                variants.finish()
            return {"FINISHED"}
        variants.stop()
        return {"CANCELLED"}

    def _wanted(self, settings):
        own = settings.kept_shape, settings.glue_strength
        for seed in range(settings.seed, settings.seed + self.count):
            for choice, strength in self._budgets(own) if self.is_with_glue else [own]:
                name = f"Seed {seed}"
                if self.is_with_glue:
                    name += f", {TITLES[choice]}" + (f" {strength:.4g}" if choice == "TACKY" else "")
                yield name, _changes(seed, choice, strength)

    def _budgets(self, own):
        """Pairs of a choice and a strength, each once: from the most glue to none."""
        found = {(choice, 0.0) for choice in self.kept_shapes}
        found |= {("TACKY", strength) for strength in strengths_of(self.strengths)}
        found.add(own if own[0] == "TACKY" else (own[0], 0.0))
        order = [name for name, *_ in KEPT_SHAPES]
        return sorted(found, key=lambda pair: (order.index(pair[0]), -pair[1]))


def strengths_of(text):
    """Parses glue strengths, separated by commas."""
    try:
        found = [float(word) for word in text.replace(";", " ").replace(", ", " ").replace(",", " ").split()]
    except ValueError:
        found = [-1.0]
    # This also excludes not-a-number.
    if not all(0.0 <= strength <= 1e9 for strength in found):
        raise Fault("Write the glue strengths as numbers with commas between them: 1, 5, 20.")
    return found


def _changes(seed, choice, strength):
    def change(scene, settings):
        scene.seed = settings["seed"] = seed
        settings["kept_shape"] = choice
        if choice == "TACKY":
            settings["glue_strength"] = strength
        if choice == "NATURAL":
            scene.glue.mode = v1.GLUE_MODE_NATURAL
        elif choice == "TACKY":
            scene.glue.mode, scene.glue.strength = v1.GLUE_MODE_TACKY, float(f"{strength:.7g}")
        elif scene.HasField("glue"):
            scene.glue.ClearField("mode")
            scene.glue.ClearField("strength")

    return change


class _OfVariant:
    variant: StringProperty(name="Variant", description="Name of the variant")

    def entry(self, context):
        found = context.scene.cairn_variants.get(self.variant)
        if found is None:
            raise Fault(f"There is no variant “{self.variant}” in this scene.")
        return found


class CAIRN_OT_show_variant(_OfVariant, Operator):
    """Draw the final pose of this variant over the view. Press again to hide it"""

    bl_idname = "cairn.show_variant"
    bl_label = "Show Variant"

    def execute(self, context):
        with explaining(self):
            entry = self.entry(context)
            if variants.is_fetched(entry):
                variants.forget_fetched()
                return {"FINISHED"}
            if not variants.is_here(entry) and not bpy.app.background:
                variants.fetch(context, entry)
                return {"FINISHED"}
            if not variants.is_here(entry):
                request.finish(variants.load(context, entry))
            variants.show("" if variants.shown == entry.bake_id else entry.bake_id)
            return {"FINISHED"}
        return {"CANCELLED"}


class CAIRN_OT_next_variant(Operator):
    """Draw the next variant over the view"""

    bl_idname = "cairn.next_variant"
    bl_label = "Next Variant"

    step: IntProperty(name="Step", description="How many variants to move forward; negative moves back", default=1)

    @classmethod
    def poll(cls, context):
        return len(context.scene.cairn_variants) > 0

    def execute(self, context):
        entries = context.scene.cairn_variants
        at = next((n for n, entry in enumerate(entries) if variants.is_at(entry)), None)
        name = entries[0 if at is None else (at + self.step) % len(entries)].name
        variants.show("")
        return bpy.ops.cairn.show_variant(variant=name)


class CAIRN_OT_keep_variant(_OfVariant, Follows, Operator):
    """Make a pile of this variant. The others stay in the list"""

    bl_idname = "cairn.keep_variant"
    bl_label = "Keep Variant"

    def begin(self, context):
        entry = self.entry(context)
        recipe = json.loads(entry.recipe)
        bake = running.Bake(preferences.server(context))
        bake.resume(recipe, entry.bake_id)
        pointers.ask(context.scene, recipe["token"], pointers.read(entry.pointers))
        variants.show("")
        running.bake = bake
        yield


class CAIRN_OT_delete_variant(_OfVariant, Operator):
    """Remove this variant from the list. A pile that was made of it stays"""

    bl_idname = "cairn.delete_variant"
    bl_label = "Delete Variant"

    def execute(self, context):
        with explaining(self):
            entry = self.entry(context)
            if variants.shown == entry.bake_id:
                variants.show("")
            job.ask(preferences.server(context), "DeleteBake", bake_id=entry.bake_id)
            entries = context.scene.cairn_variants
            entries.remove(entries.find(entry.name))
            preview.redraw(context)
            return {"FINISHED"}
        return {"CANCELLED"}


class CAIRN_OT_stop_trying(Operator):
    """Stop trying seeds. Finished variants stay"""

    bl_idname = "cairn.stop_trying"
    bl_label = "Stop"

    @classmethod
    def poll(cls, _):
        return variants.is_trying()

    def execute(self, context):
        variants.stop()
        preview.redraw(context)
        return {"FINISHED"}


class CAIRN_OT_show_pile(Operator):
    """Show this pile of the shape, and hide the others"""

    bl_idname = "cairn.show_pile"
    bl_label = "Show Pile"
    bl_options = {"UNDO"}

    collection: StringProperty(name="Collection", description="The pile's collection")

    def execute(self, context):
        from . import result

        collection = bpy.data.collections.get(self.collection)
        if collection is None or not collection.cairn.is_result:
            return explain(self, Fault(f"There is no pile “{self.collection}” in this file."))
        result.show_only(context.scene, collection)
        return {"FINISHED"}


CLASSES = [
    CAIRN_OT_try_seeds,
    CAIRN_OT_show_variant,
    CAIRN_OT_next_variant,
    CAIRN_OT_keep_variant,
    CAIRN_OT_delete_variant,
    CAIRN_OT_stop_trying,
    CAIRN_OT_show_pile,
]
