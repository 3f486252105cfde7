"""A pile is worked on by hand: what was disturbed settles, the rest keeps its pose to the last bit."""

import json
import time

import bmesh
import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import points_of


def poses(collection):
    return {
        body.name: np.float32([*body.location, *body.rotation_quaternion, *body.scale]).tobytes()
        for body in bodies_of(collection)
    }


@pytest.fixture
def edited(desk):
    """The copy of a pile to work on."""
    desk.add_stick()
    desk.add_stick("Block", (0.2, 0.2, 0.2))
    first = desk.bake(kept_shape="NATURAL")
    before = {body.name: body.animation_data is not None for body in bodies_of(first)}
    assert bpy.ops.cairn.edit_pile() == {"FINISHED"}
    collection = desk.addon("result").chosen(bpy.context)
    assert collection != first and first.hide_viewport and len(bodies_of(collection)) == len(bodies_of(first))
    assert {body.name: body.animation_data is not None for body in bodies_of(first)} == before
    last = desk.expected(len(desk.motion.positions) - 1)
    for body, matrix in zip(bodies_of(collection), last):
        assert is_at(body, matrix) and not body.animation_data
    return collection


def is_at(body, matrix):
    here = np.array(body.matrix_basis) @ np.diag([*(1 / np.array(body.scale)), 1.0])
    return np.abs(here[:3, 3] - matrix[:3, 3]).max() < 1e-5 and np.abs(here[:3, :3] - matrix[:3, :3]).max() < 1e-4


def select(*bodies):
    for other in bpy.context.view_layer.objects:
        other.select_set(other in bodies)


def top_of(collection):
    return max(bodies_of(collection), key=lambda body: body.location.z)


def bottom_of(collection):
    """One that carries others: low, and in the middle."""
    return min(bodies_of(collection), key=lambda body: body.location.z + body.location.xy.length)


@pytest.mark.parametrize("is_plain", [True, False])
def test_the_final_pose_is_copied_in_any_frame(desk, is_plain):
    desk.add_stick()
    pile = desk.bake(kept_shape="NATURAL")
    body = next(body for body in bodies_of(pile) if body.animation_data)
    if not is_plain:
        driver = body.driver_add("pass_index").driver
        driver.expression = "7"
    scene, moved = bpy.context.scene, []
    scene.frame_set(3)
    bpy.app.handlers.frame_change_pre.append(lambda *_: moved.append(1))
    assert bpy.ops.cairn.edit_pile() == {"FINISHED"}
    bpy.app.handlers.frame_change_pre.pop()
    # Only what an artist has added needs another look at the scene.
    assert bool(moved) is not is_plain and scene.frame_current == 3
    copies = bodies_of(desk.addon("result").chosen(bpy.context))
    assert all(map(is_at, copies, desk.expected(len(desk.motion.positions) - 1)))


def test_nothing_to_settle_is_told(edited):
    with pytest.raises(RuntimeError, match="Nothing was changed"):
        bpy.ops.cairn.settle()
    select()
    with pytest.raises(RuntimeError, match="Select the bodies"):
        bpy.ops.cairn.remove_bodies()


def test_what_stood_on_a_removed_body_settles(edited, desk):
    count = len(bodies_of(edited))
    select(bottom_of(edited))
    assert bpy.ops.cairn.remove_bodies() == {"FINISHED"} and len(bodies_of(edited)) == count - 1
    before = poses(edited)
    bpy.ops.ed.undo_push(message="removed")
    assert bpy.ops.cairn.settle() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="settled")
    report = desk.addon("running").report_of(edited)
    assert report["measures"]["at_rest_fraction"] > 0.8
    settled = report["settled"]
    assert settled["moved"] > 0 and settled["kept"] > 0 and settled["moved"] + settled["kept"] == count - 1
    after = poses(edited)
    same = [name for name in after if after[name] == before[name]]
    assert settled["kept"] <= len(same) < count - 1
    # What keeps its pose was certified to stand, and is.
    stood, stands = settled["standing"]
    assert settled["kept"] >= stood > 0.8 * settled["kept"] and stands >= 0.95 * stood
    said = desk.addon("weighing").said(report)
    assert said.startswith("The edit did not weaken" if stands >= stood else "The edit weakened")
    # One step back is all of it.
    name = edited.name
    bpy.ops.ed.undo()
    assert poses(bpy.data.collections[name]) == before


def test_the_top_is_taken_off_and_nothing_else_moves(edited, desk):
    select(top_of(edited))
    bpy.ops.cairn.remove_bodies()
    before = poses(edited)
    try:
        bpy.ops.cairn.settle()
    except RuntimeError as error:
        # Where nothing stood on it, there is nothing to settle.
        assert "Nothing was changed" in str(error)
    after = poses(edited)
    assert sum(after[name] == before[name] for name in after) >= len(after) - 5


def test_a_body_moved_by_hand_falls(edited):
    body = top_of(edited)
    body.location.z += 0.5
    before, height = poses(edited), body.location.z
    assert bpy.ops.cairn.settle() == {"FINISHED"}
    assert body.location.z < height - 0.2
    after = poses(edited)
    assert sum(after[name] != before[name] for name in after) < len(after) / 2


def test_a_body_is_replaced(edited, desk):
    body = top_of(edited)
    select(body)
    number, where = body.cairn.number, body.location.copy()
    other = 1 - body.cairn.prop
    assert bpy.ops.cairn.replace_bodies(prop=str(other)) == {"FINISHED"}
    (made,) = [body for body in bodies_of(edited) if body.cairn.number == number]
    assert made.location == where and made.cairn.prop == other
    assert made.data == bpy.data.objects[["Stick", "Block"][other]].data
    assert bpy.ops.cairn.settle() == {"FINISHED"}


def test_more_is_dropped_on_top(edited, desk):
    before, count = poses(edited), len(bodies_of(edited))
    assert bpy.ops.cairn.add_on_top(count=6) == {"FINISHED"}
    after = poses(edited)
    assert len(bodies_of(edited)) == count + 6
    assert all(after[name] == before[name] for name in before)
    settled = desk.addon("running").report_of(edited)["settled"]
    assert (settled["moved"], settled["kept"], settled["added"]) == (0, count, 6)
    numbers = [body.cairn.number for body in bodies_of(edited)]
    assert len(set(numbers)) == len(numbers)


def test_what_has_lost_its_hold_is_not_certified(edited, desk):
    """If bodies were left where nothing holds them, the verdict after the edit would show it."""
    weighing, edit = desk.addon("weighing"), desk.addon("edit")
    before = edit.settled(edited)
    bodies_of(edited)[0].location.z += 3.0
    taken = desk.addon("request").finish(edit.settling(bpy.context, edited))[0]
    after = {body.cairn.number: edit._state(body) for body in bodies_of(edited)}
    asked = weighing.Weighing(desk.addon("preferences").server(bpy.context), taken, before, set(before))
    asked.begin("none", after)
    while weighing.collect():
        time.sleep(0.05)
    stood, stands = asked.standing()
    assert stood > stands > 0
    (first, second) = (set(job.report["unsupported"]) for job in asked.jobs)
    lifted = list(after).index(bodies_of(edited)[0].cairn.number)
    assert lifted in second and lifted not in first


def test_points_cannot_be_edited(desk):
    desk.add_stick()
    desk.bake(output_mode="POINTS")
    with pytest.raises(RuntimeError, match="Animated Objects"):
        bpy.ops.cairn.edit_pile()


def test_what_hung_from_a_removed_body_is_let_go(edited, desk):
    """Glue holds nothing to what is gone, wherever it was."""
    edit, dots, running = desk.addon("edit"), desk.addon("dots"), desk.addon("running")
    listed = [{"body": 0, "other": 1, "at": [0, 0, 0], "load": 1.0, "broken": False}]
    edited.cairn.report = json.dumps({**running.report_of(edited), "dots": listed})
    ends = [dots.number_of(edited, body) for body in (listed[0]["body"], listed[0]["other"])]
    by_number = {body.cairn.number: body for body in bodies_of(edited)}
    gone, other = sorted((by_number[number] for number in ends), key=lambda body: -body.location.z)
    props = desk.addon("request").finish(desk.addon("export").Exporter(bpy.context).props(list(desk.props.objects)))
    select(gone)
    bpy.ops.cairn.remove_bodies()
    placed = edit.Placed(edited, props)
    free = desk.addon("request").finish(placed.disturbed())
    assert free[placed.objects.index(other)]


def test_bodies_carry_what_a_pipeline_goes_by(desk):
    stick = desk.add_stick()
    stick.pass_index, stick["asset"], stick["lod"] = 7, "stick_a", 2
    collection = desk.bake(output_mode="POSE")
    assert {(body.pass_index, body["asset"], body["lod"]) for body in bodies_of(collection)} == {(7, "stick_a", 2)}
    collection.cairn.display = "BOUNDS"
    assert {body.display_type for body in bodies_of(collection)} == {"BOUNDS"} and stick.display_type == "TEXTURED"


def test_a_bake_leaves_an_edited_pile_alone(edited, desk):
    before = poses(edited)
    again = desk.bake(kept_shape="NATURAL")
    assert again != edited and not again.hide_viewport and edited.hide_viewport and poses(edited) == before


@pytest.mark.parametrize("size", [0.5, 2.0])
def test_what_is_gone_had_its_size(desk, size):
    """Bodies that lay on a removed body are found by that body's surface, not by its prop's."""
    desk.add_stick("Block", (0.2, 0.2, 0.2))
    common = desk.settings.prop_common
    common.scale_min = common.scale_max = size
    desk.settings.fill.use_count, desk.settings.fill.count = True, 4
    desk.bake(kept_shape="NATURAL", output_mode="POSE")
    bpy.ops.cairn.edit_pile()
    collection = desk.addon("result").chosen(bpy.context)
    edge = 0.2 * size
    bodies = sorted(bodies_of(collection), key=lambda body: body.name)[:3]
    for body in set(bodies_of(collection)) - set(bodies):
        bpy.data.objects.remove(body)
    # One on the other, and one beside it, where a block of the prop's own size would be.
    for body, place in zip(bodies, ((0, 0, 0), (0, 0, edge), (1.1 * edge, 0, 0.1 * edge))):
        body.location, body.rotation_quaternion = place, (1, 0, 0, 0)
    bpy.context.view_layer.update()
    edit, request = desk.addon("edit"), desk.addon("request")
    edit.remember(collection)
    assert all(abs(body.cairn.size - size) < 1e-6 for body in bodies_of(collection))
    gone, on_it, far = bodies
    select(gone)
    bpy.ops.cairn.remove_bodies()
    props = request.finish(desk.addon("export").Exporter(bpy.context).props(list(desk.props.objects)))
    placed = edit.Placed(collection, props)
    (pose,) = placed.gone
    _, low, high = placed.reaching(*pose)
    # And a little more, for what only touches it.
    assert np.all(high - low > edge) and np.all(high - low < 1.1 * edge)
    free = request.finish(placed.disturbed())
    assert dict(zip(placed.objects, free)) == {on_it: True, far: False}


def paint(control, name, weight_of):
    """Weights by place, on a mesh that is finely divided."""
    with_edges = bmesh.new()
    with_edges.from_mesh(control.data)
    bmesh.ops.subdivide_edges(with_edges, edges=with_edges.edges[:], cuts=15, use_grid_fill=True)
    with_edges.to_mesh(control.data)
    with_edges.free()
    group = control.vertex_groups.new(name=name)
    for vertex in control.data.vertices:
        group.add([vertex.index], weight_of(vertex.co), "REPLACE")
    bpy.context.view_layer.update()


def test_more_is_dropped_over_what_is_painted(edited, desk, monkeypatch):
    paint(desk.control, "Half", lambda place: float(place.x > 0.1 and place.z > 0.4))
    before, count = poses(edited), len(bodies_of(edited))
    edit, asked, settling = desk.addon("edit"), [], desk.addon("edit").settling

    def spying(*words):
        taken = yield from settling(*words)
        asked.append(taken[0])
        return taken

    monkeypatch.setattr(edit, "settling", spying)
    assert bpy.ops.cairn.add_on_top(count=8, region="Half") == {"FINISHED"}
    after = poses(edited)
    assert len(bodies_of(edited)) == count + 8 and all(after[name] == before[name] for name in before)
    (request,) = asked
    (emitter,) = request.spec.scene.emitters
    (sha256,) = [asset.sha256 for asset in request.spec.assets if asset.uri == emitter.mesh]
    points = points_of(request.contents[sha256])
    low, high = points.min(axis=0), points.max(axis=0)
    # The half of the shape's top, from above the bodies on; a cell more or less.
    assert np.abs(low[:2] - (0.1, -0.4)).max() < 0.1 and np.abs(high[:2] - (0.4, 0.4)).max() < 0.1
    top = max(body.location.z for body in bodies_of(edited) if body.name in before)
    assert top < low[2] < top + 1.0 and high[2] - low[2] == pytest.approx(0.36, abs=0.01)
    new = [body.location.x for body in bodies_of(edited) if body.name not in before]
    assert np.mean(new) > 0.1


def test_a_region_that_is_none_is_told(edited, desk):
    with pytest.raises(RuntimeError, match="no vertex group"):
        bpy.ops.cairn.add_on_top(count=1, region="Nowhere")
    desk.control.vertex_groups.new(name="Bare")
    with pytest.raises(RuntimeError, match="Nothing is painted"):
        bpy.ops.cairn.add_on_top(count=1, region="Bare")
    assert desk.addon("running").bake is None


def test_a_region_is_painted(edited, desk):
    manager, control = bpy.context.window_manager, desk.control
    assert bpy.ops.cairn.paint_region() == {"FINISHED"}
    assert bpy.context.mode == "PAINT_WEIGHT" and bpy.context.object == control
    name = manager.cairn_add_region
    assert control.vertex_groups.active.name == name and control.display_type == "TEXTURED"
    assert bpy.ops.cairn.paint_region() == {"FINISHED"}
    assert bpy.context.mode == "OBJECT" and control.display_type == "WIRE"
    assert bpy.ops.cairn.paint_region() == {"FINISHED"} and len(control.vertex_groups) == 1
    control.vertex_groups[name].add(range(8), 1.0, "REPLACE")
    count = len(bodies_of(edited))
    # From the painting on.
    assert bpy.ops.cairn.add_on_top(count=2, region=name) == {"FINISHED"}
    assert bpy.context.mode == "OBJECT" and control.display_type == "WIRE" and len(bodies_of(edited)) == count + 2
    manager.cairn_add_region = ""


@pytest.mark.parametrize("rows", [["##", "##"], ["#.", ".#"], ["###", "#.#", "###"], ["#"]])
def test_a_block_over_cells_is_closed(addon, rows):
    found = np.array([[sign == "#" for sign in row] for row in rows])
    points, triangles = addon("painted").block(0.5, np.array([1.0, 2.0]), found, 3.0, 4.0)
    edges = np.concatenate([triangles[:, (0, 1)], triangles[:, (1, 2)], triangles[:, (2, 0)]])
    forward = {}
    for one, other in edges.tolist():
        forward[one, other] = forward.get((one, other), 0) + 1
    assert all(forward.get((other, one)) == count for (one, other), count in forward.items())
    corners = points[triangles]
    volume = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(0.25 * found.sum())
    assert points.min(axis=0).tolist() == [1.0, 2.0, 3.0]
