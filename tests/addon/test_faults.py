"""Each fault is reported with its remedy; a stopped bake leaves nothing behind; a bake that runs on is found again."""

import time
from types import SimpleNamespace

import bpy
import pytest
from blocks import bodies_of
from conftest import PROGRAM, cuboid, mesh_object

# Long enough to be stopped on the way.
LONG = {"accuracy": "FINE", "use_frame_count": True, "frame_count": 5000}
PATIENCE = 60.0


def preferences(module):
    return bpy.context.preferences.addons[module].preferences


def refusal(operator=None):
    """What the popup would say."""
    with pytest.raises(RuntimeError) as error:
        (operator or bpy.ops.cairn.bake)()
    return str(error.value)


def names():
    kinds = ("objects", "meshes", "collections")
    return {kind: sorted(block.name for block in getattr(bpy.data, kind)) for kind in kinds}


def wait(bake, until):
    end = time.monotonic() + PATIENCE
    while not until():
        assert time.monotonic() < end, bake.line()
        bake.poll(wait=0.05)


def start(desk, addon, **settings):
    """A bake under way, as the button starts it."""
    for name, value in settings.items():
        setattr(desk.settings, name, value)
    request, running, chosen = addon("request"), addon("running"), addon("preferences")
    taken = request.take(bpy.context)
    bake = running.bake = running.Bake(chosen.server(bpy.context))
    addon("pointers").ask(bpy.context.scene, taken.recipe["token"], taken.pointers)
    bake.ask(taken)
    bake.start()
    return bake


def test_an_empty_panel_says_what_to_do(addon):
    settings = bpy.context.scene.cairn
    assert "shape" in addon("request").missing(settings)
    assert "Choose the mesh" in refusal()
    settings.control_mesh = cuboid("Heap", (1, 1, 1))
    assert "collection of objects" in refusal()
    settings.prop_collection = bpy.data.collections.new("Empty")
    assert "collection of objects" in refusal()


def test_a_scene_that_is_wrong_is_told_by_its_objects(desk):
    before = names()
    mesh_object("Sheet", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    desk.settings.control_mesh = bpy.data.objects["Sheet"]
    desk.add_stick("Beam", (9, 9, 9))
    message = refusal()
    assert "Sheet: the shape is open" in message and "\n" in message
    desk.settings.control_mesh = desk.control
    message = refusal(bpy.ops.cairn.check)
    assert "Beam" in message and "Traceback" not in message
    assert names()["collections"] == before["collections"]


def test_props_without_faces_are_named(desk):
    mesh_object("Ghost", [(0, 0, 0)], [], desk.props)
    assert "“Ghost” has no faces" in refusal()


def test_a_missing_program(desk, module):
    desk.add_stick()
    preferences(module).program = "/nowhere/cairn"
    try:
        message = refusal()
    finally:
        preferences(module).program = str(PROGRAM)
    assert "/nowhere/cairn" in message and "preferences" in message


def test_a_program_that_is_another(desk, module, addon, tmp_path, monkeypatch):
    desk.add_stick()
    wrong = tmp_path / "cairn"
    wrong.write_text("#!/bin/sh\necho this is no server >&2\nexit 3\n")
    wrong.chmod(0o755)
    monkeypatch.setattr(addon("preferences"), "_local", addon("server").LocalServer(tmp_path / "store"))
    preferences(module).program = str(wrong)
    try:
        assert "this is no server" in refusal()
    finally:
        preferences(module).program = str(PROGRAM)


def test_a_server_out_of_reach(desk, module, addon):
    desk.add_stick()
    chosen = preferences(module)
    kept = addon("preferences").folder() / "asked"
    before = set(kept.glob("*"))
    chosen.server = "REMOTE"
    try:
        assert "address is missing" in refusal()
        chosen.address = "127.0.0.1"
        assert "HOST:PORT" in refusal()
        chosen.address = "127.0.0.1:1"
        assert "cannot be reached" in refusal()
        # What was to be sent is not kept.
        assert set(kept.glob("*")) == before
    finally:
        chosen.server, chosen.address = "LOCAL", ""


def test_a_token_that_is_wrong(desk, module, addon):
    desk.add_stick()
    local = addon("preferences").local()
    right = local.reach(PROGRAM)
    chosen = preferences(module)
    chosen.server, chosen.address, chosen.token = "REMOTE", right.address, "wrong"
    try:
        assert "token" in refusal()
        chosen.token = right.token
        assert bpy.ops.cairn.bake() == {"FINISHED"}
    finally:
        chosen.server, chosen.address, chosen.token = "LOCAL", "", ""


def test_a_server_on_a_port_with_a_token(desk, addon, module, tmp_path, monkeypatch):
    """As on systems without Unix sockets."""
    desk.add_stick()
    server = addon("server")
    monkeypatch.delattr(server.socket, "AF_UNIX")
    local = server.LocalServer(tmp_path)
    monkeypatch.setattr(addon("preferences"), "_local", local)
    try:
        assert bpy.ops.cairn.bake() == {"FINISHED"}
        assert local._read_note()["address"].startswith("127.0.0.1:")
        assert local.note.stat().st_mode & 0o077 == 0
    finally:
        local.stop()


def test_stopped_at_once_and_nothing_left(desk, addon):
    desk.add_stick()
    before = names()
    bake = start(desk, addon, **LONG)
    wait(bake, lambda: bake.progress is not None)
    bake.stop()
    frames = bake.frame_count
    wait(bake, lambda: bake.end)
    # The server is not waited for.
    assert bake.end == "stopped" and bake.frame_count <= frames + 1
    assert names() == before
    ended = server_state(addon, bake, {"BAKE_STATE_CANCELLED"})
    assert ended


def server_state(addon, bake, wanted):
    job, v1 = addon("job"), addon("messages").v1
    states = {getattr(v1, name) for name in wanted}
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if job.ask(bake.job.server, "GetBake", bake_id=bake.job.bake_id).result(PATIENCE).bake.state in states:
            return True
        time.sleep(0.05)
    return False


def test_what_there_is_can_be_kept(desk, addon):
    desk.add_stick()
    bake = start(desk, addon, accuracy="DRAFT", use_frame_count=True, frame_count=100000)
    wait(bake, lambda: bake.frame_count > 3 or bake.end)
    bake.stop()
    wait(bake, lambda: bake.end)
    assert bpy.ops.cairn.keep() == {"FINISHED"}
    assert addon("running").bake is None
    collection = bpy.data.collections["Heap Pile"]
    assert len(bodies_of(collection)) > 0
    report = addon("running").report_of(collection)
    assert not report["is_whole"] and report["frame_count"] > 3


def test_a_bake_survives_its_file_and_its_server(desk, addon, tmp_path):
    desk.add_stick()
    path = str(tmp_path / "pile.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bake = start(desk, addon, accuracy="STANDARD", seed=77)
    wait(bake, lambda: bake.accepted is not None)
    running = addon("running")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert running.bake is None and running.left is None
    # As when Blender quits at once: the next server takes the bake up.
    addon("preferences").local().stop_now()
    bpy.ops.wm.open_mainfile(filepath=path)
    assert running.left is not None
    assert bpy.ops.cairn.fetch() == {"FINISHED"}
    assert len(bodies_of(bpy.data.collections["Heap Pile"])) > 0
    assert running.left is None and addon("pending").of_this_file() is None


def test_every_button_and_setting_says_what_it_does(addon):
    import importlib

    properties = addon("properties")
    for group in (properties.CairnProp, properties.CairnSettings, *addon("schema").PARAMETERS.values()):
        for prop in group.bl_rna.properties:
            is_group = prop.type in {"POINTER", "COLLECTION"} and prop.fixed_type.identifier.startswith("Cairn")
            if prop.identifier not in ("rna_type", "name") and not is_group:
                assert len(prop.description) > 10, f"{group.__name__}.{prop.identifier}"
    for prop in addon("preferences").CairnPreferences.bl_rna.properties:
        if prop.identifier not in ("rna_type", "bl_idname"):
            assert len(prop.description) > 10, prop.identifier
    modules = ("operators", "pile_operators", "setup_operators", "variant_operators", "glue")
    for name in (*modules, "edit_operators", "timing_panel"):
        for operator in importlib.import_module(addon(name).__name__).CLASSES:
            assert issubclass(operator, bpy.types.Panel) or len(operator.__doc__) > 20, operator


def test_the_pile_is_there_before_its_figures(desk, addon):
    desk.add_stick()
    running, result = addon("running"), addon("result")
    bake = start(desk, addon, accuracy="DRAFT", seed=41)
    wait(bake, lambda: bake.has_all_frames)
    motion = bake.job.recording.motion()
    collection = addon("request").finish(result.build(bpy.context, motion, bake.recipe, bake.record()))
    assert running.report_of(collection)["is_whole"]
    running.bake = None
    running.wait_for_report(bake)
    end = time.monotonic() + PATIENCE
    while running.measuring and time.monotonic() < end:
        # Without a window, Blender runs no timers.
        running._collect()
        time.sleep(0.05)
    report = running.report_of(collection)
    assert report["measures"]["shape_iou"] > 0.5
    # None was late.
    assert report["frame_count"] == len(motion.positions)


@pytest.mark.parametrize("is_made", [False, True])
def test_an_undo_between_two_ticks_of_the_writer_is_told(desk, addon, monkeypatch, is_made):
    desk.add_stick()
    for message in ("before", "seen"):
        bpy.ops.ed.undo_push(message=message)
    before, following, running, said = names(), addon("following"), addon("running"), []
    # A few bodies in each tick.
    monkeypatch.setattr(following, "SLICE", 1e-5)
    bake = start(desk, addon, accuracy="DRAFT", seed=43)
    wait(bake, lambda: bake.end)

    class Operator(following.Follows):
        workspace = SimpleNamespace(status_text_set=lambda _: None)

        def report(self, kind, text):
            said.append((kind, text))

    operator, tick = Operator(), SimpleNamespace(type="TIMER", value="NOTHING")
    while not (operator.made if is_made else bake.written):
        assert operator.modal(bpy.context, tick) == {"RUNNING_MODAL"}
    assert names() != before
    bpy.ops.ed.undo()
    while operator.modal(bpy.context, tick) != {"CANCELLED"}:
        assert operator.writer
    assert said == [({"ERROR"}, "An undo took away what was being made. Press the button again.")]
    assert running.bake is None and not running.measuring and names() == before
    # The server still has the result.
    assert bpy.ops.cairn.bake() == {"FINISHED"} and len(bodies_of(bpy.data.collections["Heap Pile"])) > 0


def test_a_pile_that_rests_enough_is_the_result(desk, addon):
    """The frames so far take the old pile's place, as a whole bake's do."""
    desk.add_stick()
    pile = desk.bake()
    bake = start(desk, addon, accuracy="DRAFT", use_frame_count=True, frame_count=100000)
    assert not bpy.ops.cairn.enough.poll()
    wait(bake, lambda: bake.frame_count > 20 or bake.end)
    assert bpy.ops.cairn.enough() == {"FINISHED"} and bake.has_all_frames and not bpy.ops.cairn.enough.poll()
    # As the operator that follows the bake does then.
    result, request = addon("result"), addon("request")
    made = request.finish(result.build(bpy.context, bake.motion(), bake.recipe, bake.record()))
    addon("running").end()
    assert made == pile and made.cairn.is_whole
    report = addon("running").report_of(pile)
    assert report["is_whole"] and report["frame_count"] == bake.frame_count > 20
    assert any(
        "ended at this frame by hand" in text and "% of the bodies at rest" in text for text in report["warnings"]
    )
