"""Assets of a show, as its departments publish them, made by USD's own library."""

import math

from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdShade

BOX = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]


def new(path, top, axis, unit):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, axis)
    UsdGeom.SetStageMetersPerUnit(stage, unit)
    prim = UsdGeom.Xform.Define(stage, top).GetPrim()
    stage.SetDefaultPrim(prim)
    return stage, prim


def mesh(stage, path, points, counts, corners):
    made = UsdGeom.Mesh.Define(stage, path)
    made.CreatePointsAttr(points)
    made.CreateFaceVertexCountsAttr(counts)
    made.CreateFaceVertexIndicesAttr(corners)
    made.CreateSubdivisionSchemeAttr("none")
    made.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(made.GetPointsAttr().Get()))
    return made


def box(stage, path, size, centre=(0, 0, 0)):
    signs = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    points = [tuple(c + s * length / 2 for c, s, length in zip(centre, sign, size, strict=True)) for sign in signs]
    return mesh(stage, path, points, [4] * 6, BOX)


def material(stage, path, color):
    made = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, f"{path}/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
    made.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    return made


def rock(folder):
    """In centimetres, Z up: an asset whose geometry is a payload, with two looks of which the second is chosen."""
    stage, top = new(folder / "rock_geo.usdc", "/rock", "Z", 0.01)
    body = box(stage, "/rock/geo/body", (24, 14, 10), (0, 0, 5))
    looks = top.GetVariantSets().AddVariantSet("look")
    for look, color in [("grey", (0.4, 0.4, 0.42)), ("red", (0.6, 0.15, 0.1))]:
        made = material(stage, f"/rock/looks/{look}", color)
        looks.AddVariant(look)
        looks.SetVariantSelection(look)
        with looks.GetVariantEditContext():
            UsdShade.MaterialBindingAPI.Apply(body.GetPrim()).Bind(made)
    UsdGeom.Scope.Define(stage, "/rock/looks")
    UsdGeom.Xform.Define(stage, "/rock/geo")
    stage.GetRootLayer().Save()
    stage, top = new(folder / "rock.usda", "/rock", "Z", 0.01)
    Usd.ModelAPI(top).SetKind(Kind.Tokens.component)
    top.GetPayloads().AddPayload("./rock_geo.usdc")
    top.GetVariantSets().GetVariantSet("look").SetVariantSelection("red")
    stage.GetRootLayer().Save()


def kit(folder):
    """In metres, Y up: a brick and a wall, away from the origin."""
    stage, _ = new(folder / "kit.usd", "/Kit", "Y", 1)
    clay = material(stage, "/Kit/Clay", (0.7, 0.3, 0.2))
    brick = UsdGeom.Xform.Define(stage, "/Kit/Brick")
    brick.AddTranslateOp().Set((3, 1, 2))
    brick.AddRotateYOp().Set(30)
    body = box(stage, "/Kit/Brick/Body", (0.2, 0.07, 0.1))
    UsdShade.MaterialBindingAPI.Apply(body.GetPrim()).Bind(clay)
    wall = UsdGeom.Xform.Define(stage, "/Kit/Wall")
    wall.AddTranslateOp().Set((0.9, 0.2, 0))
    box(stage, "/Kit/Wall/Body", (0.1, 0.8, 1.0))
    stage.GetRootLayer().Save()


def heap(folder, radius=40, height=35, sides=24):
    """In centimetres, Z up: the shape of the pile."""
    stage, _ = new(folder / "heap.usda", "/Heap", "Z", 0.01)
    turns = [2 * math.pi * i / sides for i in range(sides)]
    points = [(radius * math.cos(turn), radius * math.sin(turn), 0) for turn in turns] + [(0, 0, height)]
    corners = [corner for i in range(sides) for corner in (i, (i + 1) % sides, sides)]
    mesh(stage, "/Heap/Cone", points, [3] * sides + [sides], [*corners, *range(sides - 1, -1, -1)])
    stage.GetRootLayer().Save()
