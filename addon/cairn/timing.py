"""When a baked pile collapses, and how fast: changed after the bake, without another one, as often as one likes."""

import json

import numpy as np

from . import keyframes, points


def times(count, start, hold, speed, ease):
    """At which frame of the scene each frame of the result is shown, shape [count]: rising."""
    last = max(count - 1, 1)
    return start + hold + (np.arange(count) / last) ** (0.5**ease) * last / speed


def shown(collection):
    """The times as the pile has them now."""
    note = collection.cairn
    told = json.loads(note.timed) if note.timed else [note.timing_start, 0, 1.0, 0.0]
    return times(note.frame_count, *told)


def set_by_bake(collection, start_frame, frame_count):
    """A new pile: it plays as it was baked."""
    note = collection.cairn
    note.frame_count, note.timed = frame_count, json.dumps([start_frame, 0, 1.0, 0.0])
    # Without their updates.
    note["timing_start"], note["timing_hold"], note["timing_speed"], note["timing_ease"] = start_frame, 0, 1.0, 0.0


def apply(collection):
    """The pile plays as its settings say."""
    note = collection.cairn
    if not note.frame_count or note.mode == "POSE":
        return
    before = shown(collection)
    told = [note.timing_start, note.timing_hold, note.timing_speed, note.timing_ease]
    note.timed = json.dumps(told)
    after = shown(collection)
    for body in collection.objects:
        if note.mode == "POINTS":
            points.retime(body, note.frame_count - 1, *told)
        elif body.animation_data and body.animation_data.action:
            keyframes.retime(body.animation_data.action, before, after)


def end_of(collection):
    """The frame of the scene from which on nothing moves."""
    return int(np.ceil(shown(collection)[-1] - 1e-3)) if collection.cairn.frame_count else 1
