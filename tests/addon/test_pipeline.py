"""A pile among other work: props from libraries, collections that renders go by, and other programs' files."""

import bpy
import numpy as np
import pytest
from blocks import bodies_of
from conftest import count_blocks, cuboid

CLOSE = 1e-4


def collection(name, *objects, parent=None):
    made = bpy.data.collections.new(name)
    (parent or bpy.context.scene.collection).children.link(made)
    for one in objects:
        made.objects.link(one)
    return made


@pytest.fixture
def sorted_props(desk):
    """Two props, each in a collection that says what it is of, besides that which the props are chosen by."""
    stick, block = desk.add_stick(), desk.add_stick("Block", (0.2, 0.2, 0.2))
    bpy.context.scene.collection.objects.link(stick)
    return collection("Wood", stick), collection("Stone", block, parent=desk.props)


def test_bodies_are_in_their_props_collections_on_request(desk, addon, sorted_props):
    wood, stone = sorted_props
    before = count_blocks()["collections"]
    pile = desk.bake(output_mode="POSE")
    assert all(list(body.users_collection) == [pile] for body in bodies_of(pile))
    pile = desk.bake(use_prop_collections=True)
    assert count_blocks()["collections"] == before + 3
    for outer, prop in ((wood, "Stick"), (stone, "Block")):
        (inner,) = [child for child in outer.children if child.cairn.of_pile == pile]
        mine = {body for body in bodies_of(pile) if desk.recipe["props"][body.cairn.prop]["name"] == prop}
        assert set(inner.objects) == mine and mine
        # Nothing lies between the props.
        assert len(outer.objects) == 1
    assert {len(body.users_collection) for body in bodies_of(pile)} == {2}
    # They are no props, though they are below their collection.
    names = {source.name for source, _ in addon("request").props_of(desk.settings)}
    assert names == {"Stick", "Block"}
    count = len(bodies_of(pile))
    assert len(bodies_of(desk.bake(output_mode="POINTS"))) == 1 and count_blocks()["collections"] > before
    assert not [one for one in bpy.data.collections if one.cairn.of_pile]
    pile = desk.bake(output_mode="ANIMATION")
    assert len(bodies_of(pile)) == count
    assert bpy.ops.cairn.delete() == {"FINISHED"}
    assert count_blocks()["collections"] == before


def test_a_pile_is_hidden_in_its_props_collections_too(desk, addon, sorted_props):
    first = desk.bake(use_prop_collections=True, output_mode="POSE", seed=1)
    second = desk.bake(seed=2)

    def seen(pile):
        bpy.context.view_layer.update()
        return {body.visible_get() for body in bodies_of(pile)}

    assert seen(first) == {False} and seen(second) == {True}
    assert bpy.ops.cairn.show_pile(collection=first.name) == {"FINISHED"}
    assert seen(first) == {True} and seen(second) == {False}
    # So is what is worked on by hand.
    assert bpy.ops.cairn.edit_pile() == {"FINISHED"}
    edited = addon("result").chosen(bpy.context)
    assert seen(edited) == {True} and seen(first) == {False}
    body = next(body for body in bodies_of(edited) if body.cairn.prop == 0)
    for other in bpy.context.view_layer.objects:
        other.select_set(other == body)
    assert bpy.ops.cairn.replace_bodies(prop="1") == {"FINISHED"}
    assert {len(body.users_collection) for body in bodies_of(edited)} == {2}
    sizes = {one.name: len(one.objects) for one in bpy.data.collections if one.cairn.of_pile == edited}
    assert sum(sizes.values()) == len(bodies_of(edited)) and len(sizes) == 2


@pytest.fixture
def library(desk, tmp_path):
    """A file with assets: an object, and a collection of two, which has its origin elsewhere."""
    rod = cuboid("Rod", (0.3, 0.1, 0.1))
    seat, back = cuboid("Seat", (0.2, 0.2, 0.05)), cuboid("Back", (0.2, 0.05, 0.2), location=(0, 0.1, 0.1))
    chair = bpy.data.collections.new("Chair")
    for part in (seat, back):
        chair.objects.link(part)
        part.location = (3, 4, 0)
    chair.instance_offset = (3, 4, 0)
    for asset in (rod, chair):
        asset.asset_mark()
    path = str(tmp_path / "assets.blend")
    bpy.data.libraries.write(path, {rod, chair}, fake_user=True)
    for part in (rod, seat, back):
        bpy.data.objects.remove(part)
    bpy.data.collections.remove(chair)
    return path


def take(path, link):
    """Both assets, as the asset browser brings them in: appended, or linked from the library."""
    with bpy.data.libraries.load(path, link=link) as (_, wanted):
        wanted.objects, wanted.collections = ["Rod"], ["Chair"]
    (rod,), (chair,) = wanted.objects, wanted.collections
    assert bool(chair.library) == bool(rod.library) == link
    instance = bpy.data.objects.new("Chair", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", chair
    return rod, instance


@pytest.mark.parametrize("mode", ["POSE", "ANIMATION", "POINTS"])
@pytest.mark.parametrize("link", [False, True])
def test_assets_are_props(desk, addon, library, link, mode):
    from conftest import gap, shown_vertices

    rod, instance = take(library, link)
    for prop in (rod, instance):
        desk.props.objects.link(prop)
    instance.location = (5, 0, 0)
    pile = desk.bake(output_mode=mode)
    assert [prop["name"] for prop in desk.recipe["props"]] == ["Rod", "Chair"]
    bpy.context.scene.frame_set(10**5)
    last = desk.expected(len(desk.motion.positions) - 1)
    sent = [desk.sent_vertices(number) for number in range(2)]
    # The instance's own place and its collection's do not matter.
    assert np.abs(sent[1]).max() < 0.3 and len(sent[1]) == 16
    owners = {body.name for body in bodies_of(pile)}
    shown = [points for (name, _), points in shown_vertices().items() if name in owners and len(points)]
    expected = [sent[prop] @ matrix[:3, :3].T + matrix[:3, 3] for prop, matrix in zip(desk.motion.props, last)]
    assert {0, 1} <= set(desk.motion.props.tolist())
    assert gap(np.concatenate(shown), np.concatenate(expected)) < CLOSE
    # Edited, too.
    if mode != "POINTS":
        assert bpy.ops.cairn.edit_pile() == {"FINISHED"}
        assert bpy.ops.cairn.add_on_top(count=3) == {"FINISHED"}
    assert bpy.ops.cairn.delete() == {"FINISHED"}
    assert rod.name in desk.props.objects and instance.instance_collection


@pytest.mark.parametrize("link", [False, True])
def test_assets_can_be_chosen_one_by_one(desk, addon, library, link, tmp_path):
    """A file that was closed has them still, and another prop of the same name does no harm."""
    rod, instance = take(library, link)
    cuboid("Chair.001", (9, 9, 9))
    for prop in (rod, instance):
        bpy.context.scene.collection.objects.link(prop)
    bpy.context.view_layer.update()
    for prop in bpy.context.view_layer.objects:
        prop.select_set(prop in (rod, instance))
    assert bpy.ops.cairn.add_props() == {"FINISHED"}
    assert {item.object for item in desk.settings.props} == {rod, instance}
    pile = desk.bake(output_mode="POSE", use_prop_collections=True)
    count = len(bodies_of(pile))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "pile.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "pile.blend"))
    settings = bpy.context.scene.cairn
    settings.props.clear()
    assert bpy.ops.cairn.restore_settings() == {"FINISHED"}
    assert {item.object.name for item in settings.props} == {"Rod", "Chair"}
    assert {bool(item.object.library) for item in settings.props} == ({True, False} if link else {False})
    assert bpy.ops.cairn.bake() == {"FINISHED"}
    assert len(bodies_of(bpy.data.collections["Heap Pile"])) == count


def poses(objects, frames):
    """World matrices of bodies at frames, by frame and name."""
    found = {}
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        graph = bpy.context.evaluated_depsgraph_get()
        for body in objects:
            found[frame, body.name] = np.array(body.evaluated_get(graph).matrix_world)
    return found


@pytest.mark.parametrize("form", ["usd", "alembic"])
def test_other_programs_get_the_motion(desk, form, tmp_path):
    """As the README's recipe says: the pile's objects selected, the scene's range that of the pile."""
    if not getattr(bpy.app.build_options, form):
        pytest.skip(f"this Blender has no {form}")
    stick = desk.add_stick()
    stick["asset"] = "stick_a"
    pile = desk.bake(output_mode="ANIMATION", start_frame=1)
    scene, last = bpy.context.scene, len(desk.motion.positions)
    scene.frame_start, scene.frame_end = 1, last
    frames = (1 + last // 2, last)
    before = poses(bodies_of(pile), frames)
    moved = [name for frame, name in before if not np.allclose(before[frames[0], name], before[last, name])]
    assert moved
    for other in bpy.context.view_layer.objects:
        other.select_set(other.name in pile.objects)
    path = str(tmp_path / ("pile.usdc" if form == "usd" else "pile.abc"))
    if form == "usd":
        assert bpy.ops.wm.usd_export(filepath=path, selected_objects_only=True, export_animation=True) == {"FINISHED"}
    else:
        wanted = {"selected": True, "start": 1, "end": last, "as_background_job": False}
        assert bpy.ops.wm.alembic_export(filepath=path, **wanted) == {"FINISHED"}
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if form == "usd":
        assert bpy.ops.wm.usd_import(filepath=path) == {"FINISHED"}
    else:
        assert bpy.ops.wm.alembic_import(filepath=path, as_background_job=False) == {"FINISHED"}
    meshes = [body for body in bpy.data.objects if body.type == "MESH"]
    after, names = poses(meshes, frames), {name for _, name in before}
    # Readers rename the bodies: the test identifies them by their last positions.
    for body in meshes:
        was = min(names, key=lambda name: np.abs(before[last, name] - after[last, body.name]).max())
        names.remove(was)
        for frame in frames:
            off = np.abs(after[frame, body.name] - before[frame, was])
            # Rotations go as Euler angles in single precision, which lose half their digits near gimbal lock.
            assert off[:3, 3].max() < CLOSE and off.max() < 10 * CLOSE, (frame, was)
        if form == "usd":
            assert body["asset"] == "stick_a"
    assert not names


def test_a_pile_of_which_only_the_surface_is_made_of_props(desk, addon):
    desk.add_stick("Twig", (0.22, 0.1, 0.09))
    full = len(bodies_of(desk.bake(kept_shape="NATURAL")))
    assert not desk.request.spec.scene.fill.HasField("shell")
    desk.settings.fill.use_shell, desk.settings.fill.shell = True, 0.6
    shell = desk.bake()
    assert abs(desk.request.spec.scene.fill.shell - 0.6) < 1e-6
    assert len(bodies_of(shell)) < 0.9 * full
    # Well inside the core: half of the heap's width less 0.14 m and a prop's reach.
    middle = [body.name for body in bodies_of(shell) if body.location.xy.length < 0.15 and body.location.z < 0.25]
    assert not middle, "nothing lies in the core"
    # When a pile is edited, the core is still there.
    assert bpy.ops.cairn.edit_pile() == {"FINISHED"}
    edited = addon("result").chosen(bpy.context)
    lowest = sorted(bodies_of(edited), key=lambda body: body.location.z)[:3]
    for body in bpy.context.view_layer.objects:
        body.select_set(body in lowest)
    assert bpy.ops.cairn.remove_bodies() == {"FINISHED"}
    taken, *_ = finish(addon("edit").settling(bpy.context, edited))
    scene = taken.spec.scene
    assert scene.control_mesh.path and abs(scene.fill.shell - 0.6) < 1e-6
    assert bpy.ops.cairn.settle() == {"FINISHED"}
    assert addon("wording").said("fill.shell: 0.1 is").startswith("“Only Near the Surface” in the panel Advanced, Fill")


def finish(generator):
    """What a generator gives in the end."""
    while True:
        try:
            next(generator)
        except StopIteration as end:
            return end.value
