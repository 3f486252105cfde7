"""Binary glTF of one mesh, with only the data that the server needs."""

import json
import struct

import numpy as np

FLOAT, UNSIGNED_INT = 5126, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963


def write(name, vertices, triangles):
    """The bytes of a .glb. Vertices: shape [n, 3], metres, Y up; triangles: shape [m, 3], counter-clockwise outside."""
    vertices = np.ascontiguousarray(vertices, "<f4")
    triangles = np.ascontiguousarray(triangles, "<u4")
    data = vertices.tobytes() + triangles.tobytes()
    document = {
        "asset": {"version": "2.0", "generator": "Cairn for Blender"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0}],
        "meshes": [{"name": name, "primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": FLOAT,
                "count": len(vertices),
                "type": "VEC3",
                "min": vertices.min(axis=0).tolist(),
                "max": vertices.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": UNSIGNED_INT, "count": triangles.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": vertices.nbytes, "target": ARRAY_BUFFER},
            {
                "buffer": 0,
                "byteOffset": vertices.nbytes,
                "byteLength": triangles.nbytes,
                "target": ELEMENT_ARRAY_BUFFER,
            },
        ],
        "buffers": [{"byteLength": len(data)}],
    }
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(data)
    head = struct.pack("<4sII", b"glTF", 2, size) + struct.pack("<I4s", len(text), b"JSON")
    return head + text + struct.pack("<I4s", len(data), b"BIN\0") + data
