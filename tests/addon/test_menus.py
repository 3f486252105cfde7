"""Found where an artist looks for it: menus, search, presets, the redo panel, settings of each shape."""

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import cuboid


def drawn_by(function):
    """The operators and menus that a drawing function shows."""
    found = []

    class Layout:
        def __getattr__(self, name):
            def call(*words, **options):
                if name in ("operator", "operator_menu_enum"):
                    found.append(words[0])
                elif name == "menu":
                    found.append(words[0])
                return type("Button", (), {})()

            return call

    menu = type("Menu", (), {"layout": Layout()})()
    function(menu, bpy.context)
    return found


def test_menus_have_the_operators(addon):
    menus = addon("menus")
    assert menus._in_object in bpy.types.VIEW3D_MT_object._dyn_ui_initialize()
    assert menus._in_add in bpy.types.VIEW3D_MT_add._dyn_ui_initialize()
    assert drawn_by(menus._in_object) == ["CAIRN_MT_pile"] and drawn_by(menus._in_add) == ["cairn.add_shape"]
    listed = drawn_by(menus.CAIRN_MT_pile.draw)
    for name in (
        "bake",
        "settle",
        "add_on_top",
        "replace_bodies",
        "delete",
        "edit_pile",
        "use_selected",
        "select_pile",
    ):
        assert f"cairn.{name}" in listed
    for name in listed:
        getattr(bpy.ops.cairn, name.removeprefix("cairn.")).get_rna_type()


def test_the_redo_panel_knows_them(addon):
    for name in ("settle", "add_on_top", "replace_bodies", "prop_preset", "heap_preset", "add_shape", "use_selected"):
        assert {"REGISTER", "UNDO"} <= getattr(bpy.types, f"CAIRN_OT_{name}").bl_options, name


def test_done_again_with_another_seed(desk, addon):
    desk.add_stick()
    desk.bake(kept_shape="NATURAL")
    bpy.ops.cairn.edit_pile()
    name = addon("result").chosen(bpy.context).name
    bpy.ops.ed.undo_push(message="edited")
    places = []
    for seed in (1, 7):
        # As the redo panel does: back, and again.
        before = {body.name for body in bodies_of(bpy.data.collections[name])}
        assert bpy.ops.cairn.add_on_top(count=4, seed=seed) == {"FINISHED"}
        new = [body for body in bodies_of(bpy.data.collections[name]) if body.name not in before]
        places.append(np.array([body.location for body in new]))
        bpy.ops.ed.undo_push(message="added")
        bpy.ops.ed.undo()
    assert len(places[0]) == len(places[1]) == 4 and not np.allclose(*places)


def test_a_shape_is_added_and_chosen(addon):
    for style in ("MOUND", "CONE", "DRUM", "WALL"):
        assert bpy.ops.cairn.add_shape(style=style, width=2.0, height=1.0) == {"FINISHED"}
        made = bpy.context.scene.cairn.control_mesh
        assert made == bpy.context.object and tuple(made.dimensions)[::2] == pytest.approx((2.0, 1.0), abs=1e-5)
        assert min(vertex.co.z for vertex in made.data.vertices) == 0
        # Closed.
        uses = {}
        for polygon in made.data.polygons:
            for key in polygon.edge_keys:
                uses[key] = uses.get(key, 0) + 1
        assert set(uses.values()) == {2}


def test_a_pile_of_what_is_selected(desk, addon):
    first, second = desk.add_stick(), desk.add_stick("Block", (0.2, 0.2, 0.2))
    desk.settings.control_mesh = None
    layer = bpy.context.view_layer
    layer.update()
    for one in layer.objects:
        one.select_set(True)
    layer.objects.active = desk.control
    assert bpy.ops.cairn.use_selected() == {"FINISHED"}
    assert desk.settings.control_mesh == desk.control and desk.settings.prop_source == "LIST"
    assert {item.object for item in desk.settings.props} == {first, second}
    assert bpy.ops.cairn.bake() == {"FINISHED"}
    # Its bodies are no props.
    for one in layer.objects:
        one.select_set(True)
    assert bpy.ops.cairn.use_selected() == {"FINISHED"} and len(desk.settings.props) == 2


def test_presets_of_props_and_heaps(desk, addon):
    starters, settings = addon("starters"), desk.settings
    for kind, (_, density, friction, bounce) in starters.PROPS.items():
        assert bpy.ops.cairn.prop_preset(kind=kind) == {"FINISHED"}
        item = settings.prop_common
        assert (item.density, item.friction, item.restitution) == pytest.approx((density, friction, bounce))
    settings.prop_source = "LIST"
    assert not bpy.ops.cairn.prop_preset.poll()
    for name in ("A", "B"):
        settings.props.add().object = cuboid(name, (1, 1, 1))
    settings.active_prop = 1
    assert bpy.ops.cairn.prop_preset(kind="STEEL") == {"FINISHED"}
    assert [item.density for item in settings.props] == [1000, 7850]
    assert bpy.ops.cairn.heap_preset(kind="STACKED") == {"FINISHED"}
    assert settings.arrangement.order == 1 and settings.kept_shape == "NATURAL"


@pytest.mark.parametrize("kind", ["prop", "heap"])
def test_own_presets_are_blenders(desk, addon, kind):
    settings = desk.settings
    chosen = settings.prop_common if kind == "prop" else settings.arrangement
    name, value = ("density", 321.0) if kind == "prop" else ("order", 0.75)
    setattr(chosen, name, value)
    add = getattr(bpy.ops.cairn, f"add_{kind}_preset")
    assert add(name="My Own") == {"FINISHED"}
    setattr(chosen, name, 1.0)
    (folder,) = bpy.utils.preset_paths(f"cairn/{kind}s")
    menu = f"CAIRN_MT_{kind}_presets"
    options = {"filepath": f"{folder}/My_Own.py", "menu_idname": menu}
    assert bpy.ops.script.execute_preset(**options) == {"FINISHED"}
    assert getattr(chosen, name) == pytest.approx(value)
    assert add(name="My Own", remove_name=True) == {"FINISHED"}


def test_each_shape_has_its_settings(desk, addon):
    stick = desk.add_stick()
    other = cuboid("Mound", (0.6, 0.6, 0.4), location=(3, 0, 0.2))
    settings = desk.settings
    bricks = bpy.data.collections.new("Bricks")
    bpy.context.scene.collection.children.link(bricks)
    bricks.objects.link(cuboid("Brick", (0.2, 0.1, 0.07)))
    settings.seed, settings.kept_shape = 5, "NATURAL"
    # A new shape begins with the settings that are shown.
    settings.control_mesh = other
    assert settings.seed == 5
    settings.seed, settings.prop_collection, settings.arrangement.order = 9, bricks, 0.5
    settings.control_mesh = desk.control
    assert (settings.seed, settings.prop_collection, settings.arrangement.order) == (5, desk.props, 0.0)
    bricks.name, stick.name = "Red Bricks", "Rod"
    settings.control_mesh = other
    assert (settings.seed, settings.prop_collection, settings.arrangement.order) == (9, bricks, 0.5)
    assert settings.kept_shape == "NATURAL" and settings.control_mesh == other
    settings.control_mesh = None
    settings.seed = 77
    settings.control_mesh = other
    assert settings.seed == 9
    # Baked one after the other, both stay.
    first = addon("result").existing(bpy.context.scene, desk.control)
    settings.control_mesh = desk.control
    assert first is None and bpy.ops.cairn.bake() == {"FINISHED"}
    settings.control_mesh = other
    settings.accuracy = "DRAFT"
    assert bpy.ops.cairn.bake() == {"FINISHED"}
    piles = [addon("result").existing(bpy.context.scene, shape) for shape in (desk.control, other)]
    assert all(not pile.hide_viewport and len(bodies_of(pile)) > 5 for pile in piles)
    # The settings of an earlier pile choose its shape, too.
    assert bpy.ops.cairn.restore_settings(collection=piles[0].name) == {"FINISHED"}
    assert settings.control_mesh == desk.control and settings.seed == 5


def test_the_scenes_gravity_and_unit(desk, addon):
    desk.add_stick()
    scene, asked = bpy.context.scene, lambda: addon("request").take(bpy.context).spec.scene.gravity
    assert asked() == 9.81
    scene.gravity = (0, 0, -1.62)
    assert asked() == pytest.approx(1.62, abs=1e-6)
    before = addon("fingerprint").of(scene)
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 0.01
    scene.gravity = (0, 0, -162)
    assert asked() == pytest.approx(1.62, abs=1e-6) and addon("fingerprint").of(scene) != before
    scene.gravity = (0, 0, -9.81)
    # The default means the Earth, whatever the unit is.
    assert asked() == 9.81
    desk.settings.use_gravity, desk.settings.gravity = True, 3.7
    scene.use_gravity = False
    assert asked() == pytest.approx(3.7, abs=1e-6)
    desk.settings.use_gravity = False
    with pytest.raises(RuntimeError, match="gravity is off"):
        bpy.ops.cairn.bake()
    scene.use_gravity, scene.gravity = True, (3, 0, -9)
    with pytest.raises(RuntimeError, match="does not point down"):
        bpy.ops.cairn.bake()


def test_props_hidden_in_renders_are_left_out_on_request(desk, addon):
    desk.add_stick()
    hidden = desk.add_stick("Old Stick")
    hidden.hide_render = True
    names = lambda: [source.name for source, _ in addon("request").props_of(desk.settings)]  # noqa: E731
    assert names() == ["Stick", "Old Stick"]
    desk.settings.use_rendered = True
    assert names() == ["Stick"] and not addon("request").left_out(desk.settings)
