"""What an artist meets in an hour of work: nothing moves by itself, nothing is lost, everything is said in words."""

import concurrent.futures
import time

import bpy
import numpy as np
import pytest
from blocks import all_blocks, bodies_of
from conftest import count_blocks, cuboid, mesh_object
from test_faults import LONG, PATIENCE, names, refusal, start, wait


@pytest.fixture
def looking(desk, addon, monkeypatch):
    """The tab is seen, which without a window it never is: a function that lets so many looks pass."""
    estimates = addon("estimates")
    monkeypatch.setattr(estimates, "_seen_at", time.monotonic() + 3600)
    estimates.forget()

    def look(until, most=2000):
        for _ in range(most):
            estimates._look()
            if until():
                return True
            time.sleep(0.01)
        return False

    yield look
    estimates.forget()


def test_looking_changes_nothing(desk, addon, looking):
    desk.add_stick()
    hidden = desk.add_stick("Hidden", (0.2, 0.2, 0.2))
    hidden.hide_viewport = True
    hidden.modifiers.new("Round", "BEVEL")
    wall = cuboid("Wall", (0.2, 1.2, 1.0), location=(1, 0, 0))
    for frame, place in ((1, 1.0), (200, 2.0)):
        wall.location.x = place
        wall.keyframe_insert("location", frame=frame)
    desk.settings.colliders = bpy.data.collections.new("Walls")
    desk.settings.colliders.objects.link(wall)
    bpy.context.scene.collection.children.link(desk.settings.colliders)
    scene = bpy.context.scene
    scene.frame_set(37, subframe=0.25)
    moved, before = [], (all_blocks(), scene.frame_current, scene.frame_subframe)
    bpy.app.handlers.frame_change_pre.append(lambda *_: moved.append(1))
    try:
        running = addon("running")
        assert looking(lambda: running.plan)
        looking(lambda: False, 20)
    finally:
        bpy.app.handlers.frame_change_pre.pop()
    assert {"DRAFT", "STANDARD"} <= set(running.plan["times"])
    assert not moved and (all_blocks(), scene.frame_current, scene.frame_subframe) == before


def test_expected_times_stay_until_the_next_are_there(desk, addon, looking, monkeypatch):
    stick = desk.add_stick()
    running, estimates = addon("running"), addon("estimates")
    # Reading takes as long as it likes: it is done in slices.
    monkeypatch.setattr(estimates, "SLICE", 0.0)
    assert looking(lambda: running.plan)
    first = running.plan
    stick.scale = (0.7, 1, 1)
    bpy.context.view_layer.update()
    assert looking(lambda: running.plan_is_old) and running.plan is first
    assert looking(lambda: not running.plan_is_old) and running.plan is not first
    # Back before there is another answer: it is of this scene.
    stick.scale = (0.6, 1, 1)
    bpy.context.view_layer.update()
    assert looking(lambda: running.plan_is_old)
    stick.scale = (0.7, 1, 1)
    bpy.context.view_layer.update()
    assert looking(lambda: not running.plan_is_old, 3)
    # While nothing may be asked, they are old all the same; and what is edited may be another shape.
    with monkeypatch.context() as patch:
        patch.setattr(estimates, "may_ask", lambda _: False)
        desk.settings.seed = 3
        assert looking(lambda: running.plan_is_old, 3)
        desk.settings.seed = 1
        assert looking(lambda: not running.plan_is_old, 3)
        bpy.context.view_layer.objects.active = desk.control
        bpy.ops.object.mode_set(mode="EDIT")
        assert looking(lambda: running.plan_is_old, 3)
        bpy.ops.object.mode_set(mode="OBJECT")
        assert not looking(lambda: not running.plan_is_old, 3)
    monkeypatch.setattr(addon("fingerprint"), "MAX_VERTICES", 4)
    assert looking(lambda: estimates.is_too_much) and running.plan is None
    assert "Check" in addon("panels").reliance()


def test_figures_go_with_their_shape(desk, addon):
    desk.add_stick()
    running, estimates = addon("running"), addon("estimates")
    bpy.ops.cairn.check()
    estimates.shown(bpy.context)
    assert running.plan
    desk.settings.control_mesh = cuboid("Other", (1.0, 1.0, 1.0))
    estimates.shown(bpy.context)
    assert running.plan is None and addon("panels").expected("STANDARD") == ""
    bpy.ops.cairn.check()
    estimates.shown(bpy.context)
    assert running.plan
    estimates.forget()


def test_time_left_only_falls_or_is_not_known(addon):
    left = addon("running").TimeLeft()
    random = np.random.default_rng(5)
    shown, doubted = [], 0
    for second in range(200):
        # A stage that takes ever longer, then ends.
        left.hear(2, 11.0 + 8 * random.random() if second < 150 else 200.0 - second, float(second))
        shown.append(left.remaining(second + 0.5))
        doubted += shown[-1] is None
    known = [value for value in shown if value is not None]
    assert all(later <= before for before, later in zip(known, known[1:]))
    assert doubted > 100 and known
    left.hear(3, None, 200.0)
    assert left.remaining(200.0) is None
    left.hear(3, 60.0, 201.0)
    assert left.remaining(202.0) == 59.0


def test_stages_before_the_first_frame_are_named(desk, addon):
    desk.add_stick()
    bake = start(desk, addon, accuracy="DRAFT", seed=991)
    seen = []
    while not bake.end:
        bake.job.messages.put(bake.job.messages.get(timeout=PATIENCE))
        kind = bake.job.messages.get()
        bake.job.messages.put(kind)
        bake.poll()
        seen += [bake.stage()] if bake.stage() not in seen else []
    addon("running").end()
    assert seen[:1] == ["Connecting"] and "Reading props" in seen, seen
    # A poll may take in several stages at once.
    assert seen.index("Reading props") < len(seen) - 1, seen


def test_what_the_fill_has_can_be_kept(desk, addon):
    desk.add_stick()
    bake = start(desk, addon, **{**LONG, "seed": 23, "accuracy": "REFERENCE"})
    wait(bake, lambda: bake.job.latest is not None and bake.job.latest.present.sum() > 3)
    assert not bake.frame_count
    bake.stop()
    count = int(bake.job.latest.present.sum())
    assert bake.kept_kind() == f"Keep the {count} Bodies as They Are"
    assert bpy.ops.cairn.keep() == {"FINISHED"}
    collection = bpy.data.collections["Heap Pile"]
    assert len(bodies_of(collection)) == count and collection.cairn.mode == "POSE"
    report = addon("running").report_of(collection)
    assert not report["is_whole"] and report["body_count"] == count
    inside = [body.location for body in bodies_of(collection)]
    assert all(abs(place.x) < 0.5 and abs(place.y) < 0.5 and -0.1 < place.z < 0.7 for place in inside)


def test_empties_with_nothing_below_are_no_props(desk, addon):
    desk.add_stick()
    marker = bpy.data.objects.new("Marker", None)
    desk.props.objects.link(marker)
    assert [source.name for source, _ in addon("request").props_of(desk.settings)] == ["Stick"]
    below = cuboid("Below", (0.1, 0.1, 0.1), desk.props)
    below.parent = marker
    assert {source.name for source, _ in addon("request").props_of(desk.settings)} == {"Stick", "Marker"}


def test_all_that_is_wrong_is_told_at_once(desk, addon):
    desk.add_stick()
    mesh_object("Ghost", [(0, 0, 0)], [], desk.props)
    mesh_object("Shade", [(0, 0, 0)], [], desk.props)
    desk.add_stick("Beam", (9, 9, 9))
    desk.settings.control_mesh = mesh_object("Sheet", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    for operator in (bpy.ops.cairn.check, bpy.ops.cairn.bake):
        message = refusal(operator)
        assert all(name in message for name in ("“Ghost”", "“Shade”", "Sheet")), message
        pairs = dict(addon("action_panel").problems())
        about = [things for things in pairs.values() if things]
        assert ["Ghost"] in about and ["Shade"] in about and ["Sheet"] in about, pairs
        assert not any("control mesh" in text for text in pairs)


def test_a_check_does_not_wait(desk, addon, monkeypatch):
    """With a window, it reads the scene in slices, and then looks for the answer now and then."""
    for number in range(4):
        desk.add_stick(f"Stick {number}", (0.3 + 0.02 * number, 0.1, 0.1))
    setup, answer, reported = addon("setup_operators"), concurrent.futures.Future(), []
    monkeypatch.setattr(setup, "SLICE", 0.0)
    monkeypatch.setattr(setup.job, "plan", lambda *_: answer)
    check = setup.CAIRN_OT_check

    class Check(setup._Waits):
        slices = None
        _ask, _read, _take, modal, cancel = check._ask, check._read, check._take, check.modal, check.cancel

        def report(self, _, text):
            reported.append(text)

    class Event:
        type, value = "TIMER", "NOTHING"

    bpy.context.scene.frame_set(9)
    made, before = Check(), all_blocks()
    made.slices = made._ask(bpy.context)
    turns = 0
    while made.slices:
        assert made.modal(bpy.context, Event()) == {"PASS_THROUGH"}
        turns += 1
    assert turns > 4 and made.answer is answer
    for _ in range(3):
        assert made.modal(bpy.context, Event()) == {"PASS_THROUGH"}
    answer.set_exception(addon("client").Fault("It was reported."))
    assert made.modal(bpy.context, Event()) == {"CANCELLED"} and reported == ["It was reported."]
    # Stopped while it reads, it leaves everything as it was.
    made.slices, answer = made._ask(bpy.context), concurrent.futures.Future()
    made.modal(bpy.context, Event())
    Event.type, Event.value = "ESC", "PRESS"
    assert made.modal(bpy.context, Event()) == {"CANCELLED"} and not made.slices
    assert bpy.context.scene.frame_current == 9 and all_blocks() == before


def test_an_object_that_is_meant_is_selected(desk):
    stick, other = desk.add_stick(), desk.add_stick("Other")
    layer = bpy.context.view_layer
    layer.update()
    other.select_set(True)
    assert bpy.ops.cairn.select(object="Stick") == {"FINISHED"}
    assert bpy.context.selected_objects == [stick] and layer.objects.active == stick
    stick.hide_set(True)
    assert "hidden" in refusal(lambda: bpy.ops.cairn.select(object="Stick"))
    assert "not in this view layer" in refusal(lambda: bpy.ops.cairn.select(object="Nobody"))


def test_an_estimate_that_was_begun_is_ended_although_nobody_looks(desk, addon, monkeypatch):
    estimates = addon("estimates")

    def reading():
        while True:
            yield

    monkeypatch.setattr(estimates, "_seen_at", -1e9)
    monkeypatch.setattr(estimates, "_slices", reading())
    assert estimates._look() == estimates.PAUSE
    estimates._give_up()
    assert estimates._look() is None


def test_warnings_are_told_once_and_in_words(addon):
    gathered = addon("wording").gathered
    tail = ": the mesh is open: its mass is computed from its collision shape, and its figures with its holes capped; "
    tail += "close it for the exact ones"
    names = {"a.glb": "Rock", "b.glb": "Rock.001", "c: d": "c: d", "e": "Leaf"}
    texts = [uri + tail for uri in names] + ["a.glb" + tail]
    texts += ["3 bodies were still moving at the last frame; bake more frames, or raise hold.patience"] * 2
    foot = "e: the pile stands on a small foot: 3 % of its underside lies within 0.010 m of the ground (base.height), a"
    texts += [foot]
    texts += ["more bodies would fit than fill.max_bodies = 20: the control mesh will not be full; raise it"]
    gathered_pairs = gathered(texts, names)
    assert [things for _, things in gathered_pairs] == [["Rock", "Rock.001", "c: d", "Leaf"], [], ["Leaf"], []]
    assert gathered_pairs[0][0].startswith("“Rock”, “Rock.001”, “c: d” and 1 more: The mesh is open")
    assert gathered_pairs[1][0].endswith("raise “Patience” in the panel Advanced, Release")
    assert "(“Height” in the panel Advanced, Fill)" in gathered_pairs[2][0]
    assert "“Max Bodies” in the panel Advanced, Fill (20): the shape will" in gathered_pairs[3][0]


def test_warnings_name_objects_not_numbers(desk, addon):
    desk.add_stick()
    desk.add_stick("Block", (0.2, 0.2, 0.2))
    wording, pile = addon("wording"), desk.bake(output_mode="POSE")
    names = desk.recipe["names"]
    texts = ["`props.1`: too thin", "prop 0 is larger than props[1]", "prop 9 is missing", "Stick: prop 0 is open"]
    (thin, larger, missing, twice) = wording.gathered(texts, names)
    assert thin == ("“Block”: too thin", ["Block"]) and larger == ("“Stick” is larger than “Block”", ["Stick", "Block"])
    assert missing == ("Prop 9 is missing", []) and twice == ("“Stick” is open", ["Stick"])
    # Settings are named as the panels have them, and where they are.
    names = {"statics.0": "Hill", "emitters.0": "Chute", "bodies.0": "Ball"}
    texts = ["friction 0.60 holds up to 31 degrees: raise statics.0.friction or the props', or the pile slides"]
    texts += ["emitters.0: only 3 of 9 could appear: there was no free spot left", "bodies.0: slow it down"]
    texts += ["move it over scenery, or set ground = true", "shaking was undone; lower fill.shake, or leave it out"]
    slides, chute, ball, ground, shake = (text for text, _ in wording.gathered(texts, names))
    assert "raise “Friction” in the panel Ground and Colliders, or in Prop Physics" in slides
    assert chute.startswith("“Chute”: Only 3") and ball.startswith("“Ball”: Slow")
    assert "tick “Ground” in the panel Ground and Colliders" in ground and "lower “Shake” in the panel Size" in shake
    first, last = bodies_of(pile)[0], bodies_of(pile)[-1]
    text = f"bodies 0 (Stick), {len(bodies_of(pile)) - 1} (Stick) (2 in all) fell"
    assert wording.with_bodies([text], pile) == [f"bodies “{first.name}”, “{last.name}” (2 in all) fell"]


def test_settings_come_back_after_everything_was_renamed(desk, addon):
    desk.add_stick()
    extra = desk.add_stick("Extra", (0.2, 0.2, 0.2))
    desk.settings.prop_source = "LIST"
    for source in (bpy.data.objects["Stick"], extra):
        desk.settings.props.add().object = source
    collection = desk.bake(seed=6)
    desk.control.name, extra.name, bpy.data.objects["Stick"].name = "Hill", "Other", "Rod"
    cuboid("Heap", (1, 1, 1))
    settings = bpy.context.scene.cairn
    settings.control_mesh, settings.seed = None, 1
    settings.props.clear()
    assert bpy.ops.cairn.restore_settings(collection=collection.name) == {"FINISHED"}
    assert settings.control_mesh.name == "Hill" and settings.seed == 6
    assert [item.object.name for item in settings.props] == ["Rod", "Other"]


def test_a_rename_during_a_bake_does_no_harm(desk, addon):
    stick = desk.add_stick()
    bake = start(desk, addon, accuracy="DRAFT", seed=8)
    stick.name, desk.control.name, bpy.context.scene.name = "Rod", "Hill", "Set"
    cuboid("Stick", (1, 1, 1))
    wait(bake, lambda: bake.end)
    collection = addon("request").finish(
        addon("result").build(bpy.context, bake.motion(), bake.recipe, bake.record()),
    )
    addon("running").end()
    assert collection.cairn.control == desk.control and collection.name == "Hill Pile"
    assert all(body.data == stick.data for body in bodies_of(collection))
    assert not bpy.context.scene.cairn_asked.token and not bpy.context.scene.cairn_asked.pointers


def test_other_presets_show_their_values(desk, addon):
    desk.add_stick()
    presets, schema = addon("presets"), addon("schema")
    bpy.ops.cairn.check()
    values = {}
    for accuracy in ("DRAFT", "STANDARD"):
        desk.settings.accuracy = accuracy
        values[accuracy] = {
            (message, field["name"]): presets.text(getattr(desk.settings, name), field)
            for message, name in schema.GROUPS.items()
            for field in schema.fields_of(message)
        }
    assert values["DRAFT"] != values["STANDARD"]
    known = [value for value in values["DRAFT"].values() if value != "–"]
    assert len(known) > len(values["DRAFT"]) / 2
    assert values["STANDARD"]["Hold", "patience"] == f"{desk.settings.hold.patience:.4g}"


def test_bodies_are_as_the_render_has_them(desk, addon):
    stick = desk.add_stick()
    smooth = stick.modifiers.new("Smooth", "SUBSURF")
    smooth.levels, smooth.render_levels = 0, 2
    before = count_blocks()["scenes"]
    collection = desk.bake(output_mode="POSE")
    assert len(desk.sent_vertices(0)) == 98 == len(bodies_of(collection)[0].data.vertices)
    assert (smooth.levels, count_blocks()["scenes"]) == (0, before)


def test_stopped_before_the_server_has_it(desk, addon):
    desk.add_stick()
    before = names()
    bake = start(desk, addon, **LONG)
    bake.stop()
    assert not bake.kept_kind()
    addon("running").end()
    assert names() == before


def test_props_are_drawn_as_they_look(addon):
    outline = addon("outline")
    bpy.ops.mesh.primitive_torus_add(major_segments=96, minor_segments=48, major_radius=1, minor_radius=0.3)
    ring = bpy.context.object
    image = bpy.data.images.new("Rust", 8, 8)
    image.pixels[:] = [0.6, 0.3, 0.1, 1.0] * 64
    material = bpy.data.materials.new("Rust")
    material.use_nodes = True
    texture = material.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    material.node_tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    ring.data.materials.append(material)
    (prop,) = addon("request").finish(addon("export").Exporter(bpy.context).props([ring]))
    (drawn,) = addon("request").finish(addon("preview").drawn([prop]))
    assert np.allclose(drawn.tint, [0.6, 0.3, 0.1], atol=0.01)
    points, soup = drawn.outlines[0].points, prop.vertices
    assert 100 < len(drawn.outlines[0].triangles) <= 300
    # It has its hole, and its size.
    assert np.linalg.norm(points[:, :2], axis=1).min() > 0.5
    assert np.abs(points.max(axis=0) - soup.max(axis=0)).max() < 0.15
    assert np.allclose(np.linalg.norm(drawn.outlines[0].normals, axis=1), 1, atol=1e-3)
    square = outline.shaded(*outline.box(soup))
    # A sharp edge has a normal for each side.
    assert len(square.triangles) == 12 and len(square.points) > 24


def test_the_report_can_be_switched_off(desk, addon):
    desk.add_stick()
    desk.bake(seed=12)
    with_report = addon("running").report_of(bpy.data.collections["Heap Pile"])
    collection = desk.bake(use_report=False)
    report = addon("running").report_of(collection)
    assert report["is_whole"] and report["result_hash"] == with_report["result_hash"]
    assert "shape_iou" in with_report["measures"] and "shape_iou" not in report["measures"]
