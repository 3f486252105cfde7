"""Seeds that are tried, kept and deleted; and piles of other seeds, which stay."""

import threading
import time
from unittest.mock import MagicMock

import bpy
import pytest
from blocks import bodies_of
from conftest import count_blocks, once


def test_a_pile_of_another_seed_stays(desk, addon):
    desk.add_stick()
    before = count_blocks()
    first = desk.bake(seed=1)
    where = [tuple(body.location) for body in bodies_of(first)]
    second = desk.bake(seed=2)
    assert second != first and first.hide_viewport and first.hide_render and not second.hide_viewport
    assert [tuple(body.location) for body in bodies_of(first)] == where
    # The same seed, or on request: in its place.
    assert desk.bake(seed=2) == second and len(bodies_of(first)) == len(where)
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
    assert len({entry.bake_id for entry in entries}) == 3 and all("bodies" in entry.summary for entry in entries)
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
    assert len(bodies_of(pile)) == snapshot.present.sum() and addon("result").seed_of(pile) == 2
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
    results = {entry.name: entry.summary for entry in bpy.context.scene.cairn_variants}
    assert set(results) == {"Seed 1, As Modeled", "Seed 1, Natural"}
    assert "dots" in results["Seed 1, As Modeled"] and "no glue" in results["Seed 1, Natural"]


@once
def test_strengths_are_tried_on_request(desk, addon):
    desk.add_stick()
    desk.control.scale = (1.0, 0.35, 1.6)
    desk.settings.seed = 3
    desk.settings.kept_shape, desk.settings.glue_strength = "TACKY", 4.0
    wanted = {"count": 1, "is_with_glue": True, "kept_shapes": {"NATURAL"}, "strengths": "0.5, 20;4"}
    assert bpy.ops.cairn.try_seeds(**wanted) == {"FINISHED"}
    entries = bpy.context.scene.cairn_variants
    names = ["Seed 3, Tacky 20", "Seed 3, Tacky 4", "Seed 3, Tacky 0.5", "Seed 3, Natural"]
    assert [entry.name for entry in entries] == names
    assert len({entry.bake_id for entry in entries}) == 4
    settings = desk.settings
    assert (settings.kept_shape, settings.glue_strength) == ("TACKY", 4.0)
    # Each is what a bake with those settings gives.
    for name, choice, strength in ((names[0], "TACKY", 20.0), (names[2], "TACKY", 0.5), (names[3], "NATURAL", 4.0)):
        assert bpy.ops.cairn.keep_variant(variant=name) == {"FINISHED"}
        pile = addon("result").chosen(bpy.context)
        kept = pile.cairn.result_hash
        assert bpy.ops.cairn.restore_settings(collection=pile.name) == {"FINISHED"}
        assert (settings.kept_shape, settings.glue_strength, settings.seed) == (choice, strength, 3)
        assert bpy.ops.cairn.bake() == {"FINISHED"} and pile.cairn.result_hash == kept


@pytest.mark.parametrize("text", ["1, x", "-1", "nan", "1..2"])
def test_strengths_that_are_none_are_told(desk, text):
    desk.add_stick()
    with pytest.raises(RuntimeError, match="numbers with commas"):
        bpy.ops.cairn.try_seeds(count=1, is_with_glue=True, strengths=text)
    assert not bpy.context.scene.cairn_variants


def test_a_variant_of_before_is_fetched_in_the_background(desk, addon, tmp_path, monkeypatch):
    """With a window: no turn of the timer waits for the server."""
    desk.add_stick()
    assert bpy.ops.cairn.try_seeds(count=2) == {"FINISHED"}
    path = str(tmp_path / "tried.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    variants, job, entries = addon("variants"), addon("job"), bpy.context.scene.cairn_variants
    monkeypatch.setattr(variants.preview, "Preview", MagicMock())
    answers, watch = threading.Event(), job.client.watch

    async def later(*words, **named):
        while not answers.is_set():
            await job.asyncio.sleep(0.01)
        async for event in watch(*words, **named):
            yield event

    monkeypatch.setattr(job.client, "watch", later)

    def turn(until):
        for _ in range(3000):
            variants.fetch_on()
            if until():
                return True
            time.sleep(0.02)
        return False

    variants.fetch(bpy.context, entries[0])
    assert variants.is_fetched(entries[0])
    for _ in range(50):
        assert variants.fetch_on() is not None
    assert variants.is_at(entries[0]) and not variants.shown
    # Another one instead: the first is not waited for.
    variants.fetch(bpy.context, entries[1])
    assert not variants.is_fetched(entries[0])
    answers.set()
    assert turn(lambda: variants.shown == entries[1].bake_id) and not variants.is_here(entries[0])
    assert variants.fetch_on() is None
    # The panel reports the fault.
    entries[0].bake_id = "0" * 64
    variants.fetch(bpy.context, entries[0])
    assert turn(lambda: variants.fetch_on() is None)
    assert addon("running").problems and not variants.is_fetched(entries[0])
    variants.show("")


def test_missing_settings_are_reported(desk):
    with pytest.raises(RuntimeError, match="Choose the props"):
        bpy.ops.cairn.try_seeds()
    assert not bpy.context.scene.cairn_variants
