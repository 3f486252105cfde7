"""Blender's rigid bodies, to keyframes. It multiplies the two frictions of a pair, as Bullet does, which it is made of.
Damping and deactivation are Blender's own.

    blender --background --factory-startup --python tests/studies/peers/in_blender.py -- SCENE OUT
"""

import sys
from pathlib import Path

import bpy
from mathutils import Matrix, Quaternion, Vector

sys.path.insert(0, str(Path(__file__).parent))
import blender_bodies
import scene as piles

MARGIN = 0.001
"""Of hulls, m. Left to itself, Blender takes 4 cm and rounds the corners of small ones away."""
DEEP = 1.0
"""Half the depth of the ground's block, m."""
WIDE = 100.0


def box(name, half):
    corners = [(x, y, z) for x in (-half[0], half[0]) for y in (-half[1], half[1]) for z in (-half[2], half[2])]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], faces)
    return mesh


def points(name, corners):
    """A convex hull asks for corners alone."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], [])
    return mesh


def placed(body):
    x, y, z, w = body["rotation"]
    return Matrix.Translation(Vector(body["position"])) @ Quaternion((w, x, y, z)).to_matrix().to_4x4()


def link(name, mesh, matrix, parent=None):
    made = bpy.data.objects.new(name, mesh)
    made.parent = parent
    made.matrix_world = matrix
    bpy.context.scene.collection.objects.link(made)
    return made


def shape(objects, kind, friction):
    for made in objects:
        made.rigid_body.collision_shape = kind
        made.rigid_body.friction, made.rigid_body.restitution = friction, 0
        if kind == "CONVEX_HULL":
            made.rigid_body.use_margin, made.rigid_body.collision_margin = True, MARGIN


def main():
    parser, given = piles.arguments(__doc__)
    arguments = parser.parse_args(given)
    scene = piles.read(arguments.scene)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.context.scene.render.fps = round(scene.fps)
    bpy.context.scene.gravity = (0, -scene.gravity, 0)
    frames, friction = scene.frames + 1, scene.friction**0.5
    world = blender_bodies.begin(frames)
    world.substeps_per_frame = round(arguments.hz / scene.fps)
    world.solver_iterations = arguments.iterations

    middle = Matrix.Translation((0, scene.ground - DEEP, 0))
    ground = link("ground", box("ground", (WIDE, DEEP, WIDE)), middle)
    blender_bodies.add([ground], "PASSIVE")
    shape([ground], "BOX", friction)

    solids = [next(iter(one["solid"].items())) for one in scene.shapes]
    meshes = [box("box", what) if kind == "box" else points("hulls", sum(what, [])) for kind, what in solids]
    bodies = [link("body", meshes[body["shape"]], placed(body)) for body in scene.bodies]
    blender_bodies.add(bodies, "ACTIVE")
    for kind, name in (("box", "BOX"), ("hulls", "CONVEX_HULL")):
        shape([made for body, made in zip(scene.bodies, bodies) if solids[body["shape"]][0] == kind], name, friction)
    for body, made in zip(scene.bodies, bodies):
        made.rigid_body.mass = scene.shapes[body["shape"]]["mass"]
    compound(scene, bodies, solids, friction)

    simulated, keyframes = blender_bodies.bake(bodies, frames)
    bpy.context.scene.frame_set(frames)
    graph = bpy.context.evaluated_depsgraph_get()
    poses = [body.evaluated_get(graph).matrix_world for body in bodies]
    turned = [(q.x, q.y, q.z, q.w) for q in (pose.to_quaternion() for pose in poses)]
    positions = [pose.to_translation()[:] for pose in poses]
    version = f"Blender {bpy.app.version_string}"
    piles.write(scene, arguments, version, simulated, scene.seconds, positions, turned, keyframes_cpu=keyframes)


def compound(scene, bodies, solids, friction):
    """Bodies of several hulls are compounds of children, each with a hull."""
    parents, children = [], []
    hulls = [what if kind == "hulls" else [] for kind, what in solids]
    meshes = [[points("part", part) for part in what] if len(what) > 1 else [] for what in hulls]
    for body, made in zip(scene.bodies, bodies):
        parts = meshes[body["shape"]]
        parents += [made] if parts else []
        children += [link("part", part, placed(body), made) for part in parts]
    if parents:
        blender_bodies.add(children, "ACTIVE")
        shape(children, "CONVEX_HULL", friction)
        shape(parents, "COMPOUND", friction)


main()
