"""The panels' settings and the scene -> what the server is asked to bake."""

import time
import uuid
from dataclasses import dataclass

import bpy
import numpy as np

from . import arrangement, others, placed, pointers
from .client import Fault, Problem
from .export import OWN, SOLID, Exporter, metres
from .prop_collections import members
from .schema import GROUPS, OF_CONTAINERS, fields_of, knows

# The value that a generator yields while it can only wait; and the pause of callers without other work, s.
WAITING = "waiting"
PAUSE = 0.02
# Objects that are props or scenery; others in the same collections are left alone.
PLACED = {"MESH", "CURVE", "SURFACE", "META", "FONT", "EMPTY"}
# Blender's default gravity, and the sideways part of a gravity that counts as downward.
EARTH, SLANTED = (0.0, 0.0, -9.81), 1e-3
# The largest weight where weights go by volume; and the share of its box below which a mesh counts as a sheet.
MOST_WEIGHT, HOLLOW = 1000.0, 1e-3
# What a prop may hang on, besides.
RIGS = {"ARMATURE", "LATTICE"}


@dataclass
class Request:
    """All data of Blender that a bake needs. The scene may change afterward."""

    spec: object
    # The models' bytes by SHA-256.
    contents: dict
    # The props of `recipe`, with data of this session.
    props: list
    recipe: dict
    # Problems found in Blender. The server may find more.
    problems: list
    # The objects that the recipe names, by their keys in it.
    pointers: dict


def props_of(settings):
    """The props' source objects with their settings, in their order."""
    if settings.prop_source == "LIST":
        pairs = [(item.object, item) for item in settings.props if item.object]
    elif settings.prop_collection:
        sources = [source for source in objects_of(settings.prop_collection) if not is_bare(source)]
        if settings.use_rendered:
            sources = [source for source in sources if not source.hide_render]
        pairs = [(source, settings.prop_common) for source in sources]
    else:
        pairs = []
    taken = taken_by_others(settings)
    return [(source, item) for source, item in pairs if source not in taken]


def objects_of(collection):
    """The top objects of a collection: their children belong to them. Below a camera or a light, each child counts."""
    inside = dict.fromkeys(members(collection) if collection else ())
    tops = PLACED | RIGS
    return [
        source
        for source in inside
        if source.type in tops and not (source.parent in inside and source.parent.type in tops)
    ]


def is_bare(source):
    """What has no surface, neither itself nor below it, is no prop: a marker, or an armature alone."""
    family = [source, *source.children_recursive]
    return not any(member.type in SOLID or member.instance_collection for member in family)


def hairy(source):
    """What of an object has hair or fur, which no body shows: instances on it count as all instances do."""
    return [
        member
        for member in (source, *source.children_recursive)
        if member.type == "CURVES"
        or any(system.settings.render_type == "PATH" for system in member.particle_systems)
        and any(kind.type == "PARTICLE_SYSTEM" and kind.show_render for kind in member.modifiers)
    ]


def left_out(settings):
    """The objects of the props' collection that no body shows: lights, cameras, markers, armatures alone."""
    if settings.prop_source != "COLLECTION" or not settings.prop_collection:
        return []
    props = [source for source, _ in props_of(settings)]
    shown = {member for source in props for member in (source, *source.children_recursive)}
    # Hair is reported with its prop.
    shown = {member for member in shown if member.type in {*PLACED, *RIGS, "CURVES"}} | taken_by_others(settings)
    if settings.use_rendered:
        # The artist has asked for it.
        hidden = [source for source in objects_of(settings.prop_collection) if source.hide_render]
        shown.update(member for source in hidden for member in (source, *source.children_recursive))
    return [source for source in members(settings.prop_collection) if source not in shown]


def taken_by_others(settings):
    """The objects that are something else than props of the fill."""
    taken = {settings.control_mesh, settings.drop_mesh, settings.region}
    for other in (settings.keep, settings.impact):
        taken.update(objects_of(other))
    return taken


def colliders_of(settings):
    """The colliders' objects."""
    container = [settings.control_mesh] if is_container(settings) else []
    if not settings.colliders:
        return container
    taken = {settings.control_mesh, settings.drop_mesh, settings.region}
    taken.update(source for source, _ in props_of(settings))
    for other in (settings.keep, settings.impact):
        taken.update(members(other) if other else ())
    inside = [source for source in members(settings.colliders) if source.type in PLACED and source not in taken]
    return container + inside


def is_container(settings):
    """Whether the shape is a container that stays, and is filled."""
    return settings.use_inside and knows("Fill", "level") and settings.control_mesh is not None


def missing(settings):
    """What to do before a bake, as one sentence; empty if nothing is missing."""
    if settings.control_mesh is None:
        return "Choose the mesh that gives the pile its shape."
    if settings.control_mesh.type not in SOLID:
        return "Choose a mesh, a text, a curve or a metaball as the shape."
    if settings.id_data not in settings.control_mesh.users_scene:
        return f"The shape “{settings.control_mesh.name}” is not in this scene any more. Choose another one."
    if not props_of(settings):
        return "Choose the props of the pile: a collection of objects, or some objects in the list."
    piles = others.of(settings.id_data, settings.control_mesh)
    if not (settings.use_ground or colliders_of(settings) or piles or objects_of(settings.keep)):
        return "Everything would fall forever. Switch the ground on, or choose colliders."
    return ""


def gravity_of(scene):
    """The acceleration of gravity, downward, m/s²: the artist's own, or the scene's."""
    settings = scene.cairn
    if settings.use_gravity:
        return round(settings.gravity, 6)
    if not scene.use_gravity:
        raise Fault("The scene's gravity is off. Switch it on in Scene Properties, or tick the pile's own gravity.")
    x, y, z = scene.gravity
    # Blender's own value does not know the scene's unit.
    if max(abs(a - b) for a, b in zip(scene.gravity, EARTH)) < 1e-6:
        return 9.81
    if z >= 0 or max(abs(x), abs(y)) > -SLANTED * z:
        raise Fault(
            "The scene's gravity does not point down. Change it in Scene Properties, or tick the pile's own gravity."
        )
    return round(-z * metres(scene), 6)


def take(context, passive=False):
    """The request of the current scene."""
    return finish(taking(context, passive))


def finish(generator):
    """Runs a generator to its end, and returns its value."""
    while True:
        try:
            if next(generator) is WAITING:
                time.sleep(PAUSE)
        except StopIteration as end:
            return end.value


def advance(generator, seconds, take):
    """Runs a generator for some time, or until it waits. Returns whether there is more; `take` gets the result."""
    until = time.monotonic() + seconds
    try:
        while next(generator) is not WAITING and time.monotonic() < until:
            pass
    except StopIteration as end:
        take(end.value)
        return False
    return True


def taking(context, passive=False):
    """The same as a generator, which yields so that Blender stays awake. `passive`: nothing of the file is touched;
    what moves is taken where it stands."""
    from .messages import v1

    scene, settings = context.scene, context.scene.cairn
    lacking = missing(settings)
    if lacking:
        raise Fault(lacking)
    exporter = Exporter(context, passive)
    control = None if is_container(settings) else exporter.region(settings.control_mesh)
    chosen = props_of(settings)
    props = yield from exporter.props([source for source, _ in chosen], OWN)
    colliders = colliders_of(settings)
    moving = [] if passive else placed.moving(context, colliders)
    statics = yield from exporter.scenery([source for source in colliders if source not in moving])
    piles = yield from others.scenery(context, exporter, settings.control_mesh)

    scene_message = v1.Scene(
        seed=settings.seed, gravity=gravity_of(scene), ground_friction=round(settings.collider_friction, 6)
    )
    set_accuracy(v1, scene_message, settings, exporter.metres)
    if not is_container(settings):
        scene_message.control_mesh.path = control.uri if control else ""
    if not settings.use_ground:
        scene_message.ground = False
    if settings.use_ground_height:
        scene_message.ground_height = settings.ground_height * exporter.metres
    weights = weights_of(settings, props, [item for _, item in chosen])
    for prop, (_, item), weight in zip(props, chosen, weights):
        scene_message.props.append(prop_message(v1, prop.model.uri, item))
        scene_message.props[-1].weight = weight
    for _, model in statics + piles:
        scene_message.statics.append(v1.StaticModel(path=model.uri, friction=round(settings.collider_friction, 6)))
    extras = placed.Extras(v1, scene_message, exporter, settings)
    yield from extras.add_moving(context, moving)
    extras.add_region()
    extras.add_drops()
    yield from extras.add_bodies(objects_of(settings.keep), objects_of(settings.impact))
    _set_parameters(v1, scene_message, settings)
    extras.add_entrance()
    extras.add_collapse()
    if is_container(settings):
        paths = {source: model.uri for source, model in statics} | extras.moved
        if settings.control_mesh in paths:
            scene_message.fill.into = paths[settings.control_mesh]
        else:
            message = f"“{settings.control_mesh.name}” has no faces. Choose a container with an inside."
            exporter.problems.append(Problem(message, settings.control_mesh.name))
    scene_message.output.fps = scene.render.fps / scene.render.fps_base
    if settings.use_frame_count:
        scene_message.output.frames = settings.frame_count
    else:
        # Frames in which nothing is to be seen would only be in the way of the next shot.
        scene_message.output.trim = True

    models = [*(prop.model for prop in props), *(model for _, model in statics + piles), *extras.models]
    names = {}
    if control:
        models.insert(0, control)
        names[control.uri] = settings.control_mesh.name
    assets = [v1.AssetReference(uri=model.uri, sha256=model.sha256) for model in models]
    names.update((prop.model.uri, prop.source.name) for prop in props)
    names.update((model.uri, source.name) for source, model in statics + piles)
    names.update(extras.names)
    props += extras.props
    # The server may count where it does not name.
    counted = {
        "props": [prop.source for prop in props],
        "statics": [*(source for source, _ in statics + piles), *extras.moved],
        "bodies": [prop.source for prop in extras.props],
        "emitters": [settings.drop_mesh] if settings.drop_mesh else [],
    }
    for kind, sources in counted.items():
        names.update((f"{kind}.{number}", source.name) for number, source in enumerate(sources))
    missed = left_out(settings)
    for source in missed:
        names.setdefault(source.name, source.name)
    recipe = {
        "token": uuid.uuid4().hex,
        "scene": scene.name,
        "control": settings.control_mesh.name,
        "place": [list(row) for row in settings.control_mesh.matrix_world],
        "props": [
            {
                "name": prop.source.name,
                "library": prop.source.library.filepath if prop.source.library else None,
                "local": [list(row) for row in prop.local],
                "middle": list(prop.middle),
                # Kept objects are in the scene already.
                "is_shown": prop not in extras.kept,
            }
            for prop in props
        ],
        "names": names,
        "notes": [
            f"{model.uri}: it moves, but the bake uses its pose at the start frame"
            for source, model in statics
            if placed.is_animated(source)
        ]
        + [
            f"{prop.model.uri}: its hair or fur is on no body. Convert it to a mesh, or let the bodies be bare"
            for prop in props
            if hairy(prop.source)
        ]
        + [f"{source.name}: it has no surface, so no body shows it" for source in missed],
        "metres": exporter.metres,
        # What the artist has asked for, of the fill's props alone.
        "weights": [item.weight for _, item in chosen],
        "start_frame": settings.start_frame,
        "output_mode": settings.output_mode,
        "settings": to_dict(settings),
    }
    named = {"control": settings.control_mesh, **{f"props.{n}": prop.source for n, prop in enumerate(props)}}
    named.update(pointers.of(settings, "settings."))
    return Request(
        v1.BakeSpec(scene=scene_message, assets=assets), exporter.contents, props, recipe, exporter.problems, named
    )


def weights_of(settings, props, items):
    """How often each prop is tried, relative to the others."""
    weights = np.array([item.weight for item in items])
    if settings.weigh_by == "VOLUME" and len(props) > 1:
        sizes = np.array([(item.scale_min**3 + item.scale_max**3) / 2 for item in items])
        weights = weights / (np.array([volume_of(prop) for prop in props]) * sizes)
        weights *= MOST_WEIGHT / weights.max()
    return [round(float(weight), 6) for weight in weights]


def volume_of(prop):
    """The volume of a prop; of its box, where its mesh encloses none."""
    corners = (prop.vertices - prop.vertices.mean(axis=0))[prop.triangles]
    inside = abs(np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6)
    box = np.prod(np.maximum(np.ptp(prop.vertices, axis=0), 1e-9))
    return float(inside if inside > HOLLOW * box else box)


def prop_message(v1, uri, item):
    """A prop with its settings."""
    low, high = sorted((item.scale_min, item.scale_max))
    prop = v1.Prop(
        path=uri,
        weight=round(item.weight, 6),
        density=round(item.density, 6),
        friction=round(item.friction, 6),
        restitution=round(item.restitution, 6),
        scale_min=round(low, 6),
        scale_max=round(high, 6),
    )
    if knows("Prop", "tilt_max") and item.tilt < 180.0:
        prop.tilt_max = round(item.tilt, 6)
    arrangement.set_prop(v1, prop, item)
    return prop


def _set_parameters(v1, scene_message, settings):
    """Sets the parameters that are set by hand; the others have the accuracy's values."""
    for message, name in GROUPS.items():
        group = getattr(settings, name, None)
        for field in fields_of(message) if group else ():
            if not getattr(group, "use_" + field["name"]):
                continue
            if (message, field["name"]) in OF_CONTAINERS and not is_container(settings):
                continue
            value = getattr(group, field["name"])
            if field["kind"] == "enum":
                value = getattr(v1, field["prefix"] + value)
            elif field["kind"] == "float":
                # As the artist typed it: Blender keeps single precision.
                value = float(f"{value:.7g}")
            setattr(getattr(scene_message, name), field["name"], value)
    arrangement.set_fill(v1, scene_message.fill, settings)
    if knows("Glue"):
        _set_glue(v1, scene_message.glue, settings)
    if not settings.use_report:
        leave_figures(v1, scene_message)


def set_accuracy(v1, scene_message, settings, metres):
    """Sets the accuracy, and the goal of the automatic one."""
    scene_message.accuracy = getattr(v1, f"ACCURACY_{settings.accuracy}")
    if settings.accuracy == "AUTO" and settings.goal == "TIME":
        scene_message.goal.seconds = float(f"{settings.goal_seconds:.7g}")
    elif settings.accuracy == "AUTO":
        scene_message.goal.overlap = float(f"{settings.goal_overlap:.7g}") * metres


def leave_figures(v1, scene_message):
    """Switches all measures of the finished pile off."""
    for field in fields_of("Figures"):
        setattr(scene_message.report, field["name"], v1.SWITCH_OFF)


def _set_glue(v1, glue, settings):
    """As modeled is the service's default where there is something to glue."""
    if settings.kept_shape == "NATURAL":
        glue.mode = v1.GLUE_MODE_NATURAL
    elif settings.kept_shape == "TACKY":
        glue.mode = v1.GLUE_MODE_TACKY
        # As the artist typed it.
        glue.strength = float(f"{settings.glue_strength:.7g}")


def to_dict(group):
    """A property group as plain values; objects and collections by name."""
    out = {}
    for prop in group.bl_rna.properties:
        name = prop.identifier
        if name in ("rna_type", "name", "last_shape"):
            continue
        value = getattr(group, name)
        if prop.type == "COLLECTION":
            value = [to_dict(item) for item in value]
        elif prop.type == "POINTER":
            value = to_dict(value) if isinstance(value, bpy.types.PropertyGroup) else value and value.name
        elif getattr(prop, "is_array", False):
            value = list(value)
        out[name] = value
    return out


def from_dict(group, values, found=None, path=""):
    """Sets a property group to what `to_dict` gave, as far as the objects are still there. `found`: them, by their
    paths, whatever their names are now; those that are not in it are looked for by name."""
    for prop in group.bl_rna.properties:
        name = prop.identifier
        if name not in values:
            continue
        value = values[name]
        if prop.type == "COLLECTION":
            items = getattr(group, name)
            items.clear()
            for number, item in enumerate(value):
                from_dict(items.add(), item, found, f"{path}{name}.{number}.")
        elif prop.type == "POINTER" and isinstance(value, dict):
            from_dict(getattr(group, name), value, found, f"{path}{name}.")
        elif prop.type == "POINTER":
            known = bpy.data.objects if prop.fixed_type.identifier == "Object" else bpy.data.collections
            setattr(group, name, (found or {}).get(path + name) or (known.get(value) if value else None))
        else:
            setattr(group, name, value)
