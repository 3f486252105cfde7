"""A show in USD: published assets go in, and the result refers to them as the show's stage asks."""

import pathlib
import subprocess

import numpy as np
import pytest
import show
from conftest import CAIRN
from pxr import Kind, Pcp, Usd, UsdGeom, UsdShade
from test_usd import faults

# As a stage in centimetres, Z up, asks that begins at 1001.
STAGE = [
    "usd.up_axis=z",
    "usd.meters_per_unit=0.01",
    "usd.start_frame=1001",
    "usd.default_prim=heap_of_rocks",
    "usd.purpose=render",
]


class Show:
    def __init__(self, folder):
        self.folder = folder
        (folder / "assets").mkdir()
        (folder / "shots").mkdir()
        for publish in [show.rock, show.kit, show.heap]:
            publish(folder / "assets")

    def bake(self, name, *given):
        models = ["--control", "assets/heap.usda", "--prop", "assets/rock.usda", "--prop", "assets/kit.usd#/Kit/Brick"]
        scene = [*models, "--static", "assets/kit.usd#/Kit/Wall", "--accuracy", "draft"]
        sets = [f"--set={one}" for one in ["fill.count=14", "output.frames=20", "glue=natural", "control=off", *given]]
        command = [CAIRN, "bake", *scene, *sets, "-o", f"shots/{name}", "-q"]
        done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return str(self.folder / "shots" / name)


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    made = Show(tmp_path_factory.mktemp("show"))
    made.plain = made.bake("plain.usdc")
    made.staged = made.bake("staged.usda", *STAGE)
    made.embedded = made.bake("embedded.usdc", *STAGE, "usd.embed=true")
    return made


def corners(path, frame):
    """The corners of every body in the world, in metres and Y up, body after body."""
    stage = Usd.Stage.Open(path)
    (prim,) = [prim for prim in stage.Traverse() if prim.GetName() == "Bodies"]
    instancer, cache = UsdGeom.PointInstancer(prim), UsdGeom.XformCache(frame)
    placed = instancer.ComputeInstanceTransformsAtTime(frame, frame, UsdGeom.PointInstancer.ExcludeProtoXform)
    places = [np.array(place) for place in placed]
    targets, indices = instancer.GetPrototypesRel().GetTargets(), instancer.GetProtoIndicesAttr().Get()
    world = np.array(cache.GetLocalToWorldTransform(prim))
    found = []
    for place, index in zip(places, indices, strict=True):
        top = stage.GetPrimAtPath(targets[index])
        above = np.linalg.inv(np.array(cache.GetLocalToWorldTransform(top.GetParent())))
        for mesh in filter(lambda one: one.IsA(UsdGeom.Mesh), Usd.PrimRange(top)):
            points = np.array(UsdGeom.Mesh(mesh).GetPointsAttr().Get(), dtype=float)
            local = np.array(cache.GetLocalToWorldTransform(mesh)) @ above
            found.append(np.column_stack([points, np.ones(len(points))]) @ local @ place @ world)
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    points = np.unique(np.concatenate(found)[:, :3].round(6), axis=0) * unit
    return points if UsdGeom.GetStageUpAxis(stage) == "Y" else points[:, [0, 2, 1]] * [1, 1, -1]


def test_the_checkers_find_no_fault(shot):
    for path in [shot.plain, shot.staged, shot.embedded]:
        assert faults(Usd.Stage.Open(path)) == [], path


def test_props_are_the_published_assets(shot):
    stage = Usd.Stage.Open(shot.staged)
    rock = stage.GetPrimAtPath("/heap_of_rocks/Bodies/Prototypes/rock/rock")
    layers = {spec.layer.GetDisplayName() for spec in rock.GetPrimStack()}
    assert layers == {"staged.usda", "rock.usda", "rock_geo.usdc"}
    assert rock.HasAuthoredPayloads() and Usd.ModelAPI(rock).GetKind() == Kind.Tokens.component
    assert Usd.ModelAPI(rock).IsModel(), "groups lead down to it"
    # Its looks can be chosen in the shot.
    looks, body = rock.GetVariantSets().GetVariantSet("look"), stage.GetPrimAtPath(f"{rock.GetPath()}/geo/body")
    assert looks.GetVariantNames() == ["grey", "red"] and looks.GetVariantSelection() == "red"
    for look in ["red", "grey"]:
        looks.SetVariantSelection(look)
        bound, _ = UsdShade.MaterialBindingAPI(body).ComputeBoundMaterial()
        assert bound.GetPath().name == look
    # The asset is in the units and axes of the stage: nothing turns or scales it.
    placed = np.array(UsdGeom.Xformable(rock.GetParent()).GetLocalTransformation())
    assert (placed[:3, :3] == np.eye(3)).all()
    # A brick's material stands beside it: the kit is taken, without the wall.
    brick = stage.GetPrimAtPath("/heap_of_rocks/Bodies/Prototypes/Brick/Kit")
    bound, _ = UsdShade.MaterialBindingAPI(brick.GetPrimAtPath("Brick/Body")).ComputeBoundMaterial()
    assert bound.GetPath().name == "Clay" and not brick.GetPrimAtPath("Wall").IsActive()
    # The layer has no geometry of its own.
    text = pathlib.Path(shot.staged).read_text()
    wanted = ["@../assets/rock.usda@\n", "@../assets/kit.usd@</Kit>\n", "@../assets/kit.usd@</Kit/Wall>\n"]
    assert all(reference in text for reference in wanted) and "faceVertex" not in text


def test_copies_are_embedded_on_request(shot):
    stage = Usd.Stage.Open(shot.embedded)
    assert len(stage.GetUsedLayers(includeClipLayers=False)) == 1 + bool(stage.GetSessionLayer())
    assert not any(
        arc.GetArcType() in (Pcp.ArcTypeReference, Pcp.ArcTypePayload)
        for prim in stage.Traverse()
        for arc in Usd.PrimCompositionQuery(prim).GetCompositionArcs()
    )
    for frame in [1001, 1010, 1021]:
        assert np.abs(corners(shot.embedded, frame) - corners(shot.staged, frame)).max() < 2e-5


def test_the_stage_is_laid_out_as_asked(shot):
    stage, plain = Usd.Stage.Open(shot.staged), Usd.Stage.Open(shot.plain)
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1001, 1021)
    assert stage.GetDefaultPrim().GetPath() == "/heap_of_rocks"
    assert UsdGeom.Imageable(stage.GetDefaultPrim()).ComputePurpose() == "render"
    assert Usd.ModelAPI(stage.GetDefaultPrim()).GetKind() == Kind.Tokens.assembly
    assert plain.GetDefaultPrim().GetPath() == "/Pile" and plain.GetEndTimeCode() == 20
    # The same pile, wherever the stage's axes point to.
    moved = 0
    for frame in [0, 6, 20]:
        expected, found = corners(shot.plain, frame), corners(shot.staged, 1001 + frame)
        assert len(expected) == len(found) > 40
        order = [np.lexsort(points.round(3).T) for points in (expected, found)]
        assert np.abs(expected[order[0]] - found[order[1]]).max() < 1e-4
        assert expected[:, 1].min() > -0.02
        moved = max(moved, np.abs(expected - corners(shot.plain, 0)).max())
    assert moved > 0.02, "nothing moves: the comparison says nothing"
    walls = [UsdGeom.BBoxCache(time, ["default", "render"]) for time in (0, 1001)]
    sizes = [
        cache.ComputeWorldBound(one.GetPrimAtPath(f"{one.GetDefaultPrim().GetPath()}/Scenery")).ComputeAlignedRange()
        for cache, one in zip(walls, (plain, stage), strict=True)
    ]
    assert np.allclose(sizes[0].GetMin(), [0.85, -0.2, -0.5], atol=1e-6)
    assert np.allclose(sizes[1].GetMax(), [95, 50, 60], atol=1e-4)


def test_samples_lie_between_frames(shot):
    path = shot.bake("fine.usdc", *STAGE, "output.fps=48", "usd.samples_per_frame=2")
    stage = Usd.Stage.Open(path)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 24
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1001, 1011)
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath("/heap_of_rocks/Bodies"))
    times = instancer.GetPositionsAttr().GetTimeSamples()
    assert 1001.5 in times and all(time * 2 == int(time * 2) for time in times)
    # Motion blur within a frame leads to the next sample.
    before, after = (
        instancer.ComputeInstanceTransformsAtTime(time, base) for time, base in [(1002 - 1e-6, 1001.5), (1002, 1002)]
    )
    assert np.abs(np.array(before) - np.array(after)).max() < 0.1


def test_a_pile_at_rest_has_no_samples(shot):
    moving, still = (shot.bake(f"{motion}.usdc", *STAGE, f"usd.motion={motion}") for motion in ["lean", "none"])
    stage = Usd.Stage.Open(still)
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath("/heap_of_rocks/Bodies"))
    assert all(attribute.GetNumTimeSamples() == 0 for attribute in instancer.GetPrim().GetAttributes())
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1001, 1001)
    assert np.abs(corners(still, 1001) - corners(shot.staged, 1021)).max() < 1e-5
    assert faults(stage) == [] == faults(Usd.Stage.Open(moving))
    # Rotations of half precision, and no velocities.
    stage = Usd.Stage.Open(moving)
    lean = UsdGeom.PointInstancer(stage.GetPrimAtPath("/heap_of_rocks/Bodies"))
    assert not lean.GetVelocitiesAttr().HasValue() and lean.GetOrientationsAttr().GetNumTimeSamples() > 5


def test_a_shot_takes_the_result(shot):
    """Z up, in centimetres, from 1001 on."""
    path = shot.folder / "shots/shot.usda"
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetStartTimeCode(1001)
    stage.SetEndTimeCode(1048)
    world = UsdGeom.Xform.Define(stage, "/world")
    stage.SetDefaultPrim(world.GetPrim())
    Usd.ModelAPI(world).SetKind(Kind.Tokens.assembly)
    pile = UsdGeom.Xform.Define(stage, "/world/pile")
    pile.GetPrim().GetReferences().AddReference("./staged.usda")
    pile.AddTranslateOp().Set((100, 0, 0))
    stage.GetRootLayer().Save()
    assert faults(stage) == []
    own = corners(shot.staged, 1015)
    found = corners(str(path), 1015)
    order = [np.lexsort(points.round(3).T) for points in (own + [1, 0, 0], found)]
    assert np.abs((own + [1, 0, 0])[order[0]] - found[order[1]]).max() < 1e-4
