"""Blender's rigid bodies, to keyframes. It multiplies the two frictions of a pair, as Bullet does, which it is made of.
Damping and deactivation are Blender's own; in problems with a known answer, nothing damps.

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


def ball(name, radius):
    """Its bounds make the sphere."""
    ends = [(sign * radius if axis == k else 0 for k in range(3)) for axis in range(3) for sign in (-1, 1)]
    return points(name, [tuple(end) for end in ends])


MESHES = {"box": box, "ball": ball, "hulls": lambda name, parts: points(name, sum(parts, []))}


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
    assert not scene.launched and not any(any(one["velocity"]) for one in scene.scenery), "Blender has no velocities"
    one_part = all(len(scene.shapes[one["place"]["shape"]]["solid"].get("hulls", [])) < 2 for one in scene.scenery)
    assert one_part, "scenery of one part"
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
    meshes = [MESHES[kind](kind, what) for kind, what in solids]
    bodies = [link("body", meshes[body["shape"]], placed(body)) for body in scene.bodies]
    blender_bodies.add(bodies, "ACTIVE")
    still = [link("scenery", meshes[one["place"]["shape"]], placed(one["place"])) for one in scene.scenery]
    if still:
        blender_bodies.add(still, "PASSIVE")
    solid = [*scene.bodies, *(one["place"] for one in scene.scenery)]
    for kind, name in (("box", "BOX"), ("ball", "SPHERE"), ("hulls", "CONVEX_HULL")):
        of_kind = [made for body, made in zip(solid, [*bodies, *still]) if solids[body["shape"]][0] == kind]
        shape(of_kind, name, friction)
    for body, made in zip(scene.bodies, bodies):
        made.rigid_body.mass = scene.shapes[body["shape"]]["mass"]
        if scene.exact:
            made.rigid_body.linear_damping = made.rigid_body.angular_damping = 0
    compound(scene, bodies, solids, friction)

    simulated, keyframes = blender_bodies.bake(bodies, frames)
    motion = [piles.frame_of(*poses(bodies, frame)) for frame in range(1, frames + 1)] if scene.exact else []
    end = poses(bodies, frames)
    version = f"Blender {bpy.app.version_string}"
    more = {"keyframes_cpu": keyframes, "motion": motion}
    piles.write(scene, arguments, version, simulated, scene.seconds, *end, **more)


def poses(bodies, frame):
    """Positions and rotations at a frame."""
    bpy.context.scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    matrices = [body.evaluated_get(graph).matrix_world for body in bodies]
    turned = [(q.x, q.y, q.z, q.w) for q in (matrix.to_quaternion() for matrix in matrices)]
    return [matrix.to_translation()[:] for matrix in matrices], turned


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
