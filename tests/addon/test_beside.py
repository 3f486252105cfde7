"""Piles in containers, and beside other piles."""

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import cuboid, mesh_object, points_of, shown_vertices


def crate(name="Crate", size=(0.9, 0.7, 0.5)):
    """A box of sheets, open at its top, on the ground."""
    x, y, z = size[0] / 2, size[1] / 2, size[2]
    ring = [(-x, -y), (x, -y), (x, y), (-x, y)]
    corners = [(*corner, height) for height in (0, z) for corner in ring]
    sides = [(k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)]
    return mesh_object(name, corners, [(3, 2, 1, 0), *sides])


def world(pile):
    """World vertices of a pile's bodies."""
    names = {body.name for body in bodies_of(pile)}
    return np.concatenate([points for (name, _), points in shown_vertices().items() if name in names])


def parts_of(pile):
    """World vertices of each body of a pile."""
    names = {body.name for body in bodies_of(pile)}
    return [points for (name, _), points in shown_vertices().items() if name in names]


@pytest.fixture
def placing(desk):
    if not desk.addon("schema").knows("Fill", "level"):
        pytest.skip("the schema has no containers")
    desk.add_stick()
    return desk


def test_a_container_is_filled_and_stays(placing):
    bpy.data.objects.remove(placing.control)
    placing.control = placing.settings.control_mesh = crate()
    placing.settings.use_inside = True
    placing.settings.fill.use_heap, placing.settings.fill.heap = True, 10.0
    pile = placing.bake(output_mode="POSE", kept_shape="NATURAL")
    scene = placing.request.spec.scene
    (piece,) = scene.statics
    assert scene.fill.into == piece.path == "Crate" and not scene.HasField("control_mesh")
    assert scene.fill.heap == 10.0
    points = world(pile)
    assert len(bodies_of(pile)) > 10
    # A sheet has no thickness: bodies press on it by a share of their own.
    assert np.abs(points[:, 0]).max() < 0.46 and np.abs(points[:, 1]).max() < 0.36 and points[:, 2].min() > -0.01
    assert placing.control.display_type == "TEXTURED" and not placing.control.hide_render
    # Another share, of the same container.
    fuller = len(bodies_of(pile))
    placing.settings.fill.use_share, placing.settings.fill.share = True, 0.4
    assert len(bodies_of(placing.bake(use_replace=True))) < 0.7 * fuller
    # What fills a container means nothing for a shape.
    placing.settings.use_inside = False
    placing.settings.control_mesh = placing.control = cuboid("Heap", (0.8, 0.8, 0.5), location=(0, 2, 0.25))
    placing.settings.prop_collection, placing.settings.use_piles = placing.props, False
    placing.settings.fill.use_share = True
    placing.bake()
    scene = placing.request.spec.scene
    assert not scene.fill.HasField("share") and scene.control_mesh.path == "Heap" and not scene.statics


def test_names_of_copies_are_not_confused(placing):
    bpy.data.objects.remove(placing.control)
    placing.control = placing.settings.control_mesh = crate()
    copy = crate()
    copy.location.x = 2
    assert copy.name == "Crate.001"
    colliders = bpy.data.collections.new("Colliders")
    bpy.context.scene.collection.children.link(colliders)
    colliders.objects.link(copy)
    pile = placing.bake(use_inside=True, colliders=colliders, output_mode="POSE")
    assert len(placing.request.spec.scene.statics) == 2 and world(pile)[:, 0].max() < 0.5


@pytest.mark.parametrize("mode", ["ANIMATION", "POSE", "POINTS"])
def test_a_new_pile_is_built_around_the_others(placing, mode):
    first = placing.bake(output_mode=mode, kept_shape="NATURAL")
    scene, end = bpy.context.scene, placing.addon("timing").end_of(first)
    scene.frame_set(end)
    shown = world(first)
    scene.frame_set(1)
    before = {body.name: body.matrix_world.copy() for body in bodies_of(first)}
    placing.control = cuboid("Beside", (0.8, 0.8, 0.5), location=(0.5, 0, 0.25))
    placing.settings.control_mesh = placing.control
    second = placing.bake(prop_collection=placing.props, accuracy="DRAFT", output_mode="POSE", use_ground_height=False)
    (piece,) = placing.request.spec.scene.statics
    (sha256,) = [asset.sha256 for asset in placing.request.spec.assets if asset.uri == piece.path]
    sent = points_of(placing.request.contents[sha256])
    # As it lies in the end, though the scene was at the first frame.
    assert np.abs(np.sort(sent, axis=0) - np.sort(shown, axis=0)).max() < 1e-4, end
    scene.frame_set(1)
    assert all(np.abs(np.array(o.matrix_world - before[o.name])).max() < 1e-6 for o in bodies_of(first))
    # The first one has the room that both shapes have.
    centers = [np.mean(points[:, 0]) for points in parts_of(second)]
    assert len(centers) > 5 and min(centers) > 0.1
    # Unless the artist does not want it, or does not show it.
    placing.bake(use_piles=False, use_replace=True)
    assert not placing.request.spec.scene.statics
    placing.addon("visibility").show(scene, first, False)
    placing.bake(use_piles=True)
    assert not placing.request.spec.scene.statics


def test_a_pile_rides_in_a_container_that_moves(placing):
    bpy.data.objects.remove(placing.control)
    placing.control = placing.settings.control_mesh = crate()
    for frame, x in ((1, 0.0), (13, 0.0), (61, 0.5)):
        placing.control.location.x = x
        placing.control.keyframe_insert("location", frame=frame)
    pile = placing.bake(use_inside=True, kept_shape="NATURAL", use_frame_count=True, frame_count=72)
    scene = placing.request.spec.scene
    (piece,) = scene.statics
    assert scene.fill.into == piece.path and len(piece.keyframes) > 2
    middles = []
    for frame in (1, 12, 73):
        bpy.context.scene.frame_set(frame)
        middles.append(np.array([points.mean(axis=0) for points in parts_of(pile)]))
    # At rest in the first frame, and along with the container.
    assert np.abs(middles[1] - middles[0]).max() < 0.01
    assert np.median(middles[2][:, 0] - middles[0][:, 0]) == pytest.approx(0.5, abs=0.03)
