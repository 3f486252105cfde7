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
    seen = frames[0] if frames[0].present.sum() == frames[-1].present.sum() else frames[-1]
    places = [Vector(place) for place in axes.points_to_blender(seen.positions[seen.present], metres)] if walls else []
    if len(places) < 2:
        return []
    group, blocked = list(range(len(places))), {}
    tree = KDTree(len(places))
    for number, place in enumerate(places):
        tree.insert(place, number)
    tree.balance()

    def top(number):
        while group[number] != number:
            group[number] = number = group[group[number]]
        return number

    for number, place in enumerate(places):
        for near, other, _ in tree.find_n(place, NEAREST + 1):
            if top(number) == top(other):
                continue
            wall = next((wall for wall in walls if _is_between(wall, place, near)), None)
            if wall is None:
                group[top(number)] = top(other)
            else:
                blocked[number], blocked[other] = wall.name, wall.name
        yield
    members = {}
    for number in range(len(places)):
        members.setdefault(top(number), []).append(number)
    most = max(members.values(), key=len)
    apart = [ones for ones in members.values() if ones is not most and any(one in blocked for one in ones)]
    count = sum(map(len, apart))
    names = {blocked[one] for ones in apart for one in ones if one in blocked}
    through = " and ".join(f"“{name}”" for name in sorted(names)[:3])
    text = f"{count} of {len(places)} bodies lie behind {through}, apart from the others: the shape reaches through. "
    return [f"{text}Move the shape off the wall, if nothing should lie there"] if count else []


def _is_between(wall, start, end):
    """Whether a collider crosses the way between two places."""
    shown = wall.evaluated_get(bpy.context.view_layer.depsgraph)
    inward = shown.matrix_world.inverted_safe()
    start, way = inward @ start, inward @ end - inward @ start
    return way.length > 0 and shown.ray_cast(start, way, distance=way.length)[0]
