"""A baked pile plays at other times: every body is where the server has it, when the settings say so."""

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import gap, shown_vertices

CLOSE = 1e-4


def at(desk, collection, frame, number):
    """Whether the pile shows that frame of the result, which may lie between two."""
    whole = int(np.floor(frame))
    bpy.context.scene.frame_set(whole, subframe=frame - whole)
    low, high = desk.expected(int(np.floor(number))), desk.expected(int(np.ceil(number)))
    wanted = low[:, :3, 3] + (number - np.floor(number)) * (high - low)[:, :3, 3]
    if collection.cairn.mode == "ANIMATION":
        found = np.array([body.matrix_world.translation for body in bodies_of(collection)])
        return np.abs(found - wanted).max() < CLOSE
    owners = {body.name for body in bodies_of(collection)}
    shown = [points for (name, _), points in shown_vertices().items() if name in owners and len(points)]
    middles = np.array([points.mean(axis=0) for points in shown])
    own = desk.sent_vertices(0).mean(axis=0)
    expected = np.array([matrix[:3, :3] @ own for matrix in low]) + wanted
    return len(middles) == len(wanted) and gap(middles, expected) < 0.02


@pytest.mark.parametrize("mode", ["ANIMATION", "POINTS"])
def test_it_plays_as_the_settings_say(desk, addon, mode):
    desk.add_stick()
    collection = desk.bake(output_mode=mode, start_frame=5)
    note, last = collection.cairn, len(desk.motion.positions) - 1
    assert (note.timing_start, note.frame_count) == (5, last + 1) and addon("timing").end_of(collection) == 5 + last
    note.timing_start, note.timing_hold = 20, 10
    assert at(desk, collection, 12, 0) and at(desk, collection, 30, 0)
    assert at(desk, collection, 30 + last // 2, last // 2)
    note.timing_speed = 0.5
    assert at(desk, collection, 30 + last, last / 2) and at(desk, collection, 30 + 2 * last, last)
    note.timing_ease, note.timing_speed = 1.0, 1.0
    times = addon("timing").shown(collection)
    assert times[0] == 30 and times[-1] == pytest.approx(30 + last) and (np.diff(times) > 0).all()
    # It begins slowly.
    assert times[last // 2] > 30 + last * 0.6
    for number in (0, last // 3, last // 2, last):
        assert at(desk, collection, float(times[number]), number), number
    # All of it taken back, it is as it was baked.
    note.timing_start, note.timing_hold, note.timing_ease = 5, 0, 0.0
    for number in (0, last // 2, last):
        assert at(desk, collection, 5 + number, number)


def test_it_fits_the_scene(desk, addon):
    desk.add_stick()
    scene = bpy.context.scene
    collection = desk.bake()
    scene.frame_start, scene.frame_end = 101, 200
    collection.cairn.timing_hold = 9
    assert bpy.ops.cairn.fit_timing() == {"FINISHED"}
    times = addon("timing").shown(collection)
    assert times[0] == pytest.approx(110) and times[-1] == pytest.approx(200, abs=1e-3)
    assert at(desk, collection, 105, 0) and at(desk, collection, 200, len(desk.motion.positions) - 1)
    scene.frame_end = 105
    with pytest.raises(RuntimeError, match="no room"):
        bpy.ops.cairn.fit_timing()


def test_a_key_of_ones_own_goes_along(desk):
    desk.add_stick()
    collection = desk.bake(start_frame=1)
    body = next(body for body in bodies_of(collection) if body.animation_data)
    body.keyframe_insert("scale", frame=0)
    body.keyframe_insert("scale", frame=1000)
    collection.cairn.timing_start = 11
    low, high = body.animation_data.action.frame_range
    assert (low, high) == (10, 1010)


def test_states_go_along(desk, addon):
    desk.add_stick()
    collection = desk.bake(start_frame=1, kept_shape="NATURAL", accuracy="PREVIEW")
    states, last = addon("states"), collection.cairn.frame_count - 1
    before = [states.at(collection, 1 + number).tolist() for number in range(last + 1)]
    collection.cairn.timing_speed, collection.cairn.timing_start = 0.5, 51
    assert [states.at(collection, 51 + 2 * number).tolist() for number in range(last + 1)] == before


@pytest.mark.parametrize("mode", ["ANIMATION", "POINTS"])
def test_the_final_pose_stays_alone(desk, addon, mode):
    desk.add_stick()
    collection = desk.bake(output_mode=mode, start_frame=5)
    last, actions = len(desk.motion.positions) - 1, len(bpy.data.actions)
    bpy.context.scene.frame_set(5)
    shown = addon("states").at(collection, 10**5)
    bpy.ops.ed.undo_push(message="pile")
    assert bpy.ops.cairn.keep_pose() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="pose")
    for frame in (1, 5, 5 + last // 2, 5 + last, 1000):
        assert at(desk, collection, frame, last), frame
    assert not bpy.data.actions and bpy.context.scene.frame_current == 1000
    states = addon("states").at(collection, 5)
    assert (states is None) == (shown is None) and (shown is None or (states == shown).all())
    with pytest.raises(RuntimeError, match="no animated pile"):
        bpy.ops.cairn.keep_pose()
    with pytest.raises(RuntimeError, match="no animated pile"):
        bpy.ops.cairn.fit_timing()
    # One step back is all of it.
    bpy.ops.ed.undo()
    collection = bpy.data.collections["Heap Pile"]
    assert len(bpy.data.actions) == actions
    for number in (0, last // 2, last):
        assert at(desk, collection, 5 + number, number)


def test_what_had_fallen_out_is_not_in_the_final_pose(desk, addon):
    desk.add_stick()
    collection = desk.bake()
    body = next(body for body in bodies_of(collection) if body.animation_data)
    body.hide_render = body.hide_viewport = False
    for hidden, frame in ((False, 1), (True, 4)):
        body.hide_render = body.hide_viewport = hidden
        body.keyframe_insert("hide_render", frame=frame)
        body.keyframe_insert("hide_viewport", frame=frame)
    assert bpy.ops.cairn.keep_pose() == {"FINISHED"}
    assert body.hide_render and body.hide_viewport and not body.animation_data
    assert collection.cairn.mode == "POSE"


def test_a_bake_ends_at_the_frame_that_the_preview_showed(desk, addon):
    """With a window, the operator comes to its end step by step."""
    desk.add_stick()
    following, running, timing = addon("following"), addon("running"), addon("timing")

    class Operator:
        timer = preview = workspace = slices = writer = None
        reported = []

        def report(self, _, text):
            self.reported.append(text)

        def _leave(self, *_):
            pass

    class Bake:
        end = "done"

    scene = bpy.context.scene
    for mode, frame in (("ANIMATION", None), ("POINTS", None), ("POSE", 3)):
        operator = Operator()
        operator.made = desk.bake(output_mode=mode, start_frame=20)
        scene.frame_set(3)
        assert following.Follows._end(operator, bpy.context, Bake()) == {"FINISHED"}
        assert scene.frame_current == (frame or 20 + len(desk.motion.positions) - 1), mode
        assert frame or scene.frame_current == timing.end_of(operator.made)
    assert running.bake is None and "Heap Pile" in Operator.reported[-1]
