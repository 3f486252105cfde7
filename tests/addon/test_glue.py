"""How far a pile keeps its shape: what is asked of the server, what the file keeps, and what is told of the glue."""

import bpy
import pytest


@pytest.fixture
def glue(desk, addon):
    """What would be sent."""
    desk.add_stick()
    return lambda: addon("request").take(bpy.context).spec.scene.glue


def test_as_modelled_is_left_to_the_server(desk, glue, addon):
    assert desk.settings.kept_shape == "AS_MODELLED"
    desk.settings.glue_strength = 0.5
    assert not addon("request").take(bpy.context).spec.scene.HasField("glue")


def test_each_choice_is_sent(desk, glue, addon):
    v1 = addon("messages").v1
    desk.settings.kept_shape = "TACKY"
    assert (glue().mode, glue().strength) == (v1.GLUE_MODE_TACKY, 5.0)
    desk.settings.glue_strength = 0.3
    assert glue().strength == 0.3
    desk.settings.glue_strength = 0.0
    assert glue().HasField("strength") and glue().strength == 0.0
    desk.settings.kept_shape = "NATURAL"
    assert glue().mode == v1.GLUE_MODE_NATURAL and not glue().HasField("strength")


def test_the_other_parameters_are_in_a_panel_of_their_own(desk, glue, addon):
    fields = {field["name"] for field in addon("properties").fields_of("Glue")}
    assert {"friction_factor", "anchor", "breaking", "proof"} <= fields and not {"mode", "strength"} & fields
    desk.settings.glue.use_anchor, desk.settings.glue.anchor = True, "OFF"
    assert glue().anchor == addon("messages").v1.SWITCH_OFF and not glue().HasField("strength")


def test_a_changed_choice_is_a_changed_scene(desk, glue, addon):
    fingerprint = addon("fingerprint").of
    before = fingerprint(bpy.context.scene)
    desk.settings.kept_shape = "TACKY"
    tacky = fingerprint(bpy.context.scene)
    desk.settings.glue_strength = 20.0
    assert len({before, tacky, fingerprint(bpy.context.scene)}) == 3


def test_files_and_undo_keep_it(desk, glue, addon, tmp_path):
    request = addon("request")
    bpy.ops.ed.undo_push(message="before")
    desk.settings.kept_shape, desk.settings.glue_strength = "TACKY", 12.5
    bpy.ops.ed.undo_push(message="tacky")
    path = str(tmp_path / "tacky.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    bpy.ops.ed.undo()
    settings = bpy.context.scene.cairn
    assert (settings.kept_shape, settings.glue_strength) == ("AS_MODELLED", 5.0)
    bpy.ops.wm.open_mainfile(filepath=path)
    settings = bpy.context.scene.cairn
    assert (settings.kept_shape, settings.glue_strength) == ("TACKY", 12.5)
    kept = request.to_dict(settings)
    settings.kept_shape = "NATURAL"
    request.from_dict(settings, kept)
    assert (settings.kept_shape, settings.glue_strength) == ("TACKY", 12.5)
    # What an older add-on remembers has neither.
    older = {name: value for name, value in kept.items() if name not in ("kept_shape", "glue_strength", "glue")}
    request.from_dict(settings, older)


def test_what_is_glued_is_told(desk, glue, addon):
    v1, running, states = addon("messages").v1, addon("running"), addon("states")
    # A wall that friction alone does not carry.
    desk.control.scale = (1.0, 0.35, 1.6)
    collection = desk.bake()
    told = running.report_of(collection)
    dots = told["counts"]["glue_dots"]
    assert dots > 0 and running.glue_of(told).startswith((f"{dots} dots", "1 dot "))
    last = states.at(collection, 10**6)
    assert ((last == v1.BODY_STATE_GLUED) | (last == v1.BODY_STATE_ANCHORED)).any()
    collection = desk.bake(kept_shape="NATURAL")
    assert running.glue_of(running.report_of(collection)) == ""
    last = states.at(collection, 10**6)
    assert not ((last == v1.BODY_STATE_GLUED) | (last == v1.BODY_STATE_ANCHORED)).any()


def test_the_words_for_it(addon):
    words = addon("running").glue_of

    def told(dots, share=0.5, anchored=0.0, broken=0):
        counts = {"glue_dots": dots, "glue_dots_broken": broken}
        return {"measures": {"glued_body_fraction": share, "anchored": anchored}, "counts": counts}

    assert words({}) == words({"measures": {}}) == ""
    assert words(told(0)) == "Nothing is glued."
    assert words(told(1, 0.04)) == "1 dot of glue joins 4% of the bodies."
    assert words(told(24, 0.4, 4.0, 2)) == (
        "24 dots of glue join 40% of the bodies. 4 dots hold on to the ground or to scenery. 2 broke."
    )
