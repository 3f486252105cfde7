"""Bodies that come in, and when a pile has all its frames: the first bake and the same bake again show the same."""

import json

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import shown_vertices
from test_faults import start, wait


def seen(pile, frame):
    """The sizes of the bodies that are seen in a frame of the scene, sorted."""
    bpy.context.scene.frame_set(frame)
    owners = {body.name for body in bodies_of(pile) if not body.hide_viewport and not body.hide_render}
    shown = [points for (name, _), points in shown_vertices().items() if name in owners and len(points)]
    return np.sort([np.linalg.norm(np.ptp(points, axis=0)) for points in shown])


def comes_in(desk, kind):
    desk.add_stick()
    desk.add_stick("Cube", (0.2, 0.2, 0.2))
    desk.settings.entrance.use_kind, desk.settings.entrance.kind = True, kind
    desk.settings.entrance.use_duration, desk.settings.entrance.duration = True, 2.0


@pytest.mark.parametrize("mode", ["ANIMATION", "POINTS"])
@pytest.mark.parametrize("kind", ["RAIN", "POUR", "THROW", "ASSEMBLE"])
def test_all_bodies_come_in(desk, addon, kind, mode):
    comes_in(desk, kind)
    found = []
    for _ in range(2):
        pile = desk.bake(output_mode=mode)
        report = addon("running").report_of(pile)
        frames = len(desk.motion.positions)
        last = seen(pile, desk.settings.start_frame + frames - 1)
        assert len(last) == report["body_count"] > 10
        assert last.min() > 0.15, "none is without size"
        assert frames == report["frame_count"] > 48
        assert set(desk.motion.props) == {0, 1} and desk.motion.scales.min() == 1.0
        if kind != "ASSEMBLE":
            assert len(seen(pile, desk.settings.start_frame)) < len(last) / 2
        found.append((frames, desk.motion.positions))
    # The second comes from what the server keeps.
    assert found[0][0] == found[1][0] and np.array_equal(found[0][1], found[1][1])


@pytest.mark.parametrize("kind", ["NONE", "POUR"])
def test_the_same_bake_twice_is_the_same(desk, addon, kind):
    """In a window, the pile is made before the report is there."""
    comes_in(desk, kind)
    made = []
    for _ in range(2):
        bake = start(desk, addon, accuracy="DRAFT", seed=77)
        wait(bake, lambda: bake.has_all_frames)
        motion = bake.motion()
        wait(bake, lambda: bake.end)
        assert bake.end == "done"
        record = bake.record()
        made.append((motion, record))
        assert len(motion.positions) == bake.frame_count == record["frame_count"]
        addon("running").end()
    (first, one), (second, other) = made
    assert np.array_equal(first.positions, second.positions) and np.array_equal(first.present, second.present)
    # All but how long it took on this machine.
    del one["seconds"], other["seconds"]
    assert json.dumps(one) == json.dumps(other)


@pytest.mark.parametrize("is_early", [True, False])
def test_frames_beyond_the_end_are_left_out(addon, is_early):
    """The number of frames may be known before the last of them arrive, and after more have arrived."""
    v1, made = addon("messages").v1, addon("recording").Recording()
    made.add_table(v1.BodyTable(stage=v1.STAGE_RELEASE, prop_indices=[0], scales=np.float32([1]).tobytes()))

    def arrive(numbers):
        for number in numbers:
            made.add_frame(v1.Frame(stage=v1.STAGE_HOLD, frame_number=number))

    arrive(range(3 if is_early else 9))
    made.end_at(0)
    made.end_at(5)
    arrive(range(3, 9) if is_early else ())
    assert len(made.frames) == 5
