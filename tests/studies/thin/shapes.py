"""Shapes with thin limbs: each of closed, round cones that overlap, as bytes of a `.glb`. Metres, Y up."""

import json
import math
import struct

AROUND = 16
ALONG = 6


def _limbs():
    """Ends and radii of the limbs of each shape."""

    def turned(k, count, radius, height):
        return radius * math.cos(math.tau * k / count), height, radius * math.sin(math.tau * k / count)

    sides = (-1, 1)
    fingers = [((-0.22 + 0.15 * k, 0.55, 0), (-0.3 + 0.2 * k, 1.1 - 0.05 * abs(k - 1.5), 0)) for k in range(4)]
    branches = [((0, 0.6 + 0.12 * k, 0), turned(k, 2.618, 0.55, 1 + 0.15 * k)) for k in range(5)]
    arms = [(turned(k, 8, 0.2, 0.3), turned(k, 8, 0.75, 0.07)) for k in range(8)]
    ears = [((0.2 * s, 1.25, 0), (0.26 * s, 1.42, 0)) for s in sides]
    hands = [((0.3 * s, 0.65, 0), (0.55 * s, 0.45, 0.1)) for s in sides]
    feet = [((0.16 * s, 0.3, 0), (0.2 * s, 0.06, 0.05)) for s in sides]
    seat = [((-0.3, 0.5, -0.3 + 0.1 * k), (0.3, 0.5, -0.3 + 0.1 * k)) for k in range(7)]
    back = [((-0.3, 0.5 + 0.1 * k, -0.3), (0.3, 0.5 + 0.1 * k, -0.3)) for k in range(1, 6)]
    legs = [((0.3 * s, 0, 0.3 * t), (0.3 * s, 0.5, 0.3 * t)) for s in sides for t in sides]

    def thick(limbs, *radii):
        return [(*ends, *radii) for ends in limbs]

    return {
        "hand": [((0, 0, 0), (0, 0.5, 0), 0.22, 0.26), ((0.2, 0.3, 0), (0.5, 0.65, 0), 0.1, 0.075)]
        + thick(fingers, 0.085, 0.065),
        "tree": [((0, 0, 0), (0, 1, 0), 0.16, 0.11), ((0, 1, 0), (0, 1.7, 0), 0.11, 0.05)]
        + thick(branches, 0.075, 0.05),
        "toy": [((0, 0.45, 0), (0, 0.55, 0), 0.34, 0.32), ((0, 1.05, 0), (0, 1.1, 0), 0.26, 0.24)]
        + thick(ears, 0.09, 0.09)
        + thick(hands, 0.09, 0.08)
        + thick(feet, 0.12, 0.12),
        "chair": thick(seat + back, 0.06, 0.06) + thick(legs, 0.055, 0.055),
        "octopus": [((0, 0.45, 0), (0, 0.7, 0), 0.3, 0.32), *thick(arms, 0.12, 0.07)],
    }


LIMBS = _limbs()


def _frame(a, b):
    """Unit vectors across a limb and along it."""
    along = [q - p for p, q in zip(a, b, strict=True)]
    size = math.dist(a, b)
    z = [v / size for v in along]
    side = (1, 0, 0) if abs(z[0]) < 0.8 else (0, 1, 0)
    x = _cross(side, z)
    size = math.hypot(*x)
    x = [v / size for v in x]
    return x, _cross(z, x), z


def _cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _limb(a, b, thick_a, thick_b):
    """Points and triangles of a cone with round ends."""
    x, y, z = _frame(a, b)
    quarter = [math.pi / 2 * k / ALONG for k in range(ALONG + 1)]
    rings = [(a, -thick_a * math.cos(w), thick_a * math.sin(w)) for w in quarter[1:]]
    rings += [(b, thick_b * math.sin(w), thick_b * math.cos(w)) for w in quarter[:-1]]
    points = [[a[i] - thick_a * z[i] for i in range(3)]]
    for center, height, radius in rings:
        for k in range(AROUND):
            u, v = radius * math.cos(math.tau * k / AROUND), radius * math.sin(math.tau * k / AROUND)
            points.append([center[i] + height * z[i] + u * x[i] + v * y[i] for i in range(3)])
    points.append([b[i] + thick_b * z[i] for i in range(3)])
    last, top = len(points) - 1, 1 + (len(rings) - 1) * AROUND
    triangles = []
    for k in range(AROUND):
        after = (k + 1) % AROUND
        triangles += [(0, 1 + after, 1 + k), (last, top + k, top + after)]
        for low in range(1, top, AROUND):
            p, q = low + k, low + after
            triangles += [(p, q, q + AROUND), (p, q + AROUND, p + AROUND)]
    return points, triangles


def glb(name):
    """A shape that stands on y = 0."""
    points, triangles = [], []
    for limb in LIMBS[name]:
        own, faces = _limb(*limb)
        triangles += [[corner + len(points) for corner in face] for face in faces]
        points += own
    low = min(p[1] for p in points)
    points = [(p[0], p[1] - low, p[2]) for p in points]
    places = b"".join(struct.pack("<3f", *p) for p in points)
    corners = b"".join(struct.pack("<3I", *t) for t in triangles)
    bounds = {"min": [min(c) for c in zip(*points, strict=True)], "max": [max(c) for c in zip(*points, strict=True)]}
    head = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(places) + len(corners)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(places)},
            {"buffer": 0, "byteOffset": len(places), "byteLength": len(corners)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3", **bounds},
            {"bufferView": 1, "componentType": 5125, "count": 3 * len(triangles), "type": "SCALAR"},
        ],
    }
    text = json.dumps(head).encode()
    text += b" " * (-len(text) % 4)
    body = places + corners
    size = 12 + 8 + len(text) + 8 + len(body)
    return b"".join(
        (
            struct.pack("<4sII", b"glTF", 2, size),
            struct.pack("<I4s", len(text), b"JSON"),
            text,
            struct.pack("<I4s", len(body), b"BIN\0"),
            body,
        )
    )
