"""Replays piles that were written as `.xml` in MuJoCo and in Bullet, and says what still stands.

Nothing but the file is known: bodies, their parts, masses, friction. Bodies that are glued to each other are one solid
in it.
"""

import math
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
import pybullet

# A body has fallen that is farther from its place than this, in diameters of the median prop.
MOVED = 0.25
# Steps of both engines in a characteristic time, the square root of diameter over gravity.
BULLET_ITERATIONS = 50


@dataclass
class Part:
    # The body's name, without the part's number.
    body: str
    center: np.ndarray
    rotation: np.ndarray
    # Corners about the part's centre, or the radius of a ball.
    corners: np.ndarray
    radius: float


@dataclass
class Solid:
    name: str
    center: np.ndarray
    rotation: np.ndarray
    mass: float
    is_fixed: bool
    friction: float
    parts: list = field(default_factory=list)

    def middles(self):
        """The middle of each body of this solid, in the solid's frame."""
        found = {}
        for part in self.parts:
            found.setdefault(part.body, []).append(part.center + part.rotation @ part.corners.mean(0))
        return np.array([np.mean(middles, 0) for middles in found.values()])


@dataclass
class Pile:
    path: str
    solids: list
    ground: float
    ground_friction: float
    diameter: float
    gravity: float
    step: float

    @property
    def natural_time(self):
        return math.sqrt(self.diameter / self.gravity)

    def unglued(self):
        """The same bodies, each by itself."""
        apart = []
        for solid in self.solids:
            bodies = dict.fromkeys(part.body for part in solid.parts)
            for body in bodies:
                parts = [part for part in solid.parts if part.body == body]
                center = np.mean([part.center + part.rotation @ part.corners.mean(0) for part in parts], 0)
                parts = [replace(part, center=part.center - center) for part in parts]
                place = solid.rotation @ center + solid.center
                apart.append(Solid(body, place, solid.rotation, solid.mass / len(bodies), False, solid.friction, parts))
        return replace(self, solids=apart)


def numbers(text):
    return np.array([float(word) for word in text.split()])


def rotation(w, x, y, z):
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def read(path):
    root = ElementTree.parse(path).getroot()
    meshes = {mesh.get("name"): numbers(mesh.get("vertex")).reshape(-1, 3) for mesh in root.iter("mesh")}
    world, option = root.find("worldbody"), root.find("option")
    plane = world.find("geom")
    solids = []
    for body in world.findall("body"):
        geoms = body.findall("geom")
        solid = Solid(
            body.get("name"),
            numbers(body.get("pos")),
            rotation(*numbers(body.get("quat"))),
            float(body.find("inertial").get("mass")),
            body.find("freejoint") is None,
            numbers(geoms[0].get("friction"))[0],
        )
        for geom in geoms:
            size, radius = numbers(geom.get("size", "0")), 0.0
            if geom.get("type") == "box":
                signs = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
                corners = np.array(signs) * size
            elif geom.get("type") == "sphere":
                corners, radius = np.zeros((1, 3)), size[0]
            else:
                corners = meshes[geom.get("mesh")]
            turn, name = rotation(*numbers(geom.get("quat"))), geom.get("name").rpartition(".")[0]
            solid.parts.append(Part(name, numbers(geom.get("pos")), turn, corners, radius))
        solids.append(solid)
    return Pile(
        str(path),
        solids,
        numbers(plane.get("pos"))[2],
        numbers(plane.get("friction"))[0],
        numbers(plane.get("size"))[2],
        -numbers(option.get("gravity"))[2],
        float(option.get("timestep")),
    )


def standing(pile, poses):
    """The share of the bodies that are at their places. `poses`: centre and rotation of each solid."""
    ways = []
    for solid, (center, turn) in zip(pile.solids, poses, strict=True):
        middles = solid.middles()
        before = middles @ solid.rotation.T + solid.center
        ways.append(np.linalg.norm(middles @ turn.T + center - before, axis=1))
    ways = np.concatenate(ways) / pile.diameter
    return float(np.mean(ways <= MOVED))


def in_mujoco(pile, seconds):
    model = mujoco.MjModel.from_xml_path(pile.path)
    data = mujoco.MjData(model)
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
    ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, solid.name) for solid in pile.solids]
    return standing(pile, [(data.xpos[i], data.xmat[i].reshape(3, 3)) for i in ids])


class BulletWorld:
    """A pile in Bullet. Bullet has margins of its own: the median prop has the diameter 1 here."""

    surface = {"restitution": 0, "rollingFriction": 0, "spinningFriction": 0, "linearDamping": 0, "angularDamping": 0}

    def __init__(self, pile):
        pybullet.connect(pybullet.DIRECT)
        self.length = 1 / pile.diameter
        pybullet.setGravity(0, 0, -pile.gravity)
        self.step = pile.step * math.sqrt(self.length)
        pybullet.setPhysicsEngineParameter(fixedTimeStep=self.step, numSolverIterations=BULLET_ITERATIONS)
        # Bullet multiplies the friction of two bodies; Cairn takes the mean.
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, planeNormal=[0, 0, 1])
        self.ground = pybullet.createMultiBody(0, plane, basePosition=[0, 0, pile.ground * self.length])
        pybullet.changeDynamics(self.ground, -1, lateralFriction=math.sqrt(pile.ground_friction), **self.surface)
        self.ids = [self.add(solid) for solid in pile.solids]

    def add(self, solid):
        body = pybullet.createMultiBody(
            0 if solid.is_fixed else solid.mass,
            bullet_shape(solid, self.length),
            basePosition=(solid.center * self.length).tolist(),
            baseOrientation=quaternion(solid.rotation),
        )
        pybullet.changeDynamics(
            body,
            -1,
            lateralFriction=math.sqrt(solid.friction),
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            collisionMargin=0.001,
            **self.surface,
        )
        return body

    def throw(self, radius, mass, place, velocity):
        ball = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=radius * self.length)
        body = pybullet.createMultiBody(mass, ball, basePosition=(place * self.length).tolist())
        pybullet.resetBaseVelocity(body, (velocity * math.sqrt(self.length)).tolist())

    def steps(self, seconds):
        return round(seconds * math.sqrt(self.length) / self.step)

    def poses(self):
        """The poses of all bodies, and the end of this world."""
        poses = []
        for body in self.ids:
            center, (x, y, z, w) = pybullet.getBasePositionAndOrientation(body)
            poses.append((np.array(center) / self.length, rotation(w, x, y, z)))
        pybullet.disconnect()
        return poses


def in_bullet(pile, seconds):
    world = BulletWorld(pile)
    for _ in range(world.steps(seconds)):
        pybullet.stepSimulation()
    return standing(pile, world.poses())


def bullet_shape(solid, length):
    parts = [((part.corners @ part.rotation.T + part.center) * length, part.radius * length) for part in solid.parts]
    if all(radius for _, radius in parts):
        return pybullet.createCollisionShapeArray(
            shapeTypes=[pybullet.GEOM_SPHERE] * len(parts),
            radii=[radius for _, radius in parts],
            collisionFramePositions=[corners[0].tolist() for corners, _ in parts],
        )
    if len(parts) == 1:
        return pybullet.createCollisionShape(pybullet.GEOM_MESH, vertices=parts[0][0].tolist())
    # Several hulls are read from a file alone: one for each object in it.
    with tempfile.NamedTemporaryFile("w", suffix=".obj") as file:
        begin = 1
        for number, (corners, _) in enumerate(parts):
            file.write(f"o part{number}\n")
            file.writelines(f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in corners)
            file.writelines(f"f {begin} {begin + i} {begin + i + 1}\n" for i in range(1, len(corners) - 1))
            begin += len(corners)
        file.flush()
        return pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=file.name)


def quaternion(turn):
    found = np.zeros(4)
    mujoco.mju_mat2Quat(found, turn.ravel())
    w, x, y, z = found
    return [x, y, z, w]


ENGINES = {"MuJoCo": in_mujoco, "Bullet": in_bullet}


def main(arguments):
    """Arguments: piles, and perhaps the engines first."""
    engines = [word for word in arguments if word in ENGINES] or list(ENGINES)
    for path in arguments:
        if path in ENGINES:
            continue
        pile = read(path)
        shares = [f"{name} {ENGINES[name](pile, 20 * pile.natural_time):.2f}" for name in engines]
        bodies = sum(len(solid.middles()) for solid in pile.solids)
        print(f"{path}: {bodies} bodies, {len(pile.solids)} solids; in place: {', '.join(shares)}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
