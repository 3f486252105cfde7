"""A preview is not drawn over the old pile: that is hidden meanwhile, and exactly as before afterward."""

import bpy
import pytest
from blocks import all_blocks, bodies_of
from test_live import live  # noqa: F401 a fixture


@pytest.fixture
def pile(desk):
    """A pile of which some bodies are selected, with bodies in their prop's collection, too."""
    stick = desk.add_stick()
    wood = bpy.data.collections.new("Wood")
    bpy.context.scene.collection.children.link(wood)
    wood.objects.link(stick)
    made = desk.bake(output_mode="POSE", use_prop_collections=True)
    bpy.context.view_layer.update()
    for body in bodies_of(made):
        body.select_set(body.cairn.number % 3 == 0)
    return made


def state(pile):
    """What the artist sees and has selected."""
    bpy.context.view_layer.update()
    layers = bpy.context.view_layer.layer_collection.children
    eyes = [(layer.name, layer.hide_viewport, layer.exclude) for layer in layers]
    return seen(pile), [body.select_get() for body in bodies_of(pile)], eyes


def seen(pile):
    return [body.visible_get() for body in bodies_of(pile)]


def test_live_hides_the_pile_while_it_shows_a_draft(desk, pile, live, tmp_path):  # noqa: F811
    module, turn = live
    desk.settings.seed = 8
    before, blocks = state(pile), all_blocks()
    assert all(before[0])
    assert turn(lambda: "Draft of" in module.status())
    assert not any(state(pile)[0])
    # The next draft is also alone.
    desk.settings.seed = 9
    turn(lambda: module.status() == "Drafting…")
    assert turn(lambda: "Draft of" in module.status()) and not any(state(pile)[0])
    # A file saved meanwhile has the pile.
    path = str(tmp_path / "meanwhile.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    assert not any(state(pile)[0])
    module.show(False)
    desk.settings.seed = 8
    assert state(pile) == before and all_blocks() == blocks
    bpy.ops.wm.open_mainfile(filepath=path)
    assert all(seen(bpy.data.collections["Heap Pile"]))


def test_variants_hide_the_pile_while_they_are_shown(desk, addon, pile):
    before = state(pile)
    assert bpy.ops.cairn.try_seeds(count=2) == {"FINISHED"}
    assert state(pile) == before
    names = [entry.name for entry in bpy.context.scene.cairn_variants]
    for name in names:
        assert bpy.ops.cairn.show_variant(variant=name) == {"FINISHED"}
        assert not any(state(pile)[0])
    assert bpy.ops.cairn.show_variant(variant=names[-1]) == {"FINISHED"}
    assert state(pile) == before


def test_an_undo_meanwhile_does_not_keep_it_hidden(desk, addon, pile):
    preview = addon("preview")
    bpy.ops.ed.undo_push(message="pile")
    drawn = preview.Preview([], 1.0)
    bpy.context.scene.frame_end = 300
    bpy.ops.ed.undo_push(message="while it is hidden")
    bpy.context.scene.frame_end = 400
    drawn.remove()
    bpy.ops.ed.undo_push(message="afterward")
    for _ in range(2):
        bpy.ops.ed.undo()
        assert all(seen(bpy.data.collections["Heap Pile"]))
    drawn = preview.Preview([], 1.0)
    bpy.ops.ed.redo()
    assert not any(seen(bpy.data.collections["Heap Pile"]))
    drawn.remove()
    assert all(seen(bpy.data.collections["Heap Pile"]))


def test_what_the_artist_had_hidden_stays_hidden(desk, addon, pile):
    layer = bpy.context.view_layer.layer_collection.children["Heap Pile"]
    layer.hide_viewport = True
    drawn = addon("preview").Preview([], 1.0)
    drawn.remove()
    assert layer.hide_viewport
