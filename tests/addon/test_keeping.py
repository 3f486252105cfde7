"""*Keep What Fits*: another bake after a change of the shape keeps what the change is not near."""

import json

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import mesh_object, once
from test_faults import refusal

LENGTH, RINGS = 2.4, 25


def bar(name="Bar"):
    """A closed bar along X, with a ring of four vertices every tenth of a metre."""
    places = np.linspace(-LENGTH / 2, LENGTH / 2, RINGS)
    vertices = [(x, y, z) for x in places for y, z in ((-0.25, 0), (0.25, 0), (0.25, 0.4), (-0.25, 0.4))]
    sides = [
        (4 * ring + k, 4 * ring + (k + 1) % 4, 4 * ring + 4 + (k + 1) % 4, 4 * ring + 4 + k)
        for ring in range(RINGS - 1)
        for k in range(4)
    ]
    last = 4 * (RINGS - 1)
    return mesh_object(name, vertices, [(3, 2, 1, 0), *sides, (last, last + 1, last + 2, last + 3)])


def sculpt(shape, height=0.25):
    """Pulls the top up at one end, less and less toward the middle, as a brush does."""
    for vertex in shape.data.vertices:
        if vertex.co.z > 0.1:
            vertex.co.z += height * max(0.0, 1.0 - (LENGTH / 2 - vertex.co.x) / 0.7)
    shape.data.update()


@pytest.fixture
def long_desk(desk):
    bpy.data.objects.remove(desk.control)
    desk.control = desk.settings.control_mesh = bar()
    desk.add_stick(size=(0.24, 0.14, 0.12))
    return desk


def ends(pile):
    """Of each body, by its name: its object, and the bits of its matrix at the end."""
    bpy.context.scene.frame_set(bpy.context.scene.cairn.start_frame + 1000)
    return {body.name: (body, np.array(body.matrix_world, np.float32).tobytes()) for body in bodies_of(pile)}


def middle(matrix):
    return np.frombuffer(matrix, np.float32).reshape(4, 4)[:3, 3]


@pytest.mark.parametrize("mode", ["ANIMATION", pytest.param("POSE", marks=once)])
def test_a_sculpted_end_changes_that_end_alone(long_desk, addon, mode):
    desk, keeping, running = long_desk, addon("keeping"), addon("running")
    pile = desk.bake(output_mode=mode)
    assert not pile.cairn.use_keep and not desk.request.spec.from_bake_id
    assert keeping.said(running.report_of(pile)) == ""
    before, first_id = ends(pile), pile.cairn.bake_id
    far = {name for name, (_, matrix) in before.items() if middle(matrix)[0] < 0.0}
    assert len(before) > 40 and len(far) > 20
    # An artist's change of looks stays on a body that stays.
    plain = [body for body, _ in before.values() if body.name in far and body.animation_data is None]
    hero = plain[0]
    hero.color = (1, 0, 0, 1)
    hero_name = hero.name = "Hero"
    far = {hero_name if name not in bpy.data.objects else name for name in far}
    before = ends(pile)
    bpy.ops.ed.undo_push(message="before")

    pile.cairn.use_keep = True
    sculpt(desk.control)
    assert desk.bake() == pile
    assert desk.request.spec.from_bake_id == first_id != pile.cairn.bake_id
    after = ends(pile)
    same = {name for name in far if name in after and after[name] == before[name]}
    assert len(same) >= 0.95 * len(far), f"{len(same)} of {len(far)} bodies far from the change are the same"
    assert hero_name in same and tuple(hero.color) == (1, 0, 0, 1)
    report = running.report_of(pile)
    counts = [report["counts"][f"bodies_{what}"] for what in ("kept", "moved", "new", "gone")]
    assert counts[0] + counts[1] + counts[3] == len(before) and counts[0] + counts[1] + counts[2] == len(after)
    assert counts[2] > 0, "the end is higher"
    assert keeping.said(report) == "{} kept, {} moved, {} new, {} gone".format(*counts)
    # New bodies have names that no body had.
    new = {name for name in after if name not in before}
    assert len(new) == counts[2] and not any(name[-4] == "." for name in new)
    assert [body.cairn.number for body in bodies_of(pile)] != [] and len(after) == report["body_count"]
    assert sorted(body.cairn.number for body in bodies_of(pile)) == list(range(1, len(after) + 1))

    # Once more, with what was kept twice; and all of it is one undo step.
    bpy.ops.ed.undo_push(message="Bake Pile")
    sculpt(desk.control, -0.1)
    desk.bake()
    again = ends(pile)
    assert len([name for name in same if again.get(name) == before[name]]) >= 0.95 * len(same)
    bpy.ops.ed.undo_push(message="Bake Pile")
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    pile = bpy.data.collections["Bar Pile"]
    assert pile.cairn.bake_id == first_id
    assert {name: matrix for name, (_, matrix) in ends(pile).items()} == {n: m for n, (_, m) in before.items()}


def test_a_body_that_the_artist_moved_is_not_kept(long_desk):
    desk = long_desk
    pile = desk.bake(output_mode="POSE")
    moved = bodies_of(pile)[0]
    moved.location.x -= 0.5
    place = moved.location.copy()
    pile.cairn.use_keep = True
    sculpt(desk.control)
    desk.bake()
    assert [holder.name for holder in moved.users_collection] == ["Bar Pile Saved"] and moved.location == place
    assert len(bodies_of(pile)) == json.loads(pile.cairn.report)["body_count"]


@once
def test_points_are_kept_too(long_desk, addon):
    desk = long_desk
    pile = desk.bake(output_mode="POINTS")
    pile.cairn.use_keep = True
    sculpt(desk.control)
    before = desk.motion
    desk.bake()
    after = desk.motion
    places = {int(number): index for index, number in enumerate(after.numbers)}
    kept = 0
    for index, number in enumerate(before.numbers):
        if before.positions[-1, index, 0] < 0.0 and int(number) in places:
            kept += np.array_equal(before.positions[-1, index], after.positions[-1, places[int(number)]])
    assert kept > 20
    assert addon("running").report_of(pile)["counts"]["bodies_kept"] >= kept


@once
def test_what_the_server_has_no_longer_is_said(long_desk, addon):
    desk, job, preferences, running = long_desk, addon("job"), addon("preferences"), addon("running")
    pile = desk.bake()
    job.ask(preferences.server(bpy.context), "DeleteBake", bake_id=pile.cairn.bake_id).result()
    before = pile.cairn.bake_id, len(bodies_of(pile))
    pile.cairn.use_keep = True
    sculpt(desk.control)
    assert "no longer has the last bake" in refusal()
    assert (pile.cairn.bake_id, len(bodies_of(pile))) == before, "nothing is baked afresh before the artist asks"
    assert "Untick “Keep What Fits”" in running.problems[0].text
    pile.cairn.use_keep = False
    assert running.problems == []
    desk.bake()
    assert pile.cairn.bake_id != before[0] and "keeps" not in running.report_of(pile)
