"""Nothing of an artist's is lost: only what a bake made and nobody changed is removed."""

import bpy
import pytest
from blocks import bodies_of
from conftest import cuboid
from test_faults import LONG, start, wait

MODES = ["ANIMATION", "POSE", "POINTS"]


def light(name, collection):
    made = bpy.data.objects.new(name, bpy.data.lights.new(name, "AREA"))
    collection.objects.link(made)
    return made


def homes(shown):
    """The names of the collections in the scene that an object is in."""
    inside = {bpy.context.scene.collection, *bpy.context.scene.collection.children_recursive}
    return {holder.name for holder in shown.users_collection if holder in inside}


def copied(body, pile):
    """As Shift D does."""
    copy = body.copy()
    if copy.animation_data and copy.animation_data.action:
        copy.animation_data.action = copy.animation_data.action.copy()
    pile.objects.link(copy)
    return copy


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("way", ["bake", "delete"])
def test_what_the_artist_put_into_the_pile_stays(desk, addon, mode, way):
    desk.add_stick()
    pile = desk.bake(output_mode=mode)
    key = light("My Key Light", pile)
    camera = bpy.data.objects.new("Shot Cam", bpy.data.cameras.new("Shot Cam"))
    bpy.context.scene.collection.objects.link(camera)
    pile.objects.link(camera)
    own = bpy.data.collections.new("My Set")
    pile.children.link(own)
    chair = cuboid("Chair", (1, 1, 1), own)
    copy = copied(bodies_of(pile)[0], pile)
    follower = light("Follower", bpy.context.scene.collection)
    follower.parent = bodies_of(pile)[0]
    bpy.context.view_layer.update()
    place = follower.matrix_world.copy()
    count = len(bodies_of(pile)) - 3
    if way == "bake":
        assert desk.bake() == pile and len(bodies_of(pile)) == count
        said = addon("running").report_of(pile)["warnings"]
        assert any("“My Key Light”" in text and "Heap Pile Saved" in text and "“My Set”" in text for text in said), said
    else:
        assert bpy.ops.cairn.delete() == {"FINISHED"}
        assert "Heap Pile" not in bpy.data.collections
    assert homes(key) == homes(copy) == {"Heap Pile Saved"}
    assert homes(camera) == {"Scene Collection"} and homes(chair) == {"My Set"}
    # It stays where it was, though the body is gone.
    bpy.context.view_layer.update()
    assert follower.parent is None and (follower.matrix_world.translation - place.translation).length < 1e-5


def test_what_the_artist_changed_stays(desk, addon):
    desk.add_stick()
    bpy.context.scene.frame_set(1)
    pile = desk.bake(output_mode="POSE")
    count = len(bodies_of(pile))
    changed = bodies_of(pile)[:9]
    changed[0].location.x += 0.5
    changed[1].scale *= 1.5
    changed[2].modifiers.new("Bevel", "BEVEL")
    changed[3].name = "Hero"
    changed[4]["note"] = "keep"
    changed[5].constraints.new("LIMIT_LOCATION")
    changed[6].data = changed[6].data.copy()
    changed[7].keyframe_insert("location", frame=9)
    changed[8].color = (1, 0, 0, 1)
    names = {body.name for body in changed}
    desk.bake()
    assert len(bodies_of(pile)) == count
    saved = bpy.data.collections["Heap Pile Saved"]
    assert {shown.name for shown in saved.objects} == names
    assert changed[2].modifiers and changed[7].animation_data.action
    # The artist's own are no bodies any more: another bake leaves them there.
    desk.bake(seed=2, use_replace=True)
    assert {shown.name for shown in saved.objects} == names
    assert not any("Saved" in text for text in addon("running").report_of(pile)["warnings"])


def test_keys_that_the_artist_changed_stay(desk):
    desk.add_stick()
    pile = desk.bake(output_mode="ANIMATION", kept_shape="NATURAL")
    moving = [body for body in bodies_of(pile) if body.animation_data][:2]
    moving[0].location.z = 3.0
    moving[0].keyframe_insert("location", frame=30)
    moving[1].animation_data.nla_tracks.new()
    # The pile's own settings of time change keys, too; these are the add-on's.
    pile.cairn.timing_speed = 2.0
    names = {body.name for body in moving}
    desk.bake()
    assert {shown.name for shown in bpy.data.collections["Heap Pile Saved"].objects} == names


@pytest.mark.parametrize("mode", MODES)
def test_the_add_ons_own_changes_are_not_the_artists(desk, addon, mode):
    desk.add_stick()
    pile = desk.bake(output_mode=mode)
    pile.cairn.timing_speed = 2.0
    pile.cairn.timing_hold = 5
    bpy.context.window_manager.cairn_states = True
    bpy.context.window_manager.cairn_states = False
    pile.cairn.display = "BOUNDS"
    if mode != "POSE":
        assert bpy.ops.cairn.keep_pose() == {"FINISHED"}
    desk.bake()
    assert "Heap Pile Saved" not in bpy.data.collections


def test_edited_piles_are_deleted_without_what_was_moved_by_hand(desk):
    desk.add_stick()
    pile = desk.bake(kept_shape="NATURAL")
    bpy.ops.cairn.edit_pile()
    edited = desk.addon("result").chosen(bpy.context)
    top = max(bodies_of(edited), key=lambda body: body.location.z)
    copy = copied(top, edited)
    copy.location.z += 0.4
    assert bpy.ops.cairn.settle() == {"FINISHED"}
    numbers = [body.cairn.number for body in bodies_of(edited)]
    assert len(set(numbers)) == len(numbers), "a copy by hand is a body of its own"
    moved = bodies_of(edited)[0]
    moved.location.x += 0.1
    assert bpy.ops.cairn.delete(collection=edited.name) == {"FINISHED"}
    (kept,) = bpy.data.collections["Heap Pile Edited Saved"].objects[:1]
    assert kept == moved and len(bodies_of(pile)) > 5


def test_a_prop_that_was_removed_is_not_lost_with_its_pile(desk):
    desk.add_stick()
    kit = bpy.data.collections.new("Kit")
    cuboid("Part", (0.3, 0.14, 0.12), kit)
    empty = bpy.data.objects.new("Kit Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", kit
    desk.props.objects.link(empty)
    desk.bake()
    bpy.data.objects.remove(empty)
    assert bpy.ops.cairn.delete() == {"FINISHED"}
    assert "Kit" in bpy.data.collections and "Part" in bpy.data.objects


def test_what_is_in_the_collections_of_bodies_stays(desk):
    stick = desk.add_stick()
    wood = bpy.data.collections.new("Wood")
    bpy.context.scene.collection.children.link(wood)
    wood.objects.link(stick)
    pile = desk.bake(use_prop_collections=True, output_mode="POSE")
    (inner,) = [child for child in wood.children if child.cairn.of_pile == pile]
    key = light("Rim", inner)
    desk.bake()
    assert homes(key) == {"Heap Pile Saved"}


def test_bodies_of_another_bake_are_numbered_from_1(desk):
    desk.add_stick()
    first = [body.name for body in bodies_of(desk.bake())]
    again = [body.name for body in bodies_of(desk.bake())]
    assert first == again and first[0] == "Stick Body 001" and not any("." in name for name in again)
    assert {action.name for action in bpy.data.actions} <= set(again)


def test_the_shape_is_shown_again_after_the_pile_was_deleted_by_hand(desk):
    desk.add_stick()
    pile = desk.bake()
    for shown in list(pile.objects):
        bpy.data.objects.remove(shown)
    bpy.data.collections.remove(pile)
    assert desk.control.display_type == "WIRE"
    desk.bake()
    assert bpy.ops.cairn.delete() == {"FINISHED"}
    assert (desk.control.display_type, desk.control.hide_render) == ("TEXTURED", False)


def test_how_the_artist_shows_the_shape_meanwhile_stays(desk):
    desk.add_stick()
    desk.control.display_type = "SOLID"
    desk.bake()
    desk.control.display_type = "BOUNDS"
    desk.bake()
    desk.control.display_type = "BOUNDS"
    assert bpy.ops.cairn.delete() == {"FINISHED"}
    assert desk.control.display_type == "BOUNDS"


def test_a_dense_shape_is_no_black_silhouette(desk):
    """Its wire would hide the pile."""
    desk.add_stick()
    dense = desk.control.modifiers.new("Dense", "SUBSURF")
    dense.subdivision_type, dense.levels = "SIMPLE", 6
    bpy.context.view_layer.update()
    desk.bake()
    assert desk.control.display_type == "BOUNDS"
    assert bpy.ops.cairn.delete() == {"FINISHED"}
    assert desk.control.display_type == "TEXTURED"


def seen(scene):
    """What a scene shows and renders."""
    layer = scene.view_layers[0]
    layer.update()
    return sorted((o.name, o.visible_get(view_layer=layer), o.hide_render, o.display_type) for o in layer.objects)


@pytest.mark.parametrize("when", ["before", "after"])
def test_a_scene_with_the_same_objects_does_not_change(desk, when):
    """A linked copy of a scene, made before or after the first bake, is another scene's."""
    desk.add_stick()
    shapes = bpy.data.collections.new("Shapes")
    bpy.context.scene.collection.children.link(shapes)
    shapes.objects.link(desk.control)
    bpy.context.scene.collection.objects.unlink(desk.control)
    if when == "after":
        desk.bake()
    first, settings = bpy.context.scene, bpy.context.scene.cairn
    second = bpy.data.scenes.new("Second")
    for child in first.collection.children:
        second.collection.children.link(child)
    second.cairn.control_mesh, second.cairn.prop_collection = settings.control_mesh, settings.prop_collection
    second.cairn.accuracy = "DRAFT"
    before = seen(first)
    window = bpy.context.window_manager.windows
    if window:
        window[0].scene = second
    with bpy.context.temp_override(scene=second, view_layer=second.view_layers[0]):
        assert bpy.ops.cairn.bake() == {"FINISHED"}
        assert seen(first) == before
        piles = desk.addon("result").piles(second, desk.control)
        assert len(piles) == (2 if when == "after" else 1)
        mine, others = piles[0], piles[1:]
        assert mine.name not in first.collection.children and len(bodies_of(mine)) > 5
        shown = {name for name, is_shown, *_ in seen(second) if is_shown}
        assert {body.name for body in bodies_of(mine)} <= shown
        assert not shown & {body.name for other in others for body in bodies_of(other)}
        assert desk.control.name not in shown or desk.control.display_type == "WIRE"
        # Bins of the second scene's window, too.
        for pile in [*others, mine]:
            assert bpy.ops.cairn.delete(collection=pile.name) == {"FINISHED"}
            assert seen(first) == before
    if window:
        window[0].scene = first


def test_what_a_stopped_bake_leaves_is_kept_beside_the_finished_pile(desk, addon):
    desk.add_stick()
    pile = desk.bake()
    before = len(bodies_of(pile))
    bake = start(desk, addon, **{**LONG, "kept_shape": "NATURAL"})
    wait(bake, lambda: bake.frame_count > 2)
    bake.stop()

    class Drawn:
        removed = 0

        def remove(self):
            self.removed += 1

    drawn = bake.preview = Drawn()
    assert bpy.ops.cairn.keep() == {"FINISHED"} and drawn.removed == 1
    beside = bpy.data.collections["Heap Pile Unfinished"]
    assert pile.hide_viewport and not beside.hide_viewport and not beside.cairn.is_whole
    assert len(bodies_of(pile)) == before
    # The next whole bake takes the finished one's place.
    assert desk.bake(use_frame_count=False, accuracy="DRAFT") == pile
    assert "Heap Pile Unfinished" in bpy.data.collections


def test_panels_follow_the_selected_pile(desk):
    desk.add_stick()
    result = desk.addon("result")
    other = cuboid("Mound", (0.6, 0.6, 0.4), location=(3, 0, 0.2))
    first = desk.bake(output_mode="POSE")
    desk.settings.control_mesh = other
    bpy.ops.cairn.bake()
    second = result.existing(bpy.context.scene, other)
    layer = bpy.context.view_layer

    def select(shown):
        for one in layer.objects:
            one.select_set(one == shown)
        layer.objects.active = shown

    select(None)
    assert result.chosen(bpy.context) == second
    for shown in (bodies_of(first)[0], desk.addon("roots").of(first), desk.control):
        select(shown)
        assert result.chosen(bpy.context) == first, shown.name
    select(bodies_of(second)[0])
    assert result.chosen(bpy.context) == second
    select(bpy.data.objects["Stick"])
    assert result.chosen(bpy.context) == second
