"""Bodies behind a wall: where a shape reaches through a collider, the fill is on both of its sides."""

import bpy
from mathutils import Vector
from mathutils.kdtree import KDTree

from . import axes, placed, request

# Neighbors of a body that are looked at.
NEAREST = 8


def notes(scene, frames, metres):
    """A generator: gives sentences about bodies that colliders keep apart from the others; none without them.
    `frames`: snapshots of a bake."""
    walls = [source for source in request.colliders_of(scene.cairn) if not placed.is_animated(source)]
    walls = [source for source in walls if source.type == "MESH" and source != scene.cairn.control_mesh]
    first, last = frames[0], frames[-1]
    # An entrance begins with few bodies.
    shots = [last] if len(frames) == 1 or first.present.sum() != last.present.sum() else [first, last]
    counts, said = [], []
    for shot in shots if walls else ():
        places = [Vector(place) for place in axes.points_to_blender(shot.positions[shot.present], metres)]
        found, names = yield from _behind(walls, places)
        counts.append((found, len(places)))
        said.append(" and ".join(f"“{name}”" for name in names[:3]))
    if not counts:
        return []
    begin, (end, count) = counts[0][0], counts[-1]
    if not begin:
        verb = "comes" if end == 1 else "come"
        over = f"{end} of {count} bodies {verb} to lie behind {said[-1]}, over its rim. Make the shape lower there"
        return [over] if end else []
    text = (
        f"{begin} of {count} bodies {'lies' if begin == 1 else 'lie'} behind {said[0]}, apart from the others: "
        "the shape reaches through. Move the shape off the wall, if nothing should lie there"
    )
    return [f"{text}. In the end, {end} lie behind it: others went over it" if end > begin else text]


def _behind(walls, places):
    """A generator: gives the number of bodies that colliders keep apart from the others, and the colliders' names."""
    if len(places) < 2:
        return 0, []
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
    return len(apart), sorted({blocked[one].name for one in apart if one in blocked})


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
