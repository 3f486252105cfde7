"""A draft while the artist shapes."""

import time

import bpy
import numpy as np
import pytest
from blocks import all_blocks
from test_faults import PATIENCE


@pytest.fixture
def live(desk, addon):
    """Without a window there are no timers: turns them by hand."""
    live = addon("live")
    live.show(True)

    def turn(until, patience=PATIENCE):
        end = time.monotonic() + patience
        while not until() and time.monotonic() < end:
            live._look()
            time.sleep(0.01)
        return until()

    yield live, turn
    live.show(False)


def test_a_draft_follows_the_scene(desk, addon, live, monkeypatch):
    live, turn = live
    drawn = []

    class Preview:
        def __init__(self, props, metres):
            self.props = props

        def update(self, snapshot):
            drawn.append(snapshot)

        def remove(self):
            drawn.append(None)

    monkeypatch.setattr(live.preview, "Preview", Preview)
    asked = []
    start = addon("job").Job.start
    monkeypatch.setattr(addon("job").Job, "start", lambda job: asked.append(job) or start(job))
    stages, add_frame = set(), addon("recording").Recording.add_frame

    def adding(recording, frame):
        stages.add(frame.stage)
        return add_frame(recording, frame)

    monkeypatch.setattr(addon("recording").Recording, "add_frame", adding)
    assert turn(lambda: "Choose the props" in live.status())
    desk.add_stick()
    desk.settings.accuracy = "REFERENCE"
    before = all_blocks(), bpy.context.scene.frame_current
    assert turn(lambda: drawn)
    v1 = addon("messages").v1
    assert asked[-1].spec.scene.accuracy == v1.ACCURACY_DRAFT
    assert drawn[-1].stage != v1.STAGE_FILL and drawn[-1].present.sum() > 10 and "Draft of" in live.status()
    # Neither the fill nor the motion is sent, and what is drawn is the pose that the whole bake ends with.
    assert len(asked[-1].recording.frames) == 1 and stages == {v1.STAGE_HOLD}
    asked[-1].spec.scene.effects.frames = v1.SWITCH_AUTO
    asked[-1].spec.scene.output.trim = False
    whole = addon("job").Job(asked[-1].server, asked[-1].spec, asked[-1].contents)
    whole.start()
    while whole.messages.get(timeout=PATIENCE)[0] != "done":
        pass
    assert len(whole.recording.frames) > 5
    assert np.array_equal(drawn[-1].positions, whole.recording.frames[-1].positions)
    asked.clear(), drawn.clear()
    # A change drops what is under way; the old picture stays until the new one is there.
    desk.control.scale.z = 0.5
    bpy.context.view_layer.update()
    assert turn(lambda: len(asked) == 1)
    desk.settings.seed = 5
    assert turn(lambda: len(drawn) == 2)
    assert len(asked) == 2 and drawn[0] is None and asked[1].spec.scene.seed == 5
    assert turn(lambda: False, 1.2 * live.REST) is False and len(asked) == 2
    desk.control.scale.z, desk.settings.seed = 1.0, 1
    assert (all_blocks(), bpy.context.scene.frame_current) == before
    live.show(False)
    assert drawn[-1] is None and live._on_change not in bpy.app.handlers.depsgraph_update_post
    assert not bpy.app.timers.is_registered(live._look)
