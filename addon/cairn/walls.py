"""Bodies behind a wall: where a shape reaches through a collider, the fill is on both of its sides."""

import bpy
from mathutils import Vector
from mathutils.kdtree import KDTree

from . import axes, placed, request

# Neighbors of a body that are looked at.
NEAREST = 8


def notes(scene, frames, metres):
    """A generator: gives a sentence about bodies that colliders keep apart from the others; none without them.
    `frames`: snapshots of a bake."""
    walls = [source for source in request.colliders_of(scene.cairn) if not placed.is_animated(source)]
    walls = [source for source in walls if source.type == "MESH" and source != scene.cairn.control_mesh]
    # An entrance begins with few bodies.
    shot = frames[0] if frames[0].present.sum() == frames[-1].present.sum() else frames[-1]
    places = [Vector(place) for place in axes.points_to_blender(shot.positions[shot.present], metres)] if walls else []
    if len(places) < 2:
        return []
    tree = KDTree(len(places))
    for number, place in enumerate(places):
        tree.insert(place, number)
    tree.balance()
    # Pairs of neighbors, and what is between them.
    pairs, blocked, seen = [], {}, set()
    for number, place in enumerate(places):
        for near, other, _ in tree.find_n(place, NEAREST + 1):
            pair = min(number, other), max(number, other)
            if number == other or pair in seen:
                continue
            seen.add(pair)
            wall = next((wall for wall in walls if _is_between(wall, place, near)), None)
            if wall is None:
                pairs.append(pair)
            else:
                blocked[number], blocked[other] = wall, wall
        yield
    rim = max((_top(wall) for wall in set(blocked.values())), default=0.0)
    below = {number for number, place in enumerate(places) if place.z < rim}
    # Bodies above the rim join what lies on both sides of a wall. Of a board that divides the pile, all above it would.
    apart = max(_apart(pairs, set(range(len(places))), blocked), _apart(pairs, below, blocked), key=len)
    names = {blocked[one].name for one in apart if one in blocked}
    through = " and ".join(f"“{name}”" for name in sorted(names)[:3])
    verb = "lies" if len(apart) == 1 else "lie"
    text = (
        f"{len(apart)} of {len(places)} bodies {verb} behind {through}, apart from the others: "
        "the shape reaches through. Move the shape off the wall, if nothing should lie there"
    )
    return [text] if apart else []


def _apart(pairs, which, blocked):
    """Those of these bodies that are not joined to most of them, and that something keeps apart."""
    group = {number: number for number in which}

    def top(number):
        while group[number] != number:
            group[number] = number = group[group[number]]
        return number

    for one, other in pairs:
        if one in group and other in group:
            group[top(one)] = top(other)
    members = {}
    for number in which:
        members.setdefault(top(number), []).append(number)
    most = max(members.values(), key=len, default=[])
    others = (ones for ones in members.values() if ones is not most and any(one in blocked for one in ones))
    return [one for ones in others for one in ones]


def _top(wall):
    """Height of a collider's highest corner."""
    return max((wall.matrix_world @ Vector(corner)).z for corner in wall.bound_box)


def _is_between(wall, start, end):
    """Whether a collider crosses the way between two places."""
    shown = wall.evaluated_get(bpy.context.view_layer.depsgraph)
    inward = shown.matrix_world.inverted_safe()
    start, way = inward @ start, inward @ end - inward @ start
    return way.length > 0 and shown.ray_cast(start, way, distance=way.length)[0]
