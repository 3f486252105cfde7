"""What the add-on says where something is not as it was, or not possible: once, and in an artist's words."""

import errno

import bpy
import pytest
from conftest import mesh_object
from test_faults import refusal


def opened(props, count):
    """Boxes without lids, as games have them."""
    for number in range(count):
        end = 0.1 + 0.01 * number
        corners = [(x, y, z) for x in (-end, end) for y in (-end, end) for z in (-end, end)]
        faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6)]
        mesh_object(f"Open {number}", corners, faces, props)


def test_open_props_are_one_line(desk, addon):
    opened(desk.props, 5)
    pile = desk.bake(output_mode="POSE")
    said = addon("running").report_of(pile)["warnings"]
    assert sum("is open" in text for text in said) == 5, "a sentence of each"
    (line,) = [text for text, _ in addon("wording").gathered(said, desk.recipe["names"]) if "is open" in text]
    assert line.startswith("“Open 0”, “Open 1”, “Open 2” and 2 more: The mesh is open")


def test_a_full_disk_names_its_folder(desk, addon, monkeypatch):
    desk.add_stick()
    folder = str(addon("preferences").folder())

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    def told_by_server(*_):
        raise addon("client").Fault(f"the server has no space left: {addon('plainly').SERVER_FULL}; make room")

    for owner, name, act in (
        (addon("job").Job, "_keep_request", full),
        (addon("pending"), "note", full),
        (addon("job").Job, "_keep_request", told_by_server),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, act)
            said = refusal()
        assert "The disk is full" in said and folder in said and "add-on has a fault" not in said, said
    assert bpy.ops.cairn.bake() == {"FINISHED"}


def test_what_has_changed_since_the_bake_is_noted(desk, addon):
    desk.add_stick()
    pile, scene = desk.bake(), bpy.context.scene
    changed = addon("report_panels").changed_since
    assert not changed(scene, pile)
    desk.control.location.x += 0.2
    bpy.context.view_layer.update()
    assert changed(scene, pile) == ["“Heap” was moved since this bake. Bake again to follow it."]
    # The pile is moved along.
    addon("roots").of(pile).location.x += 0.2
    bpy.context.view_layer.update()
    assert not changed(scene, pile)
    scene.render.fps *= 2
    (line,) = changed(scene, pile)
    assert "Baked for 24 frames per second, and the scene has 48" in line and "Speed in the panel Timing to 0.5" in line
    pile.cairn.timing_speed = 0.5
    assert not changed(scene, pile)


@pytest.mark.parametrize("name", ["pile.abc", "pile.glb", "there/is/no/folder/pile.usdc"])
def test_a_file_name_that_does_not_do_is_no_fault_of_the_addon(desk, addon, name, tmp_path):
    if "USD" not in addon("outgoing").forms():
        pytest.skip("this Blender writes no USD")
    desk.add_stick()
    desk.bake(output_mode="POSE")
    path = tmp_path / name
    if path.parent != tmp_path:
        # A file is where a folder would have to be.
        (tmp_path / "there").write_text("")
    said = refusal(lambda: bpy.ops.cairn.export_pile(form="USD", filepath=str(path)))
    assert "add-on has a fault" not in said and str(path) in said, said
    if path.parent == tmp_path:
        assert str(tmp_path / "pile.usdc") in said and "Choose the format" in said
    assert not path.exists()
