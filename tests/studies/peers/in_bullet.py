"""Bullet, by pybullet. It multiplies the two frictions of a pair."""

import tempfile
from pathlib import Path

import pybullet as bullet

import scene as piles

HEAVY = 1e6
"""Mass of scenery that moves, kg."""


def shape_of(shape, folder, number):
    """A box, or a compound of hulls: an OBJ file with an object for each is how pybullet takes one."""
    kind, what = next(iter(shape["solid"].items()))
    if kind == "box":
        return bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=what)
    if kind == "ball":
        return bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=what)
    lines, base = [], 1
    for part, points in enumerate(what):
        lines.append(f"o part{part}")
        lines += ["v {} {} {}".format(*point) for point in points]
        # Only the corners count; every one is in some face.
        lines += [f"f {base} {base + i} {base + i + 1}" for i in range(1, len(points) - 1)]
        base += len(points)
    path = Path(folder, f"{number}.obj")
    path.write_text("\n".join(lines) + "\n")
    return bullet.createCollisionShape(bullet.GEOM_MESH, fileName=str(path))


def main():
    parser, given = piles.arguments(__doc__)
    parser.add_argument("--sleeping", action="store_true", help="bodies at rest fall asleep")
    arguments = parser.parse_args(given)
    scene = piles.read(arguments.scene)
    bullet.connect(bullet.DIRECT)
    bullet.setGravity(0, -scene.gravity, 0)
    bullet.setPhysicsEngineParameter(
        fixedTimeStep=1 / arguments.hz, numSubSteps=0, numSolverIterations=arguments.iterations
    )
    surface = {"lateralFriction": scene.friction**0.5, "restitution": 0, "linearDamping": 0, "angularDamping": 0}
    plane = bullet.createCollisionShape(bullet.GEOM_PLANE, planeNormal=[0, 1, 0])
    ground = bullet.createMultiBody(0, plane, basePosition=[0, scene.ground, 0], useMaximalCoordinates=True)
    bullet.changeDynamics(ground, -1, **surface)
    with tempfile.TemporaryDirectory() as folder:
        shapes = [shape_of(shape, folder, number) for number, shape in enumerate(scene.shapes)]
    sleeping = (
        bullet.ACTIVATION_STATE_ENABLE_SLEEPING if arguments.sleeping else bullet.ACTIVATION_STATE_DISABLE_SLEEPING
    )

    def add(mass, body):
        place = {"basePosition": body["position"], "baseOrientation": body["rotation"]}
        return bullet.createMultiBody(mass, shapes[body["shape"]], useMaximalCoordinates=True, **place)

    lifted = []
    for one in scene.scenery:
        moves = any(one["velocity"])
        # What moves is so heavy that nothing slows it, not even the ground, and is carried at each step.
        made = add(HEAVY if moves else 0, one["place"])
        bullet.changeDynamics(made, -1, **surface)
        if moves:
            lifted.append(made)
            bullet.changeDynamics(made, -1, activationState=bullet.ACTIVATION_STATE_DISABLE_SLEEPING)
            bullet.setCollisionFilterPair(ground, made, -1, -1, 0)
            bullet.resetBaseVelocity(made, one["velocity"], [0, 0, 0])
    ids = []
    for body in scene.bodies:
        shape = scene.shapes[body["shape"]]
        ids.append(add(shape["mass"], body))
        # With the inertia alone, pybullet takes the mass for 0.
        own = {"mass": shape["mass"], "localInertiaDiagonal": shape["inertia"], "activationState": sleeping}
        bullet.changeDynamics(ids[-1], -1, **own, **surface)
    for launch in scene.launched:
        bullet.resetBaseVelocity(ids[launch["body"]], launch["velocity"], launch["angular_velocity"])

    def poses():
        return zip(*(bullet.getBasePositionAndOrientation(body) for body in ids))

    def step():
        for made in lifted:
            at, _ = bullet.getBasePositionAndOrientation(made)
            bullet.applyExternalForce(made, -1, [0, HEAVY * scene.gravity, 0], at, bullet.WORLD_FRAME)
        bullet.stepSimulation()

    cpu, seconds, motion = piles.simulate(step, scene, arguments.hz, arguments.limit, poses)
    piles.write(scene, arguments, "Bullet, by pybullet 3.2.7", cpu, seconds, *poses(), motion=motion)


main()
