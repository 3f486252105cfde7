"""Stages as Cairn reads them, against USD's own library: generated ones, at several times of each.

Cairn shows a stage as scenery of a small bake. Every triangle of it must lie in a face that USD shows there and then,
turn the same side to the front, and all triangles together must cover all faces once.
"""

import json
import os
import random
import struct
import subprocess

import numpy as np
from conftest import CAIRN, ROOT
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

# Stages, and times at which each is read.
STAGES = int(os.environ.get("CAIRN_STAGES", "12"))
TIMES = 3
# Lengths and places of the stages are some metres: single precision.
CLOSE = 2e-5

OPS = [
    UsdGeom.XformOp.TypeTranslate,
    UsdGeom.XformOp.TypeScale,
    UsdGeom.XformOp.TypeOrient,
    UsdGeom.XformOp.TypeRotateX,
    UsdGeom.XformOp.TypeRotateY,
    UsdGeom.XformOp.TypeRotateZ,
    UsdGeom.XformOp.TypeRotateXYZ,
    UsdGeom.XformOp.TypeRotateXZY,
    UsdGeom.XformOp.TypeRotateYXZ,
    UsdGeom.XformOp.TypeRotateYZX,
    UsdGeom.XformOp.TypeRotateZXY,
    UsdGeom.XformOp.TypeRotateZYX,
    UsdGeom.XformOp.TypeTransform,
]
# Half precision between samples is rounding.
PRECISIONS = [UsdGeom.XformOp.PrecisionFloat, UsdGeom.XformOp.PrecisionDouble]


class Maker:
    """A random stage in a folder: its first layer, a weaker layer below it and an asset that it refers to."""

    def __init__(self, folder, seed):
        self.random = random.Random(seed)
        self.path = str(folder / f"stage{seed}.usda")
        self.count = 0
        self.asset = self.new(str(folder / f"asset{seed}.usdc"), "/asset")
        self.prims(UsdGeom.Xform(self.asset.GetDefaultPrim()), 1)
        self.asset.GetRootLayer().Save()
        weaker = self.new(str(folder / f"weaker{seed}.usda"), "/top")
        self.stage = self.new(self.path, "/top")
        self.stage.GetRootLayer().subLayerPaths.append(f"./weaker{seed}.usda")
        # Time runs at another speed in the layer below.
        self.stage.GetRootLayer().subLayerOffsets[0] = Sdf.LayerOffset(self.some(-2, 2), self.random.choice([1, 1, 2]))
        with Usd.EditContext(self.stage, self.stage.GetEditTargetForLocalLayer(weaker.GetRootLayer())):
            top = UsdGeom.Xform(self.stage.GetDefaultPrim())
            self.prims(top, 2)
        self.opinions()
        weaker.GetRootLayer().Save()
        self.stage.GetRootLayer().Save()

    def new(self, path, top):
        stage = Usd.Stage.CreateNew(path)
        UsdGeom.SetStageUpAxis(stage, self.random.choice(["Y", "Z"]))
        UsdGeom.SetStageMetersPerUnit(stage, self.random.choice([1, 0.01, 0.0254]))
        stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, top).GetPrim())
        return stage

    def some(self, low, high):
        return self.random.uniform(low, high)

    def any(self, share):
        return self.random.random() < share

    def times(self):
        return sorted(self.random.sample(range(-2, 12), self.random.randint(1, 4)))

    def set(self, attribute, make, share=0.5):
        """A default, samples, or both."""
        if self.any(0.7):
            attribute.Set(make())
        if self.any(share) or not attribute.HasAuthoredValue():
            for time in self.times():
                attribute.Set(make(), time)

    def vector(self, size, kind=Gf.Vec3f):
        return kind(*[self.some(-size, size) for _ in range(3)])

    def place(self, prim):
        """A transform of some steps."""
        able = UsdGeom.Xformable(prim)
        if not able:
            # A scope or a prim without a kind has no place, whatever is written there.
            prim.CreateAttribute("xformOp:translate", Sdf.ValueTypeNames.Double3).Set(Gf.Vec3d(5, 5, 5))
            order = prim.CreateAttribute(
                "xformOpOrder", Sdf.ValueTypeNames.TokenArray, variability=Sdf.VariabilityUniform
            )
            order.Set(["xformOp:translate"])
            return
        ops = []
        for n in range(self.random.randint(0, 4)):
            kind = self.random.choice(OPS)
            is_matrix = kind == UsdGeom.XformOp.TypeTransform
            precision = UsdGeom.XformOp.PrecisionDouble if is_matrix else self.random.choice(PRECISIONS)
            suffix = f"step{n}" if self.any(0.6) or any(op.GetOpType() == kind for op in ops) else ""
            op = able.AddXformOp(kind, precision, suffix)
            if self.any(0.9):
                self.set(op.GetAttr(), lambda op=op: self.step(op))
            ops.append(op)
            if suffix and self.any(0.3):
                ops.append(able.AddXformOp(kind, precision, suffix, True))
        able.SetXformOpOrder(self.random.sample(ops, len(ops)), self.any(0.15))

    def step(self, op):
        kind, value = op.GetOpType(), op.GetAttr().GetTypeName().type.pythonClass
        if kind == UsdGeom.XformOp.TypeTransform:
            turn = Gf.Matrix4d().SetRotate(Gf.Rotation(self.vector(1, Gf.Vec3d), self.some(0, 180)))
            return (
                turn * Gf.Matrix4d().SetScale(self.some(0.5, 2)) * Gf.Matrix4d().SetTranslate(self.vector(1, Gf.Vec3d))
            )
        if kind == UsdGeom.XformOp.TypeOrient:
            quaternion = Gf.Rotation(self.vector(1, Gf.Vec3d), self.some(0, 180)).GetQuat()
            return value(quaternion)
        if kind == UsdGeom.XformOp.TypeScale:
            return value(*[self.random.choice([1, 1, -1]) * self.some(0.5, 1.5) for _ in range(3)])
        if kind == UsdGeom.XformOp.TypeTranslate:
            return value(*[self.some(-1, 1) for _ in range(3)])
        if value in (None, float):
            return self.some(-180, 180)
        return value(*[self.some(-180, 180) for _ in range(3)])

    def prims(self, above, level):
        """Prims below one."""
        stage = above.GetPrim().GetStage()
        for _ in range(self.random.randint(2, 4)):
            self.count += 1
            path = above.GetPrim().GetPath().AppendChild(f"p{self.count}")
            kind = self.random.choice(["Xform", "Mesh", "Mesh", "Mesh", "Scope", "", "Camera", "PointInstancer"])
            prim = stage.DefinePrim(path, kind)
            self.place(prim)
            image = UsdGeom.Imageable(prim)
            if image and self.any(0.2):
                self.set(image.CreateVisibilityAttr(), lambda: self.random.choice(["inherited", "invisible"]))
            if image and self.any(0.15):
                image.CreatePurposeAttr(self.random.choice(["default", "guide", "proxy", "render"]))
            if kind == "Mesh":
                self.mesh(UsdGeom.Mesh(prim))
            if kind == "PointInstancer":
                self.instances(UsdGeom.PointInstancer(prim))
            elif level > 0:
                self.prims(UsdGeom.Imageable(prim) if image else prim, level - 1)
        if stage != self.asset and self.any(0.5):
            self.count += 1
            prim = stage.DefinePrim(above.GetPrim().GetPath().AppendChild(f"r{self.count}"), "Xform")
            offset = Sdf.LayerOffset(self.some(-2, 2), self.random.choice([1, 0.5]))
            prim.GetReferences().AddReference(f"./{os.path.basename(self.asset.GetRootLayer().realPath)}", offset)
            prim.SetInstanceable(self.any(0.5))

    def polygon(self):
        """Corners of a polygon in a plane, which may be concave and have corners on its edges."""
        count = self.random.randint(3, 9)
        radii = [self.some(0.15, 1) if self.any(0.6) else 0.6 for _ in range(count)]
        corners = [
            np.array([r * np.cos(2 * np.pi * k / count), r * np.sin(2 * np.pi * k / count)])
            for k, r in enumerate(radii)
        ]
        if self.any(0.4):
            at = self.random.randrange(count)
            corners.insert(at + 1, (corners[at] + corners[(at + 1) % count]) / 2)
        return corners[::-1] if self.any(0.5) else corners

    def mesh(self, mesh):
        points, counts, corners = [], [], []
        for _ in range(self.random.randint(1, 4)):
            origin, (u, v) = self.vector(0.5), self.plane()
            own = self.polygon()
            corners += range(len(points), len(points) + len(own))
            counts.append(len(own))
            points += [origin + Gf.Vec3f(*(u * x + v * y).tolist()) for x, y in own]
        mesh.CreateFaceVertexCountsAttr(counts)
        mesh.CreateFaceVertexIndicesAttr(corners)
        mesh.CreateSubdivisionSchemeAttr("none")
        mesh.CreatePointsAttr(points)
        if self.any(0.3):
            for time in self.times():
                shift = self.vector(0.3)
                mesh.GetPointsAttr().Set([point + shift for point in points], time)
        if self.any(0.3):
            mesh.CreateOrientationAttr("leftHanded")
        if self.any(0.3):
            mesh.CreateHoleIndicesAttr([self.random.randrange(len(counts))])

    def plane(self):
        u = np.array([self.some(-1, 1) for _ in range(3)])
        u /= np.linalg.norm(u)
        v = np.cross(u, [self.some(-1, 1) for _ in range(3)])
        return 0.5 * u, 0.5 * v / np.linalg.norm(v)

    def turn(self):
        return Gf.Quatf(Gf.Rotation(self.vector(1, Gf.Vec3d), self.some(0, 90)).GetQuat())

    def instances(self, instancer):
        stage, count = instancer.GetPrim().GetStage(), self.random.randint(1, 4)
        for n in range(2):
            prototype = UsdGeom.Mesh.Define(stage, instancer.GetPath().AppendChild(f"proto{n}"))
            self.place(prototype.GetPrim())
            # USD leaves open what a prototype's transform begins at if not at its instances.
            prototype.SetResetXformStack(False)
            self.mesh(prototype)
            instancer.CreatePrototypesRel().AddTarget(prototype.GetPath())
        instancer.CreateProtoIndicesAttr([self.random.randrange(2) for _ in range(count)])
        self.set(instancer.CreatePositionsAttr(), lambda: [self.vector(1) for _ in range(count)])
        if self.any(0.6):
            self.set(instancer.CreateOrientationsfAttr(), lambda: [self.turn() for _ in range(count)])
        if self.any(0.6):
            self.set(instancer.CreateScalesAttr(), lambda: [Gf.Vec3f(self.some(0.5, 1.5)) for _ in range(count)])
        ids = list(range(count))
        if self.any(0.4):
            ids = self.random.sample(range(100), count)
            instancer.CreateIdsAttr(ids)
        if self.any(0.5):
            hidden = instancer.CreateInvisibleIdsAttr()
            self.set(hidden, lambda: Vt.Int64Array(self.random.sample(ids, self.random.randint(0, count))))
        if self.any(0.3):
            instancer.DeactivateIds([self.random.choice(ids)])

    def opinions(self):
        """Opinions of the stronger layer: defaults over the samples of the weaker one, samples over its defaults, or
        none at all."""
        for prim in list(self.stage.Traverse()):
            for attribute in prim.GetAuthoredAttributes():
                name = attribute.GetName()
                if not name.startswith("xformOp:") or not self.any(0.2) or prim.IsInstanceProxy():
                    continue
                value = attribute.Get(3)
                if value is None:
                    continue
                choice = self.random.choice(["default", "samples", "block"])
                if choice == "default":
                    attribute.Set(value)
                elif choice == "samples":
                    attribute.Set(value, self.random.randint(0, 5))
                elif self.any(0.3):
                    attribute.Block()


def shown(stage, time):
    """The faces that a stage shows at a time, in metres and Y up: corners of each, and whether they turn right."""
    faces = []

    def mesh(prim, place):
        counts, corners = (
            getattr(UsdGeom.Mesh(prim), f"GetFaceVertex{what}Attr")().Get(time) for what in ["Counts", "Indices"]
        )
        points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(time), float)
        points = (np.column_stack([points, np.ones(len(points))]) @ place)[:, :3]
        is_left = UsdGeom.Mesh(prim).GetOrientationAttr().Get(time) == "leftHanded"
        holes = set(UsdGeom.Mesh(prim).GetHoleIndicesAttr().Get(time) or [])
        at = 0
        for face, count in enumerate(counts):
            if face not in holes:
                faces.append((points[list(corners[at : at + count])], is_left))
            at += count

    def walk(top, place_of):
        flags = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
        prims = iter(Usd.PrimRange(top, flags))
        for prim in prims:
            image = UsdGeom.Imageable(prim)
            is_seen = image and image.ComputeVisibility(time) != "invisible"
            is_seen = is_seen and image.ComputePurpose() in ("default", "render")
            if prim.IsA(UsdGeom.PointInstancer):
                prims.PruneChildren()
                if is_seen:
                    instances(prim, place_of(prim))
            elif prim.IsA(UsdGeom.Mesh) and is_seen:
                mesh(prim, place_of(prim))

    def instances(prim, above):
        instancer = UsdGeom.PointInstancer(prim)
        targets, indices = instancer.GetPrototypesRel().GetTargets(), instancer.GetProtoIndicesAttr().Get(time)
        # Not masked, since the mask also takes what is no instance: by hand.
        mask = instancer.ComputeMaskAtTime(time)
        places = instancer.ComputeInstanceTransformsAtTime(
            time, time, instancer.IncludeProtoXform, instancer.IgnoreMask
        )
        for n, place in enumerate(places):
            if mask and not mask[n]:
                continue
            top = prim.GetStage().GetPrimAtPath(targets[indices[n]])
            cache = UsdGeom.XformCache(time)
            own = np.linalg.inv(np.array(cache.GetLocalToWorldTransform(top)))
            world = np.array(place) @ above
            walk(top, lambda one: np.array(cache.GetLocalToWorldTransform(one)) @ own @ world)

    cache = UsdGeom.XformCache(time)
    walk(stage.GetDefaultPrim(), lambda prim: np.array(cache.GetLocalToWorldTransform(prim)))
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    turn = np.eye(3) if UsdGeom.GetStageUpAxis(stage) == "Y" else np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    return [(points * unit @ turn, is_left) for points, is_left in faces]


def triangles(path):
    """{name of the scenery: its triangles} of a result."""
    data = open(path, "rb").read()
    (length,) = struct.unpack_from("<I", data, 12)
    table, rest = json.loads(data[20 : 20 + length]), data[28 + length :]

    def numbers(index):
        accessor = table["accessors"][index]
        start = table["bufferViews"][accessor["bufferView"]].get("byteOffset", 0) + accessor.get("byteOffset", 0)
        width = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
        kind = {5126: "<f4", 5125: "<u4", 5123: "<u2"}[accessor["componentType"]]
        return np.frombuffer(rest, kind, accessor["count"] * width, start).reshape(-1, width)

    def walk(index, above):
        node = table["nodes"][index]
        place = np.array(node.get("matrix", np.eye(4).T.flatten()), float).reshape(4, 4)
        if "matrix" not in node:
            turn = Gf.Quatd(*np.roll(node.get("rotation", [0, 0, 0, 1.0]), 1).tolist())
            place = np.array(
                Gf.Matrix4d().SetScale(Gf.Vec3d(*node.get("scale", [1.0, 1, 1])))
                * Gf.Matrix4d().SetRotate(turn)
                * Gf.Matrix4d().SetTranslate(Gf.Vec3d(*node.get("translation", [0.0, 0, 0])))
            )
        place = place @ above
        for primitive in table["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
            points = numbers(primitive["attributes"]["POSITION"]).astype(float)
            points = (np.column_stack([points, np.ones(len(points))]) @ place)[:, :3]
            yield points[numbers(primitive["indices"])[:, 0]].reshape(-1, 3, 3)
        for child in node.get("children", []):
            yield from walk(child, place)

    tops = [table["nodes"][top] for top in table["scenes"][0]["nodes"]]
    scenery = next(top for top in tops if top.get("name") == "scenery")
    found = {}
    for index in scenery["children"]:
        parts = list(walk(index, np.eye(4)))
        found[table["nodes"][index]["name"]] = np.concatenate(parts) if parts else np.zeros((0, 3, 3))
    return found


def area(points):
    """Newell's."""
    return (
        sum((np.cross(a - points[0], b - points[0]) for a, b in zip(points, np.roll(points, -1, 0))), np.zeros(3)) / 2
    )


def inside(point, points, normal):
    """Whether a point in the plane of a polygon is in it."""
    axis = np.abs(normal).argmax()
    flat = [k for k in range(3) if k != axis]
    (x, y), corners = point[flat], points[:, flat]
    crossings = 0
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, 0)):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            crossings += 1
    return crossings % 2 == 1


def compare(faces, found):
    """Why triangles are not these faces; None where they are."""
    # What takes the place of a prim in several copies is there as often.
    own, times = [], []
    for points, is_left in faces:
        same = [n for n, (one, left) in enumerate(own) if left == is_left and one.shape == points.shape]
        same = [n for n in same if np.abs(own[n][0] - points).max() < CLOSE]
        if same:
            times[same[0]] += 1
        else:
            own.append((points, is_left))
            times.append(1)
    faces, sizes = own, [area(points) for points, _ in own]
    left = [n * np.linalg.norm(size) for n, size in zip(times, sizes)]
    for triangle in found:
        own, middle = area(triangle), triangle.mean(0)
        length, edge = np.linalg.norm(own), np.linalg.norm(np.ptp(triangle, 0))
        # Where it is a line, its side is rounding.
        is_line = length < 50 * CLOSE * edge
        homes = []
        for n, ((points, is_left), size) in enumerate(zip(faces, sizes)):
            normal = size / max(np.linalg.norm(size), 1e-30)
            front = own @ normal * (-1 if is_left else 1)
            if np.abs((triangle - points[0]) @ normal).max() > CLOSE or not is_line and front < 0.9 * length:
                continue
            if inside(middle, points, normal):
                homes.append(n)
        if homes:
            left[max(homes, key=lambda n: left[n])] -= length
        elif not is_line:
            return f"a triangle around {middle} is in no face"
    for rest, (points, _), size in zip(left, faces, sizes):
        edges = np.linalg.norm(points - np.roll(points, -1, 0), axis=1).sum()
        if abs(rest) > 1e-3 * np.linalg.norm(size) + 50 * CLOSE * edges:
            return f"{rest / np.linalg.norm(size):.1%} of a face is not covered once"
    return None


def read(folder, paths):
    """What Cairn reads of stages: {path: triangles}."""
    assets = ROOT / "examples/assets"
    command = [CAIRN, "bake", "--control", assets / "cone-small.glb", "--prop", assets / "stick.glb", "-q"]
    command += [f"--set={one}" for one in ["fill.count=1", "control=off", "output.frames=0"]]
    command += ["--accuracy", "draft", "-o", folder / "read.glb"]
    done = subprocess.run(command + [f"--static={path}" for path in paths], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return triangles(folder / "read.glb")


def test_generated_stages_are_read_as_the_library_reads_them(tmp_path):
    expected, wrong = {}, []
    shapes = 0
    for seed in range(STAGES):
        made = Maker(tmp_path, seed)
        for n in range(TIMES):
            time = made.random.uniform(-3, 12) if n else float(made.random.randint(0, 8))
            # The stage as it begins at this time.
            path = tmp_path / f"at{seed}_{n}.usda"
            layer = Sdf.Layer.CreateNew(str(path))
            layer.TransferContent(made.stage.GetRootLayer())
            layer.startTimeCode, layer.endTimeCode = time, time + 10
            layer.Save()
            faces = shown(Usd.Stage.Open(str(path)), time)
            if faces:
                expected[path] = faces
                shapes += len(faces)
    assert shapes > 5 * len(expected), "stages show next to nothing"
    found = read(tmp_path, expected)
    for path, faces in expected.items():
        (name,) = [name for name in found if name.endswith(path.name)]
        why = compare(faces, found[name])
        if why:
            wrong.append(f"{path.name}: {why}")
    assert not wrong, "\n".join(wrong)
