"""Makes one of the pictures in the README files, as an artist would: run by Blender 3.4 in a real window.

    CAIRN_PICTURE=variants blender --factory-startup --window-geometry 0 0 1100 860 --python pictures.py

`tests/addon/run pictures` makes all of them. $CAIRN_ADDON is the add-on's zip, $CAIRN_SCREENSHOTS where they go.
"""

import os
import sys

import bpy
from mathutils import Vector

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from hands import SCREENSHOTS, click, drag, sidebar, view, wait, xdotool
from window import follow_changes, install, make_scene, start, take_out

NAME = os.environ["CAIRN_PICTURE"]
# Which panels are open.
OPEN = {
    "panel": {"states", "support", "props", "quality"},
    "live": {"support", "props", "quality"},
    "variants": {"variants"},
    "glue": {"holds"},
    "edit": {"edit"},
}[NAME]
# The tab, before any object is there, from the view's right edge and its top; and how wide the sidebar becomes.
TAB = 12, 166
WIDTH = 330


def region_of(area, kind):
    return next(region for region in area.regions if region.type == kind)


def take(area):
    """A picture of the view with its sidebar."""
    xdotool("mousemove", 300, 700)
    yield 1.0
    with view(area):
        bpy.ops.screen.screenshot_area(filepath=os.path.join(SCREENSHOTS, f"{NAME}.png"))


def baked(area):
    from cairn import running

    with view(area):
        bpy.ops.cairn.bake("INVOKE_DEFAULT")
    yield from wait(lambda: running.bake is None, "the pile")
    yield from wait(lambda: not running.measuring, "the report")


def panel(area):
    from cairn import running

    bpy.context.scene.cairn.kept_shape = "NATURAL"
    yield from baked(area)
    bpy.context.window_manager.cairn_states = True
    bpy.context.scene.frame_set(4)
    # What is expected of a natural pile, not of the one before.
    yield from wait(lambda: not running.plan_is_old, "the estimates")


def live(_):
    yield from follow_changes()


def variants(area):
    from cairn import variants

    manager, settings = bpy.context.window_manager, bpy.context.scene.cairn
    settings.accuracy = "DRAFT"
    manager.cairn_seed_glue, manager.cairn_seed_count = True, 2
    manager.cairn_seed_shapes, manager.cairn_seed_strengths = {"AS_MODELLED"}, "1"
    with view(area):
        bpy.ops.cairn.try_seeds(count=2, is_with_glue=True, kept_shapes={"AS_MODELLED"}, strengths="1")
    yield from wait(lambda: not variants.is_trying(), "the variants")
    with view(area):
        bpy.ops.cairn.show_variant(variant=bpy.context.scene.cairn_variants[2].name)


def glue(area):
    cone = bpy.data.objects["Cone"]
    cone.rotation_euler.x = 3.14159265
    yield 0.5
    yield from baked(area)
    manager = bpy.context.window_manager
    manager.cairn_glue = manager.cairn_loads = True


def edit(area):
    from cairn import result, running

    yield from baked(area)
    yield from take_out(area, Vector((0.6, 0, 0.1)), 14)
    cone = bpy.data.objects["Cone"]
    group = cone.vertex_groups.new(name="Drop Here")
    group.add([vertex.index for vertex in cone.data.vertices if vertex.co.x > 0.3], 1.0, "REPLACE")
    manager = bpy.context.window_manager
    manager.cairn_add_region, manager.cairn_add_count = group.name, 20
    with view(area):
        bpy.ops.cairn.add_on_top("INVOKE_DEFAULT", count=20, region=group.name)
    yield from wait(lambda: running.bake is None, "more props")
    yield from wait(lambda: not running.measuring, "the report")
    yield from wait(lambda: "standing" in running.report_of(result.chosen(bpy.context))["settled"], "the verdicts")


def walk():
    from cairn import running

    for source in list(bpy.data.objects):
        bpy.data.objects.remove(source)
    area = sidebar()
    yield 0.5
    with view(area):
        # Nothing but the view.
        bpy.ops.screen.screen_full_area()
    yield 1.0
    area = sidebar()
    top = bpy.context.window_manager.windows[0].height
    right = area.x + area.width
    yield from click(right - TAB[0], top - (area.y + area.height) + TAB[1])
    yield 0.7
    # A little within the region: that much of it is not drawn.
    edge = region_of(area, "UI").x + 6
    yield from drag((edge, 500), (right - WIDTH, 500))
    assert region_of(area, "UI").width >= WIDTH
    make_scene(area, stick_at=(0.1, -1.1, 0.03))
    area.spaces[0].region_3d.view_distance = 3.4
    area.spaces[0].region_3d.view_location = (0.45, -0.1, 0.45)
    yield from wait(lambda: running.plan, "what a bake is expected to take")
    yield from {"panel": panel, "live": live, "variants": variants, "glue": glue, "edit": edit}[NAME](area)
    yield 0.7
    yield from take(area)


def open_panels():
    """Before the tab is seen for the first time: later, Blender keeps what is open."""
    from cairn import CLASSES

    panels = [cls for cls in CLASSES if issubclass(cls, bpy.types.Panel) and getattr(cls, "bl_parent_id", "")]
    # Those inside of others first.
    for cls in reversed(panels):
        bpy.utils.unregister_class(cls)
        is_open = cls.__name__.rpartition("_PT_")[2] in OPEN
        cls.bl_options = set() if is_open else {"DEFAULT_CLOSED"}
    for cls in panels:
        bpy.utils.register_class(cls)


install()
open_panels()
start(walk())
