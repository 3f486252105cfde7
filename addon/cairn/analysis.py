"""What holds what: the selected objects as bodies, analysed by `cairn analyse`; colors and figures on the objects."""

import json
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy
from bpy.props import EnumProperty
from bpy.types import Operator, Panel

from . import axes, export, glb, preferences, request, states
from .client import Fault
from .following import explaining, is_running
from .layouts import wrapped
from .panels import Pile
from .report_panels import draw_shading
from .result import finish
from .server import find

# Figures on the objects that were analysed, and their color before.
FIGURES, BEFORE = "cairn_analysis", "cairn_color_before"
# On the empty of a dot of glue: the force that it has to hold.
FORCE = "force_newton"
# On the scene: the dots of glue that are needed.
GLUE = "cairn_needed_glue"
# Longest run of the program, s.
LONGEST = 300
# The file that the objects are written to.
NAME = "selection.glb"

GREEN, YELLOW, ORANGE, RED = (0.03, 0.30, 0.08, 1), (0.85, 0.60, 0.05, 1), (0.80, 0.18, 0.02, 1), (0.60, 0.01, 0.01, 1)
LOADS = [(0.06, 0.0, 0.09, 1), (0.04, 0.09, 0.26, 1), (0.02, 0.28, 0.26, 1), (0.12, 0.58, 0.12, 1), YELLOW]
MARGINS = [RED, YELLOW, GREEN]
# The largest push that is looked for, in weights.
MOST_PUSH = 10.0
# Names in a sentence.
MOST_NAMES = 8
# A push of this share of its weight is a large margin.
LARGE = 0.5

SHOWN = [
    ("REMOVAL", "May Be Removed", "Green: the others stand without it. Red: something falls. Yellow: not proven"),
    ("LOAD", "Load", "From dark, which carries nothing, to yellow, which carries most"),
    ("MARGIN", "Margin", "Red: a touch moves it. Green: it bears a push of half its weight or more"),
    ("STANDING", "Stands", "Green: it stands. Red: it falls. Orange: it falls together with others"),
]


def bodies(context):
    """The selected objects that are bodies; children belong to selected parents, and dots of glue are none."""
    chosen = {source for source in context.selected_objects if FORCE not in source}
    return [
        source
        for source in context.selected_objects
        if source in chosen and source.type in request.PLACED and source.parent not in chosen and source.visible_get()
    ]


def analysed(scene):
    return [source for source in scene.objects if FIGURES in source]


def figures(source):
    """The figures of an object; None where it was not analysed."""
    text = source.get(FIGURES)
    return json.loads(text) if text else None


@dataclass
class Written:
    """Objects as the program reads them."""

    # A .glb with a node for each body and each piece of scenery, named by its number.
    content: bytes
    scenery: int
    # Per body: position in m and rotation x y z w, in the server's axes, and its own frame in Blender.
    poses: list
    frames: list


def write(context, sources, scenery, *, posed=True):
    """The objects as a file. `posed`: its bodies stand where they are; otherwise each lies in its own frame."""
    exporter = export.Exporter(context, passive=True)
    props = finish(exporter.props(sources))
    if exporter.problems:
        raise Fault(exporter.problems[0].text)
    still = [(source, model) for source, model in finish(exporter.scenery(scenery))] if scenery else []
    meshes, nodes, known, poses = [], [], {}, []
    for number, prop in enumerate(props):
        if prop.model.sha256 not in known:
            known[prop.model.sha256] = len(meshes)
            meshes.append((axes.points_to_server(prop.vertices, exporter.metres), prop.triangles))
        place, rotation, _ = prop.frame.decompose()
        position = axes.points_to_server(place, exporter.metres).tolist()
        turn = axes.rotations_to_server(rotation).tolist()
        poses.append((position, turn))
        placed = {"translation": position, "rotation": turn} if posed else {}
        nodes.append({"name": f"body {number}", "mesh": known[prop.model.sha256], **placed})
    for number, (source, _) in enumerate(still):
        with export.evaluated(context, [source], True) as geometry:
            vertices, triangles = export.joined(geometry(source), export.Matrix())
        nodes.append({"name": f"scenery {number}", "mesh": len(meshes)})
        meshes.append((axes.points_to_server(vertices, exporter.metres), triangles))
    return Written(glb.write_nodes(meshes, nodes), len(still), poses, [prop.frame.copy() for prop in props])


def run(context, folder, arguments):
    """The program's output, run in a folder."""
    program = find(bpy.path.abspath(preferences.of(context).program))
    try:
        done = subprocess.run(
            [str(program), *arguments],
            cwd=folder,
            capture_output=True,
            text=True,
            encoding="utf-8",
            errors="replace",
            timeout=LONGEST,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
    except OSError as error:
        raise Fault(f"{program} does not start: {error}. Choose another in the add-on's preferences.") from error
    except subprocess.TimeoutExpired as error:
        raise Fault("It takes too long. Select fewer objects.") from error
    if done.returncode != 0:
        raise Fault(done.stderr.strip().removeprefix("error: ").replace(NAME, "The selection"))
    return done.stdout


def scenery_of(context, sources):
    """The scene's colliders, which stand still."""
    return [source for source in request.colliders_of(context.scene.cairn) if source not in sources]


def analyse(context, sources):
    """The answers of `cairn analyse` for these objects, with the scene's colliders as scenery."""
    settings = context.scene.cairn
    written = write(context, sources, scenery_of(context, sources))
    with tempfile.TemporaryDirectory(prefix="cairn-") as folder:
        (Path(folder) / NAME).write_bytes(written.content)
        arguments = ["analyse", NAME, "--json", f"--friction={settings.collider_friction}"]
        arguments += ["--scenery", "scenery *"] if written.scenery else []
        arguments += [] if settings.use_ground else ["--no-ground"]
        if settings.use_ground and settings.use_ground_height:
            arguments.append(f"--ground={settings.ground_height * export.metres(context.scene)}")
        return json.loads(run(context, folder, arguments))


def keep(sources, answers):
    """Writes the figures of each body to its object, with names in place of numbers."""
    names = [source.name for source in sources]
    most = max((body["load"] for body in answers["bodies"]), default=0.0)
    for number, (source, body) in enumerate(zip(sources, answers["bodies"], strict=True)):
        body = {**body, "name": source.name, "share": body["load"] / most if most else 0.0}
        for key in ("carries", "rests_on_it"):
            body[key] = [names[other] for other in body[key]]
        if body["removal"]:
            moving = body["removal"]["moving"]
            # What begins to fall takes along what rests on it.
            on_these = {other for one in moving for other in answers["bodies"][one]["rests_on_it"]}
            on_these -= {*moving, number}
            body["removal"]["moving"] = [names[other] for other in moving]
            body["removal"]["on_these"] = [names[other] for other in sorted(on_these)]
        source[FIGURES] = json.dumps(body)


def dots(sources, answers):
    """What would fix a pile that falls, with names in place of numbers: dots of glue with which all stand, and what no
    glue holds; small moves, and what falls even so."""
    name = [source.name for source in sources].__getitem__
    needed = [
        {**dot, "body": name(dot["body"]), "other": None if dot["other"] is None else name(dot["other"])}
        for dot in answers["glue"]
    ]
    moves = [{"body": name(nudge["body"]), "by": nudge["by"]} for nudge in answers["nudges"]]
    beyond, still = ([name(number) for number in answers[key]] for key in ("beyond_glue", "beyond_nudges"))
    return {"dots": needed, "beyond": beyond, "moves": moves, "still": still}


def _between(scale, share):
    at = min(max(share, 0.0), 1.0) * (len(scale) - 1)
    low = min(int(at), len(scale) - 2)
    return [a + (b - a) * (at - low) for a, b in zip(scale[low], scale[low + 1], strict=True)]


def color(body, shown):
    if shown == "LOAD":
        return _between(LOADS, body["share"] ** 0.5)
    if shown == "MARGIN":
        return _between(MARGINS, (body["least_push"] or 0.0) / LARGE)
    if shown == "STANDING":
        return {"stands": GREEN, "falls_with_others": ORANGE}.get(body["standing"], RED)
    removal = body["removal"]
    if removal is None:
        return ORANGE
    return GREEN if removal["is_safe"] else YELLOW if removal["is_open"] else RED


def paint(scene, shown):
    """Colors the analysed objects, in the Solid view by object."""
    for source in analysed(scene):
        if BEFORE not in source:
            source[BEFORE] = list(source.color)
        source.color = color(figures(source), shown)


class CAIRN_OT_analyze(Operator):
    """Find out what the selected objects hold: which stand, what each carries, and which may be removed"""

    bl_idname = "cairn.analyze"
    bl_label = "Analyze"
    bl_options = {"REGISTER", "UNDO"}

    shown: EnumProperty(name="Colors", description="What the colors show", items=SHOWN)

    @classmethod
    def poll(cls, context):
        return not is_running() and bool(context.selected_objects)

    def execute(self, context):
        with explaining(self):
            sources = bodies(context)
            if not sources:
                raise Fault("Select the objects to analyze, such as the things on a table.")
            answers = analyse(context, sources)
            clear(context.scene)
            keep(sources, answers)
            context.scene[GLUE] = json.dumps(dots(sources, answers))
            paint(context.scene, self.shown)
            states.shade(True, "analysis")
            self.report({"INFO"}, summary(sources, answers))
            return {"FINISHED"}
        return {"CANCELLED"}


def renew(context):
    """Finds the figures of what was analyzed again, once it has moved, and shows which stand."""
    context.view_layer.update()
    sources = [source for source in analysed(context.scene) if source.visible_get()]
    keep(sources, analyse(context, sources))
    paint(context.scene, "STANDING")


def summary(sources, answers):
    falling = [
        source.name for source, body in zip(sources, answers["bodies"], strict=True) if "falls" in body["standing"]
    ]
    if falling:
        return f"{len(falling)} of {len(sources)} objects fall: {listed(falling)}"
    safe = sum(bool(body["removal"] and body["removal"]["is_safe"]) for body in answers["bodies"])
    tilt = answers["whole"]["tilt"][1] if answers["whole"] else 0.0
    return f"All {len(sources)} objects stand; {safe} may be removed; they go at a tilt of {tilt:.1f}°"


def clear(scene):
    for source in analysed(scene):
        if BEFORE in source:
            source.color = list(source[BEFORE])
            del source[BEFORE]
        del source[FIGURES]
    scene.pop(GLUE, None)


class CAIRN_OT_clear_analysis(Operator):
    """Take the colors and the figures of the analysis away"""

    bl_idname = "cairn.clear_analysis"
    bl_label = "Clear"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context):
        return bool(analysed(context.scene))

    def execute(self, context):
        clear(context.scene)
        states.shade(False, "analysis")
        return {"FINISHED"}


class CAIRN_PT_analysis(Pile, Panel):
    bl_label = "Analysis"
    bl_parent_id = "CAIRN_PT_pile"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        layout.operator_menu_enum("cairn.analyze", "shown", text="Analyze Selected", icon="VIEWZOOM")
        if not analysed(context.scene):
            return
        # Beside another button, its words would be cut.
        layout.operator_menu_enum("cairn.make_it_stand", "by", icon="LINKED")
        row = layout.row(align=True)
        row.operator("cairn.inspect", icon="EYEDROPPER")
        row.operator("cairn.clear_analysis", icon="X")
        draw_shading(layout, context)
        body = figures(context.object) if context.object else None
        if body:
            layout.operator("cairn.pull_out", icon="EXPORT")
            for line in lines(body):
                wrapped(layout, context, line)


def lines(body):
    """What is known of a body, as sentences."""
    said = {
        "stands": "stands",
        "pinned": "is placed to stay",
        "falls_alone": "falls, even if all that it touches were held",
        "falls_with_others": "falls together with others",
    }
    found = [f"“{body['name']}” {said[body['standing']]}."]
    falls = body["standing"].startswith("falls")
    # Of what falls, forces and pushes say nothing.
    if not falls:
        found.append(f"It carries {body['load']:.3g} N, {body['load_in_weights']:.2f} of its weight.")
    if body["rests_on_it"]:
        found.append(f"On it: {listed(body['rests_on_it'])}.")
    push = None if falls else body["least_push"]
    if push is not None and push < MOST_PUSH:
        found.append(f"A push of {push:.2f} of its weight moves it; its neighbors held.")
    elif push is not None:
        found.append(f"No push of less than {MOST_PUSH:g} times its weight moves it; its neighbors held.")
    removal = body["removal"]
    if removal and removal["is_safe"]:
        found.append("The others stand without it.")
    elif removal and removal["is_open"]:
        found.append("Whether the others stand without it is not proven.")
    elif removal:
        found.append(f"Without it, these begin to fall: {listed(removal['moving'])}.")
        if removal.get("on_these"):
            found.append(f"What rests on these follows: {listed(removal['on_these'])}.")
        found.append("Pull Out also shows what their fall hits.")
    return found


def listed(names):
    """Names in a sentence, not too many."""
    more = len(names) - MOST_NAMES
    return ", ".join(names[:MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


CLASSES = [CAIRN_OT_analyze, CAIRN_OT_clear_analysis, CAIRN_PT_analysis]
