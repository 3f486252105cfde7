"""Cairn: piles of props that keep the shape of a mesh. Blender 4.2 on takes it as an extension, 3.4 on as an add-on."""

import atexit

import bpy
from bpy.app.handlers import persistent
from bpy.props import BoolProperty

try:
    import numpy  # noqa: F401 nearly all modules need it
except ImportError as error:
    raise ImportError("Cairn needs numpy. Some systems pack Blender without it: install python3-numpy") from error

from . import (
    analysis,
    apart,
    aside,
    edit_operators,
    estimates,
    examples,
    glue,
    hover,
    job,
    live,
    menus,
    operators,
    outgoing,
    panels,
    parameter_panels,
    pending,
    pile_operators,
    preferences,
    properties,
    report_panels,
    running,
    setup_operators,
    starters,
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
    *starters.CLASSES,
    *menus.CLASSES,
    *outgoing.CLASSES,
    *examples.CLASSES,
    *panels.CLASSES,
    *timing_panel.CLASSES,
    *edit_operators.CLASSES,
    *variant_panel.CLASSES,
    *report_panels.CLASSES,
    *analysis.CLASSES,
    *apart.CLASSES,
    *hover.CLASSES,
    *parameter_panels.CLASSES,
    *panels.LAST,
]


@persistent
def _before_load(*_):
    """Runs before another file is opened. The server continues the bake; this file's note says so."""
    live.show(False)
    glue.show(False)
    variants.forget()
    aside.forget()
    weighing.forget()
    running.forget_all()
    states.forget()
    estimates.forget()


@persistent
def _after_load(*_):
    running.left = pending.of_this_file()
    # Blender may have saved this file by itself, with colors.
    states.restore()
    aside.bring_back()


@persistent
def _before_save(*_):
    states.restore()
    aside.bring_back()


@persistent
def _after_save(*_):
    bake = running.bake
    if bake is not None and not bake.end and bake.recipe:
        pending.note(bake.recipe, bake.job.bake_id)
    states.refresh(bpy.context.scene)
    aside.refresh(bpy.context)


@persistent
def _after_undo(*_):
    # The undo step may be from before the colors were set, or from before they were removed.
    states.refresh(bpy.context.scene)
    aside.refresh(bpy.context)


HANDLERS = {
    "load_pre": _before_load,
    "load_post": _after_load,
    "save_pre": _before_save,
    "save_post": _after_save,
    "undo_post": _after_undo,
    "redo_post": _after_undo,
}


# Of this session, not of the file: options that the panels show before an operator runs, as the operator has them.
OPTIONS = {
    "cairn_seed_count": (variant_operators.CAIRN_OT_try_seeds, "count"),
    "cairn_seed_glue": (variant_operators.CAIRN_OT_try_seeds, "is_with_glue"),
    "cairn_seed_shapes": (variant_operators.CAIRN_OT_try_seeds, "kept_shapes"),
    "cairn_seed_strengths": (variant_operators.CAIRN_OT_try_seeds, "strengths"),
    "cairn_add_count": (edit_operators.CAIRN_OT_add_on_top, "count"),
    "cairn_add_region": (edit_operators.CAIRN_OT_add_on_top, "region"),
}


def register():
    properties.register()
    bpy.types.WindowManager.cairn_warnings = BoolProperty(
        name="Warnings", description="Show the server's warnings about the scene or the pile"
    )
    for name, (operator, option) in OPTIONS.items():
        setattr(bpy.types.WindowManager, name, operator.__annotations__[option])
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    states.register()
    live.register()
    glue.register()
    menus.register()
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    atexit.register(preferences.stop_server)


def unregister():
    atexit.unregister(preferences.stop_server)
    menus.unregister()
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
    for name in ("cairn_warnings", *OPTIONS):
        delattr(bpy.types.WindowManager, name)
    properties.unregister()
