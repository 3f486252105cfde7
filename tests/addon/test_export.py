"""What the server gets of odd objects, and what comes back: the bodies look as their sources do."""

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import cuboid, gap, shown_vertices
from mathutils import Euler, Matrix

CLOSE = 1e-5


def check_bodies(desk, collection):
    """Each body's shown vertices are where the server has those that it got."""
    last = len(desk.motion.positions) - 1
    bpy.context.scene.frame_set(desk.settings.start_frame + last)
    shown = shown_vertices()
    bodies = list(bodies_of(collection))
    expected = desk.expected(last)
    assert len(bodies) == len(expected) > 0
    scale = 1.0 / desk.recipe["metres"]
    for body, prop, matrix in zip(bodies, desk.motion.props, expected):
        points = desk.sent_vertices(prop) @ matrix[:3, :3].T + matrix[:3, 3]
        assert gap(points, shown[(body.name, 0)]) < CLOSE * max(1.0, scale)


@pytest.mark.parametrize("scale", [(0.5, 2.0, 1.0), (-1, 1, 1), (-1, -1.5, -1), (1, 1, -0.5)])
def test_scales_even_negative(desk, scale):
    stick = desk.add_stick()
    stick.scale = scale
    stick.rotation_euler = (0.3, 1.0, -2.0)
    stick.location = (5, -3, 2)
    collection = desk.bake()
    assert all(body.data == stick.data for body in bodies_of(collection))
    check_bodies(desk, collection)


def test_sheared_by_its_parent(desk):
    stick = desk.add_stick()
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale = (1.0, 0.6, 1.4)
    stick.parent = parent
    stick.rotation_euler = (0.4, 0.5, 0.6)
    check_bodies(desk, desk.bake())


def test_scene_units(desk):
    bpy.context.scene.unit_settings.system = "METRIC"
    bpy.context.scene.unit_settings.scale_length = 0.01
    stick = desk.add_stick(size=(36, 14, 12))
    desk.control.data.transform(Matrix.Scale(100, 4))
    collection = desk.bake()
    assert desk.request.spec.scene.props[0].path == stick.name
    # The server has metres.
    assert 0.1 < np.abs(desk.motion.positions).max() < 1.0
    check_bodies(desk, collection)


def test_modifiers_curves_and_hierarchies(desk):
    smooth = desk.add_stick("Smooth")
    smooth.modifiers.new("Bevel", "BEVEL").width = 0.02
    curve = bpy.data.curves.new("Pipe", "CURVE")
    curve.dimensions, curve.bevel_depth, curve.use_fill_caps = "3D", 0.06, True
    spline = curve.splines.new("POLY")
    spline.points.add(1)
    spline.points[0].co, spline.points[1].co = (-0.1, 0, 0, 1), (0.1, 0, 0, 1)
    desk.props.objects.link(bpy.data.objects.new("Pipe", curve))
    hammer = desk.add_stick("Hammer", (0.36, 0.1, 0.1))
    head = cuboid("Head", (0.1, 0.2, 0.1), desk.props)
    head.parent = hammer
    head.location = (0.15, 0, 0)
    head.scale = (1, 1, -1)
    collection = desk.bake()
    assert sorted(desk.recipe["names"][p.path] for p in desk.request.spec.scene.props) == ["Hammer", "Pipe", "Smooth"]
    assert set(desk.motion.props) == {0, 1, 2}
    check_bodies(desk, collection)
    bevelled = [body for body in bodies_of(collection) if body.name.startswith("Smooth")]
    assert len({body.data for body in bevelled}) == 1 and len(bevelled[0].data.vertices) > 8


def test_instances_of_collections(desk):
    kit = bpy.data.collections.new("Kit")
    kit.instance_offset = (1, 2, 3)
    cuboid("Part", (0.36, 0.14, 0.12), kit, location=(1, 2, 3))
    empty = bpy.data.objects.new("Kit Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", kit
    empty.rotation_euler, empty.scale = (1, 2, 3), (0.8, 1.0, 1.2)
    desk.props.objects.link(empty)
    collection = desk.bake()
    assert all(body.instance_collection == kit for body in bodies_of(collection))
    check_bodies(desk, collection)


@pytest.mark.parametrize("hide", ["viewport", "eye", "excluded"])
def test_hidden_props_and_colliders(desk, hide):
    stick = desk.add_stick()
    stick.modifiers.new("Bevel", "BEVEL").width = 0.01
    walls = bpy.data.collections.new("Walls")
    bpy.context.scene.collection.children.link(walls)
    cuboid("Wall", (0.1, 2, 2), walls, location=(0.6, 0, 0))
    desk.settings.colliders = walls
    layer = bpy.context.view_layer
    for source in (stick, walls.objects[0]):
        if hide == "viewport":
            source.hide_viewport = True
        elif hide == "eye":
            source.hide_set(True)
    if hide == "excluded":
        for collection in (desk.props, walls):
            layer.layer_collection.children[collection.name].exclude = True
    before = len(bpy.data.objects), len(bpy.data.scenes)
    collection = desk.bake(output_mode="POSE")
    assert (len(bpy.data.objects) - len(collection.objects), len(bpy.data.scenes)) == before
    assert len(desk.request.spec.scene.statics) == 1
    # Bevelled.
    assert len(desk.sent_vertices(0)) > 8
    check_bodies(desk, collection)


def test_shared_meshes_are_sent_once(desk):
    first = desk.add_stick("A")
    second = bpy.data.objects.new("B", first.data)
    second.location, second.rotation_euler = (3, 0, 0), Euler((1, 1, 1))
    desk.props.objects.link(second)
    desk.bake(output_mode="POSE")
    assert len(desk.request.spec.scene.props) == 2
    # The control mesh's, and one for both.
    assert len(desk.request.contents) == 2


def test_props_in_a_list_have_weights_and_sizes(desk):
    for name in ("A", "B"):
        item = desk.settings.props.add()
        item.object = cuboid(name, (0.26, 0.14, 0.12))
    desk.settings.props[0].weight = 9
    desk.settings.props[1].scale_min, desk.settings.props[1].scale_max = 0.5, 0.8
    collection = desk.bake(prop_source="LIST")
    props, scales = desk.motion.props, desk.motion.scales
    assert (props == 0).sum() > 2 * (props == 1).sum() > 0
    assert ((scales >= 0.5) & (scales <= 0.8))[props == 1].all() and (scales[props == 0] == 1).all()
    check_bodies(desk, collection)


def test_while_a_mesh_is_edited(desk):
    stick = desk.add_stick()
    bpy.context.view_layer.objects.active = stick
    stick.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.resize(value=(0.9, 0.9, 0.9))
    assert bpy.context.mode == "EDIT_MESH"
    collection = desk.bake(output_mode="POSE")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert np.ptp(desk.sent_vertices(0)[:, 0]) == pytest.approx(0.9 * 0.36)
    check_bodies(desk, collection)


def test_linked_props(desk, tmp_path):
    stick = desk.add_stick("Linked")
    stick.scale = (0.9, 1.1, 1.0)
    path = str(tmp_path / "kit.blend")
    bpy.data.libraries.write(path, {stick})
    bpy.data.objects.remove(stick)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = ["Linked"]
    desk.props.objects.link(wanted.objects[0])
    # One of the same name in the file itself is another.
    cuboid("Linked", (1, 1, 1))
    collection = desk.bake()
    assert all(body.library is None and body.data.library for body in bodies_of(collection))
    check_bodies(desk, collection)


def test_colliders_that_are_not_followed_are_told(desk):
    desk.add_stick()
    walls = bpy.data.collections.new("Walls")
    wall = cuboid("Door", (0.1, 2, 2), walls, location=(0.8, 0, 0))
    wall.keyframe_insert("location", frame=1)
    bpy.context.scene.collection.children.link(walls)
    # Blender does not move what it does not show.
    wall.hide_viewport = True
    collection = desk.bake(colliders=walls)
    warnings = desk.addon("running").report_of(collection)["warnings"]
    assert [text for text in warnings if text.startswith("Door: it moves")]


def test_weights_as_wanted_and_as_reached(desk):
    for name, size in (("A", (0.26, 0.14, 0.12)), ("B", (0.13, 0.07, 0.06))):
        desk.settings.props.add().object = cuboid(name, size)
    desk.settings.props[0].weight = 3
    pile = desk.bake(prop_source="LIST", output_mode="POSE")
    assert [prop.weight for prop in desk.request.spec.scene.props] == [3, 1]
    result = desk.addon("result")
    shares = result.shares_of(pile)
    counts = np.bincount(desk.motion.props)
    assert [(name, wanted) for name, wanted, *_ in shares] == [("A", 0.75), ("B", 0.25)]
    assert [count for *_, count in shares] == counts.tolist()
    assert sum(reached for _, _, reached, _ in shares) == pytest.approx(1)
    # By volume: B has an eighth of A's, and a third of its weight.
    desk.settings.weigh_by = "VOLUME"
    first, second = (prop.weight for prop in desk.addon("request").take(bpy.context).spec.scene.props)
    assert second / first == pytest.approx(8 / 3, rel=1e-4)
    # A sheet has a box.
    sheet = desk.settings.props.add()
    sheet.object = cuboid("Sheet", (0.2, 0.2, 0.0))
    weights = [prop.weight for prop in desk.addon("request").take(bpy.context).spec.scene.props]
    assert all(0 < weight <= 1000 for weight in weights)
    assert desk.addon("report_panels").percent(0.002) == "<1%" and desk.addon("report_panels").percent(0.5) == "50%"
