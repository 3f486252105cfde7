"""Seeds that are tried, kept and deleted; and piles of other seeds, which stay."""

import bpy
import pytest
from conftest import count_blocks


def test_a_pile_of_another_seed_stays(desk, addon):
    desk.add_stick()
    before = count_blocks()
    first = desk.bake(seed=1)
    where = [tuple(body.location) for body in first.objects]
    second = desk.bake(seed=2)
    assert second != first and first.hide_viewport and first.hide_render and not second.hide_viewport
    assert [tuple(body.location) for body in first.objects] == where
    # The same seed, or on request: in its place.
    assert desk.bake(seed=2) == second and len(first.objects) == len(where)
    assert desk.bake(seed=3, use_replace=True) == second
    assert bpy.ops.cairn.show_pile(collection=first.name) == {"FINISHED"}
    assert not first.hide_viewport and second.hide_viewport
    assert addon("result").chosen(bpy.context) == first
    # The last to go gives the shape back.
    assert bpy.ops.cairn.delete() == {"FINISHED"} and not second.hide_viewport and desk.control.hide_render
    assert bpy.ops.cairn.delete() == {"FINISHED"}
    assert not desk.control.hide_render and desk.control.display_type == "TEXTURED"
    assert count_blocks() == before


def test_seeds_are_tried_and_one_is_kept(desk, addon, tmp_path):
    desk.add_stick()
    before = count_blocks()
    assert bpy.ops.cairn.try_seeds(count=3) == {"FINISHED"}
    entries = bpy.context.scene.cairn_variants
    assert [entry.name for entry in entries] == ["Seed 1", "Seed 2", "Seed 3"] and count_blocks() == before
    assert len({entry.bake_id for entry in entries}) == 3 and all("bodies" in entry.told for entry in entries)
    assert desk.settings.seed == 1
    # A file that was closed has them still, whatever the prop is called now.
    path = str(tmp_path / "tried.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    variants, entries = addon("variants"), bpy.context.scene.cairn_variants
    bpy.data.objects["Stick"].name = "Rod"
    assert not variants.is_here(entries[1])
    addon("request").finish(variants.load(bpy.context, entries[1]))
    snapshot, _ = variants._poses[entries[1].bake_id]
    assert bpy.ops.cairn.keep_variant(variant="Seed 2") == {"FINISHED"}
    pile = bpy.data.collections["Heap Pile"]
    assert len(pile.objects) == snapshot.present.sum() and addon("result").seed_of(pile) == 2
    assert len(entries) == 3
    # As if it had been baked with that seed.
    kept = pile.cairn.result_hash
    settings = bpy.context.scene.cairn
    assert bpy.ops.cairn.restore_settings(collection=pile.name) == {"FINISHED"}
    assert settings.seed == 2 and bpy.ops.cairn.bake() == {"FINISHED"}
    assert pile.cairn.result_hash == kept
    assert bpy.ops.cairn.delete_variant(variant="Seed 1") == {"FINISHED"}
    assert [entry.name for entry in entries] == ["Seed 2", "Seed 3"]


def test_glue_is_tried_with_each_seed(desk, addon):
    desk.add_stick()
    desk.control.scale = (1.0, 0.35, 1.6)
    assert bpy.ops.cairn.try_seeds(count=1, is_with_glue=True) == {"FINISHED"}
    told = {entry.name: entry.told for entry in bpy.context.scene.cairn_variants}
    assert set(told) == {"Seed 1, As Modelled", "Seed 1, Natural"}
    assert "dots" in told["Seed 1, As Modelled"] and "no glue" in told["Seed 1, Natural"]


def test_what_is_lacking_is_told(desk):
    with pytest.raises(RuntimeError, match="made of"):
        bpy.ops.cairn.try_seeds()
    assert not bpy.context.scene.cairn_variants
