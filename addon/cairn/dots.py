"""The dots of glue of a pile, as its collection remembers them."""

import functools
import json

import numpy as np

from . import axes

# Loads, in weights of a typical prop, from which a dot or a body has the next color (sRGB), from pale to dark red:
# distinguished by lightness, too.
LOADS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
COLORS = np.array(
    [
        (1.00, 0.96, 0.75),
        (1.00, 0.86, 0.50),
        (0.99, 0.72, 0.35),
        (0.97, 0.54, 0.26),
        (0.89, 0.33, 0.18),
        (0.73, 0.13, 0.13),
        (0.45, 0.00, 0.10),
    ]
)


def remembered(job, report, metres):
    """The glue that a collection remembers, from a report and the last frame. For each dot: its bodies, its position
    on the first of them (in the body's own axes, Blender's, scene units), its load in weights of a typical prop,
    whether it broke. The largest loads come first."""
    dots = (report.get("glue") or {}).get("dots", ())
    frames = job.recording.frames
    if not dots or not frames:
        return []
    forces = [float(np.linalg.norm(dot["force"])) for dot in dots]
    # The report also has the largest load in weights.
    largest = report["measures"].get("glue_force_max") or 0.0
    weight = max(forces) / largest if largest else 1.0
    last, made = frames[-1], []
    for dot, force in zip(dots, forces):
        body = dot["body"]
        position = axes.points_to_blender(last.positions[body].astype(float), metres)
        w, x, y, z = axes.rotations_to_blender(last.rotations[body].astype(float))
        turn = axes.matrices(np.zeros((1, 3)), np.array([[w, x, y, z]]), np.ones(1))[0, :, :3]
        at = turn.T @ (axes.points_to_blender(np.array(dot["point"]), metres) - position)
        made.append(
            {
                "body": body,
                "other": dot["other"],
                "at": [round(float(value), 6) for value in at],
                "load": round(force / weight, 4) if weight else 0.0,
                # A collapse ends all glue: that is not for its load.
                "broken": dot["is_broken"] and not report.get("collapse"),
            }
        )
    return sorted(made, key=lambda dot: -dot["load"])


def level(load):
    """The color of a load."""
    return int(np.searchsorted(LOADS, load, side="right")) - 1


def loads(collection, dots, count):
    """The largest load of each body's dots, as levels counted from 1; 0 of those that no dot holds. Shape [count]."""
    levels = np.zeros(count, int)
    for dot in dots:
        for body in (dot["body"], dot["other"]):
            number = number_of(collection, body)
            if number is not None and 0 < number <= count:
                levels[number - 1] = max(levels[number - 1], 1 + level(dot["load"]))
    return levels


@functools.lru_cache(maxsize=4)
def _left_out(text):
    return json.loads(text or "[]")


def number_of(collection, body):
    """The number that the pile's objects have for a body of the server; None for the ground and for bodies that are
    not shown."""
    left_out = _left_out(collection.cairn.left_out)
    if body is None or body in left_out:
        return None
    return 1 + body - sum(other < body for other in left_out)


def body_of(collection, number):
    """The body of the server that the pile's objects have this number for. `collection`: None without a pile."""
    body = number - 1
    for other in _left_out(collection.cairn.left_out) if collection else ():
        body += other <= body
    return body
