"""What holds what: the selected objects as bodies, their colors, and what the panel says."""

import json
from types import SimpleNamespace

import bpy
import pytest
from conftest import cuboid, once
from mathutils import Vector


@pytest.fixture
def stack(addon):
    """A board that reaches over the edge of a table, held down by a block; the board's own units are feet."""
    made = {
        "table": cuboid("table", (1.0, 1.0, 1.0), location=(0, 0, 0.5)),
        "board": cuboid("board", (1.0, 0.3, 0.05), location=(0.52, 0, 1.025)),
        "block": cuboid("block", (0.2, 0.2, 0.4), location=(0.2, 0, 1.25)),
    }
    for source in made.values():
        source.select_set(True)
    bpy.context.view_layer.objects.active = made["block"]
    return made


def test_colors_and_words(stack, addon):
    analysis = addon("analysis")
    stack["board"].color = (0.1, 0.2, 0.3, 1)
    assert bpy.ops.cairn.analyze(shown="REMOVAL") == {"FINISHED"}
    answers = {name: analysis.figures(source) for name, source in stack.items()}
    assert all(body["standing"] == "stands" for body in answers.values())
    assert answers["table"]["rests_on_it"] == ["block", "board"] or answers["table"]["rests_on_it"] == [
        "board",
        "block",
    ]
    assert not answers["block"]["removal"]["is_safe"] and answers["block"]["removal"]["moving"] == ["board"]
    assert tuple(stack["block"].color) == pytest.approx(analysis.RED)
    said = " ".join(analysis.lines(answers["block"]))
    assert "“block” stands." in said and "Without it, these begin to fall: board." in said
    falling = {**answers["board"], "standing": "falls_with_others", "least_push": 10.0}
    assert not any("carries" in line or "push" in line for line in analysis.lines(falling)), "it falls by itself"
    firm = analysis.lines({**answers["board"], "least_push": 10.0})
    assert any("No push of less than 10 times its weight" in line for line in firm)
    # Carried mass: 1 x .3 x .05 and .2 x .2 x .4 m of 1000 kg/m^3.
    assert answers["table"]["load"] == pytest.approx((0.015 + 0.016) * 1000 * 9.81, rel=1e-3)
    for shown in ("LOAD", "MARGIN", "STANDING"):
        assert bpy.ops.cairn.analyze(shown=shown) == {"FINISHED"}
    assert bpy.ops.cairn.clear_analysis() == {"FINISHED"}
    assert tuple(stack["board"].color) == pytest.approx((0.1, 0.2, 0.3, 1))
    assert not any(analysis.FIGURES in source for source in stack.values())


@once
def test_the_mouse_tells(stack, addon):
    hover = addon("hover")
    assert not bpy.ops.cairn.inspect.poll()
    assert bpy.ops.cairn.analyze() == {"FINISHED"}
    assert bpy.ops.cairn.inspect.poll()
    cuboid("part", (0.1, 0.1, 0.1), location=(0.2, 0, 1.6)).parent = stack["block"]
    bpy.context.view_layer.update()
    down = Vector((0, 0, -1))
    # From above, the first is hit by its part.
    for name, x in (("block", 0.2), ("block", 0.28), ("board", 0.9), ("table", -0.4)):
        source = hover.hit(bpy.context, Vector((x, 0, 5)), down)
        assert source == stack[name]
        assert hover.said(source).startswith(f"“{name}” stands. It carries ")
    assert hover.hit(bpy.context, Vector((9, 9, 5)), down) is None and "Esc" in hover.said(None)


@once
def test_colliders_are_scenery(stack, addon):
    analysis = addon("analysis")
    colliders = bpy.data.collections.new("colliders")
    bpy.context.scene.collection.children.link(colliders)
    colliders.objects.link(stack["table"])
    bpy.context.scene.cairn.colliders = colliders
    stack["table"].select_set(False)
    stack["block"].select_set(False)
    assert bpy.ops.cairn.analyze() == {"FINISHED"}
    assert analysis.figures(stack["board"])["standing"] == "falls_alone", "nothing holds it down"
    assert analysis.figures(stack["table"]) is None


@once
def test_units_of_the_scene(stack, addon):
    bpy.context.scene.unit_settings.scale_length = 0.01
    assert bpy.ops.cairn.analyze() == {"FINISHED"}
    answers = addon("analysis").figures(stack["table"])
    assert answers["load"] == pytest.approx((0.015 + 0.016) * 1000 * 9.81 * 1e-6, rel=1e-3)


def test_nothing_selected(addon):
    assert not bpy.ops.cairn.analyze.poll()


def middle(source):
    """Where the middle of an object's box is."""
    corners = [source.matrix_world @ Vector(corner) for corner in source.bound_box]
    return sum(corners, Vector()) / 8


def test_pull_out(stack, addon):
    bpy.context.scene.frame_set(10)
    assert not bpy.ops.cairn.pull_out.poll(), "nothing is analyzed"
    assert bpy.ops.cairn.analyze(shown="REMOVAL") == {"FINISHED"}
    said = []
    made = SimpleNamespace(report=lambda _, text: said.append(text))
    assert addon("apart").CAIRN_OT_pull_out.execute(made, bpy.context) == {"FINISHED"}
    assert said == ["“block” is out: board came down, as the analysis says"]
    assert stack["table"].animation_data is None, "it stands still"
    scene = bpy.context.scene
    scene.frame_set(10)
    assert tuple(middle(stack["board"])) == pytest.approx((0.52, 0, 1.025), abs=0.01), "all is as it was"
    assert tuple(middle(stack["block"])) == pytest.approx((0.2, 0, 1.25), abs=0.01)
    scene.frame_set(scene.frame_end)
    assert middle(stack["board"]).z < 0.7, "nothing holds it down"
    assert middle(stack["block"]).z == pytest.approx(0.2, abs=0.02) and middle(stack["block"]).x > 1.0
    assert tuple(stack["board"].matrix_world.to_scale()) == pytest.approx((1, 1, 1), rel=1e-4)
    with pytest.raises(RuntimeError, match="is animated"):
        bpy.ops.cairn.pull_out()


@once
def test_the_list_and_pull_out_say_the_same(stack, addon):
    analysis, said = addon("analysis"), addon("apart").said
    stack["cup"] = cuboid("cup", (0.1, 0.1, 0.1), location=(0.9, 0, 1.1))
    stack["cup"].select_set(True)
    assert bpy.ops.cairn.analyze() == {"FINISHED"}
    removal = analysis.figures(stack["block"])["removal"]
    assert sorted([*removal["moving"], *removal["on_these"]]) == ["board", "cup"]
    words = " ".join(analysis.lines(analysis.figures(stack["block"])))
    assert "Pull Out also shows what their fall hits." in words and "cup" in words
    sources, out = list(stack.values()), list(stack).index("block")

    def words_of(down, moved=(), **other):
        stack["block"][analysis.FIGURES] = json.dumps({"standing": "stands", "removal": {**removal, **other}})
        number = list(stack).index
        removed = {"body": out, "came_down": [number(name) for name in down]}
        removed["moved"] = [(number(name), 0.1) for name in (*down, *moved)]
        return said(sources, {"removals": [removed]}).partition(" is out: ")[2]

    assert words_of(["board", "cup"]) == "board, cup came down, as the analysis says"
    assert words_of(["board", "cup", "table"]).endswith("; table came down besides, hit or pulled along")
    assert words_of(["board"], ["cup"]).endswith("; cup began to fall and found a hold")
    assert words_of(["board"]).endswith("; cup stayed, although no forces were found that hold it")
    loose = {**analysis.figures(stack["table"]), "standing": "falls_alone"}
    stack["table"][analysis.FIGURES] = json.dumps(loose)
    assert words_of(["board", "cup", "table"]).endswith("; table came down, as without Pull Out")
    # It may lie on the ground before the block is out.
    assert words_of(["board", "cup"]).endswith("; table came down, as without Pull Out")
    safe = {"moving": [], "on_these": [], "is_safe": True}
    stack["table"][analysis.FIGURES] = json.dumps({**loose, "standing": "stands"})
    assert words_of([], **safe) == "the others stand, as the analysis says"
    assert words_of(["cup"], **safe) == "cup came down; the analysis says that all could stand"
    assert analysis.listed(list("abcdefghij")) == "a, b, c, d, e, f, g, h and 2 more"


@once
def test_what_falls_by_itself_takes_others_along(addon):
    boxes = {
        "Base": ((0.5, 0.5, 0.5), (0, 0, 0.25)),
        "Mid": ((0.8, 0.4, 0.2), (0.2, 0, 0.6)),
        "Over": ((0.8, 0.3, 0.2), (0.75, 0, 0.8)),
        "Side": ((0.09, 0.4, 0.18), (0.65, 0, 0.6)),
    }
    for name, (size, place) in boxes.items():
        cuboid(name, size, location=place).select_set(True)
    bpy.context.view_layer.objects.active = bpy.data.objects["Side"]
    assert bpy.ops.cairn.analyze() == {"FINISHED"} and bpy.ops.cairn.make_it_stand() == {"FINISHED"}
    # Marks are no bodies.
    for mark in bpy.data.collections["Needed Glue"].objects:
        mark.select_set(True)
    assert bpy.ops.cairn.analyze() == {"FINISHED"}
    words = []
    made = SimpleNamespace(report=lambda _, text: words.append(text))
    assert addon("apart").CAIRN_OT_pull_out.execute(made, bpy.context) == {"FINISHED"}
    assert "Mid moved before, as what falls by itself came down" in words[0], words
    assert not bpy.ops.cairn.make_it_stand.poll() and not bpy.ops.cairn.pull_out.poll()


@once
@pytest.mark.parametrize("mode", ["XYZ", "ZXY", "AXIS_ANGLE", "QUATERNION"])
def test_pull_out_leaves_rotation_modes_alone(stack, addon, mode):
    for source in stack.values():
        source.rotation_mode = mode
    stack["board"].rotation_mode = "XYZ"
    stack["board"].rotation_euler.z = 0.1
    bpy.context.view_layer.update()
    assert bpy.ops.cairn.analyze() == {"FINISHED"} and bpy.ops.cairn.pull_out() == {"FINISHED"}
    assert stack["block"].rotation_mode == mode and stack["board"].rotation_mode == "XYZ"
    scene = bpy.context.scene
    scene.frame_set(1)
    assert stack["board"].matrix_world.to_euler().z == pytest.approx(0.1, abs=0.01)
    tops = []
    for frame in range(1, scene.frame_end):
        # Between two keys as well, nothing turns the long way.
        for part in (0.0, 0.5):
            scene.frame_set(frame, subframe=part)
            tops.append(stack["board"].matrix_world.to_quaternion())
    turns = [one.rotation_difference(other).angle for one, other in zip(tops, tops[1:])]
    assert max(min(turn, 6.2832 - turn) for turn in turns) < 0.5
    assert middle(stack["board"]).z < 0.7


@once
def test_what_floats_falls(stack, addon):
    """Glue says so, moves do it, and no message sends to the other for the same object."""
    high = cuboid("high", (0.2, 0.2, 0.2), location=(-0.3, 0, 2.5))
    on_it = cuboid("on it", (0.1, 0.1, 0.1), location=(-0.3, 0, 2.65))
    for source in (high, on_it):
        source.select_set(True)
    bpy.context.view_layer.update()
    stood = {name: source.matrix_world.copy() for name, source in stack.items()}
    said, apart = [], addon("apart")

    assert bpy.ops.cairn.analyze() == {"FINISHED"}
    for way in ("GLUE", "MOVES", "MOVES", "GLUE"):
        made = SimpleNamespace(report=lambda _, text: said.append(text), by=way)
        assert apart.CAIRN_OT_make_it_stand.execute(made, bpy.context) == {"FINISHED"}
    assert "Choose Moves" in said[0] and "2 objects fell to what carries them; all stand now" in said, said
    assert not any("Use glue" in text or "use glue" in text for text in said), said
    bpy.context.view_layer.update()
    # They lie on the table, or have rolled off it.
    assert middle(high).z == pytest.approx(1.1, abs=0.02) and middle(on_it).z < 1.3
    assert all(source.matrix_world == stood[name] for name, source in stack.items())
    # Without another look.
    assert all(addon("analysis").figures(source)["standing"] == "stands" for source in (high, on_it))


@once
def test_colors_are_seen_at_once(stack, addon):
    # Blender has screens without a window, too.
    views = [
        area.spaces.active.shading for screen in bpy.data.screens for area in screen.areas if area.type == "VIEW_3D"
    ]
    if not views:
        pytest.skip("no 3D View without a window")
    assert bpy.ops.cairn.analyze() == {"FINISHED"}
    assert all(shading.color_type == "OBJECT" for shading in views)
    assert bpy.ops.cairn.clear_analysis() == {"FINISHED"}
    assert all(shading.color_type != "OBJECT" for shading in views)


@once
def test_what_falls_is_marked(stack, addon):
    bpy.data.objects.remove(stack["block"])
    assert bpy.ops.cairn.analyze() == {"FINISHED"}
    assert bpy.ops.cairn.make_it_stand() == {"FINISHED"}
    (dot,) = bpy.data.collections[addon("apart").DOTS].objects
    assert dot.name == "table – board" and dot["force_newton"] > 0
    assert dot.location.z == pytest.approx(1.0, abs=0.01)
    # A view of all of it shows it: some 1.5 m, in 600 pixels.
    assert dot.show_in_front and 0.02 < dot.empty_display_size < 0.05
    assert bpy.ops.cairn.make_it_stand() == {"FINISHED"}
    assert len(bpy.data.collections[addon("apart").DOTS].objects) == 1, "not once more"


@once
@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_what_falls_is_moved(stack, addon, scale):
    """Without the block that holds it down, the board has to come back over the table; what floats comes down."""
    bpy.context.scene.unit_settings.scale_length = scale
    bpy.data.objects.remove(stack["block"])
    # The ground is where the lowest of all stands.
    cuboid("stone", (0.2, 0.2, 0.2), location=(3, 0, 0.1)).select_set(True)
    stack["table"].location.z += 0.1
    stack["board"].location.z += 0.1
    bpy.context.view_layer.update()
    assert bpy.ops.cairn.analyze() == {"FINISHED"}
    assert bpy.ops.cairn.make_it_stand(by="MOVES") == {"FINISHED"}
    bpy.context.view_layer.update()
    assert middle(stack["table"]).z == pytest.approx(0.5, abs=1e-3)
    assert middle(stack["board"]).z == pytest.approx(1.025, abs=2e-3)
    assert 0.4 < middle(stack["board"]).x < 0.5
    assert all(addon("analysis").figures(stack[name])["standing"] == "stands" for name in ("table", "board"))
