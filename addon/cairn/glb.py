"""Binary glTF of meshes, with only the data that the server needs."""

import json
import struct

import numpy as np

FLOAT, UNSIGNED_INT = 5126, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963


def write(name, vertices, triangles):
    """The bytes of a .glb. Vertices: shape [n, 3], metres, Y up; triangles: shape [m, 3], counter-clockwise outside."""
    return write_nodes([(vertices, triangles)], [{"name": name, "mesh": 0}])


def write_nodes(meshes, nodes):
    """The bytes of a .glb of these nodes and meshes (vertices, triangles); a mesh has its first node's name."""
    data, views, accessors, described = bytearray(), [], [], []
    for number, (vertices, triangles) in enumerate(meshes):
        vertices = np.ascontiguousarray(vertices, "<f4")
        triangles = np.ascontiguousarray(triangles, "<u4")
        first = len(accessors)
        for content, target in ((vertices, ARRAY_BUFFER), (triangles, ELEMENT_ARRAY_BUFFER)):
            views.append({"buffer": 0, "byteOffset": len(data), "byteLength": content.nbytes, "target": target})
            data += content.tobytes()
        accessors.append(
            {
                "bufferView": first,
                "componentType": FLOAT,
                "count": len(vertices),
                "type": "VEC3",
                "min": vertices.min(axis=0).tolist(),
                "max": vertices.max(axis=0).tolist(),
            }
        )
        indices = {"bufferView": first + 1, "componentType": UNSIGNED_INT, "count": triangles.size, "type": "SCALAR"}
        accessors.append(indices)
        name = next(node["name"] for node in nodes if node["mesh"] == number)
        primitive = {"attributes": {"POSITION": first}, "indices": first + 1}
        described.append({"name": name, "primitives": [primitive]})
    document = {
        "asset": {"version": "2.0", "generator": "Cairn for Blender"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": described,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(data)
    head = struct.pack("<4sII", b"glTF", 2, size) + struct.pack("<I4s", len(text), b"JSON")
    return head + text + struct.pack("<I4s", len(data), b"BIN\0") + bytes(data)
