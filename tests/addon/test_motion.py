"""The writers, on motions made up here: what is keyed, and that playing it gives the motion back."""

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import count_blocks, cuboid, gap, shown_vertices

CLOSE = 1e-5


def made_up(addon, bodies=20, frames=12, seed=3):
    """A motion in the server's space: each body moves for a while, turning any way; the last one never does."""
    random = np.random.default_rng(seed)
    positions = random.uniform(-2, 2, (frames, bodies, 3)).astype(np.float32)
    rotations = random.normal(size=(frames, bodies, 4))
    # Turns about the axes by quarters: where angles of three axes are ambiguous.
    quarters = np.round(random.normal(size=(frames, 5, 4)) * 1.5)
    quarters[(quarters == 0).all(axis=2)] = (0, 0, 0, 1)
    rotations[:, :5] = quarters
    rotations = (rotations / np.linalg.norm(rotations, axis=2, keepdims=True)).astype(np.float32)
    for body in range(bodies):
        begin, end = sorted(random.integers(0, frames, 2)) if body < bodies - 1 else (0, 0)
        for values in (positions, rotations):
            values[:begin, body] = values[begin, body]
            values[end:, body] = values[end, body]
    present = np.ones((frames, bodies), bool)
    Motion = addon("recording").Motion
    scales = random.uniform(0.5, 1.5, bodies).astype(np.float32)
    states = np.sort(random.integers(1, 9, (frames, bodies)), axis=0).astype(np.uint8)
    return Motion(np.zeros(bodies, np.int32), scales, positions, rotations, present, states)


def recipe_of(desk, mode):
    return {
        "scene": bpy.context.scene.name,
        "control": desk.control.name,
        "props": [{"name": "Stick", "local": np.eye(4).tolist()}],
        "metres": 1.0,
        "start_frame": 1,
        "output_mode": mode,
        "settings": {},
    }


def write(desk, motion, mode):
    """The motion that a bake would give it."""
    desk.add_stick()
    desk.motion, desk.recipe = motion, recipe_of(desk, mode)
    result = desk.addon("result")
    return desk.addon("request").finish(result.build(bpy.context, motion, desk.recipe, {}))


def check(desk, collection, frame, matrices, present):
    bpy.context.scene.frame_set(int(frame), subframe=frame % 1)
    owners = {body.name for body in bodies_of(collection)}
    shown = [points for (name, _), points in shown_vertices().items() if name in owners and len(points)]
    assert len(shown) == present.sum()
    corners = np.array([vertex.co for vertex in bpy.data.objects["Stick"].data.vertices])
    for matrix in matrices[present]:
        points = corners @ matrix[:3, :3].T + matrix[:3, 3]
        assert min(gap(points, other) for other in shown) < CLOSE


@pytest.mark.parametrize("mode", ["ANIMATION", "POINTS"])
def test_any_motion_plays_back(desk, addon, mode):
    motion = made_up(addon)
    collection = write(desk, motion, mode)
    for frame in range(len(motion.positions)):
        check(desk, collection, 1 + frame, desk.expected(frame), motion.present[frame])


@pytest.mark.parametrize("mode", ["ANIMATION", "POINTS"])
def test_bodies_that_come_and_go(desk, addon, mode):
    motion = made_up(addon)
    motion.present[:4, 0] = False
    motion.present[7:, 1] = False
    motion.present[:, 2] = False
    collection = write(desk, motion, mode)
    for frame in (0, 3, 4, 6, 7, 11):
        bpy.context.scene.frame_set(1 + frame)
        owners = {body.name for body in bodies_of(collection)}
        visible = {body.name for body in bodies_of(collection) if not body.hide_viewport and not body.hide_render}
        shown = [key for key, points in shown_vertices().items() if key[0] in owners & visible and len(points)]
        assert len(shown) == motion.present[frame].sum()


def test_between_frames_points_move_as_objects_do(desk, addon):
    motion = made_up(addon)
    # Half a turn has no way that is the shorter one.
    motion.rotations[:] = motion.rotations[0]
    collection = write(desk, motion, "POINTS")
    matrices = (desk.expected(4) + desk.expected(5)) / 2
    check(desk, collection, 5.5, matrices, motion.present[4])


@pytest.mark.parametrize("mode", ["ANIMATION", "POINTS"])
def test_what_is_given_up_on_the_way_leaves_nothing(desk, addon, mode):
    desk.add_stick()
    blocks = count_blocks()
    result = addon("result")
    recipe = recipe_of(desk, mode)
    writer = result.build(bpy.context, made_up(addon), recipe, {})
    assert next(writer) == 0.0 and next(writer) > 0.0
    assert count_blocks() != blocks
    writer.close()
    assert count_blocks() == blocks


@pytest.mark.parametrize("is_left", [False, True])
def test_a_pile_is_replaced_in_small_steps(desk, addon, is_left):
    result, motion = addon("result"), made_up(addon, bodies=50)
    before = write(desk, motion, "ANIMATION")
    names, blocks = {body.name for body in bodies_of(before)}, count_blocks()
    writer = result.build(bpy.context, motion, recipe_of(desk, "ANIMATION"), {})
    # The old one is whole until all of the new one is there.
    while next(writer) != result.CLOSING:
        assert names <= {body.name for body in bodies_of(before)}
    assert len(bodies_of(before)) == 50 and not names & {body.name for body in bodies_of(before)}
    counts = [len(bpy.data.objects)]
    if is_left:
        # The file is closed, for example: what was begun is done.
        writer.close()
    for _ in writer:
        counts.append(len(bpy.data.objects))
    assert is_left or max(np.abs(np.diff(counts))) == result.REMOVED
    assert count_blocks() == blocks and {body.name for body in bodies_of(before)} == names


def test_what_stands_still_is_not_keyed(desk, addon):
    motion = made_up(addon)
    collection = write(desk, motion, "ANIMATION")
    bodies = list(bodies_of(collection))
    assert bodies[-1].animation_data is None
    changes = (motion.positions[1:] != motion.positions[:-1]).any(axis=2)
    for number, body in enumerate(bodies):
        moving = np.flatnonzero(changes[:, number])
        if not len(moving):
            assert body.animation_data is None
            continue
        for curve in curves_of(body):
            assert len(curve.keyframe_points) <= 2 + moving[-1] - moving[0] + 1
            assert curve.keyframe_points[-1].co.x == 1 + moving[-1] + 1
            assert {point.interpolation for point in curve.keyframe_points} == {"LINEAR"}


def test_turns_take_the_short_way(addon):
    keyframes = addon("keyframes")
    rotations = made_up(addon).rotations
    rotations[3] *= -1
    out = keyframes.continuous(rotations)
    assert (np.einsum("fnc,fnc->fn", out[1:], out[:-1]) >= 0).all()
    assert np.array_equal(np.abs(out), np.abs(rotations))


def curves_of(body):
    action = body.animation_data.action
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    (layer,) = action.layers
    (strip,) = layer.strips
    (bag,) = strip.channelbags
    return list(bag.fcurves)


def test_a_pile_beyond_one_table_becomes_several_objects(desk, addon, monkeypatch):
    points = addon("points")
    monkeypatch.setattr(points, "MAX_ROWS", 40)
    motion = made_up(addon)
    collection = write(desk, motion, "POINTS")
    assert len(bodies_of(collection)) > 1
    check(desk, collection, 6, desk.expected(5), motion.present[5])


def test_axes_there_and_back(addon):
    axes = addon("axes")
    points = np.random.default_rng(1).normal(size=(5, 3))
    assert np.allclose(axes.points_to_blender(axes.points_to_server(points, 0.01), 0.01), points)
    assert np.array_equal(axes.points_to_server([0, 0, 1]), [0, 1, 0])
    # A turn about the vertical stays one.
    assert np.array_equal(axes.rotations_to_blender([0, 0.6, 0, 0.8]), [0.8, 0, 0, 0.6])


def test_the_preview_draws_many_bodies_coarser(addon):
    preview, recording, outline = addon("preview"), addon("recording"), addon("outline")
    motion = made_up(addon)
    snapshot = recording.Snapshot(
        3,
        motion.props,
        motion.scales,
        *(v[0] for v in (motion.positions, motion.rotations)),
        *(v[0] for v in (motion.present, motion.states)),
    )
    points = np.random.default_rng(1).normal(size=(100, 3))
    outlines = [outline.shaded(points, np.arange(99).reshape(33, 3)), *(outline.shaded(*outline.box(points)),) * 2]
    drawn = preview.Preview([preview.Drawn(outlines, preview.COLORS[0])], 1.0, is_shown=False)
    assert drawn.update(snapshot) and not drawn.update(snapshot)
    assert len(drawn.faces) == 20 * 33 and drawn.faces.max() < len(drawn.arrays[0]) == len(drawn.arrays[1])
    limit, preview.MAX_TRIANGLES = preview.MAX_TRIANGLES, 300
    try:
        vertices, colors = drawn._vertices(snapshot)
    finally:
        preview.MAX_TRIANGLES = limit
    assert len(drawn.faces) == 20 * 12 and len(vertices) == len(colors)
    # A box's faces look outwards.
    corners, faces = outline.box(points)
    box = corners[faces]
    normals = np.cross(box[:, 1] - box[:, 0], box[:, 2] - box[:, 0])
    assert (np.einsum("ti,ti->t", normals, box.mean(axis=1) - points.mean(axis=0)) > 0).all()


def test_a_prop_far_from_its_origin_turns_about_itself(desk):
    cuboid("Far", (0.36, 0.14, 0.12), desk.props, location=(7, 0, 3))
    collection = desk.bake(kept_shape="NATURAL")

    def middles(frame, subframe=0.0):
        bpy.context.scene.frame_set(frame, subframe=subframe)
        owners = {body.name for body in bodies_of(collection)}
        shown = shown_vertices().items()
        return {name: points.mean(axis=0) for (name, _), points in shown if name in owners and len(points)}

    for frame in range(1, 12):
        before, after, between = middles(frame), middles(frame + 1), middles(frame, 0.5)
        assert len(before) == len(bodies_of(collection)) > 10
        for name, middle in between.items():
            assert np.abs(middle - (before[name] + after[name]) / 2).max() < 1e-4
    bpy.context.scene.frame_set(bpy.context.scene.frame_end)

    # Worked on by hand, it stays where it is.
    assert bpy.ops.cairn.edit_pile() == {"FINISHED"}
    edited = desk.addon("result").chosen(bpy.context)
    top = max(bodies_of(edited), key=lambda body: body.location.z)
    before = {body.name: np.array(body.location) for body in bodies_of(edited)}
    top.location.z += 0.2
    assert bpy.ops.cairn.settle() == {"FINISHED"}
    moved = [np.linalg.norm(np.array(body.location) - before[body.name]) for body in bodies_of(edited)]
    assert max(moved) < 1.0 and np.median(moved) < 1e-5
