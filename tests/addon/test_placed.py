"""What is placed by hand: colliders that move, objects that stay, projectiles, drops."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import cuboid, once, shown_vertices


@pytest.fixture
def placing(desk):
    """A desk, if the server's schema has bodies."""
    if not desk.addon("schema").knows("Body"):
        pytest.skip("the schema has no bodies placed by hand")
    desk.add_stick()
    return desk


def collection(name, *objects):
    made = bpy.data.collections.new(name)
    bpy.context.scene.collection.children.link(made)
    for source in objects:
        bpy.context.scene.collection.objects.unlink(source)
        made.objects.link(source)
    return made


def test_moving_colliders_are_followed(placing):
    wall = cuboid("Wall", (0.2, 1.2, 1.0))
    wall.scale = (1, 1, 0.8)
    wall.rotation_euler.z = 0.2
    for frame, x in ((1, 1.5), (10, 1.5), (20, 0.3)):
        wall.location.x = x
        wall.keyframe_insert("location", frame=frame)
    made = placing.bake(colliders=collection("Walls", wall), use_frame_count=True, frame_count=24)
    (scenery,) = placing.request.spec.scene.statics
    numbers = [key.frame for key in scenery.keyframes]
    # Standing, moving, standing.
    assert numbers[0] == 0 and 9 in numbers and 19 in numbers and 23 not in numbers and 5 not in numbers
    assert scenery.keyframes[0].position[0] == pytest.approx(1.5)
    assert scenery.keyframes[-1].position[0] == pytest.approx(0.3)
    # It has pushed the pile.
    bpy.context.scene.frame_set(25)
    names = {body.name for body in bodies_of(made)}
    points = [points for (name, _), points in shown_vertices().items() if name in names]
    assert np.median([p[:, 0].mean() for p in points]) < -0.02
    assert bpy.context.scene.frame_current == 25


def test_colliders_that_grow_are_refused(placing):
    wall = cuboid("Wall", (0.2, 1.2, 1.0), location=(1, 0, 0))
    for frame, size in ((1, 1.0), (10, 2.0)):
        wall.scale.z = size
        wall.keyframe_insert("scale", frame=frame)
    placing.settings.colliders = collection("Walls", wall)
    with pytest.raises(RuntimeError, match="“Wall” changes its size"):
        bpy.ops.cairn.bake()


def test_what_is_kept_stays_and_is_not_made_twice(placing):
    rock = cuboid("Rock", (0.3, 0.3, 0.3))
    rock.location, rock.rotation_euler = (0.05, 0.02, 0.151), (0, 0, 0.5)
    kept = collection("Kept", rock)
    before = rock.matrix_basis.copy()
    made = placing.bake(keep=kept)
    (body,) = placing.request.spec.scene.bodies
    assert body.kept and body.position == pytest.approx([0.05, 0.151, -0.02], abs=1e-6)
    assert len(bodies_of(made)) == (placing.motion.props == 0).sum() == len(placing.motion.props) - 1
    where = placing.expected(-1)[placing.motion.props == 1][0]
    assert np.abs(where - np.array(rock.matrix_world)).max() < 1e-5
    assert rock.matrix_basis == before and not rock.hide_render
    assert not [body for body in bodies_of(made) if body.name.startswith("Rock")]


def test_projectiles_appear_and_hit(placing):
    ball = cuboid("Ball", (0.2, 0.2, 0.2))
    ball.location = (2.0, 0, 0.25)
    made = placing.bake(
        impact=collection("Thrown", ball),
        impact_frame=6,
        impact_velocity=(-8, 0, 1),
        use_impact_mass=True,
        impact_mass=50,
        use_frame_count=True,
        frame_count=30,
    )
    (thrown,) = placing.request.spec.scene.bodies
    assert thrown.start_frame == 5 and thrown.mass == 50 and list(thrown.velocity) == [-8, 1, 0]
    (body,) = [body for body in bodies_of(made) if body.name.startswith("Ball")]
    bpy.context.scene.frame_set(4)
    assert body.hide_render and body.hide_viewport
    bpy.context.scene.frame_set(7)
    assert not body.hide_render and 1.0 < body.matrix_world.translation.x < 2.0
    bpy.context.scene.frame_set(10)
    assert body.matrix_world.translation.x < 1.0, "it comes to the pile"
    bpy.context.scene.frame_set(31)
    assert body.matrix_world.translation.x > -1.0, "the pile stops it"


def test_drops(placing):
    cloud = cuboid("Cloud", (0.8, 0.8, 0.8), location=(0, 0, 1.6))
    made = placing.bake(
        drop_mesh=cloud,
        drop_frame=3,
        drop_count=4,
        drop_rate=20,
        use_frame_count=True,
        frame_count=30,
        region=placing.control,
    )
    assert placing.request.spec.scene.HasField("region")
    present = placing.motion.present
    assert present[-1].sum() == present[0].sum() + 4
    assert len(bodies_of(made)) == len(placing.motion.props)


def test_tilt(placing):
    placing.settings.prop_common.tilt = 20
    placing.bake(output_mode="POSE")
    assert placing.request.spec.scene.props[0].tilt_max == 20


def test_how_props_lie(placing):
    placing.add_stick("Plank", (0.5, 0.14, 0.05))
    # Unset fields are not sent.
    asked = placing.addon("request").take(bpy.context).spec.scene
    assert not asked.HasField("fill") and not asked.props[0].turns and not asked.props[0].up
    chosen, common = placing.settings.arrangement, placing.settings.prop_common
    set_here = {
        "order": 0.9,
        "surface": 0.25,
        "shake": 0.3,
        "layout": "BANDS",
        "sort_by": "MASS",
        "descending": True,
        "gaps": True,
    }
    for name, value in set_here.items():
        setattr(chosen, name, value)
    common.up, common.turns, common.skew = "NEGATIVE_Y", "QUARTER", 0.5
    made = placing.bake(output_mode="POSE")
    v1 = placing.addon("messages").v1
    fill = placing.request.spec.scene.fill
    assert (fill.order, fill.surface, fill.shake) == pytest.approx((0.9, 0.25, 0.3))
    assert (fill.layout, fill.sort_by) == (v1.LAYOUT_BANDS, v1.SORT_BY_MASS)
    assert fill.descending and fill.gaps
    # Blender's -Y is the server's Z.
    for prop in placing.request.spec.scene.props:
        assert list(prop.up) == [0, 0, 1] and prop.turns == v1.TURNS_QUARTER and prop.scale_skew == 0.5
    # Laid, not thrown: each of them has its Y axis down.
    turns = np.array([np.array(body.matrix_world)[:3, :3] for body in bodies_of(made)])
    assert (turns[:, 2, 1] < -0.9).mean() > 0.7
    # A result brings them back.
    for name in set_here:
        chosen.property_unset(name)
    common.up, common.turns, common.skew = "AUTO", "ANY", 0.0
    assert bpy.ops.cairn.restore_settings(collection=made.name) == {"FINISHED"}
    for name, value in set_here.items():
        # Blender keeps single precision.
        assert getattr(chosen, name) == (pytest.approx(value) if isinstance(value, float) else value), name
    assert (common.up, common.turns, common.skew) == ("NEGATIVE_Y", "QUARTER", 0.5)


@pytest.mark.parametrize(
    "up, way",
    [("X", [1, 0, 0]), ("Y", [0, 0, -1]), ("Z", [0, 1, 0]), ("NEGATIVE_X", [-1, 0, 0]), ("NEGATIVE_Z", [0, -1, 0])],
)
def test_up_is_told_in_the_servers_axes(placing, up, way):
    placing.settings.prop_common.up = up
    assert list(placing.addon("request").take(bpy.context).spec.scene.props[0].up) == way


def test_a_stacked_fill_is_as_tidy_as_the_slider_says(placing):
    settings, take = placing.settings, placing.addon("request").take
    settings.fill.use_method, settings.fill.method = True, "STACK"
    fill = take(bpy.context).spec.scene.fill
    assert fill.HasField("order") and fill.order == 0
    # The sorting field is sent only where something is sorted.
    settings.arrangement.layout, settings.arrangement.descending = "CLUSTERS", True
    fill = take(bpy.context).spec.scene.fill
    assert fill.layout and not fill.HasField("descending")


def test_bodies_come_from_an_empty_and_follow_a_curve(placing):
    if not placing.addon("schema").knows("Entrance"):
        pytest.skip("the schema has no entrance")
    spout = bpy.data.objects.new("Spout", None)
    spout.location = (1.5, 0.25, 2.0)
    data = bpy.data.curves.new("Line", "CURVE")
    spline = data.splines.new("BEZIER")
    spline.bezier_points.add(1)
    for point, x in zip(spline.bezier_points, (1.0, -1.0)):
        point.co = (x, 0, 0)
        point.handle_left_type = point.handle_right_type = "VECTOR"
    line = bpy.data.objects.new("Line", data)
    for source in (spout, line):
        bpy.context.scene.collection.objects.link(source)
    line.location.z = 0.5
    bpy.context.view_layer.update()
    entrance = placing.settings.entrance
    entrance.use_kind, entrance.kind = True, "POUR"
    entrance.use_duration, entrance.duration = True, 1.0
    made = placing.bake(entrance_source=spout, entrance_curve=line)
    asked = placing.request.spec.scene.entrance
    assert list(asked.source) == pytest.approx([1.5, 2.0, -0.25])
    assert not asked.curve, "another order"
    assert len(bodies_of(made)) > 5
    entrance.use_order, entrance.order = True, "ALONG"
    placing.bake(entrance_source=spout, entrance_curve=line)
    curve = np.array(placing.request.spec.scene.entrance.curve).reshape(-1, 3)
    assert len(curve) == 16
    assert curve[[0, -1]] == pytest.approx(np.array([[1.0, 0.5, 0.0], [-1.0, 0.5, 0.0]]), abs=1e-6)


@once
@pytest.mark.parametrize("angle", [0, 90, 200])
def test_a_pile_collapses_to_the_side_that_is_chosen(desk, addon, angle):
    desk.control = desk.settings.control_mesh = cuboid("Tower", (0.4, 0.4, 1.4), location=(0, 0, 0.7))
    desk.add_stick("Brick", (0.2, 0.1, 0.06))
    before = desk.bake(output_mode="POSE")
    first = len(bodies_of(before)) // 2
    named = {"use_collapse_first": angle == 90, "collapse_first": first, "use_collapse_frame": angle == 90}
    named["output_mode"] = "ANIMATION"
    pile = desk.bake(use_collapse=True, collapse_angle=angle, collapse_frame=31, **named)
    ways = desk.motion.positions[-1] - desk.motion.positions[0]
    # Blender's X and Y.
    way = np.array([ways[:, 0].mean(), -ways[:, 2].mean()])
    fell = np.degrees(np.arctan2(way[1], way[0]))
    # Glue that the collapse ends was there before, and did not break.
    glue, scene = addon("glue"), bpy.context.scene
    shown = []
    for frame in (1, scene.frame_end):
        scene.frame_set(frame)
        shown.append(glue.has_ended(pile))
    assert shown == [False, True] and not any(dot["broken"] for dot in glue.dots_of(pile))
    # It says what the figures are of.
    said = addon("report_panels").figures_of(pile)
    before, after = said.index(("Before the Collapse", "")), said.index(("At the End", ""))
    match = [float(text.rstrip("%")) for title, text in said if title == "Shape Match"]
    assert before < after and len(match) == 2 and match[0] > 60.0 > match[1] and "Kept Shape" in dict(said)
    assert np.linalg.norm(way) > 0.2 and abs((fell - angle + 180) % 360 - 180) < 25, (fell, angle)
    if angle == 90:
        assert np.abs(desk.motion.positions[:30] - desk.motion.positions[0]).max() < 0.05
        moved = np.linalg.norm(desk.motion.positions[29:] - desk.motion.positions[29], axis=2) > 0.004
        assert moved.argmax(axis=0)[first - 1] == moved.any(axis=1).argmax(), "no other is earlier"


def test_bodies_are_counted_as_their_names_are(addon):
    dots = addon("dots")

    class Pile:
        class cairn:  # noqa: N801 as a collection has it
            left_out = "[0, 3]"

    assert [dots.number_of(Pile, body) for body in range(5)] == [None, 1, 2, None, 3]
    assert [dots.body_of(Pile, number) for number in (1, 2, 3)] == [1, 2, 4] and dots.body_of(None, 3) == 2


@once
def test_bodies_behind_a_wall_are_reported(desk, addon):
    desk.add_stick("Cube", (0.1, 0.1, 0.1))
    desk.settings.colliders = collection("Walls", cuboid("Wall", (0.04, 3.0, 2.0), location=(0.22, 0, 1.0)))
    desk.settings.colliders.objects.link(cuboid("Table", (3.0, 3.0, 0.1), location=(0, 0, -0.05)))

    def said():
        pile = desk.bake(output_mode="POSE")
        warnings = addon("running").report_of(pile)["warnings"]
        return bodies_of(pile), [text for text in warnings if "behind" in text]

    bodies, (text,) = said()
    behind = sum(body.location.x > 0.22 for body in bodies)
    assert 0 < behind < len(bodies) / 2
    assert text.startswith(f"{behind} of {len(bodies)} bodies lie behind “Wall”, apart from the others")
    # Bodies over its rim do not join its two sides.
    wall, rim = bpy.data.objects["Wall"], 0.6 * max(body.location.z for body in bodies)
    wall.scale.z = rim / 2.0
    bpy.context.view_layer.update()
    bodies, (text,) = said()
    behind = sum(body.location.x > 0.22 and body.location.z < rim for body in bodies)
    assert 0.8 * behind <= int(text.partition(" ")[0]) <= behind
    # The same wall beside the shape.
    bpy.data.objects["Wall"].location.x += 0.5
    bpy.context.view_layer.update()
    assert said()[1] == []


@once
def test_bodies_that_went_over_a_wall_are_reported(desk, addon):
    desk.settings.colliders = collection("Walls", cuboid("Wall", (0.04, 3.0, 0.4), location=(0.5, 0, 0.2)))
    bpy.context.view_layer.update()

    def shot(*places):
        return SimpleNamespace(present=np.ones(len(places), bool), positions=np.array([(x, 0.1, 0) for x in places]))

    def reported(*shots):
        found = addon("walls").notes(bpy.context.scene, shots, 1.0)
        while True:
            try:
                next(found)
            except StopIteration as end:
                return end.value

    inside, over = shot(-0.2, -0.1, 0.0, 0.1, 0.2, 0.3, 0.4), shot(-0.2, -0.1, 0.0, 0.1, 0.2, 0.3, 0.6)
    assert reported(inside, inside) == []
    (text,) = reported(inside, over)
    assert text.startswith("1 of 7 bodies comes to lie behind “Wall”, over its rim")
    (text,) = reported(over, shot(-0.2, -0.1, 0.0, 0.1, 0.2, 0.6, 0.7))
    assert text.startswith("1 of 7 bodies lies behind “Wall”") and text.endswith(
        "In the end, 2 lie behind it: others went over it"
    )


@once
def test_what_is_thrown_and_stays_in_view_is_reported(placing, addon):
    desk = placing
    ball = cuboid("Ball", (0.2, 0.2, 0.2), location=(3, 0, 1))
    desk.settings.impact = collection("Thrown", ball)
    desk.settings.impact_velocity = (-4, 0, 0)

    def reported():
        pile = desk.bake(use_frame_count=True, frame_count=4)
        return [text for text in addon("running").report_of(pile)["warnings"] if "A copy is thrown" in text]

    assert reported() == ["A copy is thrown, and “Ball” is rendered, too. Hide it"]
    ball.hide_render = True
    assert reported() == []


@once
def test_a_motion_beyond_the_end_of_the_scene_is_reported(placing, addon):
    pile = placing.bake(use_frame_count=True, frame_count=24)
    scene, reported = bpy.context.scene, addon("report_panels").changed_since
    assert not any("moves until" in text for text in reported(scene, pile))
    scene.frame_end = pile.cairn.timing_start + 5
    assert any(text.endswith(f"the scene ends at {scene.frame_end}.") for text in reported(scene, pile))
