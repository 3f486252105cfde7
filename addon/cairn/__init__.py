"""Cairn: piles of props that keep the shape of a mesh. Blender 4.2 on takes it as an extension, 3.4 on as an add-on."""

import atexit

import bpy
from bpy.app.handlers import persistent
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty

from . import (
    edit_operators,
    estimates,
    glue,
    job,
    live,
    operators,
    panels,
    parameter_panels,
    pending,
    pile_operators,
    preferences,
    properties,
    report_panels,
    running,
    setup_operators,
    states,
    timing_panel,
    variant_operators,
    variant_panel,
    variants,
    weighing,
)

bl_info = {
    "name": "Cairn",
    "description": "Bake piles of props that keep the shape of a mesh",
    "author": "The Cairn authors",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "3D View > Sidebar > Pile",
    "doc_url": "https://extensions.blender.org/add-ons/cairn/",
    "tracker_url": "https://extensions.blender.org/add-ons/cairn/",
    "support": "COMMUNITY",
    "category": "Physics",
}

CLASSES = [
    preferences.CairnPreferences,
    *operators.CLASSES,
    *pile_operators.CLASSES,
    *setup_operators.CLASSES,
    *glue.CLASSES,
    *variant_operators.CLASSES,
    *panels.CLASSES,
    *timing_panel.CLASSES,
    *edit_operators.CLASSES,
    *variant_panel.CLASSES,
    *report_panels.CLASSES,
    *parameter_panels.CLASSES,
    *panels.LAST,
]


@persistent
def _before_load(*_):
    """Runs before another file is opened. The server continues the bake; this file's note says so."""
    live.show(False)
    glue.show(False)
    variants.forget()
    weighing.forget()
    running.forget_all()
    states.forget()
    estimates.forget()


@persistent
def _after_load(*_):
    running.left = pending.of_this_file()
    # Blender may have saved this file by itself, with colors.
    states.restore()


@persistent
def _before_save(*_):
    states.restore()


@persistent
def _after_save(*_):
    bake = running.bake
    if bake is not None and not bake.end and bake.recipe:
        pending.note(bake.recipe, bake.job.bake_id)
    states.refresh(bpy.context.scene)


@persistent
def _after_undo(*_):
    # The undo step may be from before the colors were set, or from before they were removed.
    states.refresh(bpy.context.scene)


HANDLERS = {
    "load_pre": _before_load,
    "load_post": _after_load,
    "save_pre": _before_save,
    "save_post": _after_save,
    "undo_post": _after_undo,
    "redo_post": _after_undo,
}


# Of this session, not of the file.
OPTIONS = (
    "cairn_warnings",
    "cairn_seed_count",
    "cairn_seed_glue",
    "cairn_seed_shapes",
    "cairn_seed_strengths",
    "cairn_add_count",
    "cairn_add_region",
)


def register():
    properties.register()
    bpy.types.WindowManager.cairn_warnings = BoolProperty(
        name="Warnings", description="Show the server's warnings about the scene or the pile"
    )
    bpy.types.WindowManager.cairn_seed_count = IntProperty(
        name="Seeds", description="How many seeds to try, starting with the scene's seed", default=4, min=1, max=32
    )
    bpy.types.WindowManager.cairn_add_count = IntProperty(
        name="Count", description="How many props to drop on top", default=10, min=1, max=10000
    )
    bpy.types.WindowManager.cairn_add_region = StringProperty(
        name="Region",
        description="Vertex group of the shape: props fall where its weights are 0.5 or more. If empty, props fall "
        "over the selected bodies, or the whole pile",
    )
    bpy.types.WindowManager.cairn_seed_glue = BoolProperty(
        name="Also Vary Glue",
        description="Try each seed with several amounts of glue: those chosen below, and the glue set above",
    )
    bpy.types.WindowManager.cairn_seed_shapes = EnumProperty(
        name="Glue Amounts",
        description="Amounts of glue to try with each seed",
        items=variant_operators.BUDGETS,
        options={"ENUM_FLAG"},
        default={"AS_MODELLED", "NATURAL"},
    )
    bpy.types.WindowManager.cairn_seed_strengths = StringProperty(
        name="Tacky",
        description="Strengths of Tacky to try with each seed, in weights of a typical prop, separated by commas, "
        "such as 1, 5, 20",
    )
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    states.register()
    live.register()
    glue.register()
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    atexit.register(preferences.stop_server)


def unregister():
    atexit.unregister(preferences.stop_server)
    glue.unregister()
    live.unregister()
    states.unregister()
    _before_load()
    preferences.stop_server()
    job.end()
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
    for name in OPTIONS:
        delattr(bpy.types.WindowManager, name)
    properties.unregister()
