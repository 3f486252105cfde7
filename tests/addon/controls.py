"""Makes the pictures of the panel, with a number beside each control: run by Blender 3.4 in a real window.

    CAIRN_PICTURE=tall blender --factory-startup --window-geometry 0 0 800 6600 --python controls.py
    CAIRN_PICTURE=short blender --factory-startup --window-geometry 0 0 800 1000 --python controls.py

`tests/addon/run pictures` makes them; `addon/controls.md` says what each number is. $CAIRN_ADDON is the add-on's zip,
$CAIRN_SCREENSHOTS where they go.
"""

import os
import sys

import blf
import bpy
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from blocks import bodies_of
from hands import SCREENSHOTS, click, drag, sidebar, view, wait, xdotool
from window import install, make_scene, start

# All panels at once, or the states in which few of them differ.
IS_TALL = os.environ["CAIRN_PICTURE"] == "tall"
# The tab, before any object is there, from the view's right edge and its top; and how wide the sidebar becomes.
TAB, WIDTH = (12, 166), 300
# Room for the numbers, left of the sidebar, and what is right of it: tabs.
MARGIN, TABS = 34, 26
# Pictures, each of one or more columns: top and bottom, and where its controls are, in pixels from the window's top.
FINISHED = {
    "pile": [(80, 485, (127, 150, 194, 217, 249, 386, 430, 463))],
    "size": [(492, 898, (537, 573, 610, 636, 688, 737, 758, 779, 805, 831, 857, 880))],
    "quality": [(898, 1350, (1006, 1137, 1163, 1226, 1252, 1278, 1304, 1330))],
    "pose": [(1350, 1961, (1393, 1419, 1445, 1471, 1523, 1549, 1612, 1675, 1701, 1722, 1743, 1811))],
    "report": [(1961, 2920, (2108, 2250, 2308, 2356, 2382, 2408, 2434, 2460, 2523, 2549, 2758))],
    "physics": [
        (2983, 3361, (3026, 3052, 3073, 3094, 3115, 3136, 3157, 3178, 3241, 3304, 3327, 3350)),
        (3361, 3713, (3373, 3438, 3496, 3519, 3584, 3628, 3691)),
        (3713, 4238, (4113, 4139, 4165, 4191, 4217)),
    ],
    "advanced": [
        (4238, 4989, (4334, 4759)),
        (4989, 5687, (5002, 5481)),
        (5687, 6359, (5700, 6049)),
        (6359, 6709, (6372, 6591)),
    ],
}
marks = []


def draw_marks():
    """The numbers, left of the sidebar."""
    area = bpy.context.area
    region = next(region for region in area.regions if region.type == "UI")
    height = bpy.context.window.height
    blf.size(0, 17.0)
    blf.color(0, 1.0, 0.82, 0.2, 1.0)
    for number, y in marks:
        blf.position(0, region.x - area.x - MARGIN + 8, height - y - area.y - 6, 0)
        blf.draw(0, str(number))


def region_of(area, kind):
    return next(region for region in area.regions if region.type == kind)


def take(area, name, columns):
    """A picture of parts of the sidebar, side by side."""
    marks[:] = enumerate((y for *_, places in columns for y in places), start=1)
    area.tag_redraw()
    yield 0.7
    path = os.path.join(SCREENSHOTS, "window.png")
    bpy.ops.screen.screenshot(filepath=path)
    image = bpy.data.images.load(path)
    wide, high = image.size
    pixels = np.empty(wide * high * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(high, wide, 4)[::-1]
    bpy.data.images.remove(image)
    panel = region_of(area, "UI")
    parts = [pixels[top:bottom, panel.x - MARGIN : panel.x + panel.width - TABS] for top, bottom, _ in columns]
    tall = max(map(len, parts))
    parts = [np.pad(part, ((0, tall - len(part)), (0, 0), (0, 0)), mode="edge") for part in parts]
    save(np.concatenate(parts, axis=1), os.path.join(SCREENSHOTS, f"controls-{name}.jpg"))


def save(pixels, path):
    high, wide, _ = pixels.shape
    image = bpy.data.images.new("cut", wide, high)
    image.pixels.foreach_set(np.ascontiguousarray(pixels[::-1]).ravel())
    scene = bpy.data.scenes.new("save")
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format, scene.render.image_settings.quality = "JPEG", 88
    image.save_render(path, scene=scene)
    bpy.data.scenes.remove(scene)
    bpy.data.images.remove(image)


def walk():
    for source in list(bpy.data.objects):
        bpy.data.objects.remove(source)
    area = sidebar()
    yield 0.5
    with view(area):
        # Nothing but the view, in which nothing is to be seen.
        bpy.ops.screen.screen_full_area()
    yield 1.0
    area = sidebar()
    top, right = bpy.context.window_manager.windows[0].height, area.x + area.width
    yield from click(right - TAB[0], top - (area.y + area.height) + TAB[1])
    yield 0.7
    edge = region_of(area, "UI").x + 6
    yield from drag((edge, 500), (right - WIDTH, 500))
    make_scene(area, stick_at=(1.5, 0, 0.2))
    space, settings, manager = area.spaces[0], bpy.context.scene.cairn, bpy.context.window_manager
    space.overlay.show_overlays = space.show_gizmo = False
    space.region_3d.view_distance = 900.0
    block = bpy.data.objects["Stick"].copy()
    block.name, block.scale = "Block", (0.2, 0.2, 0.2)
    settings.prop_collection.objects.link(block)
    settings.accuracy, settings.kept_shape, settings.arrangement.layout = "DRAFT", "TACKY", "BANDS"
    bpy.types.SpaceView3D.draw_handler_add(draw_marks, (), "WINDOW", "POST_PIXEL")
    yield from (finished if IS_TALL else others)(area, settings, manager)


def finished(area, settings, manager):
    """All panels beside a finished pile. Each of these waits, so that a window of this height need not be drawn."""
    with view(area):
        assert bpy.ops.cairn.bake() == {"FINISHED"}
        assert bpy.ops.cairn.check() == {"FINISHED"}
    manager.cairn_states = manager.cairn_seed_glue = True
    yield 0.5
    for name, columns in FINISHED.items():
        yield from take(area, name, columns)


def others(area, settings, manager):
    """Other states of the panel."""
    from cairn import result, running, variants

    settings.accuracy, settings.use_frame_count, settings.frame_count = "STANDARD", True, 30000
    with view(area):
        bpy.ops.cairn.bake("INVOKE_DEFAULT")
    yield from wait(lambda: running.bake and running.bake.frame_count > 5, "frames")
    yield from take(area, "running", RUNNING)
    running.bake.stop()
    yield from wait(lambda: running.bake and running.bake.end == "stopped", "the end")
    # Closes the popup.
    xdotool("mousemove", 20, 700)
    yield 1.0
    yield from take(area, "stopped", STOPPED)
    bpy.ops.cairn.discard()

    settings.accuracy, settings.use_frame_count = "DRAFT", False
    with view(area):
        bpy.ops.cairn.try_seeds(count=2)
    yield from wait(lambda: not variants.is_trying(), "the variants")
    yield 0.5
    yield from take(area, "variants", VARIANTS)
    bpy.context.scene.cairn_variants.clear()

    with view(area):
        bpy.ops.cairn.bake()
        bpy.ops.cairn.edit_pile()
        bpy.data.objects["Cone"].vertex_groups.new(name="Drop Here")
        bodies_of(result.chosen(bpy.context))[0].select_set(True)
    manager.cairn_add_region = "Drop Here"
    yield 0.5
    yield from take(area, "edit", EDIT)

    settings.use_inside, settings.prop_source = True, "LIST"
    for source in settings.prop_collection.objects:
        settings.props.add().object = source
    yield 0.5
    yield from take(area, "list", LIST)


# Of other states of the panel.
RUNNING = [(80, 376, (249, 291, 328, 354))]
STOPPED = [(80, 310, (249,))]
VARIANTS = [(425, 735, (469, 495, 521, 707))]
EDIT = [(425, 725, (469, 490, 511, 537, 688))]
LIST = [(80, 470, (173, 196, 219, 301))]


def open_panels():
    """Before the tab is seen for the first time: later, Blender keeps what is open."""
    from cairn import CLASSES

    panels = [cls for cls in CLASSES if issubclass(cls, bpy.types.Panel) and getattr(cls, "bl_parent_id", "")]
    # Those inside of others first.
    for cls in reversed(panels):
        bpy.utils.unregister_class(cls)
        is_open = IS_TALL or cls.__name__.rpartition("_PT_")[2] in ("edit", "variants")
        cls.bl_options = set() if is_open else {"DEFAULT_CLOSED"}
    for cls in panels:
        bpy.utils.register_class(cls)


install()
open_panels()
start(walk())
