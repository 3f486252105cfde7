"""An artist at the panel: run by Blender 3.4 in a real window, with xdotool's mouse and keys.

    blender --factory-startup --window-geometry 0 0 1400 900 --python ui.py

Bakes four times: stopped by Esc and by the Stop button, and to the end, as objects and as points, both of them
colored by state, too. $CAIRN_ADDON is the add-on's zip,
$CAIRN_SCREENSHOTS a folder for pictures of the window.
"""

import gc
import os
import sys
import time

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from blocks import bodies_of
import hands
import ui_hour
from hands import click, picture, press, sidebar, view, wait, xdotool
from window import install, make_scene, start

# Where things are in this window at this size, in pixels from its left and its top: the tab, before any object is
# there; the button; Live, at the right end of the same row; and Stop, below, while a bake runs.
TAB = 1144, 192
BAKE = 1000, 249
LIVE = 1106, 249
STOP = 1000, 328
VIEW = 600, 500
OUTLINER = 1270, 170


def answer_escape():
    """Esc asks; the answer lies under the pointer."""
    xdotool("mousemove", *VIEW)
    yield 0.3
    yield from press("Escape")
    yield 0.6
    picture("3-question.png")
    yield from click(VIEW[0], VIEW[1] + 2)


def walk():
    """The steps; what is yielded is the pause until the next, s."""
    from cairn import live, running

    bake_button = BAKE
    for source in list(bpy.data.objects):
        bpy.data.objects.remove(source)
    area = sidebar()
    yield 1.0
    yield from click(*TAB)
    yield 1.0
    picture("1-empty.png")
    make_scene(area, stick_at=(1.5, 0, 0.2))
    with view(area):
        bpy.ops.view3d.view_all()
    settings = bpy.context.scene.cairn
    yield 1.0
    picture("2-before.png")
    objects = sorted(bpy.data.objects.keys())
    yield from wait(lambda: running.plan, "what a bake is expected to take")
    assert {"DRAFT", "STANDARD", "FINE"} <= set(running.plan["times"])
    yield 0.5
    picture("2-expected.png")
    yield from ui_hour.idle()
    with view(area):
        bpy.ops.ed.undo_push(message="scene")

    # To be stopped on the way. A click elsewhere, or Esc without an answer, does not.
    settings.accuracy, settings.use_frame_count, settings.frame_count = "DRAFT", True, 100000
    for name, stop in (("escape", answer_escape), ("button", lambda: click(*STOP))):
        yield from click(*bake_button)
        yield from wait(lambda: running.bake and running.bake.frame_count > 5, f"frames, to stop by {name}")
        yield 0.5
        picture(f"3-{name}.png")
        bake = running.bake
        yield from click(*VIEW, 3)
        yield 0.5
        # Closes the menu.
        xdotool("mousemove", 300, 700)
        yield 0.5
        # Pressed once more.
        yield from click(*LIVE)
        yield 0.3
        assert not bake.end and not live.is_on
        yield from stop()
        yield from wait(lambda: bake.end, f"the end by {name}")
        print(f"stopped by {name}: at most {time.monotonic() - hands.pressed_at:.2f} s later", flush=True)
        assert bake.end == "stopped" and sorted(bpy.data.objects.keys()) == objects
        yield 0.5
        picture(f"4-stopped-by-{name}.png")
        # The popup closes, and the panel still asks.
        xdotool("mousemove", 300, 500)
        yield 0.5
        assert bpy.ops.cairn.discard() == {"FINISHED"}
        yield 0.5

    yield from during_the_fill(bake_button, objects)
    settings.accuracy, settings.use_frame_count = "STANDARD", False
    frozen = gc.get_freeze_count()
    yield from click(*bake_button)
    yield from wait(lambda: running.bake and running.bake.job.latest, "the pile to form")
    assert gc.get_freeze_count() > frozen, "a pass over all of Python's objects may come while the pile forms"
    yield 1.0
    picture("5-during.png")
    bpy.context.window_manager.cairn_states = True
    yield from wait(lambda: not running.bake or running.bake.job.latest.states.any(), "states")
    yield 0.3
    picture("5-during-by-state.png")
    bpy.context.window_manager.cairn_states = False
    yield from wait(lambda: running.bake is None, "the pile")
    pile = bpy.data.collections["Cone Pile"]
    count, frames = len(bodies_of(pile)), running.report_of(pile)["frame_count"]
    assert count > 20 and running.report_of(pile)["is_whole"]
    assert gc.get_freeze_count() == frozen
    # The figures may come later.
    yield from wait(lambda: "measures" in running.report_of(bpy.data.collections["Cone Pile"]), "the report")
    report = running.report_of(bpy.data.collections["Cone Pile"])
    assert (report["body_count"], report["frame_count"]) == (count, frames), report
    assert report["result_hash"]
    yield 1.0
    picture("6-after.png")
    with view(area):
        bpy.ops.ed.undo()
    assert "Cone Pile" not in bpy.data.collections and sorted(bpy.data.objects.keys()) == objects
    with view(area):
        bpy.ops.ed.redo()
    assert len(bodies_of(bpy.data.collections["Cone Pile"])) == count
    assert "measures" in running.report_of(bpy.data.collections["Cone Pile"])
    yield from by_state(area, "objects")
    # Undo has put another scene in the old one's place.
    bpy.context.scene.cairn.output_mode = "POINTS"
    with view(area):
        bpy.ops.cairn.bake("INVOKE_DEFAULT")
    yield from wait(lambda: running.bake is None, "the pile of points")
    yield from by_state(area, "points")
    yield from ui_hour.work(area)
    print("1 passed, 0 failed", flush=True)


def during_the_fill(bake_button, objects):
    """A right-click, or Esc in another editor, ends nothing; Esc over the view asks, and the bodies can be kept."""
    from cairn import running

    settings = bpy.context.scene.cairn
    settings.accuracy, common = "REFERENCE", settings.prop_common
    # Thousands of small props: time enough.
    common.scale_min = common.scale_max = 0.3
    yield from click(*bake_button)
    yield from wait(lambda: running.bake and running.bake.job.latest, "the fill")
    bake = running.bake
    assert not bake.frame_count
    for place in (VIEW, OUTLINER):
        yield from click(*place, 3)
        yield 0.4
        # Closes the menu.
        xdotool("mousemove", 300, 700)
        yield 0.4
    xdotool("mousemove", *OUTLINER)
    yield 0.3
    yield from press("Escape")
    yield 0.4
    assert not bake.end and running.bake is bake
    yield from answer_escape()
    yield from wait(lambda: bake.end, "the end during the fill")
    assert bake.end == "stopped" and not bake.frame_count and bake.kept_kind().endswith("Bodies as They Are")
    assert sorted(bpy.data.objects.keys()) == objects
    yield 0.5
    picture("4-stopped-during-the-fill.png")
    xdotool("mousemove", 300, 500)
    yield 0.5
    assert bpy.ops.cairn.discard() == {"FINISHED"}
    common.scale_min = common.scale_max = 1.0
    yield 0.5


def by_state(area, name):
    """Pictures on the way; and nothing of it stays."""
    shading, scene = area.spaces[0].shading, bpy.context.scene
    before, objects = shading.color_type, sorted(bpy.data.objects.keys())
    bpy.context.window_manager.cairn_states = True
    for frame in (1, 12, 100):
        scene.frame_set(frame)
        yield 0.6
        picture(f"7-{name}-by-state-{frame}.png")
    assert shading.color_type == "OBJECT"
    bpy.context.window_manager.cairn_states = False
    yield 0.4
    assert shading.color_type == before and sorted(bpy.data.objects.keys()) == objects


install()
start(walk())
