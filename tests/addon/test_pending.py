"""A bake that was asked for is not lost: it is noted, and fetched when its file is opened again."""

import time

import bpy
from blocks import bodies_of
from test_faults import PATIENCE, start


def test_a_bake_is_noted_when_it_is_asked_for(desk, addon, tmp_path, monkeypatch):
    desk.add_stick()
    path = str(tmp_path / "pile.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    pending, running, job = addon("pending"), addon("running"), addon("job")

    async def never(*_):
        await job.asyncio.sleep(PATIENCE)
        yield

    monkeypatch.setattr(job.client, "bake", never)
    bake = start(desk, addon, accuracy="DRAFT", seed=78)
    assert pending.of_this_file()["bake_id"] == "" and pending.of_this_file()["recipe"] == bake.recipe
    folder = pending.request_folder(bake.recipe)
    end = time.monotonic() + PATIENCE
    while not folder.exists():
        assert time.monotonic() < end
        time.sleep(0.01)
    monkeypatch.undo()
    # Blender closes, and the shape is another one when the file is opened again: what was asked for counts.
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert running.left is not None and running.left["bake_id"] == ""
    bpy.data.objects["Heap"].scale = (0.1, 0.1, 0.1)
    assert bpy.ops.cairn.fetch() == {"FINISHED"}
    assert len(bodies_of(bpy.data.collections["Heap Pile"])) > 20
    assert pending.of_this_file() is None and not folder.exists()


def test_fetching_draws_the_props(desk, addon, tmp_path):
    desk.add_stick()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "pile.blend"))
    taken = addon("request").take(bpy.context)
    props = addon("request").finish(addon("operators").seen_props(bpy.context, taken.recipe))
    assert [len(prop.outlines[0].triangles) for prop in props] == [12]


def test_a_file_that_gets_its_name_while_connecting_is_fetched(desk, addon, tmp_path, monkeypatch):
    desk.add_stick()
    assert not bpy.data.filepath
    path, pending, job = str(tmp_path / "late.blend"), addon("pending"), addon("job")

    async def never(*_):
        await job.asyncio.sleep(PATIENCE)
        yield

    monkeypatch.setattr(job.client, "bake", never)
    bake = start(desk, addon, accuracy="DRAFT", seed=79)
    folder, end = pending.request_folder(bake.recipe), time.monotonic() + PATIENCE
    while not folder.exists():
        assert time.monotonic() < end
        time.sleep(0.01)
    bpy.ops.wm.save_as_mainfile(filepath=path)
    monkeypatch.undo()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert addon("running").left["bake_id"] == "" and bpy.ops.cairn.fetch() == {"FINISHED"}
    assert len(bodies_of(bpy.data.collections["Heap Pile"])) > 20
    assert pending.of_this_file() is None and not folder.exists()


def test_two_blenders_with_one_file_keep_their_notes(desk, addon, tmp_path):
    desk.add_stick()
    pending, request, running = addon("pending"), addon("request"), addon("running")
    first, second = (request.take(bpy.context).recipe for _ in range(2))
    path = str(tmp_path / "shared.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    pending.note(first, "1")
    pending.note(second, "2")
    # The server has taken the first one's, later.
    pending.note(first, "one")
    assert pending.of_this_file()["bake_id"] == "one"
    assert pending.of_this_file(besides=first["token"])["bake_id"] == "2"
    pending.forget(first)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert running.left["bake_id"] == "2"
    pending.note(first, "one")
    assert bpy.ops.cairn.forget() == {"FINISHED"} and running.left["bake_id"] == "2"
    # Whatever the file is called when its bake ends.
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "other.blend"))
    assert pending.of_this_file() is None
    pending.forget(second)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert running.left is None


def test_no_more_is_kept_than_somebody_may_come_back_to(desk, addon, tmp_path, monkeypatch):
    desk.add_stick()
    pending, request = addon("pending"), addon("request")
    monkeypatch.setattr(pending, "MOST", 2)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "many.blend"))
    recipes = [request.take(bpy.context).recipe for _ in range(5)]
    for recipe in recipes:
        pending.request_folder(recipe).mkdir(parents=True)
        pending.note(recipe, "")
    pending.note(recipes[-1], "last")
    there = [pending.request_folder(recipe).exists() for recipe in recipes]
    assert not any(there[:3]) and all(there[3:])
    for _ in recipes[3:]:
        pending.give_up()
    assert pending.of_this_file() is None and not any(pending.request_folder(recipe).exists() for recipe in recipes)


def test_two_blenders_keep_their_notes(desk, addon, tmp_path):
    """Each writes a file of its own, and removes none but its own."""
    desk.add_stick()
    pending, request = addon("pending"), addon("request")
    first, second = (request.take(bpy.context).recipe for _ in range(2))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "one.blend"))
    pending.note(first, "1")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "two.blend"))
    assert pending.of_this_file() is None
    pending.note(second, "2")
    assert pending.of_this_file()["bake_id"] == "2"
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "one.blend"))
    pending.forget(second)
    assert pending.of_this_file()["bake_id"] == "1"
    pending.give_up()
    assert pending.of_this_file() is None
