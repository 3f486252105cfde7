"""Every kind of prop, alone and beside every other: its bodies are there, look like it, and go into other files."""

import itertools

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import count_blocks, cuboid, gap, points_of, shown_vertices
from mathutils import Matrix, Vector
from test_export import check_bodies
from test_faults import refusal

COLORS = {"red": (1, 0, 0), "green": (0, 1, 0), "blue": (0, 0, 1)}


def material(name):
    """Shines in its color, so that renders need no light."""
    made = bpy.data.materials.get(name) or bpy.data.materials.new(name)
    made.use_nodes = True
    made.node_tree.nodes.clear()
    shine, out = (made.node_tree.nodes.new(kind) for kind in ("ShaderNodeEmission", "ShaderNodeOutputMaterial"))
    shine.inputs["Color"].default_value = (*COLORS[name], 1)
    made.node_tree.links.new(shine.outputs[0], out.inputs["Surface"])
    return made


def mesh(props):
    made = cuboid("Mesh", (0.3, 0.12, 0.1), props)
    made.data.materials.append(material("red"))
    # Its own, not its mesh's.
    made.material_slots[0].link = "OBJECT"
    made.material_slots[0].material = material("blue")
    return made


def linked(props):
    made = cuboid("Linked", (0.25, 0.12, 0.1), props)
    made.data.materials.append(material("green"))
    return made


def curve(props):
    data = bpy.data.curves.new("Curve", "CURVE")
    data.dimensions, data.bevel_depth, data.use_fill_caps = "3D", 0.06, True
    spline = data.splines.new("POLY")
    spline.points.add(1)
    spline.points[0].co, spline.points[1].co = (-0.1, 0, 0, 1), (0.1, 0, 0, 1)
    data.materials.append(material("green"))
    return placed("Curve", data, props)


def text(props):
    data = bpy.data.curves.new("Text", "FONT")
    data.body, data.size, data.extrude = "H", 0.3, 0.05
    data.materials.append(material("blue"))
    return placed("Text", data, props)


def surface(props):
    with bpy.context.temp_override():
        bpy.ops.surface.primitive_nurbs_surface_sphere_add(radius=0.12)
    made = bpy.context.object
    made.name = "Surface"
    # Each corner is compared with each.
    made.data.resolution_u = made.data.resolution_v = 2
    made.data.materials.append(material("red"))
    for holder in list(made.users_collection):
        holder.objects.unlink(made)
    props.objects.link(made)
    return made


def metaball(props):
    data = bpy.data.metaballs.new("Metaball")
    data.resolution = data.render_resolution = 0.05
    data.elements.new().radius = 0.2
    data.materials.append(material("green"))
    return placed("Metaball", data, props)


def instance(props):
    kit = bpy.data.collections.new("Kit")
    part = cuboid("Kit Part", (0.25, 0.12, 0.1), kit)
    part.data.materials.append(material("blue"))
    top = cuboid("Kit Top", (0.1, 0.1, 0.1), kit, location=(0, 0, 0.1))
    top.data.materials.append(material("red"))
    made = placed("Instance", None, props)
    made.instance_type, made.instance_collection = "COLLECTION", kit
    return made


def nodes(props):
    """A mesh, and two instances of another object."""
    from_ = cuboid("Node Source", (0.08, 0.08, 0.08))
    from_.data.materials.append(material("red"))
    from_.hide_render = from_.hide_viewport = False
    made = cuboid("Nodes", (0.3, 0.1, 0.06), props)
    made.data.materials.append(material("blue"))
    group = bpy.data.node_groups.new("Two", "GeometryNodeTree")
    if hasattr(group, "interface"):
        for way in ("INPUT", "OUTPUT"):
            group.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    else:
        group.inputs.new("NodeSocketGeometry", "Geometry")
        group.outputs.new("NodeSocketGeometry", "Geometry")
    new = group.nodes.new
    incoming, outgoing, join = new("NodeGroupInput"), new("NodeGroupOutput"), new("GeometryNodeJoinGeometry")
    group.links.new(incoming.outputs[0], join.inputs[0])
    for x in (-0.1, 0.1):
        info, move = new("GeometryNodeObjectInfo"), new("GeometryNodeTransform")
        info.inputs["Object"].default_value = from_
        info.inputs["As Instance"].default_value = True
        move.inputs["Translation"].default_value = (x, 0, 0.07)
        group.links.new(info.outputs["Geometry"], move.inputs[0])
        group.links.new(move.outputs[0], join.inputs[0])
    group.links.new(join.outputs[0], outgoing.inputs[0])
    made.modifiers.new("Two", "NODES").node_group = group
    # The source itself is not in the picture.
    bpy.context.scene.collection.objects.unlink(from_)
    return made


def rig(props):
    """A mesh posed by an armature, both in the collection."""
    data = bpy.data.armatures.new("Rig")
    made = placed("Rig", data, props)
    bpy.context.view_layer.objects.active = made
    bpy.ops.object.mode_set(mode="EDIT")
    bone = data.edit_bones.new("Bone")
    bone.head, bone.tail = (0, 0, 0), (0, 0, 0.2)
    bpy.ops.object.mode_set(mode="OBJECT")
    doll = cuboid("Doll", (0.1, 0.1, 0.3), props, location=(0, 0, 0.15))
    doll.data.materials.append(material("green"))
    doll.parent = made
    doll.vertex_groups.new(name="Bone").add(range(8), 1.0, "REPLACE")
    doll.modifiers.new("Armature", "ARMATURE").object = made
    made.pose.bones["Bone"].rotation_mode = "XYZ"
    made.pose.bones["Bone"].rotation_euler = (0.8, 0, 0)
    return made


def family(props):
    made = cuboid("Family", (0.3, 0.1, 0.1), props)
    made.data.materials.append(material("red"))
    child = metaball(props)
    child.name, child.parent, child.location = "Family Ball", made, (0.2, 0, 0)
    return made


def placed(name, data, props):
    made = bpy.data.objects.new(name, data)
    props.objects.link(made)
    return made


KINDS = {kind.__name__: kind for kind in (mesh, curve, text, surface, metaball, instance, nodes, rig, family, linked)}
# Blender cannot give these bodies a mesh of their own: an instance of several objects stays one.
AS_INSTANCES = {"Instance", "Family"}


def add(desk, kinds, tmp_path):
    """Props of these kinds, some meters from each other."""
    for number, kind in enumerate(kinds):
        made = KINDS[kind](desk.props)
        made.location = (2 + number, 3, 1)
    if "linked" in kinds:
        link(desk, tmp_path, "library" if bpy.app.version < (4, 0, 0) else "override")
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = None


def link(desk, tmp_path, way):
    """Puts the prop into a library, and takes it from there."""
    source = bpy.data.objects["Linked"]
    place = source.location.copy()
    path = str(tmp_path / "kit.blend")
    bpy.data.libraries.write(path, {source})
    bpy.data.objects.remove(source)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = ["Linked"]
    made = wanted.objects[0]
    if way == "override":
        made = made.override_create(remap_local_usages=True)
        made.location = place
    desk.props.objects.link(made)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mode", ["POSE", "POINTS"])
def test_alone(desk, kind, mode, tmp_path):
    add(desk, [kind], tmp_path)
    pile = desk.bake(output_mode=mode)
    assert len(desk.motion.props) > 5
    last = desk.expected(len(desk.motion.positions) - 1)
    if mode == "POSE":
        check_bodies(desk, pile)
        is_instance = bodies_of(pile)[0].name.split(" Body")[0] in AS_INSTANCES
        assert {body.type for body in bodies_of(pile)} == {"EMPTY" if is_instance else "MESH"}
    else:
        bpy.context.scene.frame_set(1000)
        owner, sent = bodies_of(pile)[0].name, desk.sent_vertices(0)
        shown = np.concatenate([found for (name, _), found in shown_vertices().items() if name == owner and len(found)])
        expected = np.concatenate([sent @ matrix[:3, :3].T + matrix[:3, 3] for matrix in last])
        assert gap(expected[::7], shown) < 1.0 and len(shown) == len(expected)
        # Nodes turn points by Euler angles in single precision, which lose half their digits near gimbal lock.
        assert max(np.abs(shown - point).sum(axis=1).min() for point in expected[::11]) < 1e-3


@pytest.mark.parametrize("kinds", list(itertools.combinations(KINDS, 2)), ids="+".join)
def test_beside_every_other(desk, addon, kinds, tmp_path):
    """What the server gets of a prop, and what its bodies are, does not depend on the other."""
    add(desk, kinds, tmp_path)
    request, parts = addon("request"), addon("parts")
    sources = [source for source, _ in request.props_of(desk.settings)]
    assert len(sources) == 2
    props = request.finish(addon("export").Exporter(bpy.context).props(sources))
    made = parts.make(bpy.context, sources, [prop.local for prop in props], as_collections=False)
    for number, (part, prop) in enumerate(zip(made, props)):
        body = part.body("Body", 1.0)
        bpy.context.scene.collection.objects.link(body)
        bpy.context.view_layer.update()
        assert (body.type == "EMPTY") == (prop.source.name in AS_INSTANCES)
        shown = shown_vertices()[("Body", 0)]
        assert len(shown) and gap(shown, prop.vertices) < 1e-5, kinds[number]
        bpy.data.objects.remove(body)


def test_all_at_once_go_into_other_files(desk, tmp_path):
    add(desk, [kind for kind in KINDS], tmp_path)
    pile = desk.bake(output_mode="POSE")
    names = {desk.recipe["props"][number]["name"] for number in desk.motion.props}
    assert len(names) >= 6, names
    wanted = shown_vertices()
    wanted = np.concatenate([wanted[body.name, 0] for body in bodies_of(pile)])
    for other in bpy.context.view_layer.objects:
        other.select_set(other.name in pile.objects)
    exporters = exporters_to(tmp_path)
    assert exporters or bpy.app.version < (4, 0, 0)
    done = {form: export() for form, (export, _) in exporters.items()}
    assert set(done.values()) <= {("FINISHED",)}, done
    for form, (_, read) in exporters.items():
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        read()
        bpy.context.view_layer.update()
        found = [points for points in shown_vertices().values() if len(points)]
        assert found, form
        found = np.concatenate(found)
        # The same surface: each vertex of the bodies is there.
        off = max(np.abs(found - point).sum(axis=1).min() for point in wanted[::29])
        assert off < 1e-3, (form, off)


def exporters_to(folder):
    """Functions that write the selection and read it, by form, of those that this Blender has."""
    made, options = {}, bpy.app.build_options
    if getattr(options, "usd", False) and hasattr(bpy.ops.wm, "usd_export"):
        path = str(folder / "pile.usdc")
        made["usd"] = (
            lambda: tuple(bpy.ops.wm.usd_export(filepath=path, selected_objects_only=True)),
            lambda: bpy.ops.wm.usd_import(filepath=path),
        )
    if getattr(options, "alembic", False):
        abc = str(folder / "pile.abc")
        made["alembic"] = (
            lambda: tuple(bpy.ops.wm.alembic_export(filepath=abc, selected=True, as_background_job=False, end=1)),
            lambda: bpy.ops.wm.alembic_import(filepath=abc, as_background_job=False),
        )
    # Debian's importer of glTF does not run.
    if bpy.app.version >= (4, 0, 0) and "io_scene_gltf2" in bpy.context.preferences.addons:
        glb = str(folder / "pile.glb")
        made["gltf"] = (
            lambda: tuple(bpy.ops.export_scene.gltf(filepath=glb, use_selection=True, export_apply=True)),
            lambda: bpy.ops.import_scene.gltf(filepath=glb),
        )
    return made


SIZE = 24


def picture(shown, tmp_path, name):
    """A render of some objects alone, [SIZE * SIZE, 3]."""
    scene = bpy.data.scenes.new("Picture")
    for one in shown:
        scene.collection.objects.link(one)
    camera = bpy.data.objects.new("Eye", bpy.data.cameras.new("Eye"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 0.9
    place = Matrix.Translation(shown[0].matrix_world.translation)
    camera.matrix_world = place @ Matrix.Rotation(0.9, 4, "X") @ Matrix.Translation((0, 0, 3))
    scene.collection.objects.link(camera)
    scene.camera, scene.render.engine = camera, "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.seed = 4, False, 0
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.render.filepath = str(tmp_path / f"{name}.png")
    bpy.ops.render.render(write_still=True, scene=scene.name)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.array(image.pixels[:]).reshape(-1, 4)[:, :3]
    bpy.data.scenes.remove(scene)
    return pixels


@pytest.mark.parametrize("kind", KINDS)
def test_a_body_renders_as_its_original(desk, addon, kind, tmp_path):
    add(desk, [kind, "mesh" if kind != "mesh" else "instance"], tmp_path)
    request, parts = addon("request"), addon("parts")
    sources = [source for source, _ in request.props_of(desk.settings) if source.name == kind.title()]
    props = request.finish(addon("export").Exporter(bpy.context).props(sources))
    (part,) = parts.make(bpy.context, sources, [props[0].local], as_collections=False)
    body = part.body("Body", 1.0)
    body.matrix_world = props[0].frame @ Matrix.Diagonal((*body.scale, 1.0))
    # Of the armature, the pose is wanted, and it is not rendered.
    source = picture([sources[0], *sources[0].children_recursive], tmp_path, "original")
    shown = picture([body], tmp_path, "body")
    assert source.max() > 0.5, "there is something to see"
    assert np.abs(source - shown).mean() < 0.02


def test_what_is_no_prop_is_named(desk, addon):
    rig(desk.props)
    for name, data in (("Key", bpy.data.lights.new("Key", "SUN")), ("Cam", bpy.data.cameras.new("Cam"))):
        placed(name, data, desk.props)
    placed("Bare Rig", bpy.data.armatures.new("Bare Rig"), desk.props)
    bulb = placed("Bulb", bpy.data.lights.new("Bulb", "POINT"), desk.props)
    bulb.parent = desk.add_stick()
    # Below a light there may be a prop.
    below = desk.add_stick("Below")
    below.parent = bpy.data.objects["Key"]
    sources = [source.name for source, _ in addon("request").props_of(desk.settings)]
    assert sorted(sources) == ["Below", "Rig", "Stick"]
    pile = desk.bake(output_mode="POSE")
    pairs = addon("wording").gathered(addon("running").report_of(pile)["warnings"], desk.recipe["names"])
    (names,) = [things for said, things in pairs if "has no surface" in said]
    assert sorted(names) == ["Bare Rig", "Bulb", "Cam", "Key"]


def big_text(holder):
    made = text(holder)
    made.data.body, made.data.size, made.data.extrude = "O", 1.6, 0.3
    made.rotation_euler.x = np.pi / 2
    return made


def big_curve(holder):
    made = curve(holder)
    made.data.bevel_depth, made.data.bevel_resolution = 0.3, 6
    made.data.splines[0].points[0].co, made.data.splines[0].points[1].co = (0, 0, 0, 1), (0, 0, 0.8, 1)
    return made


def big_metaball(holder):
    made = metaball(holder)
    made.data.elements[0].radius, made.data.resolution, made.data.render_resolution = 1.0, 0.4, 0.1
    made.location.z = 0.6
    return made


@pytest.mark.parametrize("kind", [big_text, big_curve, big_metaball])
def test_a_shape_may_be_of_any_kind(desk, addon, kind):
    desk.add_stick("Cube", (0.09, 0.09, 0.09))
    before = count_blocks()
    shape = desk.control = desk.settings.control_mesh = kind(bpy.context.scene.collection)
    bpy.context.view_layer.update()
    assert bpy.ops.cairn.use_selected.poll() or bpy.context.object is None
    assert addon("request").missing(desk.settings) == ""
    pile = desk.bake(output_mode="POSE")
    places = np.array([body.location for body in bodies_of(pile)])
    corners = np.array([shape.matrix_world @ Vector(corner) for corner in shape.bound_box])
    assert len(places) > 10 and shape.hide_render and shape.display_type == "WIRE"
    # Some roll away.
    inside = ((places > corners.min(axis=0) - 0.1) & (places < corners.max(axis=0) + 0.1)).all(axis=1)
    assert inside.mean() > 0.8
    # It is sent as it is rendered.
    (sent,) = [asset.sha256 for asset in desk.request.spec.assets if asset.uri == shape.name]
    seen = len(shape.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh().vertices)
    count = len(points_of(desk.request.contents[sent]))
    assert count > 4 * seen if kind is big_metaball else count == seen
    assert bpy.ops.cairn.delete() == {"FINISHED"}
    assert not shape.hide_render and shape.display_type == "TEXTURED"
    data = bpy.data.metaballs if kind is big_metaball else bpy.data.curves
    assert len(data) == 1 and count_blocks()["objects"] == before["objects"] + 1


def test_a_curve_is_as_fine_as_in_the_render(desk, addon):
    made = bpy.data.curves.new("Ring", "CURVE")
    made.dimensions, made.bevel_depth = "3D", 0.03
    spline = made.splines.new("BEZIER")
    spline.bezier_points.add(3)
    spline.use_cyclic_u = True
    for point, place in zip(spline.bezier_points, ((0.1, 0, 0), (0, 0.1, 0), (-0.1, 0, 0), (0, -0.1, 0))):
        point.co, point.handle_left_type, point.handle_right_type = place, "AUTO", "AUTO"
    ring, counts = placed("Ring", made, desk.props), []
    for made.render_resolution_u in (0, 3, 24):
        bpy.context.view_layer.update()
        (prop,) = addon("request").finish(addon("export").Exporter(bpy.context).props([ring]))
        (part,) = addon("parts").make(bpy.context, [ring], [prop.local], as_collections=False)
        assert len(part.data.vertices) == len(prop.vertices)
        counts.append(len(prop.vertices))
    # Else as in the view, with 12.
    assert counts[1] == counts[0] / 4 and counts[2] == 2 * counts[0] and made.resolution_u == 12
    assert len(bpy.data.curves) == 1


def test_hair_and_fur_are_named(desk, addon):
    bear, plain = desk.add_stick("Bear"), desk.add_stick("Plain", (0.2, 0.2, 0.2))
    bear.modifiers.new("Fur", "PARTICLE_SYSTEM")
    bear.particle_systems[0].settings.type = "HAIR"
    assert bear.particle_systems[0].settings.render_type == "PATH"
    if hasattr(bpy.data, "hair_curves"):
        cat = desk.add_stick("Cat", (0.25, 0.2, 0.1))
        placed("Coat", bpy.data.hair_curves.new("Coat"), desk.props).parent = cat
    pile = desk.bake(output_mode="POSE")
    pairs = addon("wording").gathered(addon("running").report_of(pile)["warnings"], desk.recipe["names"])
    (names,) = [things for said, things in pairs if "hair or fur" in said]
    assert sorted(names) == ["Bear", "Cat"][: len(names)] and len(names) == 1 + hasattr(bpy.data, "hair_curves")
    assert not any("no surface" in said for said, _ in pairs) and plain.name not in names


def test_a_flat_text_is_told_to_have_depth(desk):
    desk.add_stick()
    shape = big_text(bpy.context.scene.collection)
    shape.data.extrude = 0.0
    desk.control = desk.settings.control_mesh = shape
    bpy.context.view_layer.update()
    assert "“Text” is flat. Give it depth: “Extrude”" in refusal()
    shape.data.extrude = 0.3
    bpy.context.view_layer.update()
    assert len(bodies_of(desk.bake(output_mode="POSE"))) > 0
