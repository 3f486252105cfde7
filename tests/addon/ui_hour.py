"""The rest of an artist's hour, in the same window: nothing happens by itself; a draft, seeds, glue, editing."""

import time

import bpy
from blocks import all_blocks
from hands import click, picture, press, view, wait, xdotool
from window import follow_changes, take_out

# How long nobody does anything, s.
IDLE = 8.0


def idle():
    """The tab is seen, with a hidden prop and a collider that moves."""
    hidden = bpy.data.objects["Stick"].copy()
    bpy.data.collections["Props"].objects.link(hidden)
    hidden.hide_viewport = True
    wall = bpy.data.objects.new("Wall", bpy.data.objects["Stick"].data)
    walls = bpy.data.collections.new("Walls")
    bpy.context.scene.collection.children.link(walls)
    walls.objects.link(wall)
    for frame, place in ((1, 3.0), (200, 4.0)):
        wall.location.x = place
        wall.keyframe_insert("location", frame=frame)
    bpy.context.scene.cairn.colliders = walls
    bpy.context.scene.frame_set(37)
    moved, before = [], all_blocks()

    def on_frame(*_):
        moved.append(1)

    bpy.app.handlers.frame_change_pre.append(on_frame)
    yield IDLE
    bpy.app.handlers.frame_change_pre.remove(on_frame)
    assert not moved and all_blocks() == before
    bpy.context.scene.cairn.colliders = None
    for unwanted in (hidden, wall):
        bpy.data.objects.remove(unwanted)
    bpy.data.collections.remove(walls)
    bpy.context.scene.frame_set(1)


def work(area):
    from cairn import running

    manager = bpy.context.window_manager
    settings = bpy.context.scene.cairn
    with view(area):
        bpy.ops.cairn.delete()
        bpy.ops.object.select_all(action="DESELECT")
    settings.accuracy, settings.output_mode = "DRAFT", "ANIMATION"
    bpy.context.scene.frame_set(1)

    # A draft while shaping.
    before = all_blocks()
    yield from follow_changes()
    yield 0.5
    picture("8-live.png")
    manager.cairn_live = False
    bpy.data.objects["Cone"].scale.z = 1.0
    assert all_blocks() == before
    yield from seeds(area)

    # What holds it.
    with view(area):
        bpy.ops.cairn.bake("INVOKE_DEFAULT")
    yield from wait(lambda: running.bake is None, "a pile of another seed")
    assert len([made for made in bpy.data.collections if made.cairn.is_result]) == 2
    yield from wait(lambda: not running.measuring, "the report")
    manager.cairn_glue = manager.cairn_loads = True
    yield 0.7
    picture("8-glue.png")
    manager.cairn_glue = manager.cairn_loads = False
    yield from editing(area)
    yield from inspecting(area)


def inspecting(area):
    """The mouse over what was analyzed."""
    from cairn import hover

    said, say = [], hover.said
    hover.said = lambda source: said.append(say(source)) or said[-1]
    with view(area):
        bpy.ops.object.select_all(action="DESELECT")
        bpy.ops.mesh.primitive_cube_add(size=2, location=(0, 0, 1))
        bpy.ops.cairn.analyze()
        bpy.ops.view3d.view_selected()
        bpy.ops.object.select_all(action="DESELECT")
        bpy.ops.cairn.inspect("INVOKE_DEFAULT")
    region = next(region for region in area.regions if region.type == "WINDOW")
    middle = region.x + region.width // 2, bpy.context.window_manager.windows[0].height - region.y - region.height // 2
    xdotool("mousemove", middle[0], middle[1] + 9)
    yield 0.3
    yield from click(*middle)
    yield from wait(lambda: any(text.startswith("“Cube” stands.") for text in said), "the words of the cube")
    yield from wait(lambda: bpy.context.view_layer.objects.active.name == "Cube", "the cube to be selected")
    picture("8-inspect.png")
    yield from press("Escape")
    yield 0.3
    hover.said = say
    with view(area):
        bpy.ops.cairn.clear_analysis()


def seeds(area):
    from cairn import running, variants

    with view(area):
        bpy.ops.cairn.try_seeds(count=4)
    yield from wait(lambda: not variants.is_trying(), "four seeds")
    entries = bpy.context.scene.cairn_variants
    assert len(entries) == 4 and all(variants.icon(entry.bake_id) for entry in entries)
    with view(area):
        bpy.ops.cairn.next_variant()
        bpy.ops.cairn.next_variant()
    assert variants.shown == entries[1].bake_id
    yield 0.7
    picture("8-variants.png")
    with view(area):
        bpy.ops.cairn.keep_variant("INVOKE_DEFAULT", variant=entries[1].name)
    yield from wait(lambda: running.bake is None, "the variant's pile")
    assert not variants.shown


def editing(area):
    from cairn import result, running, weighing

    yield from take_out(area, bpy.data.objects["Stick"].location, 20)
    cone = bpy.data.objects["Cone"]
    with view(area):
        bpy.ops.cairn.paint_region()
    group = cone.vertex_groups.active
    group.add([vertex.index for vertex in cone.data.vertices if vertex.co.x > 0], 1.0, "REPLACE")
    yield 0.7
    picture("8-painting.png")
    with view(area):
        bpy.ops.cairn.add_on_top("INVOKE_DEFAULT", count=20, region=group.name)
    assert bpy.context.mode == "OBJECT"
    yield from wait(lambda: running.bake is None, "more props")
    yield from wait(lambda: not running.measuring, "the report")
    # Undo may have put others in their places since.
    settled = running.report_of(result.chosen(bpy.context))["settled"]
    assert settled["added"] == 20 and settled["moved"] == 0 and settled["kept"] > 50, settled
    yield from wait(lambda: "standing" in running.report_of(result.chosen(bpy.context))["settled"], "the verdicts")
    report = running.report_of(result.chosen(bpy.context))
    assert weighing.said(report).startswith("The edit "), report["settled"]
    yield 0.5
    picture("8-edited.png")
    print(f"worked for {time.process_time():.0f} s of CPU time in all", flush=True)
