"""What USD's own library says of Cairn's results."""

import json
import pathlib
import re
import zipfile

import numpy as np
import pytest
from conftest import LAYERS
from glb import Glb, matrix
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, UsdValidation

BODIES = "/Pile/Bodies"


def opened(bake, ending="usdc"):
    return Usd.Stage.Open(bake.path(ending))


def bodies(stage):
    return UsdGeom.PointInstancer(stage.GetPrimAtPath(BODIES))


def places(stage, frame, base=None):
    """Where every body is, those included that are not there yet."""
    base = frame if base is None else base
    found = bodies(stage).ComputeInstanceTransformsAtTime(
        frame, base, UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
    )
    return np.array([np.array(place) for place in found])


def faults(stage):
    """What usdchecker finds."""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 20
    return [fault.GetErrorAsString() for fault in UsdValidation.ValidationContext(validators).Validate(stage)]


@pytest.mark.parametrize("ending", LAYERS)
def test_the_checkers_find_no_fault(bake, ending):
    stage = opened(bake, ending)
    assert not faults(stage)
    # They do look: an input of a wrong type is found.
    (surface, *_) = [prim for prim in stage.Traverse() if prim.GetName() == "Surface"]
    surface.RemoveProperty("inputs:metallic")
    UsdShade.Shader(surface).CreateInput("metallic", Sdf.ValueTypeNames.String)
    assert any("metallic" in fault for fault in faults(stage))


@pytest.mark.parametrize("ending", LAYERS)
def test_what_the_stage_states(bake, ending):
    stage = opened(bake, ending)
    assert stage.GetDefaultPrim().GetPath() == "/Pile"
    assert UsdGeom.GetStageUpAxis(stage) == "Y" and UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == bake.table["fps"]
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, len(bake.table["frames"]) - 1)
    measures = stage.GetDefaultPrim().GetCustomDataByKey("cairn:measures")
    of_a_run = {"control_overhead", "analysis_us_per_body"}
    assert measures == {
        name: value for name, value in bake.report["measures"].items() if value is not None and name not in of_a_run
    }
    origin = stage.GetRootLayer().customLayerData["cairn"]
    assert origin["result_blake3"] == bake.report["result_blake3"]
    assert json.loads(origin["scene"])["accuracy"] == "draft" and origin["versions"] == bake.report["versions"]


def test_text_crate_and_package_say_the_same(bake):
    texts = [Sdf.Layer.FindOrOpen(bake.path(ending)).ExportToString() for ending in LAYERS]
    # They are results of their own requests, each with its own hash; and text has no zero below zero.
    texts = [re.sub(r"-0(?=[,)\]])", "0", text) for text in texts]
    lines = [[line for line in text.splitlines() if "request_blake3" not in line] for text in texts]
    assert lines[0] == lines[1] == lines[2] and len(lines[0]) > 500
    # Older programs refuse what states a newer version than theirs.
    assert (bake.folder / "pile.usdc").read_bytes()[:11] == b"PXR-USDC\x00\x08\x00"


@pytest.mark.parametrize("ending", LAYERS)
def test_bodies_are_where_the_glb_has_them(bake, ending):
    stage, glb = opened(bake, ending), Glb(bake.path("glb"))
    nodes = glb.children("pile")
    assert len(nodes) == len(bake.table["bodies"]) == len(places(stage, 0)) > 10
    names = [glb.json["nodes"][node]["name"] for node in nodes]
    assert list(bodies(stage).GetIdsAttr().Get()) == [int(name.rsplit(".", 1)[1]) for name in names]
    moved = 0
    for frame in bake.frames:
        at, found = glb.at(frame, bake.table["fps"]), places(stage, frame)
        mask = bodies(stage).ComputeMaskAtTime(frame) or [True] * len(nodes)
        for body, node in enumerate(nodes):
            is_there = bake.table["frames"][frame][body] is not None
            assert bool(mask[body]) == is_there
            if is_there:
                assert np.abs(found[body] - matrix(at[node])).max() < 1e-4, (frame, body)
        moved = max(moved, np.abs(found - places(stage, 0)).max())
    assert moved > 0.1, "nothing moves: the comparison says nothing"


def test_velocities_lead_to_the_next_frame(mixed):
    stage = opened(mixed)
    attributes = [bodies(stage).GetVelocitiesAttr(), bodies(stage).GetAngularVelocitiesAttr()]
    assert all(attribute.GetNumTimeSamples() > 10 for attribute in attributes)
    for frame in [3, 6, 10]:
        arrived = places(stage, frame + 1 - 1e-6, base=frame)
        assert np.abs(arrived - places(stage, frame + 1)).max() < 1e-3
        assert np.abs(arrived - places(stage, frame)).max() > 1e-2


def test_bodies_rest_before_and_after_the_clip(still):
    """Shots begin before the clip and go on after it: USD extrapolates by velocities there."""
    stage = opened(still)
    instancer, end = bodies(stage), stage.GetEndTimeCode()
    assert end > 2
    for frame, held in [(-24, 0), (-0.5, 0), (end + 0.5, end), (end + 100, end), (1001, end)]:
        assert np.abs(places(stage, frame) - places(stage, held)).max() == 0, frame
    # Motion blur within the clip goes from pose to pose, at its ends, too.
    for frame in [0, end - 1]:
        arrived = places(stage, frame + 1 - 1e-6, base=frame)
        assert np.abs(arrived - places(stage, frame + 1)).max() < 1e-3
    # No sample is redundant.
    attributes = [instancer.GetPositionsAttr(), instancer.GetOrientationsAttr()]
    times = attributes[0].GetTimeSamples()
    assert times == attributes[1].GetTimeSamples() == instancer.GetVelocitiesAttr().GetTimeSamples()
    written = [[list(attribute.Get(time)) for attribute in attributes] for time in times]
    around = zip(written, written[1:], written[2:], strict=False)
    assert all(before != now or now != after for before, now, after in around)


def test_bodies_that_appear_later_have_no_size_before(late):
    stage = opened(late)
    hidden = [frame for frame in range(40) if late.table["frames"][frame][-1] is None]
    assert len(hidden) > 5
    last = len(late.table["bodies"]) - 1
    for frame in range(40):
        mask = bodies(stage).ComputeMaskAtTime(frame) or [True] * (last + 1)
        size = bodies(stage).GetScalesAttr().Get(frame)[last]
        assert (bool(mask[last]), size != Gf.Vec3f(0)) == (frame not in hidden, frame not in hidden)


def test_extents_are_those_of_the_bodies(bake):
    stage = opened(bake)
    for frame in bake.frames:
        extent = bodies(stage).GetExtentAttr().Get(frame)
        if not any(bake.table["frames"][frame]):
            continue
        exact = UsdGeom.BBoxCache(frame, [UsdGeom.Tokens.default_], useExtentsHint=False)
        computed = UsdGeom.Boundable.ComputeExtentFromPlugins(bodies(stage), frame)
        assert np.abs(np.array(extent) - np.array(computed)).max() < 1e-3
        assert exact.ComputeWorldBound(stage.GetPrimAtPath("/Pile")).GetRange().GetSize()[0] > 0
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            mesh = UsdGeom.Mesh(prim)
            assert np.allclose(mesh.GetExtentAttr().Get(), mesh.ComputeExtent(mesh.GetPointsAttr().Get()), atol=1e-6)


def test_scenery_moves(late):
    stage, glb = opened(late), Glb(late.path("glb"))
    (piece,) = stage.GetPrimAtPath("/Pile/Scenery").GetChildren()
    (node,) = glb.children("scenery")
    for frame in [0, 10, 20, 39]:
        place = np.array(UsdGeom.Xformable(piece).ComputeLocalToWorldTransform(frame))
        assert np.abs(place - matrix(glb.at(frame, late.table["fps"])[node])).max() < 1e-4
    assert abs(place[3][0] - 0.5) < 1e-6


@pytest.mark.parametrize("ending", LAYERS)
def test_props_keep_their_looks(mixed, ending):
    stage = opened(mixed, ending)
    tub = UsdGeom.Mesh(stage.GetPrimAtPath(f"{BODIES}/Prototypes/barrow/Barrow/Tub/Tub"))
    material, _ = UsdShade.MaterialBindingAPI(tub).ComputeBoundMaterial()
    surface, _, _ = material.ComputeSurfaceSource()
    assert surface.GetIdAttr().Get() == "UsdPreviewSurface"
    texture = UsdShade.Shader(surface.GetInput("diffuseColor").GetConnectedSources()[0][0].source.GetPrim())
    assert texture.GetIdAttr().Get() == "UsdUVTexture"
    assert texture.GetInput("sourceColorSpace").Get() == "sRGB"
    file = texture.GetInput("file").Get()
    # Found from where the layer is; in a package, in it.
    assert file.resolvedPath
    if ending == "usdz":
        with zipfile.ZipFile(mixed.path(ending)) as package:
            assert package.namelist()[0] == "pile.usdc"
            assert all(entry.compress_type == zipfile.ZIP_STORED for entry in package.infolist())
            picture = package.read(file.path.removeprefix("./"))
    else:
        picture = pathlib.Path(file.resolvedPath).read_bytes()
    assert picture.startswith((b"\x89PNG", b"\xff\xd8\xff"))
    coordinates = UsdGeom.PrimvarsAPI(tub).GetPrimvar("st")
    assert coordinates.GetInterpolation() == "vertex" and len(coordinates.Get()) == len(tub.GetPointsAttr().Get())
    # The picture is laid on twice as densely.
    transform = UsdShade.Shader(texture.GetInput("st").GetConnectedSources()[0][0].source.GetPrim())
    assert transform.GetIdAttr().Get() == "UsdTransform2d" and transform.GetInput("scale").Get() == Gf.Vec2f(2)
    reader = UsdShade.Shader(transform.GetInput("in").GetConnectedSources()[0][0].source.GetPrim())
    assert reader.GetInput("varname").Get() == "st"


def test_every_mesh_is_whole(bake):
    stage = opened(bake)
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert meshes
    for mesh in meshes:
        points, counts = mesh.GetPointsAttr().Get(), mesh.GetFaceVertexCountsAttr().Get()
        is_valid, why = UsdGeom.Mesh.ValidateTopology(mesh.GetFaceVertexIndicesAttr().Get(), counts, len(points))
        assert is_valid, why
        normals = mesh.GetNormalsAttr().Get()
        expected = {"vertex": len(points), "uniform": len(counts)}
        assert len(normals) == expected[mesh.GetNormalsInterpolation()]
        assert mesh.GetSubdivisionSchemeAttr().Get() == "none"


def test_glue_is_exported(glued):
    stage, glue = opened(glued), glued.table["glue"]
    assert len(glue["dots"]) > 5
    assert not faults(stage)
    dots = UsdGeom.Points(stage.GetPrimAtPath("/Pile/Glue"))
    assert dots.ComputePurpose() == "guide"
    assert np.abs(np.array(dots.GetPointsAttr().Get()) - [dot["point"] for dot in glue["dots"]]).max() < 1e-5
    pairs = [tuple(-1 if body is None else body for body in dot["bodies"]) for dot in glue["dots"]]
    assert [tuple(pair) for pair in UsdGeom.PrimvarsAPI(dots).GetPrimvar("cairn:bodies").Get()] == pairs
    anchored = UsdGeom.PrimvarsAPI(bodies(stage)).GetPrimvar("cairn:anchored").Get()
    assert [body for body, value in enumerate(anchored) if value] == glue["anchored"]


def test_a_pile_can_be_referred_to(mixed):
    """A shot takes the pile, and another one prop of it."""
    stage = Usd.Stage.CreateInMemory()
    stage.DefinePrim("/shot/pile").GetReferences().AddReference(mixed.path("usdc"))
    prop = stage.DefinePrim("/shot/prop")
    prop.GetReferences().AddReference(mixed.path("usdz"), f"{BODIES}/Prototypes/barrow")
    tub = UsdGeom.Mesh(stage.GetPrimAtPath("/shot/prop/Barrow/Tub/Tub"))
    material, _ = UsdShade.MaterialBindingAPI(tub).ComputeBoundMaterial()
    assert str(material.GetPath()).startswith("/shot/prop/Materials/")
    assert stage.GetPrimAtPath("/shot/pile").GetCustomDataByKey("cairn:measures")


@pytest.mark.parametrize("ending", LAYERS)
def test_the_stage_for_simulators(simulated, ending):
    stage = opened(simulated, ending)
    assert not faults(stage)
    kinds = {
        kind.name: descriptions for kind, (_, descriptions) in UsdPhysics.LoadUsdPhysicsFromRange(stage, ["/"]).items()
    }
    assert all(one.isValid for all_of_a_kind in kinds.values() for one in all_of_a_kind)
    bodies = simulated.table["bodies"]
    assert len(kinds["RigidBody"]) == len(bodies) - 1, "one is kept"
    assert len(kinds["Scene"]) == len(kinds["PlaneShape"]) == 1
    (scenery,) = stage.GetPrimAtPath("/Pile/Physics/Scenery").GetChildren()
    assert scenery.GetAttribute("physics:approximation").Get() == "none"
    # Each body stands where the picture has it at the last frame, with all of its prop within its hulls' room.
    places_seen = places(stage, stage.GetEndTimeCode())
    cache = UsdGeom.XformCache()
    masses = []
    for number, prim in enumerate(stage.GetPrimAtPath("/Pile/Physics/Bodies").GetChildren()):
        assert prim.GetDisplayName() == bodies[number]["name"]
        place = np.array(cache.GetLocalToWorldTransform(prim.GetChild("Picture").GetChild("Prop")))
        assert np.allclose(place, places_seen[number], atol=1e-4), prim
        colliders = [below for below in Usd.PrimRange(prim) if below.HasAPI(UsdPhysics.CollisionAPI)]
        assert colliders
        if prim.HasAPI(UsdPhysics.RigidBodyAPI):
            masses.append(prim.GetAttribute("physics:mass").Get())
        material = UsdShade.MaterialBindingAPI(colliders[0]).ComputeBoundMaterial("physics")[0].GetPrim()
        assert np.isclose(material.GetAttribute("physics:staticFriction").Get(), 0.7)
    assert len(set(np.round(masses, 3))) == len({body["prop"] for body in bodies})
    # The picture is shown, and only once.
    shown = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Imageable)]
    shown = [prim for prim in shown if UsdGeom.Imageable(prim).ComputeVisibility() != "invisible"]
    assert not [prim for prim in shown if prim.GetPath().HasPrefix("/Pile/Physics")]
