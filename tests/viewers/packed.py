"""packed.py PACK TABLE: Blender's own importer reads a pack: the skeleton moves each body as the table has it, and the
meshes at rest are where the bodies are."""

import json
import sys

import bpy
import table as tables
from mathutils import Matrix, Vector

pack, path = sys.argv[1:]
table = tables.load(path)
with open(f"{pack}/manifest.json") as file:
    manifest = json.load(file)
turn = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))


def load(name):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = round(table["fps"])
    assert bpy.ops.import_scene.gltf(filepath=f"{pack}/{name}") == {"FINISHED"}
    return [thing for thing in bpy.data.objects if thing.type == "MESH" and thing.users_scene]


# Where the vertices of the skinned mesh are in each frame, by joint: where the table's pose takes those at rest.
# Beside the shape that Blender gives to its bones.
(mesh,) = (thing for thing in load("skinned.glb") if thing.vertex_groups)
names = [group.name for group in mesh.vertex_groups]
joints = [names[vertex.groups[0].group] for vertex in mesh.data.vertices]
bodies = {entry["name"]: number for number, entry in enumerate(table["bodies"])}
last = len(table["frames"]) - 1


def posed(frame):
    bpy.context.scene.frame_set(frame)
    shown = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return [turn.inverted() @ (shown.matrix_world @ vertex.co) for vertex in shown.data.vertices]


rest, worst = posed(last), 0.0
for frame in tables.frames(table):
    moves = {
        name: Matrix(tables.matrix(table, frame, body)) @ Matrix(tables.matrix(table, last, body)).inverted()
        for name, body in bodies.items()
    }
    for joint, before, now in zip(joints, rest, posed(frame)):
        worst = max(worst, (moves[joint] @ before - now).length)
print(f"Blender {bpy.app.version_string}, a skeleton of {len(names)} joints: within {worst:.1e} m")
assert len(names) == len(bodies) and worst < 1e-4

# All that rests is within the manifest's bounds, and reaches them.
low, high = (Vector(manifest["bounds"][end]) for end in ("low", "high"))
for name in ("static.lod0.glb", "motion.glb", "colliders.glb"):
    corners = [
        turn.inverted() @ (mesh.matrix_world @ vertex.co) for mesh in load(name) for vertex in mesh.data.vertices
    ]
    for axis in range(3):
        ends = [pick(corner[axis] for corner in corners) for pick in (min, max)]
        assert abs(ends[0] - low[axis]) < 0.02 * (high - low).length, (name, axis, ends, low[axis])
        assert abs(ends[1] - high[axis]) < 0.02 * (high - low).length, (name, axis, ends, high[axis])
    if name == "motion.glb":
        assert all(len(mesh.data.uv_layers) == 2 for mesh in bpy.data.objects if mesh.type == "MESH")
