"""A pile is moved as one: by the empty that everything in it is parented to."""

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import cuboid, gap, shown_vertices
from mathutils import Euler, Matrix

CLOSE = 2e-5
MODES = ["ANIMATION", "POSE", "POINTS"]


def world(pile):
    """World vertices of all bodies."""
    bpy.context.view_layer.update()
    names = {shown.name for shown in pile.objects}
    return np.concatenate([found for (name, _), found in shown_vertices().items() if name in names and len(found)])


def moved(points, matrix):
    return points @ np.array(matrix)[:3, :3].T + np.array(matrix)[:3, 3]


@pytest.mark.parametrize("mode", MODES)
def test_the_whole_pile_moves_and_stays_moved(desk, addon, mode):
    desk.add_stick()
    pile = desk.bake(output_mode=mode)
    roots, scene = addon("roots"), bpy.context.scene
    root, last = roots.of(pile), len(desk.motion.positions)
    assert root.name == "Heap Pile" and all(shown.parent == root for shown in bodies_of(pile))
    # Its home is below the middle of the shape, and nothing is to be cleared there.
    assert np.abs(np.array(root.matrix_world.translation)).max() < CLOSE and roots.is_home(root)
    for frame in (1, last):
        scene.frame_set(frame)
        before = world(pile)
        root.location, root.rotation_euler, root.scale = (2, -1, 0.5), (0.3, 0.2, 1.0), (1.5, 1.5, 1.5)
        bpy.context.view_layer.update()
        expected = moved(before, root.matrix_world)
        assert gap(expected, world(pile)) < 1e-4, frame
        for path, value in (("location", (0, 0, 0)), ("rotation_euler", (0, 0, 0)), ("scale", (1, 1, 1))):
            setattr(root, path, value)
        assert gap(before, world(pile)) < CLOSE
    # Parented and animated.
    carrier = bpy.data.objects.new("Truck", None)
    scene.collection.objects.link(carrier)
    root.parent = carrier
    carrier.location.x = 4
    assert gap(before + (4, 0, 0), world(pile)) < 1e-4
    root.keyframe_insert("location", frame=1)
    root.location.y = 3
    root.keyframe_insert("location", frame=last)
    assert gap(before + (4, 3, 0), world(pile)) < 1e-4
    # Another bake keeps all of that.
    assert desk.bake(seed=4, use_replace=True) == pile and roots.of(pile) == root
    assert root.parent == carrier and root.animation_data.action
    scene.frame_set(last)
    away = world(pile)
    root.parent, root.location = None, (0, 0, 0)
    root.animation_data_clear()
    assert gap(away - (4, 3, 0), world(pile)) < 1e-4


def test_the_home_follows_the_shape_until_the_pile_is_moved(desk, addon):
    desk.add_stick()
    root = addon("roots").of(desk.bake())
    desk.control.location = (3, 0, 0)
    bpy.context.view_layer.update()
    pile = desk.bake()
    assert addon("roots").of(pile) == root and root.location.length == 0
    bpy.context.view_layer.update()
    assert abs(root.matrix_world.translation.x - 3) < 1e-6
    assert abs(np.median(world(pile)[:, 0]) - 3) < 0.5
    root.location = (0, 5, 0)
    desk.control.location = (7, 0, 0)
    bpy.context.view_layer.update()
    desk.bake()
    assert tuple(root.location) == (0, 5, 0)
    middle = np.median(world(pile), axis=0)
    assert abs(middle[0] - 7) < 0.5 and abs(middle[1] - 5) < 0.5


def test_an_edited_pile_has_an_empty_of_its_own(desk, addon):
    desk.add_stick()
    pile = desk.bake(kept_shape="NATURAL")
    roots, bpy.context.scene.frame_current = addon("roots"), 1
    roots.of(pile).location.x = 5
    assert bpy.ops.cairn.edit_pile() == {"FINISHED"}
    edited = addon("result").chosen(bpy.context)
    root = roots.of(edited)
    assert root != roots.of(pile) and root.location.x == 5 and edited != pile
    assert all(body.parent == root for body in bodies_of(edited))
    # Where it stands, the scene is another.
    with pytest.raises(RuntimeError, match="Clear the transform of “Heap Pile Edited”"):
        bpy.ops.cairn.add_on_top(count=2)
    root.location.x = 0
    assert bpy.ops.cairn.add_on_top(count=2) == {"FINISHED"}
    assert all(body.parent == root for body in bodies_of(edited))


def test_an_empty_that_carries_the_artists_work_stays(desk, addon):
    desk.add_stick()
    pile = desk.bake()
    root = addon("roots").of(pile)
    lamp = cuboid("Lamp", (0.1, 0.1, 0.1))
    lamp.parent = root
    root.matrix_basis = Matrix.Translation((1, 2, 3)) @ Euler((0, 0, 1)).to_matrix().to_4x4()
    bpy.context.view_layer.update()
    place = lamp.matrix_world.copy()
    assert bpy.ops.cairn.delete() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert lamp.parent == root and lamp.matrix_world == place
    assert [holder.name for holder in root.users_collection] == ["Heap Pile Saved"]


def test_no_empty_is_left(desk):
    desk.add_stick()
    before = len(bpy.data.objects)
    desk.bake()
    assert bpy.ops.cairn.delete() == {"FINISHED"} and len(bpy.data.objects) == before


def test_an_empty_that_was_removed_is_made_again(desk, addon):
    desk.add_stick()
    pile = desk.bake()
    bpy.data.objects.remove(addon("roots").of(pile))
    desk.bake()
    root = addon("roots").of(pile)
    assert root is not None and all(body.parent == root for body in bodies_of(pile))
