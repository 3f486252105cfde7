"""Acts in a window like a person, by xdotool, and waits. Each step yields the pause until the next, s."""

import os
import subprocess
import time

import bpy

PATIENCE = 60.0
SCREENSHOTS = os.environ["CAIRN_SCREENSHOTS"]


pressed_at = 0.0


def xdotool(*words):
    subprocess.run(["xdotool", *map(str, words)], check=True)


def click(x, y, button=1):
    """Moves and presses as a hand does: in steps, between which Blender looks."""
    for step in (8, 4, 0):
        xdotool("mousemove", x, y + step)
        yield 0.1
    xdotool("mousedown", button)
    yield 0.1
    press_done()
    xdotool("mouseup", button)
    yield 0.02


def drag(start, end):
    for step in (8, 4, 0):
        xdotool("mousemove", start[0] - step, start[1])
        yield 0.15
    xdotool("mousedown", 1)
    yield 0.2
    for share in (0.05, 0.1, 0.3, 0.6, 1.0):
        xdotool("mousemove", *(round(a + share * (b - a)) for a, b in zip(start, end)))
        yield 0.2
    xdotool("mouseup", 1)
    yield 0.3


def press(key):
    press_done()
    xdotool("key", key)
    yield 0.02


def press_done():
    """What is asked for is asked for now: a button acts when it is released."""
    global pressed_at
    pressed_at = time.monotonic()


def picture(name):
    bpy.ops.screen.screenshot(filepath=os.path.join(SCREENSHOTS, name))


def sidebar():
    area = next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D")
    area.spaces[0].show_region_ui = True
    return area


def view(area):
    region = next(region for region in area.regions if region.type == "WINDOW")
    return bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=area, region=region)


def wait(until, what):
    end = time.monotonic() + PATIENCE
    while not until():
        assert time.monotonic() < end, f"waited in vain for {what}"
        yield 0.02
