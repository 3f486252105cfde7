"""The nodes of a `.glb` at a moment of its animation."""

import json
import struct

import numpy as np

WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


class Glb:
    def __init__(self, path):
        with open(path, "rb") as file:
            data = file.read()
        (length,) = struct.unpack_from("<I", data, 12)
        self.json = json.loads(data[20 : 20 + length])
        self.bin = data[28 + length :]

    def accessor(self, index):
        accessor = self.json["accessors"][index]
        view = self.json["bufferViews"][accessor["bufferView"]]
        assert accessor["componentType"] == 5126
        width = WIDTH[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(self.bin, "<f4", accessor["count"] * width, start).reshape(-1, width)

    def children(self, name):
        """The nodes below the top node of that name, in their order; none where there is no such."""
        nodes = self.json["nodes"]
        tops = [nodes[top] for top in self.json["scenes"][0]["nodes"]]
        return next((top.get("children", []) for top in tops if top.get("name") == name), [])

    def at(self, frame, fps):
        """{node: (translation, rotation x y z w, scale)} at a frame, which is a key or between two equal ones."""
        found = {}
        for index, node in enumerate(self.json["nodes"]):
            place = (
                node.get("translation", [0, 0, 0]),
                node.get("rotation", [0, 0, 0, 1]),
                node.get("scale", [1, 1, 1]),
            )
            found[index] = [np.array(part, float) for part in place]
        for animation in self.json.get("animations", []):
            for channel in animation["channels"]:
                sampler = animation["samplers"][channel["sampler"]]
                times = self.accessor(sampler["input"])[:, 0] * fps
                values = self.accessor(sampler["output"])
                if sampler["interpolation"] == "STEP":
                    value = values[np.searchsorted(times, frame + 1e-3) - 1]
                else:
                    value = [np.interp(frame, times, values[:, k]) for k in range(values.shape[1])]
                part = ["translation", "rotation", "scale"].index(channel["target"]["path"])
                found[channel["target"]["node"]][part] = np.array(value, float)
        return found


def matrix(place):
    """The 4x4 matrix of a place, for points that stand before it."""
    translation, (x, y, z, w), scale = place
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
            [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
            [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    whole = np.eye(4)
    whole[:3, :3] = np.diag(scale) @ turn
    whole[3, :3] = translation
    return whole
