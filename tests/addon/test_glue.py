"""How far a pile keeps its shape: the request, what the file keeps, and what the panels say of the glue."""

import json

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import TURN, count_blocks
from test_motion import made_up, write


@pytest.fixture
def glue(desk, addon):
    """The request that would be sent."""
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
    fields = {field["name"] for field in addon("schema").fields_of("Glue")}
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
    report = running.report_of(collection)
    dots = report["counts"]["glue_dots"]
    assert dots > 0 and running.glue_of(report).startswith((f"{dots} dots", "1 dot "))
    last = states.at(collection, 10**6)
    assert ((last == v1.BODY_STATE_GLUED) | (last == v1.BODY_STATE_ANCHORED)).any()
    collection = desk.bake(kept_shape="NATURAL")
    assert running.glue_of(running.report_of(collection)) == ""
    last = states.at(collection, 10**6)
    assert not ((last == v1.BODY_STATE_GLUED) | (last == v1.BODY_STATE_ANCHORED)).any()


def test_the_words_for_it(addon):
    words = addon("running").glue_of

    def report_with(dots, share=0.5, anchored=0.0, broken=0):
        counts = {"glue_dots": dots, "glue_dots_broken": broken}
        return {"measures": {"glued_body_fraction": share, "anchored": anchored}, "counts": counts}

    assert words({}) == words({"measures": {}}) == ""
    assert words(report_with(0)) == "Nothing is glued."
    assert words(report_with(1, 0.04)) == "1 dot of glue joins 4% of the bodies."
    assert words(report_with(24, 0.4, 4.0, 2)) == (
        "24 dots of glue join 40% of the bodies. 4 dots hold the pile to the ground or to scenery. 2 broke."
    )
    collapsed = {**report_with(24, 0.4, 0.0, 24), "collapse_frame": 30}
    assert words(collapsed) == "Before the collapse: 24 dots of glue join 40% of the bodies."


def test_dots_are_where_the_server_has_them(desk, glue, addon):
    """Each on a body that it joins, whatever the body does then."""
    desk.control.scale = (1.0, 0.35, 1.6)
    bakes, running, view, dots = [], addon("running"), addon("glue"), addon("dots")
    record = running.Bake.record
    running.Bake.record = lambda bake: bakes.append(bake) or record(bake)
    try:
        collection = desk.bake(start_frame=5)
    finally:
        running.Bake.record = record
    report = bakes[-1].job.report
    listed = view.dots_of(collection)
    assert len(listed) == len(report["glue"]["dots"]) > 0
    assert [dot["load"] for dot in listed] == sorted((dot["load"] for dot in listed), reverse=True)
    assert listed[0]["load"] == pytest.approx(report["measures"]["glue_force_max"], rel=1e-3)
    bpy.context.scene.frame_set(10**5)
    expected = np.array([dot["point"] for dot in report["glue"]["dots"]]) @ TURN.T
    found = view.places(collection)
    assert np.abs(found[:, None] - expected[None]).max(axis=2).min(axis=1).max() < 1e-4
    first = view.objects_of(collection)[dots.number_of(collection, listed[0]["body"])]
    first.animation_data_clear()
    first.location.x += 1.0
    bpy.context.view_layer.update()
    assert view.places(collection)[0][0] - found[0][0] == pytest.approx(1.0, abs=1e-4)
    assert bpy.ops.cairn.select_dot(collection=collection.name, dot=0) == {"FINISHED"}
    assert first in bpy.context.selected_objects
    # Bodies have the color of the most that a dot on them carries, and then their own again.
    own = tuple(first.color)
    states, manager = addon("states"), bpy.context.window_manager
    manager.cairn_loads = True
    wanted = states.LINEAR[len(states.STATES) + dots.level(listed[0]["load"])]
    assert np.allclose(first.color, wanted, atol=1e-6) and not manager.cairn_states
    manager.cairn_loads = False
    assert tuple(first.color) == own


def test_bodies_that_are_not_shown_are_left_out_of_the_count(addon):
    dots = addon("dots")
    made = bpy.data.collections.new("Pile")
    made.cairn.left_out = "[1, 4]"
    assert [dots.number_of(made, body) for body in (0, 1, 2, 3, 4, 5, None)] == [1, None, 2, 3, None, 4, None]
    dots_of_all = [{"body": 0, "other": 2, "load": 3.0}, {"body": 2, "other": None, "load": 0.1}]
    assert dots.loads(made, dots_of_all, 4).tolist() == [4, 4, 0, 0]


def made_up_glue(desk, addon, mode):
    """A pile that moves, with dots on bodies that do, and on the ground."""
    motion = made_up(addon)
    collection = write(desk, motion, mode)
    remembered = [
        {"body": body, "other": other, "at": [0.1, -0.2, 0.3], "load": load, "broken": False}
        for body, other, load in ((3, 4, 7.0), (7, None, 1.5), (19, 0, 0.2))
    ]
    collection.cairn.report = json.dumps({"dots": remembered, "measures": {"prop_diameter": 0.3}})
    return collection, motion, remembered


@pytest.mark.parametrize("mode", ["ANIMATION", "POINTS"])
def test_dots_go_along_with_bodies_of_both_kinds(desk, addon, mode):
    collection, motion, remembered = made_up_glue(desk, addon, mode)
    view, scene = addon("glue"), bpy.context.scene

    def holds(frame, number):
        scene.frame_set(int(frame), subframe=frame % 1)
        matrices = desk.expected(number)
        # The bodies' sizes do not matter.
        turns = matrices[:, :3, :3] / motion.scales[:, None, None]
        wanted = [turns[dot["body"]] @ dot["at"] + matrices[dot["body"], :3, 3] for dot in remembered]
        return np.abs(view.places(collection) - wanted).max() < 1e-4

    assert all(holds(1 + number, number) for number in range(len(motion.positions)))
    assert holds(-5, 0) and holds(500, len(motion.positions) - 1)
    note = collection.cairn
    note.timing_start, note.timing_hold, note.timing_speed, note.timing_ease = 10, 5, 0.5, 1.0
    times = addon("timing").shown(collection)
    assert all(holds(float(times[number]), number) for number in (0, 4, 11))
    for shown in bodies_of(collection):
        shown.location.x += 2.0 if mode == "POINTS" else 0.0
    bpy.context.view_layer.update()
    before = view.places(collection)
    assert mode == "ANIMATION" or not holds(float(times[4]), 4)
    assert bpy.ops.cairn.keep_pose() == {"FINISHED"}
    scene.frame_set(1)
    assert np.isfinite(before).all() and np.isfinite(view.places(collection)).all()
    # What somebody has changed has no places, and is no fault.
    bodies_of(collection)[0].modifiers.clear()
    if mode == "POINTS":
        assert np.isnan(view.places(collection)).all()


@pytest.mark.parametrize("mode", ["ANIMATION", "POINTS"])
def test_loads_are_shown_where_no_states_are_told(desk, addon, mode):
    """As of a pile that was worked on by hand, or baked without the control."""
    collection, _, remembered = made_up_glue(desk, addon, mode)
    states, dots, manager = addon("states"), addon("dots"), bpy.context.window_manager
    collection.cairn.states = ""
    blocks = count_blocks()
    manager.cairn_loads = True
    try:
        now = states.at(collection, 1)
        wanted = {3: 7.0, 4: 7.0, 7: 1.5, 19: 0.2, 0: 0.2}
        for body in range(20):
            level = len(states.STATES) + dots.level(wanted[body]) if body in wanted else 0
            assert now[body] == level, body
        if mode == "ANIMATION":
            shown = {body.cairn.number: tuple(body.color) for body in bodies_of(collection)}
            assert np.allclose(shown[4], states.LINEAR[now[3]], atol=1e-6)
        else:
            assert len({part.cairn.number for part in bpy.data.objects if part.parent}) == 4
        manager.cairn_states = True
        assert states.at(collection, 1) is None
    finally:
        manager.cairn_loads = manager.cairn_states = False
    assert count_blocks() == blocks
    if mode == "POINTS":
        assert not any(item.value for item in bodies_of(collection)[0].data.attributes["state"].data)


def test_a_settled_pile_has_its_loads(desk, glue, addon):
    desk.control.scale = (1.0, 0.35, 1.6)
    desk.bake()
    bpy.ops.cairn.edit_pile()
    collection = addon("result").chosen(bpy.context)
    view, states, dots = addon("glue"), addon("states"), addon("dots")
    first = max(bodies_of(collection), key=lambda body: body.location.z)
    number = first.cairn.number
    bpy.data.objects.remove(first)
    bpy.ops.cairn.add_on_top(count=2)
    assert not collection.cairn.states and len(view.dots_of(collection)) > 0
    manager = bpy.context.window_manager
    manager.cairn_loads = True
    try:
        now = states.at(collection, 1)
    finally:
        manager.cairn_loads = False
    load = view.dots_of(collection)[0]
    joined = dots.number_of(collection, load["body"])
    assert now[joined - 1] == len(states.STATES) + dots.level(load["load"]) and now[number - 1] == 0
    assert np.isfinite(view.places(collection)).all()
