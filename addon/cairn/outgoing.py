"""A pile for other programs and other files: exported with its motion, or as an asset with a thumbnail."""

import os
from contextlib import contextmanager

import bpy
import numpy as np
from bpy.props import EnumProperty, StringProperty
from bpy.types import Operator
from bpy_extras.io_utils import ExportHelper
from mathutils import Euler

from . import belongings, result, roots, states, timing, tints
from .client import Fault
from .following import is_running
from .pile_operators import OfPile

ENDINGS = {"USD": (".usdc", ".usda", ".usd"), "ALEMBIC": (".abc",), "GLTF": (".glb",)}
TITLES = {"USD": "USD", "ALEMBIC": "Alembic", "GLTF": "glTF"}
# Edge of a thumbnail, pixels; its view direction; points that are drawn, and brightness of the dark side.
THUMBNAIL, VIEW, POINTS, AMBIENT = 256, Euler((1.15, 0.0, 0.6)), 400_000, 0.35
GRAY = np.array([0.80, 0.62, 0.38])


def forms():
    """The forms that this Blender writes."""
    known = {
        "USD": getattr(bpy.app.build_options, "usd", False),
        "ALEMBIC": getattr(bpy.app.build_options, "alembic", False),
        "GLTF": "io_scene_gltf2" in bpy.context.preferences.addons,
    }
    return [form for form, is_there in known.items() if is_there]


class CAIRN_OT_export_pile(OfPile, ExportHelper, Operator):
    """Export this pile with its motion: the bodies keep their names, with underscores for spaces"""

    bl_idname = "cairn.export_pile"
    bl_label = "Export Pile"
    bl_options = {"REGISTER"}

    form: EnumProperty(
        name="Format",
        description="File format",
        items=[
            ("USD", TITLES["USD"], "Universal Scene Description"),
            ("ALEMBIC", TITLES["ALEMBIC"], "Alembic"),
            ("GLTF", TITLES["GLTF"], "Binary glTF, with one clip for all bodies"),
        ],
    )
    filter_glob: StringProperty(default="*.usdc;*.usda;*.usd;*.abc;*.glb", options={"HIDDEN"})
    filename_ext = ""
    check_extension = None

    @classmethod
    def poll(cls, context):
        return not is_running() and result.chosen(context) is not None and bool(forms())

    def change(self, context, collection):
        path = bpy.path.abspath(self.filepath)
        of = [form for form, endings in ENDINGS.items() if path.lower().endswith(endings)]
        if of and not self.properties.is_property_set("form"):
            self.form = of[0]
        if self.form not in forms():
            raise Fault("This Blender does not write that format. Choose another, or enable the exporter's add-on.")
        if collection.cairn.mode == "POINTS" and self.form != "USD":
            raise Fault("Instanced points have no bodies to export. Bake as Animated Objects, or export USD.")
        if of and self.form not in of:
            right = path[: path.rindex(".")] + ENDINGS[self.form][0]
            raise Fault(
                f"{path} ends as files of {TITLES[of[0]]} do. Choose the format {TITLES[of[0]]}, or name it {right}."
            )
        path += "" if of else ENDINGS[self.form][0]
        states.restore()
        is_new = not os.path.exists(path)
        with _alone(context, collection):
            try:
                write(context, collection, self.form, path)
            except RuntimeError as error:
                # The last line but the place in the code is the reason; those before it are of the exporter's own code.
                lines = [line for line in str(error).splitlines() if line.strip() and not line.startswith("Location:")]
                reason = lines[-1].removeprefix("Error: ").strip() if lines else "its exporter says no reason"
                if is_new and os.path.isfile(path):
                    os.remove(path)
                raise Fault(f"Blender does not write {path}: {reason}") from error
        states.refresh(context.scene)
        self.report({"INFO"}, f"Exported “{collection.name}” to {path}")


class _alone:  # noqa: N801 used as a function
    """The pile alone is selected, and the scene's range is the pile's."""

    def __init__(self, context, collection):
        self.context, self.pile, self.scene = context, collection, context.scene

    def __enter__(self):
        layer, scene = self.context.view_layer, self.scene
        self.before = [shown for shown in layer.objects if shown.select_get()], layer.objects.active
        self.range = scene.frame_start, scene.frame_end, scene.frame_current
        for shown in self.before[0]:
            shown.select_set(False)
        missing = [shown for shown in self.pile.objects if layer.objects.get(shown.name) != shown]
        if missing or self.pile.hide_viewport:
            raise Fault(f"“{self.pile.name}” is hidden or not in this view layer. Show it to export it.")
        for shown in self.pile.objects:
            shown.select_set(True)
        layer.objects.active = roots.of(self.pile)
        start = int(np.floor(timing.shown(self.pile)[0])) if self.pile.cairn.frame_count else scene.frame_current
        scene.frame_start, scene.frame_end = start, max(start, timing.end_of(self.pile))

    def __exit__(self, *_):
        scene, layer = self.scene, self.context.view_layer
        for shown in layer.objects:
            shown.select_set(shown in self.before[0])
        layer.objects.active = self.before[1]
        scene.frame_start, scene.frame_end = self.range[:2]
        scene.frame_set(self.range[2])


def write(context, collection, form, path):
    """Calls Blender's exporter."""
    scene, is_moving = context.scene, collection.cairn.frame_count > 1
    if form == "USD":
        options = {"filepath": path, "selected_objects_only": True, "export_animation": is_moving}
        # The object's name, not that of its mesh, is to be the one that readers show.
        if "merge_parent_xform" in bpy.ops.wm.usd_export.get_rna_type().properties:
            bpy.ops.wm.usd_export(merge_parent_xform=True, **options)
        else:
            with _named_meshes(collection):
                bpy.ops.wm.usd_export(**options)
    elif form == "ALEMBIC":
        span = {"start": scene.frame_start, "end": scene.frame_end}
        bpy.ops.wm.alembic_export(filepath=path, selected=True, as_background_job=False, **span)
    else:
        options = {"use_selection": True, "export_animations": is_moving, "export_extras": True}
        known = bpy.ops.export_scene.gltf.get_rna_type().properties
        if "export_animation_mode" in known:
            # One clip, not one for each body.
            options["export_animation_mode"] = "SCENE"
            options["export_anim_scene_split_object"] = False
        elif "export_nla_strips" in known:
            options["export_nla_strips"] = False
        bpy.ops.export_scene.gltf(filepath=path, **options)


@contextmanager
def _named_meshes(collection):
    """Each body has a mesh of its own, with its own name."""
    swapped = [(body, body.data) for body in belongings.bodies(collection) if body.type == "MESH"]
    made = []
    try:
        for body, data in swapped:
            made.append(data.copy())
            if body.name not in bpy.data.meshes:
                made[-1].name = body.name
            body.data = made[-1]
        yield
    finally:
        for body, data in swapped:
            body.data = data
        bpy.data.batch_remove(made)


class CAIRN_OT_mark_asset(OfPile, Operator):
    """Make this pile an asset, with a thumbnail: a ready-made pile in the asset browser"""

    bl_idname = "cairn.mark_asset"
    bl_label = "Mark as Asset"

    @classmethod
    def poll(cls, context):
        return not is_running() and result.chosen(context) is not None

    def change(self, context, collection):
        collection.asset_mark()
        collection.asset_data.description = f"{len(belongings.bodies(collection))} bodies, baked by Cairn"
        root = roots.of(collection)
        if root is not None:
            # An instance stands on the ground, in the middle.
            collection.instance_offset = root.matrix_world.translation
        pixels = thumbnail(context, collection)
        shown = collection.preview_ensure()
        shown.image_size = (THUMBNAIL, THUMBNAIL)
        shown.image_pixels_float.foreach_set(pixels.astype(np.float32).ravel())
        self.report({"INFO"}, f"“{collection.name}” is an asset. Save the file into an asset library to find it there")


def thumbnail(context, collection):
    """A picture of a pile as it is now: shape [THUMBNAIL, THUMBNAIL, 4], from its lower left. Points on its surface are
    drawn, the nearest last."""
    points, colors = _points(context, collection)
    turn = np.array(VIEW.to_matrix())
    seen = points @ turn
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = 0.92 * THUMBNAIL / max((high - low)[:2].max(), 1e-9)
    order = np.argsort(seen[:, 2])
    at = ((seen[order, :2] - (low + high)[:2] / 2) * scale + THUMBNAIL / 2).astype(int)
    # Each is two pixels wide and high, so that nothing behind it shows through.
    at = (at[:, None] + [(0, 0), (1, 0), (0, 1), (1, 1)]).reshape(-1, 2).clip(0, THUMBNAIL - 1)
    image = np.zeros((THUMBNAIL, THUMBNAIL, 4))
    image[at[:, 1], at[:, 0], :3] = colors[order].repeat(4, axis=0)
    image[at[:, 1], at[:, 0], 3] = 1
    return image


def _points(context, collection):
    """Points on the bodies' surfaces in the world, and their colors."""
    own = {shown.name for shown in collection.objects}
    meshes, known = [], {}
    for instance in context.evaluated_depsgraph_get().object_instances:
        holder = instance.parent if instance.is_instance else instance.object
        if holder.original.name not in own or instance.object.type != "MESH":
            continue
        data = instance.object.data
        if data.as_pointer() not in known:
            data.calc_loop_triangles()
            vertices = np.empty(3 * len(data.vertices), np.float32)
            data.vertices.foreach_get("co", vertices)
            triangles = np.empty(3 * len(data.loop_triangles), np.int32)
            data.loop_triangles.foreach_get("vertices", triangles)
            tint = tints.of(instance.object.original)
            corners = vertices.reshape(-1, 3)[triangles.reshape(-1, 3)]
            known[data.as_pointer()] = corners, GRAY if tint is None else tint
        corners, tint = known[data.as_pointer()]
        if len(corners):
            place = np.array(instance.matrix_world)
            meshes.append((corners @ place[:3, :3].T + place[:3, 3], tint))
    if not meshes:
        raise Fault("There is nothing to see of this pile. Show it first.")
    corners = np.concatenate([corners for corners, _ in meshes])
    tint = np.concatenate([np.tile(tint, (len(corners), 1)) for corners, tint in meshes])
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    random = np.random.default_rng(0)
    chosen = random.choice(len(corners), POINTS, p=area / area.sum())
    first, second = random.random((2, POINTS, 1))
    outside = first + second > 1
    first, second = np.where(outside, 1 - first, first), np.where(outside, 1 - second, second)
    a, b, c = corners[chosen].transpose(1, 0, 2)
    normals = (across / np.maximum(area, 1e-20)[:, None])[chosen]
    light = np.array([0.4, -0.5, 0.77])
    shade = AMBIENT + (1 - AMBIENT) * np.clip(normals @ light, 0, 1)
    return a + first * (b - a) + second * (c - a), tint[chosen] * shade[:, None]


CLASSES = [CAIRN_OT_export_pile, CAIRN_OT_mark_asset]
