"""Piles as UsdPhysics in Bullet: bodies, joints and their strength are read from the stage, by USD's own library.

Joints break where they carry more than the stage says, and something may be thrown at the pile.
"""

import math
from dataclasses import dataclass

import numpy as np
import pybullet
import replay
from pxr import Usd, UsdGeom, UsdPhysics

# Steps in the time in which a body falls half of its diameter.
STEPS = 100


@dataclass
class Joint:
    # Numbers of the solids; None for what stands still.
    sides: tuple
    # Its place and rotation in each of them.
    frames: tuple
    break_force: float
    break_torque: float


def pose(matrix):
    """Place and rotation of a prim in the stage."""
    matrix = matrix.RemoveScaleShear()
    return np.array(matrix.ExtractTranslation()), np.array(matrix.ExtractRotationMatrix()).T


def corners_of(collider):
    """Corners of a collision shape in its own frame, and the radius of a ball."""
    kind = collider.GetTypeName()
    if kind == "Sphere":
        return np.zeros((1, 3)), collider.GetAttribute("radius").Get()
    if kind == "Cube":
        half = collider.GetAttribute("size").Get() / 2
        return half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]), 0.0
    assert kind == "Mesh" and collider.GetAttribute("physics:approximation").Get() == "convexHull"
    return np.array(collider.GetAttribute("points").Get()), 0.0


def read(path, diameter):
    """The bodies of a stage as `replay` knows them, Z up, and its joints. `diameter`: of the median prop, m."""
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    places = UsdGeom.XformCache()
    solids, numbers = [], {}
    for prim in stage.GetPrimAtPath("/Pile/Physics/Bodies").GetChildren():
        center, turn = pose(places.GetLocalToWorldTransform(prim))
        offset = np.zeros(3)
        if prim.HasAPI(UsdPhysics.MassAPI):
            offset = np.array(prim.GetAttribute("physics:centerOfMass").Get())
        material = stage.GetPrimAtPath(prim.GetRelationship("material:binding:physics").GetTargets()[0])
        numbers[prim.GetPath()] = len(solids)
        solid = replay.Solid(
            prim.GetName(),
            center + turn @ offset,
            turn,
            prim.GetAttribute("physics:mass").Get() if prim.HasAPI(UsdPhysics.MassAPI) else 0.0,
            not prim.HasAPI(UsdPhysics.RigidBodyAPI),
            material.GetAttribute("physics:dynamicFriction").Get(),
        )
        for collider in Usd.PrimRange(prim):
            if not collider.HasAPI(UsdPhysics.CollisionAPI):
                continue
            corners, radius = corners_of(collider)
            matrix = np.array(places.GetLocalToWorldTransform(collider))
            world = corners @ matrix[:3, :3] + matrix[3, :3]
            local = (world - solid.center) @ turn
            radius *= np.linalg.norm(matrix[0, :3])
            solid.parts.append(replay.Part(solid.name, np.zeros(3), np.eye(3), local, radius))
        solids.append(solid)
    joints = [
        joint(prim, stage, places, solids, numbers) for prim in stage.Traverse() if prim.IsA(UsdPhysics.FixedJoint)
    ]
    ground = stage.GetPrimAtPath("/Pile/Physics/Ground")
    friction = stage.GetPrimAtPath(ground.GetRelationship("material:binding:physics").GetTargets()[0])
    gravity = stage.GetPrimAtPath("/Pile/Physics/World").GetAttribute("physics:gravityMagnitude").Get()
    pile = replay.Pile(
        str(path),
        solids,
        places.GetLocalToWorldTransform(ground).ExtractTranslation()[2],
        friction.GetAttribute("physics:dynamicFriction").Get(),
        diameter,
        gravity,
        math.sqrt(diameter / gravity) / STEPS,
    )
    return pile, joints


def joint(prim, stage, places, solids, numbers):
    fixed = UsdPhysics.FixedJoint(prim)
    sides, frames = [], []
    for target, place, turn in (
        (fixed.GetBody0Rel(), fixed.GetLocalPos0Attr(), fixed.GetLocalRot0Attr()),
        (fixed.GetBody1Rel(), fixed.GetLocalPos1Attr(), fixed.GetLocalRot1Attr()),
    ):
        (path,) = target.GetTargets()
        number = numbers.get(path)
        center, axes = pose(places.GetLocalToWorldTransform(stage.GetPrimAtPath(path)))
        quaternion = turn.Get()
        local = replay.rotation(quaternion.GetReal(), *quaternion.GetImaginary())
        world = center + axes @ np.array(place.Get())
        if number is not None and not solids[number].is_fixed:
            solid = solids[number]
            frames.append((solid.rotation.T @ (world - solid.center), local))
        else:
            frames.append((world, axes @ local))
            number = None
        sides.append(number)
    return Joint(tuple(sides), tuple(frames), fixed.GetBreakForceAttr().Get(), fixed.GetBreakTorqueAttr().Get())


@dataclass
class Shot:
    """A ball that is thrown at the pile."""

    radius: float
    mass: float
    place: np.ndarray
    velocity: np.ndarray


def in_bullet(pile, joints, seconds, shot=None):
    """The share of the bodies that are in place after that time, and the joints that broke, by their numbers."""
    world = replay.BulletWorld(pile)
    length = world.length
    links = {}
    for number, link in enumerate(joints):
        (a, b), (first, second) = link.sides, link.frames
        if a is None:
            (a, b), (first, second) = (b, a), (second, first)
        if a is None:
            continue
        child = -1 if b is None else world.ids[b]
        links[number] = pybullet.createConstraint(
            world.ids[a],
            -1,
            child,
            -1,
            pybullet.JOINT_FIXED,
            [0, 0, 0],
            (first[0] * length).tolist(),
            (second[0] * length).tolist(),
            replay.quaternion(first[1]),
            replay.quaternion(second[1]),
        )
        pybullet.changeConstraint(links[number], maxForce=1e12)
        other = world.ground if child == -1 else child
        pybullet.setCollisionFilterPair(world.ids[a], other, -1, -1, 0)
    if shot is not None:
        world.throw(shot.radius, shot.mass, shot.place, shot.velocity)
    broken = []
    for _ in range(world.steps(seconds)):
        pybullet.stepSimulation()
        for number, link in list(links.items()):
            load = np.array(pybullet.getConstraintState(link))
            # Masses are in kilograms there, lengths in diameters.
            force = np.linalg.norm(load[:3]) / length
            torque = np.linalg.norm(load[3:]) / length**2
            if force > joints[number].break_force or torque > joints[number].break_torque:
                pybullet.removeConstraint(link)
                del links[number]
                broken.append(number)
    return replay.standing(pile, world.poses()), broken
