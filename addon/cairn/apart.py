"""Pull Out: an object leaves those around it, and they move if they must. Make It Stand: glue, or small moves."""

import json
import tempfile
from pathlib import Path

import bpy
import numpy as np
from bpy.props import EnumProperty
from bpy.types import Operator
from mathutils import Matrix, Quaternion, Vector

from . import analysis, axes, export, keyframes
from .client import Fault
from .following import explaining, is_running
from .placed import is_animated

# Objects that are made: one for each dot of glue.
DOTS = "Needed Glue"
# Their radius, relative to the extent of all that was analyzed: a view that shows all of it shows them.
DOT_SIZE = 0.02
# An object that moves less than this share of its size is not keyed.
STILL = 0.005
# An object that ends farther away than this share of its size is named, also one that turns by as many radians.
FAR = 0.1


def scene(context, sources, written, falling):
    """The request: all objects as bodies placed by hand. One is taken away once they rest; or some fall, and the others
    stay. `falling`: the index of the one, or the indices of some."""
    settings = context.scene.cairn
    friction = round(settings.collider_friction, 6)
    props, bodies = [], []
    for number, (position, rotation) in enumerate(written.poses):
        props.append({"path": f"{analysis.NAME}#body {number}", "weight": 0, "friction": friction})
        bodies.append({"prop": str(number), "position": position, "rotation": rotation})
        if not isinstance(falling, int):
            bodies[-1]["kept"] = number not in falling
    asked = {
        "props": props,
        "bodies": bodies,
        "statics": [
            {"path": f"{analysis.NAME}#scenery {number}", "friction": friction} for number in range(written.scenery)
        ],
        "control": "off",
        "ground": settings.use_ground,
        "ground_friction": friction,
        "remove": [{"number": falling}] if isinstance(falling, int) else [],
        "output": {"fps": context.scene.render.fps / context.scene.render.fps_base},
    }
    if settings.use_ground and settings.use_ground_height:
        asked["ground_height"] = settings.ground_height * export.metres(context.scene)
    return asked


def bake(context, sources, falling):
    """The table of poses [frame, body, 7] in the server's axes, the report, and the frames in Blender."""
    scenery = analysis.scenery_of(context, sources)
    written = analysis.write(context, sources, scenery, posed=False)
    with tempfile.TemporaryDirectory(prefix="cairn-") as folder:
        folder = Path(folder)
        (folder / analysis.NAME).write_bytes(written.content)
        (folder / "scene.json").write_text(json.dumps(scene(context, sources, written, falling)), encoding="utf-8")
        analysis.run(context, folder, ["bake", "scene.json", "-o", "motion.json", "--report", "report.json", "--quiet"])
        motion = json.loads((folder / "motion.json").read_text(encoding="utf-8"))
        report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    return np.array(motion["frames"], float), report, written.frames


def play(context, sources, poses, frames):
    """Keys the objects that move, from the current frame on."""
    first, metres = context.scene.frame_current, export.metres(context.scene)
    positions = axes.points_to_blender(poses[..., :3], metres)
    rotations = keyframes.continuous(axes.rotations_to_blender(poses[..., 3:]))
    keyed = keyframes.needed(positions, rotations)
    for number, source in enumerate(sources):
        at = np.flatnonzero(keyed[:, number])
        # What is left of the object's matrix without its frame: its scale.
        rest = frames[number].inverted() @ source.matrix_world
        corners = np.array([rest @ Vector(corner) for corner in source.bound_box])
        turned = axes.matrices(positions[:, number], rotations[:, number], np.ones(len(poses)))
        places = np.einsum("fij,cj->fci", turned[:, :, :3], corners) + turned[:, None, :, 3]
        # What only settles into its contacts stays as it is.
        if len(at) < 2 or np.linalg.norm(places - places[0], axis=2).max() < STILL * max(source.dimensions):
            continue
        own = source.parent.matrix_world @ source.matrix_parent_inverse if source.parent else Matrix()
        locations, turns = [], []
        for frame in at:
            world = Matrix.Translation(Vector(positions[frame, number]))
            world = world @ Quaternion(rotations[frame, number]).to_matrix().to_4x4() @ rest
            location, turn, _ = (own.inverted() @ world).decompose()
            locations.append(tuple(location))
            turns.append(tuple(turn))
        turns = keyframes.continuous(np.array(turns)[:, None])[:, 0]
        keyframes.write(source, f"{source.name} pulled", at + first, np.array(locations), turns, None)
    context.scene.frame_end = max(context.scene.frame_end, first + len(poses) - 1)


def far(sources, poses):
    """Names of the objects that end far from where they were: by a tenth of their size, or turned by as much."""
    sizes = np.array([max(source.dimensions) for source in sources])
    ways = np.linalg.norm(poses[-1, :, :3] - poses[0, :, :3], axis=1) / export.metres(bpy.context.scene)
    turns = 1 - np.abs((poses[-1, :, 3:] * poses[0, :, 3:]).sum(axis=1))
    return [sources[number].name for number in np.flatnonzero((ways > FAR * sizes) | (turns > FAR**2 / 8))]


def said(sources, report, gone_far=()):
    """What happened, beside what the analysis says of the same object. `gone_far`: names of what ends elsewhere."""
    removed = report["removals"][0]
    source, names = sources[removed["body"]], [other.name for other in sources]
    forecast = analysis.figures(source)["removal"] or {}
    expected = [*forecast.get("moving", ()), *forecast.get("on_these", ())]
    fell = [names[number] for number in removed["came_down"] if sources[number] != source]
    loose = [one.name for one in sources if analysis.figures(one)["standing"].startswith("falls")]
    moved = [names[number] for number, _ in removed["moved"] if names[number] not in [*fell, *loose, source.name]]
    # Before it was pulled out, they came to rest.
    others = [name for name in gone_far if name not in [*fell, *loose, *moved, source.name]]
    other = "came down besides, hit or pulled along" if expected else "came down"
    parts = []
    for which, words in (
        ([name for name in fell if name in expected], "came down, as the analysis says"),
        ([name for name in fell if name not in expected + loose], other),
        ([name for name in loose if name not in [*expected, source.name]], "came down, as without Pull Out"),
        ([name for name in expected if name in moved], "began to fall and found a hold"),
        ([name for name in moved if name not in expected], "moved a little"),
        (others, "moved before, as what falls by itself came down"),
        ([name for name in expected if name not in fell + moved], "stayed, although no forces were found that hold it"),
    ):
        parts += [f"{analysis.listed(which)} {words}"] if which else []
    if forecast.get("is_safe"):
        parts.append("the analysis says that all could stand" if fell else "the others stand, as the analysis says")
    return f"“{source.name}” is out: {'; '.join(parts) or 'nothing else moved'}"


class CAIRN_OT_pull_out(Operator):
    """Take the active object away from the analyzed ones, and let them fall if they must: keys from this frame on"""

    bl_idname = "cairn.pull_out"
    bl_label = "Pull Out"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        if is_running() or not context.object or analysis.FIGURES not in context.object:
            return False
        if is_animated(context.object):
            cls.poll_message_set("It is animated. Clear its animation, or undo the last Pull Out")
            return False
        return True

    def execute(self, context):
        with explaining(self):
            sources = [source for source in analysis.analysed(context.scene) if source.visible_get()]
            animated = [source.name for source in sources if is_animated(source)]
            if animated:
                raise Fault(f"“{animated[0]}” is animated. Clear its animation, or undo the last Pull Out.")
            poses, report, frames = bake(context, sources, sources.index(context.object))
            if not report.get("removals"):
                raise Fault(f"“{context.object.name}” cannot be pulled out: the objects do not come to rest.")
            play(context, sources, poses, frames)
            # What would hold them was of where they stood.
            context.scene.pop(analysis.GLUE, None)
            self.report({"INFO"}, said(sources, report, far(sources, poses)))
            return {"FINISHED"}
        return {"CANCELLED"}


class CAIRN_OT_make_it_stand(Operator):
    """Hold what falls by few dots of glue, or move it a little so that it stands by itself"""

    bl_idname = "cairn.make_it_stand"
    bl_label = "Make It Stand"
    bl_options = {"REGISTER", "UNDO"}

    by: EnumProperty(
        name="By",
        description="How what falls is made to stand",
        items=[
            ("GLUE", "Glue", "Mark each dot of glue by an empty, with the force that it has to hold"),
            ("MOVES", "Moves", "Let fall what floats, and move back what leans out too far"),
        ],
    )

    @classmethod
    def poll(cls, context):
        if analysis.GLUE not in context.scene:
            cls.poll_message_set("Analyze the objects where they are now")
            return False
        return True

    def execute(self, context):
        with explaining(self):
            needed = json.loads(context.scene[analysis.GLUE])
            if self.by == "MOVES":
                self.report(*move(context, needed))
                return {"FINISHED"}
            if needed["beyond"]:
                names = ", ".join(needed["beyond"][:5])
                self.report({"WARNING"}, f"No glue holds {names}: they touch nothing. Choose Moves, and they fall")
            if not needed["dots"]:
                if not needed["beyond"]:
                    self.report({"INFO"}, "All stand without glue")
                return {"FINISHED"}
            mark(context, needed["dots"])
            marked = "1 dot" if len(needed["dots"]) == 1 else f"{len(needed['dots'])} dots"
            self.report(
                {"INFO"},
                f"{marked} of glue in the collection “{DOTS}”. Analyze and Pull Out count friction alone",
            )
            return {"FINISHED"}
        return {"CANCELLED"}


def move(context, needed):
    """Moves what was found to fall, once, and lets fall what floats; the report of it."""
    moves, floating = needed["moves"], [name for name in needed["still"] if name in needed["beyond"]]
    leaning = [name for name in needed["still"] if name not in floating]
    metres = export.metres(context.scene)
    farthest = 0.0
    for one in moves:
        body = context.scene.objects.get(one["body"])
        if body:
            by = Vector(axes.points_to_blender(np.array(one["by"]), metres))
            body.matrix_world = Matrix.Translation(by) @ body.matrix_world
            farthest = max(farthest, float(np.linalg.norm(one["by"])))
    let_fall(context, floating)
    if moves or floating:
        analysis.renew(context)
    context.scene[analysis.GLUE] = json.dumps({**needed, "moves": [], "still": leaning, "beyond": []})
    said = [f"{counted(moves)} moved, by at most {1000 * farthest:.1f} mm"] if moves else []
    said += [f"{counted(floating)} fell to what carries {'it' if len(floating) == 1 else 'them'}"] if floating else []
    if leaning:
        return {"WARNING"}, ". ".join([*said, f"No small move holds {', '.join(leaning[:5])}: use glue"])
    return {"INFO"}, "; ".join([*said, "all stand now"]) if said else "All stand as they are"


def counted(things):
    return "1 object" if len(things) == 1 else f"{len(things)} objects"


def let_fall(context, names):
    """Lets objects fall until they rest. All other analyzed objects stay where they are."""
    if not names:
        return
    context.view_layer.update()
    sources = [source for source in analysis.analysed(context.scene) if source.visible_get()]
    falling = [number for number, source in enumerate(sources) if source.name in names]
    poses, _, frames = bake(context, sources, falling)
    metres = export.metres(context.scene)
    positions = axes.points_to_blender(poses[-1, :, :3], metres)
    rotations = axes.rotations_to_blender(poses[-1, :, 3:])
    for number in falling:
        source, turn = sources[number], Quaternion(rotations[number]).to_matrix().to_4x4()
        # What is left of the object's matrix without its frame: its scale.
        rest = frames[number].inverted() @ source.matrix_world
        source.matrix_world = Matrix.Translation(positions[number]) @ turn @ rest


def mark(context, dots):
    """An empty for each dot, with the force that it has to hold."""
    collection = bpy.data.collections.get(DOTS) or bpy.data.collections.new(DOTS)
    if DOTS not in context.scene.collection.children:
        context.scene.collection.children.link(collection)
    for old in list(collection.objects):
        bpy.data.objects.remove(old)
    analyzed = analysis.analysed(context.scene)
    corners = [source.matrix_world @ Vector(corner) for source in analyzed for corner in source.bound_box]
    size = DOT_SIZE * float(np.linalg.norm(np.ptp(corners or [Vector()], axis=0)))
    for dot in dots:
        other = dot["other"] or "ground"
        empty = bpy.data.objects.new(f"{dot['body']} – {other}", None)
        empty.empty_display_type = "SPHERE"
        empty.empty_display_size, empty.show_in_front = size, True
        empty.location = axes.points_to_blender(np.array(dot["point"]), export.metres(context.scene))
        empty[analysis.FORCE] = dot["force"]
        collection.objects.link(empty)


CLASSES = [CAIRN_OT_pull_out, CAIRN_OT_make_it_stand]
