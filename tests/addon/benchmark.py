"""What the add-on takes, beside Blender's own rigid bodies. Run by Blender with the add-on unpacked in target/addon:

    blender --background --factory-startup --python tests/addon/benchmark.py              writing of results
    blender --background --factory-startup --python tests/addon/benchmark.py -- writing 5000 200     of that size
    blender --background --factory-startup --python tests/addon/benchmark.py -- bake      609 sticks, both ways
    blender --background --factory-startup --python tests/addon/benchmark.py -- bake ours     the first of them alone
    blender --background --factory-startup --python tests/addon/benchmark.py -- bake --result FILE     as JSON, too
    blender --background --factory-startup --python tests/addon/benchmark.py -- live      a draft of 150 sticks
    blender --background --factory-startup --python tests/addon/benchmark.py -- turns     what keeps Blender busy
    blender --factory-startup --python tests/addon/benchmark.py -- window                 the bake, in a window
    blender --factory-startup --python tests/addon/benchmark.py -- window warm            with the server running

A Python with bpy does for all but the last. CPU seconds of processes and their children; wall seconds where stated.
"""

import gc
import json
import os
import resource
import statistics
import sys
import time
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / folder) for folder in ("target/addon", "tests/studies/peers", "tests/addon")]

from blocks import bodies_of

STICK = (1.0, 0.1, 0.1)
FRAMES = 250


def cpu():
    own, children = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def enable():
    import addon_utils

    addon_utils.enable("cairn", default_set=True)
    bpy.context.preferences.addons["cairn"].preferences.program = str(ROOT / "target" / "release" / "cairn")


def empty():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def scene():
    """Sticks, as examples/sticks.toml has them, in a mesh that takes about 609."""
    bpy.ops.mesh.primitive_cone_add(vertices=48, radius1=1.8, depth=5.2, location=(0, 0, 2.6))
    cone = bpy.context.object
    cone.name = "Cone"
    bpy.ops.mesh.primitive_cube_add(size=1, location=(6, 0, 0))
    stick = bpy.context.object
    stick.name = "Stick"
    stick.dimensions = STICK
    bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)
    props = bpy.data.collections.new("Props")
    bpy.context.scene.collection.children.link(props)
    props.objects.link(stick)
    settings = bpy.context.scene.cairn
    settings.control_mesh, settings.prop_collection = cone, props
    settings.fill.use_count, settings.fill.count = True, 609
    settings.use_frame_count, settings.frame_count = True, FRAMES
    return settings


def motion(bodies, frames):
    """One in which every body moves in every frame: the most that there can be to write."""
    from cairn.recording import Motion

    random = np.random.default_rng(1)
    rotations = random.normal(size=(frames, bodies, 4)).astype(np.float32)
    rotations /= np.linalg.norm(rotations, axis=2, keepdims=True)
    return Motion(
        np.zeros(bodies, np.int32),
        np.ones(bodies, np.float32),
        random.normal(size=(frames, bodies, 3)).astype(np.float32),
        rotations,
        np.ones((frames, bodies), bool),
        np.sort(random.integers(1, 5, (frames, bodies), np.uint8), axis=0),
    )


def writing():
    asked = [int(number) for number in sys.argv[sys.argv.index("--") + 2 :]] if "--" in sys.argv else []
    sizes = [("ANIMATION", 1000, FRAMES), ("POINTS", 10000, FRAMES)]
    if asked:
        bodies, frames = asked
        sizes = [("AUTO", bodies, frames)]
    for mode, bodies, frames in sizes:
        times = []
        for _ in range(3):
            empty()
            scene()
            from cairn import request, result

            identity = [[float(i == j) for j in range(4)] for i in range(4)]
            recipe = {
                "scene": bpy.context.scene.name,
                "control": "Cone",
                "props": [{"name": "Stick", "local": identity}],
                "metres": 1.0,
                "start_frame": 1,
                "output_mode": mode,
            }
            made_up = motion(bodies, frames)
            began, worked = time.perf_counter(), cpu()
            request.finish(result.build(bpy.context, made_up, recipe, {}))
            times.append((time.perf_counter() - began, cpu() - worked))
        wall, work = (statistics.median(column) for column in zip(*times))
        print(f"{mode}: {bodies} bodies x {frames} frames, {wall:.2f} s wall, {work:.2f} s CPU", flush=True)


def bake():
    """Each way on its own: the server's bakes are children, so that their time counts."""
    empty()
    scene()
    from cairn import preferences

    began, wall = cpu(), time.perf_counter()
    bpy.ops.cairn.bake()
    wall = time.perf_counter() - wall
    collection = bpy.data.collections["Cone Pile"]
    from cairn import running

    report = running.report_of(collection)
    here = cpu() - began
    ours = here + report["cpu_seconds"]
    preferences.stop_server()
    measured = report["stage_seconds"]["measure"]
    print(f"Cairn: {len(bodies_of(collection))} bodies, {report['frame_count']} frames")
    print(
        f"{ours:.1f} s CPU, {wall:.1f} s wall; of the CPU time {here:.1f} s in Blender, {measured:.1f} s for the report"
    )
    bodies = list(bodies_of(collection))
    bpy.context.scene.frame_set(1)
    poses = [body.matrix_world.copy() for body in bodies]
    for body, pose in zip(bodies, poses):
        body.animation_data_clear()
        body.matrix_world = pose
    print("of the server's: " + ", ".join(f"{stage} {spent:.1f} s" for stage, spent in report["stage_seconds"].items()))
    if "ours" in sys.argv:
        return
    theirs, seconds = rigid_bodies(bodies)
    print(f"Blender's rigid bodies: {len(bodies)} bodies, {FRAMES} frames, {theirs:.1f} s CPU, {seconds:.1f} s wall")
    print(f"{theirs / (ours - measured):.1f} times less CPU time to the keyframes, {theirs / ours:.1f} with the report")
    if "--result" in sys.argv:
        figures = {"ours": ours, "ours_without_report": ours - measured, "blender": theirs}
        figures |= {"version": bpy.app.version_string, "bodies": len(bodies), "frames": FRAMES}
        Path(sys.argv[sys.argv.index("--result") + 1]).write_text(json.dumps(figures))


def rigid_bodies(bodies):
    """The same bodies fall from where they stand, baked to keyframes. CPU and wall seconds."""
    import blender_bodies

    blender_bodies.begin(FRAMES)
    bpy.ops.mesh.primitive_plane_add(size=40)
    blender_bodies.add([bpy.context.object], "PASSIVE")
    blender_bodies.add(bodies, "ACTIVE")
    wall = time.perf_counter()
    return blender_bodies.bake(bodies, FRAMES, cpu)[1], time.perf_counter() - wall


def live():
    """A draft of 150 sticks to its final pose, as Live asks for it."""
    empty()
    settings = scene()
    settings.accuracy, settings.fill.count = "DRAFT", 150
    from cairn import job, preferences, preview, request
    from cairn.messages import v1

    began = cpu()
    taken = request.take(bpy.context, passive=True)
    drawn = request.finish(preview.drawn(taken.props))
    request.leave_figures(v1, taken.spec.scene)
    taken.spec.scene.effects.frames = v1.SWITCH_OFF
    asked = job.Job(preferences.server(bpy.context), taken.spec, taken.contents, taken.problems, has_fill=False)
    summary = wait_for(asked)
    shown = preview.Preview(drawn, taken.recipe["metres"], is_shown=False)
    shown.update(asked.latest)
    here = cpu() - began
    preferences.stop_server()
    print(f"{summary.body_count} bodies, {here + summary.cpu_seconds:.2f} s CPU, of that {here:.2f} s in Blender")


def wait_for(asked):
    """What a job gives in the end."""
    asked.start()
    while True:
        kind, what = asked.messages.get()
        assert kind != "failed", what
        if kind == "done":
            return what


def turns():
    """The main thread's CPU time in one go, for a pile of 600 bodies: what is done in slices by its longest step,
    buttons by what the add-on does when they are pressed. What Blender does besides, to redraw the scene,
    is not in it."""
    empty()
    settings = scene()
    settings.accuracy = "DRAFT"
    # A prop of many triangles beside the stick, as artists have them.
    bpy.ops.mesh.primitive_uv_sphere_add(segments=300, ring_count=150, radius=0.1, location=(8, 0, 0))
    settings.prop_collection.objects.link(bpy.context.object)
    from cairn import edit, edit_operators, fingerprint, job, pile_operators, preview, request, result, states, timing

    longest_of = {}

    def whole(name, do):
        began = time.thread_time()
        value = do()
        longest_of[name] = max(longest_of.get(name, 0.0), time.thread_time() - began)
        return value

    def pressed(name, operator, press):
        execute = operator.execute
        operator.execute = lambda self, context: whole(name, lambda: execute(self, context))
        assert press() == {"FINISHED"}
        operator.execute = execute

    def sliced(name, generator):
        # As while a bake runs in a window.
        gc.freeze()
        try:
            while True:
                whole(name, lambda: next(generator))
        except StopIteration as end:
            return end.value
        finally:
            gc.unfreeze()

    taken = sliced("the scene is read for a bake", request.taking(bpy.context))
    drawn = sliced("the preview's props are made", preview.drawn(taken.props))
    sliced("the scene is read in passing", request.taking(bpy.context, passive=True))
    whole("whether the scene has changed", lambda: fingerprint.of(bpy.context.scene))
    bpy.ops.cairn.bake()
    pile = result.chosen(bpy.context)
    from cairn import preferences

    bodies = len(bodies_of(pile))
    again = job.Job(preferences.server(bpy.context), taken.spec, taken.contents, taken.problems)
    wait_for(again)
    moved = again.recording.motion()
    sliced("the pile is made", result.build(bpy.context, moved, taken.recipe, {}))
    pile = result.chosen(bpy.context)
    pile.cairn.report = json.dumps({"measures": {"prop_diameter": 1.0}, "body_count": bodies})
    shown = preview.Preview(drawn, taken.recipe["metres"], is_shown=False)
    whole("a frame of the preview", lambda: shown.update(again.latest))
    whole("Color by State", lambda: states.show(True))
    bpy.context.scene.frame_current = 40
    whole("a frame with colors", lambda: states.refresh(bpy.context.scene))
    whole("colors off", lambda: states.show(False))
    bpy.context.scene.frame_set(timing.end_of(pile))
    pressed("Edit Pile", edit_operators.CAIRN_OT_edit_pile, bpy.ops.cairn.edit_pile)
    bpy.ops.cairn.delete()
    bpy.context.scene.frame_set(1)
    pressed("Edit Pile, in another frame than the last", edit_operators.CAIRN_OT_edit_pile, bpy.ops.cairn.edit_pile)
    edited = result.chosen(bpy.context)
    select = sorted(bodies_of(edited), key=lambda body: body.location.z)
    for other in bpy.context.view_layer.objects:
        other.select_set(False)
    for body in select[-60:]:
        body.select_set(True)
    pressed("Replace 60", edit_operators.CAIRN_OT_replace_bodies, lambda: bpy.ops.cairn.replace_bodies(prop="0"))
    for body in select[:200]:
        body.select_set(True)
    pressed("Remove 200", edit_operators.CAIRN_OT_remove_bodies, bpy.ops.cairn.remove_bodies)
    changed, objects, free = sliced("what was disturbed is found", edit.settling(bpy.context, edited))
    again = job.Job(preferences.server(bpy.context), changed.spec, changed.contents, changed.problems)
    wait_for(again)
    moved = again.recording.motion()
    sliced("what has settled is taken", edit.applied(bpy.context, edited, objects, free, moved, changed.recipe, {}))
    pressed("Delete", pile_operators.CAIRN_OT_delete, bpy.ops.cairn.delete)
    # The most that there is to remove.
    keyed = motion(1000, FRAMES)
    recipe = {**taken.recipe, "props": taken.recipe["props"][:1], "output_mode": "ANIMATION"}
    request.finish(result.build(bpy.context, keyed, dict(recipe), {}))
    bpy.context.view_layer.update()
    sliced("a pile of 1,000 bodies with a key in each frame is replaced", result.build(bpy.context, keyed, recipe, {}))
    preferences.stop_server()
    print(f"{bodies} bodies")
    for name, seconds in sorted(longest_of.items(), key=lambda row: -row[1]):
        print(f"{seconds * 1000:6.0f} ms  {name}")


def window():
    """The button, pressed in a window: how long each of the operator's turns takes."""
    settings = scene()
    settings.control_mesh.select_set(False)
    from cairn import following, operators, running

    turns, pressed, seen = [], 0.0, None
    modal, invoke = following.Follows.modal, following.Follows.invoke

    def timed(function):
        def turn(self, context, event):
            began, worked = time.perf_counter(), time.thread_time()
            answer = function(self, context, event)
            stage = running.bake.stage() if running.bake else "end"
            turns.append((time.perf_counter() - began, time.thread_time() - worked, stage))
            return answer

        return turn

    operators.CAIRN_OT_bake.modal, operators.CAIRN_OT_bake.invoke = timed(modal), timed(invoke)

    def press():
        nonlocal pressed
        pressed = time.perf_counter()
        screen = bpy.context.window_manager.windows[0]
        area = next(area for area in screen.screen.areas if area.type == "VIEW_3D")
        region = next(region for region in area.regions if region.type == "WINDOW")
        with bpy.context.temp_override(window=screen, area=area, region=region):
            bpy.ops.cairn.bake("INVOKE_DEFAULT")
        bpy.app.timers.register(look, first_interval=0.01)

    def look():
        nonlocal seen
        latest = running.bake.job.latest if running.bake else None
        if seen is None and latest is not None and latest.present.any():
            seen = time.perf_counter() - pressed
        if running.bake is not None:
            return 0.5 if seen else 0.01
        longest = sorted(turns, reverse=True)[:5]
        parts = (f"{wall * 1000:.0f} ms, of that {work * 1000:.0f} at work ({stage})" for wall, work, stage in longest)
        print(f"the first body after {seen:.2f} s; {len(turns)} turns; the longest: " + "; ".join(parts))
        sys.stdout.flush()
        from cairn import preferences

        preferences.stop_server()
        os._exit(0)

    if "warm" in sys.argv:
        # As where the tab was seen before: it has asked for estimates.
        bpy.ops.cairn.check()
    bpy.app.timers.register(press, first_interval=2.0)


chosen = sys.argv[sys.argv.index("--") + 1] if "--" in sys.argv else "writing"
print(f"Blender {bpy.app.version_string}", flush=True)
enable()
{"writing": writing, "bake": bake, "live": live, "turns": turns, "window": window}[chosen]()
