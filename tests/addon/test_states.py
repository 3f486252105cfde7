"""Bodies colored by state: at each frame, and not a trace of it afterwards."""

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import count_blocks
from test_motion import made_up, write


@pytest.fixture
def show(addon):
    """Switches the colors as the panel does."""

    def switch(on):
        bpy.context.window_manager.cairn_states = on

    yield switch
    switch(False)


def colors_of(objects):
    return np.array([list(body.color) for body in objects], np.float32)


def test_objects_have_their_states_colors_at_each_frame(desk, addon, show):
    states = addon("states")
    motion = made_up(addon)
    collection = write(desk, motion, "ANIMATION")
    own = (0.1, 0.2, 0.3, 0.4)
    bodies_of(collection)[3].color = own
    before, blocks = colors_of(bodies_of(collection)), count_blocks()
    bpy.context.scene.frame_set(6)
    show(True)
    assert bpy.context.window_manager.cairn_states
    for frame in (6, 1, 9, 50):
        bpy.context.scene.frame_set(frame)
        now = motion.states[min(frame - 1, 11)]
        assert np.array_equal(states.at(collection, frame), now)
        graph = bpy.context.evaluated_depsgraph_get()
        for body, state in zip(bodies_of(collection), now):
            assert np.array_equal(body.evaluated_get(graph).color, states.LINEAR[state])
    show(False)
    assert np.array_equal(colors_of(bodies_of(collection)), before) and count_blocks() == blocks
    bpy.context.scene.frame_set(2)
    assert np.array_equal(colors_of(bodies_of(collection)), before)
    assert not bpy.app.handlers.frame_change_pre


def instances():
    """Position and color of each instance."""
    graph = bpy.context.evaluated_depsgraph_get()
    return [(i.matrix_world.translation.copy(), i.object.color[:]) for i in graph.object_instances if i.is_instance]


def test_points_of_each_state_have_an_instancer_of_its_color(desk, addon, show):
    states = addon("states")
    motion = made_up(addon)
    collection = write(desk, motion, "POINTS")
    (shown,) = bodies_of(collection)
    blocks = count_blocks()
    values = lambda name: [item.value for item in shown.data.attributes[name].data]  # noqa: E731
    assert values("state") == motion.states[-1].tolist()
    show(True)
    for frame in (1, 7):
        bpy.context.scene.frame_set(frame)
        now = motion.states[frame - 1]
        assert values("state") == now.tolist()
        found = instances()
        assert len(found) == len(now)
        for matrix, state in zip(desk.expected(frame - 1), now):
            _, color = min(found, key=lambda one: np.linalg.norm(np.array(one[0]) - matrix[:3, 3]))
            assert np.array_equal(np.float32(color), states.LINEAR[state])
    show(False)
    assert count_blocks() == blocks
    assert values("state") == motion.states[-1].tolist() and shown.modifiers["Pile"].show_viewport
    assert len(instances()) == len(motion.props) and all(color == (1, 1, 1, 1) for _, color in instances())


def test_what_was_changed_by_hand_is_left_alone(desk, addon, show):
    collection = write(desk, made_up(addon), "POINTS")
    (shown,) = bodies_of(collection)
    collection.objects.link(desk.control)
    show(True)
    shown.data.attributes.remove(shown.data.attributes["state"])
    bpy.context.scene.frame_set(7)
    show(False)
    assert shown.modifiers["Pile"].show_viewport
    shown.modifiers.clear()
    show(True)
    show(False)


@pytest.mark.parametrize("mode", ["ANIMATION", "POINTS"])
def test_the_file_and_the_undo_history_never_keep_them(desk, addon, show, mode, tmp_path):
    states = addon("states")
    collection = write(desk, made_up(addon), mode)
    before, blocks = colors_of(bodies_of(collection)), count_blocks()
    bpy.ops.ed.undo_push(message="pile")
    show(True)
    bpy.ops.ed.undo_push(message="with colors")
    colored = count_blocks()
    path = str(tmp_path / "pile.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    assert count_blocks() == colored, "they are still shown"
    with bpy.data.libraries.load(path) as (inside, _):
        assert len(inside.objects) == blocks["objects"] and len(inside.collections) == blocks["collections"]
    show(False)
    bpy.ops.ed.undo_push(message="without")
    bpy.ops.ed.undo()
    collection = bpy.data.collections["Heap Pile"]
    assert np.array_equal(colors_of(bodies_of(collection)), before) and count_blocks() == blocks
    bpy.ops.wm.save_as_mainfile(filepath=path)
    show(True)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=path)
    assert not states.is_shown
    assert np.array_equal(colors_of(bodies_of(bpy.data.collections["Heap Pile"])), before)
    assert count_blocks() == blocks and states.at(bpy.data.collections["Heap Pile"], 4) is not None


def test_a_bake_tells_of_states(desk, addon, show):
    v1 = addon("messages").v1
    desk.add_stick()
    show(True)
    collection = desk.bake(start_frame=11, kept_shape="NATURAL")
    states = addon("states")
    first = states.at(collection, 11)
    assert len(first) == len(bodies_of(collection)) and (first == v1.BODY_STATE_WAITING).all()
    # The control may end before the bake does.
    frames = range(11, 11 + len(desk.motion.positions))
    assert max((states.at(collection, frame) == v1.BODY_STATE_HELD).mean() for frame in frames) > 0.5
    bpy.context.scene.frame_set(11)
    assert np.array_equal(colors_of(bodies_of(collection)), states.LINEAR[first])
    desk.settings.control.use_mode, desk.settings.control.mode = True, "OFF"
    collection = desk.bake()
    assert not collection.cairn.states and states.at(collection, 11) is None
    assert (colors_of(bodies_of(collection)) == 1).all()


def test_the_numbers_are_those_of_the_schema(addon):
    v1, states = addon("messages").v1, addon("states")
    names = {name: number for name, number in vars(v1).items() if name.startswith("BODY_STATE_")}
    assert sorted(names.values()) == list(range(len(states.STATES)))
    for name, number in names.items():
        title = states.STATES[number][0].upper()
        assert name == "BODY_STATE_UNSPECIFIED" and title == "FREE" or title.startswith(name[11:])
    # A newer server may have more.
    assert states.known(np.array([0, 8, 9, 255], np.uint8)).tolist() == [0, 8, 0, 0]
