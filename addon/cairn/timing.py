"""When a baked pile collapses, and how fast: changed after the bake, without another one, as often as you like."""

import json

import bpy
import numpy as np

from . import belongings, keyframes, points


def times(count, start, hold, speed, ease):
    """At which frame of the scene each frame of the result is shown, shape [count], ascending."""
    last = max(count - 1, 1)
    return start + hold + (np.arange(count) / last) ** (0.5**ease) * last / speed


def _timing_of(note):
    return json.loads(note.timed) if note.timed else [note.timing_start, 0, 1.0, 0.0]


def shown(collection):
    """The current times of the pile."""
    return times(collection.cairn.frame_count, *_timing_of(collection.cairn))


def number_at(collection, frame):
    """The frame of the result at a scene frame; it may be fractional."""
    start, hold, speed, ease = _timing_of(collection.cairn)
    last = max(collection.cairn.frame_count - 1, 0)
    share = max(frame - start - hold, 0.0) * speed / max(last, 1)
    return min(share ** (2.0**ease) * last, last)


def set_by_bake(collection, start_frame, frame_count):
    """Sets the timing of a new pile, which plays as it was baked."""
    note = collection.cairn
    note.frame_count, note.timed = frame_count, json.dumps([start_frame, 0, 1.0, 0.0])
    # Without their updates.
    note["timing_start"], note["timing_hold"], note["timing_speed"], note["timing_ease"] = start_frame, 0, 1.0, 0.0


def apply(collection):
    """Applies the pile's timing settings."""
    note = collection.cairn
    if not note.frame_count or note.mode == "POSE":
        return
    before = shown(collection)
    values = [note.timing_start, note.timing_hold, note.timing_speed, note.timing_ease]
    note.timed = json.dumps(values)
    after = shown(collection)
    is_unchanged = belongings.Unchanged(collection)
    for body in belongings.bodies(collection):
        is_own = is_unchanged(body)
        if note.mode == "POINTS":
            points.retime(body, note.frame_count - 1, *values)
        elif body.animation_data and body.animation_data.action:
            keyframes.retime(body.animation_data.action, before, after)
        if is_own:
            belongings.mark(body)


def keep_end(collection):
    """Keeps only the final pose of an animated pile."""
    end, used = end_of(collection), set()
    is_unchanged = belongings.Unchanged(collection)
    for body in belongings.bodies(collection):
        is_own = is_unchanged(body)
        if collection.cairn.mode == "POINTS":
            points.keep_end(body)
        elif body.animation_data and body.animation_data.action:
            used.add(body.animation_data.action)
            keyframes.freeze(body, end)
        if is_own:
            belongings.mark(body)
    bpy.data.batch_remove([action for action in used if action.users == 0])
    note = collection.cairn
    note.mode = note.mode if note.mode == "POINTS" else "POSE"
    note.frame_count = 0


def beyond(collection, scene):
    """A sentence about a motion that goes on after the scene's end; empty where it does not."""
    end = end_of(collection) if collection.cairn.mode != "POSE" else 0
    return f"It moves until frame {end}, and the scene ends at {scene.frame_end}" if end > scene.frame_end else ""


def end_of(collection):
    """The frame of the scene from which on nothing moves."""
    return int(np.ceil(shown(collection)[-1] - 1e-3)) if collection.cairn.frame_count else 1
