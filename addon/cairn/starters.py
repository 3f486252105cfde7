"""Presets of props and of heaps: those that come with the add-on, and the artist's own, which Blender keeps."""

from bl_operators.presets import AddPresetBase
from bpy.props import EnumProperty
from bpy.types import Menu, Operator

# Density in kg/m³, friction, and bounce: usual values of the dry material.
PROPS = {
    "WOOD": ("Wood", 600.0, 0.5, 0.2),
    "BRICK": ("Brick", 1900.0, 0.7, 0.05),
    "FRUIT": ("Fruit", 950.0, 0.5, 0.15),
    "PAPER": ("Paper", 800.0, 0.4, 0.0),
    "STEEL": ("Steel", 7850.0, 0.4, 0.3),
    "STONE": ("Stone", 2600.0, 0.7, 0.1),
}
# Order, surface, shake, and shape support.
HEAPS = {
    "MODELED": ("As Modeled", 0.0, 0.5, 0.0, "AS_MODELLED"),
    "DUMPED": ("Dumped", 0.0, 0.25, 0.0, "NATURAL"),
    "SETTLED": ("Shaken Down", 0.0, 0.5, 5.0, "NATURAL"),
    "TIDIED": ("Tidied", 0.4, 0.5, 0.0, "AS_MODELLED"),
    "STACKED": ("Stacked", 1.0, 0.5, 0.0, "NATURAL"),
    "CAST": ("Cast in a Mold", 0.0, 1.0, 3.0, "AS_MODELLED"),
}


def item_of(settings):
    """The settings that a preset of props changes: those of all objects of the collection, or the active prop's."""
    if settings.prop_source == "COLLECTION":
        return settings.prop_common
    return settings.props[settings.active_prop] if 0 <= settings.active_prop < len(settings.props) else None


def set_prop(item, kind):
    _, item.density, item.friction, item.restitution = PROPS[kind]


def set_heap(settings, kind):
    lie = settings.arrangement
    _, lie.order, lie.surface, lie.shake, settings.kept_shape = HEAPS[kind]


class _Preset:
    """Sets what a preset of its kind sets."""

    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        self.set(context.scene.cairn, self.kind)
        return {"FINISHED"}


class CAIRN_OT_prop_preset(_Preset, Operator):
    """Set density, friction and bounce of the props to those of a material"""

    bl_idname = "cairn.prop_preset"
    bl_label = "Prop Preset"
    set = staticmethod(lambda settings, kind: set_prop(item_of(settings), kind))

    kind: EnumProperty(
        name="Material",
        description="Material of the props",
        items=[(key, title, f"{density:g} kg/m³") for key, (title, density, *_) in PROPS.items()],
    )

    @classmethod
    def poll(cls, context):
        return item_of(context.scene.cairn) is not None


class CAIRN_OT_heap_preset(_Preset, Operator):
    """Set how props lie and what supports the shape to a style of heap"""

    bl_idname = "cairn.heap_preset"
    bl_label = "Heap Preset"
    set = staticmethod(set_heap)

    kind: EnumProperty(
        name="Style",
        description="Style of the heap",
        items=[(key, title, "") for key, (title, *_) in HEAPS.items()],
    )


class _Presets:
    """A menu of both kinds."""

    preset_operator = "script.execute_preset"

    def draw(self, context):
        layout = self.layout
        for key, (title, *_) in self.own.items():
            layout.operator(self.own_operator, text=title).kind = key
        layout.separator()
        Menu.draw_preset(self, context)


class CAIRN_MT_prop_presets(_Presets, Menu):
    bl_label = "Prop Presets"
    preset_subdir = "cairn/props"
    own, own_operator = PROPS, "cairn.prop_preset"


class CAIRN_MT_heap_presets(_Presets, Menu):
    bl_label = "Heap Presets"
    preset_subdir = "cairn/heaps"
    own, own_operator = HEAPS, "cairn.heap_preset"


class CAIRN_OT_add_prop_preset(AddPresetBase, Operator):
    """Add a preset of the props' density, friction, bounce and size, or remove the chosen one"""

    bl_idname = "cairn.add_prop_preset"
    bl_label = "Add Prop Preset"
    preset_menu = "CAIRN_MT_prop_presets"
    preset_subdir = CAIRN_MT_prop_presets.preset_subdir
    preset_defines = [
        "settings = bpy.context.scene.cairn",
        "item = settings.prop_common if settings.prop_source == 'COLLECTION' else settings.props[settings.active_prop]",
    ]
    preset_values = [
        f"item.{name}"
        for name in ("density", "friction", "restitution", "scale_min", "scale_max", "skew", "tilt", "up", "turns")
    ]


class CAIRN_OT_add_heap_preset(AddPresetBase, Operator):
    """Add a preset of how props lie and what supports the shape, or remove the chosen one"""

    bl_idname = "cairn.add_heap_preset"
    bl_label = "Add Heap Preset"
    preset_menu = "CAIRN_MT_heap_presets"
    preset_subdir = CAIRN_MT_heap_presets.preset_subdir
    preset_defines = ["settings = bpy.context.scene.cairn"]
    preset_values = [
        "settings.kept_shape",
        "settings.glue_strength",
        *(f"settings.arrangement.{name}" for name in ("order", "surface", "shake", "layout", "sort_by", "descending")),
        "settings.arrangement.gaps",
    ]


def draw(layout, menu, operator):
    """Draws a menu of presets with its buttons, as Blender does."""
    row = layout.row(align=True)
    row.use_property_split = False
    row.menu(menu.__name__, text=menu.bl_label)
    row.operator(operator, text="", icon="ADD")
    row.operator(operator, text="", icon="REMOVE").remove_active = True


CLASSES = [
    CAIRN_OT_prop_preset,
    CAIRN_OT_heap_preset,
    CAIRN_MT_prop_presets,
    CAIRN_MT_heap_presets,
    CAIRN_OT_add_prop_preset,
    CAIRN_OT_add_heap_preset,
]
