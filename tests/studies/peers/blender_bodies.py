"""Blender's own rigid bodies, as an artist bakes them. Also used by tests/addon/benchmark.py."""

import time

import bpy


def select(objects):
    for other in bpy.context.view_layer.objects:
        other.select_set(False)
    for chosen in objects:
        chosen.select_set(True)
    bpy.context.view_layer.objects.active = objects[0]


def add(objects, kind):
    """`kind`: ACTIVE or PASSIVE."""
    select(objects)
    bpy.ops.rigidbody.objects_add(type=kind)


def begin(frames):
    """A world of rigid bodies over frames 1 to `frames`."""
    bpy.ops.rigidbody.world_add()
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, frames
    scene.rigidbody_world.point_cache.frame_start, scene.rigidbody_world.point_cache.frame_end = 1, frames
    return scene.rigidbody_world


def bake(bodies, frames, cpu=time.process_time):
    """Simulates, and makes keyframes of it. CPU seconds of the first, and of both."""
    started = cpu()
    bpy.ops.ptcache.bake_all(bake=True)
    simulated = cpu() - started
    select(bodies)
    # It asks for a view.
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    with bpy.context.temp_override(window=window, area=area, region=area.regions[-1]):
        bpy.ops.rigidbody.bake_to_keyframes(frame_start=1, frame_end=frames, step=1)
    return simulated, cpu() - started
