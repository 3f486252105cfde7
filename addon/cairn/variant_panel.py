"""The panel of variants, and of the piles of other seeds that stay."""

from bpy.types import Panel

from . import result, variants
from .panels import Pile

SCALE = 4.0


class CAIRN_PT_variants(Pile, Panel):
    bl_label = "Variants"
    bl_parent_id = "CAIRN_PT_pile"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return context.scene.cairn.control_mesh is not None

    def draw(self, context):
        layout, settings, manager = self.layout, context.scene.cairn, context.window_manager
        entries = context.scene.cairn_variants
        row = layout.row(align=True)
        if variants.is_trying():
            row.label(text=variants.status(), icon="TIME")
            row.operator("cairn.stop_trying", text="", icon="CANCEL")
        else:
            row.prop(manager, "cairn_seed_count", text="")
            button = row.operator("cairn.try_seeds")
            button.count, button.is_with_glue = manager.cairn_seed_count, manager.cairn_seed_glue
            button.kept_shapes, button.strengths = manager.cairn_seed_shapes, manager.cairn_seed_strengths
            self.draw_glue(layout, manager)
        if len(entries) > 1:
            row = layout.row(align=True)
            row.operator("cairn.next_variant", text="Previous", icon="TRIA_LEFT").step = -1
            row.operator("cairn.next_variant", text="Next", icon="TRIA_RIGHT").step = 1
        grid = layout.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
        for entry in entries:
            self.draw_variant(grid.column(align=True).box(), entry)
        self.draw_piles(layout, result.piles(context.scene, settings.control_mesh))

    def draw_glue(self, layout, manager):
        column = layout.column(align=True)
        column.prop(manager, "cairn_seed_glue")
        if manager.cairn_seed_glue:
            column.row(align=True).prop(manager, "cairn_seed_shapes")
            row = column.split(factor=0.3, align=True)
            row.label(text="Tacky")
            row.prop(manager, "cairn_seed_strengths", text="")

    def draw_variant(self, box, entry):
        number = variants.icon(entry.bake_id)
        if number:
            box.template_icon(icon_value=number, scale=SCALE)
        column = box.column(align=True)
        # Line by line: two of them stand side by side.
        for line in (*entry.name.split(", "), *entry.summary.split(", ")):
            column.label(text=line)
        row = column.row(align=True)
        icon = "TIME" if variants.is_fetched(entry) else "HIDE_OFF"
        row.operator("cairn.show_variant", text="", icon=icon, depress=variants.is_at(entry)).variant = entry.name
        row.operator("cairn.keep_variant", text="Keep").variant = entry.name
        row.operator("cairn.delete_variant", text="", icon="X").variant = entry.name

    def draw_piles(self, layout, piles):
        if len(piles) < 2:
            return
        column = layout.column(align=True)
        column.label(text="Piles of This Shape")
        for pile in sorted(piles, key=lambda pile: pile.name):
            row = column.row(align=True)
            icon = "HIDE_ON" if pile.hide_viewport else "HIDE_OFF"
            seed = result.seed_of(pile)
            row.operator("cairn.show_pile", text=f"{pile.name}, seed {seed}", icon=icon).collection = pile.name
            row.operator("cairn.delete", text="", icon="TRASH").collection = pile.name


CLASSES = [CAIRN_PT_variants]
