"""Editing a pile by hand: bodies are removed, replaced, moved or added, and the disturbed bodies settle again. All
others stay: their objects are not even written to."""

import json
import uuid
from types import SimpleNamespace

import bpy
import numpy as np
from mathutils import Matrix, Quaternion, Vector
from mathutils.bvhtree import BVHTree

from . import (
    axes,
    belongings,
    keyframes,
    others,
    outline,
    painted,
    parts,
    pointers,
    prop_collections,
    request,
    result,
    roots,
    running,
    timing,
    weighing,
)
from .client import Fault
from .dots import number_of
from .export import Exporter, middles_of

# A body counts as moved by hand from this displacement on, relative to its prop's size; within it, two are in contact.
MOVED, TOUCH = 1e-4, 0.03
# Triangles of a body, for finding contacts.
TRIANGLES = 80
# Height above the pile at which new bodies appear, and the width of their place, in sizes of the largest prop.
ABOVE, MARGIN = 1.5, 0.25
# A painted region is divided into squares: this many to a side of the largest prop.
CELLS = 4
# New bodies per second.
RATE = 12.0


def still_copy(scene, collection):
    """Makes a copy of a pile's final pose, as objects without animation. The pile itself is hidden, and stays."""
    frame, end = scene.frame_current, timing.end_of(collection)
    root, bodies = roots.of(collection), belongings.bodies(collection)
    # Changing the frame and back takes as long as everything else, and is not needed for what a bake has made.
    is_plain = (root is None or root.animation_data is None) and all(map(keyframes.is_plain, bodies))
    if frame != end and not is_plain:
        scene.frame_set(end)
    made = bpy.data.collections.new(f"{collection.name} Edited")
    if root is not None:
        root = root.copy()
        root.animation_data_clear()
        if made.name not in bpy.data.objects:
            root.name = made.name
        root.cairn.made_name = root.name
        made.objects.link(root)
    copies = []
    for body in bodies:
        copy, action = body.copy(), body.animation_data and body.animation_data.action
        copy.animation_data_clear()
        copy.matrix_basis = body.matrix_basis
        if action and is_plain:
            keyframes.pose(copy, action, end)
        if body.parent is not None and body.parent.cairn.is_root:
            copy.parent = root
        made.objects.link(copy)
        copies.append(copy)
    if frame != end and not is_plain:
        scene.frame_set(frame)
    scene.collection.children.link(made)
    for prop in collection.cairn.bl_rna.properties:
        if not prop.is_readonly and prop.identifier not in ("name", "rna_type") and not prop.identifier[:6] == "timing":
            setattr(made.cairn, prop.identifier, getattr(collection.cairn, prop.identifier))
    pointers.write(made.cairn.pointers, pointers.read(collection.cairn.pointers))
    belongings.number_copies(made)
    for copy in copies:
        belongings.mark(copy)
    made.cairn.mode, made.cairn.frame_count = "POSE", 0
    remember(made)
    carry(made)
    result.show_only(scene, made)
    return made


def remember(collection):
    """Remembers the poses of the settled pile."""
    found = belongings.bodies(collection)
    collection.cairn.settled = json.dumps({str(body.cairn.number): _state(body) for body in found})


def settled(collection):
    """The bodies' last settled states, by number."""
    return {int(number): state for number, state in json.loads(collection.cairn.settled).items()}


def carry(collection):
    """Links edited bodies to their props' collections again, if the settings say so."""
    sources = result.sources_of(running.recipe_of(collection), pointers.read(collection.cairn.pointers))
    if None not in sources:
        prop_collections.refresh(collection, sources)


def _state(body):
    return [body.cairn.prop, *body.location, *body.rotation_quaternion, body.cairn.size]


def is_edited(collection):
    """Whether a pile is an editable copy."""
    return bool(collection and collection.cairn.settled)


class Placed:
    """Bodies of a pile at their current poses: objects [n], and their props."""

    def __init__(self, collection, props):
        self.objects = belongings.bodies(collection)
        self.props = props
        # The pile's last settled state, by number: prop, pose and size.
        before = settled(collection)
        here = {body.cairn.number for body in self.objects}
        shapes = [outline.fewer(prop.vertices, prop.triangles, TRIANGLES) for prop in props]
        self.sizes = [float(np.ptp(points, axis=0).max()) for points, _ in shapes]
        self.shapes = shapes
        self.changed = [self._is_changed(body, before.get(body.cairn.number)) for body in self.objects]
        # Places of removed bodies.
        moved = {body.cairn.number for body, is_changed in zip(self.objects, self.changed) if is_changed}
        self.partners = _partners(collection)
        self.lost = moved | (set(before) - here)
        self.gone = [_pose(state) for number, state in before.items() if number in moved or number not in here]

    def _is_changed(self, body, state):
        if state is None or state[0] != body.cairn.prop:
            return True
        now = _state(body)
        limit = MOVED * self.sizes[body.cairn.prop]
        turn = max(abs(a - b) for a, b in zip(now[4:8], state[4:8]))
        return max(abs(a - b) for a, b in zip(now[1:4], state[1:4])) > limit or turn > MOVED

    def _tree(self, prop, matrix, size, reach=0.0):
        """A search tree for overlaps, with the lowest and the highest corner. `reach`: the body is enlarged by this
        on all sides: scaled, and each face moved outward."""
        points, triangles = self.shapes[prop]
        if reach:
            points, triangles = _grown(points, triangles, reach / size)
        world = points * size @ np.array(matrix)[:3, :3].T + np.array(matrix)[:3, 3]
        return BVHTree.FromPolygons(world.tolist(), triangles.tolist()), world.min(axis=0), world.max(axis=0)

    def reaching(self, prop, matrix, size):
        """The same for all bodies in contact with it."""
        return self._tree(prop, matrix, size, TOUCH * self.sizes[prop] * size)

    def disturbed(self):
        """A generator of a mask [n]: the objects that may move. These are the changed ones, the ones that stood on
        removed ones, and all that stand on these."""
        trees, poses = [], [_pose(_state(body)) for body in self.objects]
        for pose in poses:
            trees.append(self._tree(*pose))
            yield
        low, high = (np.array([tree[side] for tree in trees]) for side in (1, 2))
        index = {body.cairn.number: n for n, body in enumerate(self.objects)}
        glued = {index[other] for number in self.lost for other in self.partners.get(number, ()) if other in index}
        free = [is_changed or n in glued for n, is_changed in enumerate(self.changed)]
        gone = []
        for pose in self.gone:
            gone.append(self.reaching(*pose))
            yield
        waiting = [(tree, None) for tree in gone] + [(None, n) for n in range(len(trees)) if free[n]]
        while waiting:
            found, own = waiting.pop()
            tree, bottom, top = found or self.reaching(*poses[own])
            near = ((low <= top) & (high >= bottom)).all(axis=1)
            # Bodies below do not need its support.
            above = (low + high)[:, 2] > (bottom + (top if own is not None else bottom))[2]
            known = self.partners.get(self.objects[own].cairn.number, ()) if own is not None else ()
            # Glue does not hold a moving body: bodies that were glued to it may move, too.
            partners = {index[other] for other in known if other in index}
            for number in {*np.flatnonzero(near & above).tolist(), *partners}:
                touches = number in partners or tree.overlap(trees[number][0])
                if not free[number] and number != own and touches:
                    free[number] = True
                    waiting.append((None, number))
            yield
        return free


def _grown(points, triangles, reach):
    """The triangles, moved outward by `reach`."""
    low, high = points.min(axis=0), points.max(axis=0)
    extent = np.maximum(high - low, 1e-12)
    scaled = (points - (low + high) / 2) * (1 + 2 * reach / extent) + (low + high) / 2
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-20)
    moved = (corners + reach * normals[:, None]).reshape(-1, 3)
    soup = len(points) + np.arange(len(moved)).reshape(-1, 3)
    return np.concatenate([scaled, moved]), np.concatenate([triangles, soup])


def _partners(collection):
    """The bodies that each body is glued to, by number."""
    found, report = {}, running.report_of(collection)
    for dot in () if "collapse_frame" in report else report.get("dots", ()):
        ends = [number_of(collection, body) for body in (dot["body"], dot["other"])]
        if None not in ends and not dot["broken"]:
            for one, other in (ends, ends[::-1]):
                found.setdefault(one, set()).add(other)
    return found


def _pose(state):
    prop, *numbers = state
    # Older files have no sizes.
    size = numbers[7] if len(numbers) > 7 else 1.0
    return int(prop), Matrix.Translation(numbers[:3]) @ Quaternion(numbers[3:7]).to_matrix().to_4x4(), size


def settling(context, collection, added=0, over=(), region="", seed=0):
    """A generator: the request that settles the disturbed bodies, the objects, and whether each may move. `added`:
    how many props are dropped from above, over the given objects or the whole pile, or over the painted vertex
    group `region` of the shape. `seed`: another than the settings'; 0: theirs."""
    from .messages import v1

    settings = context.scene.cairn
    recipe = running.recipe_of(collection)
    found = pointers.read(collection.cairn.pointers)
    sources = result.sources_of(recipe, found)
    if None in sources:
        raise Fault("Some of the pile's props are not in the file any more. Bring them back first.")
    exporter = Exporter(context)
    props = yield from exporter.props(sources, middles_of(recipe))
    if exporter.problems:
        raise Fault("", problems=exporter.problems)
    root = roots.of(collection)
    if root is not None and not roots.is_home(root):
        raise Fault(
            f"The pile was moved, and it settles only where it was baked. Clear the transform of “{root.name}” (Alt G, "
            "Alt R, Alt S) and its animation first; afterward, move it again."
        )
    belongings.number_copies(collection)
    placed = Placed(collection, props)
    free = yield from placed.disturbed()
    if not any(free) and not added:
        raise Fault("Nothing was changed since the pile settled. Remove, replace, move or add bodies first.")
    statics = yield from exporter.scenery(request.colliders_of(settings))
    statics += yield from others.scenery(context, exporter, collection.cairn.control)

    scene_message = v1.Scene(
        seed=seed or settings.seed,
        gravity=request.gravity_of(context.scene),
        ground_friction=round(settings.collider_friction, 6),
        ground=settings.use_ground,
        ground_height=_ground(collection, settings) * exporter.metres,
    )
    request.set_accuracy(v1, scene_message, settings, exporter.metres)
    scene_message.glue.mode = v1.GLUE_MODE_NATURAL
    shape = _add_core(v1, scene_message, exporter, collection, recipe)
    scene_message.output.fps = context.scene.render.fps / context.scene.render.fps_base
    for prop, item in zip(props, _items(recipe, len(props))):
        scene_message.props.append(request.prop_message(v1, prop.model.uri, item))
    for _, model in statics:
        scene_message.statics.append(v1.StaticModel(path=model.uri, friction=round(settings.collider_friction, 6)))
    for body, is_free in zip(placed.objects, free):
        weighing.place(scene_message, _state(body), exporter.metres, kept=not is_free)
        yield
    places = None
    if added:
        largest = max(size * prop.scale_max for size, prop in zip(placed.sizes, scene_message.props))
        if region:
            places = _painted(context, exporter, collection, placed, region, largest)
            scene_message.emitters.add(rate=RATE, count=added, mesh=places.uri)
        else:
            _add_above(scene_message, placed, added, over, largest, exporter.metres)
    models = [*(prop.model for prop in props), *(model for _, model in statics), *filter(None, [places, shape])]
    assets = [v1.AssetReference(uri=model.uri, sha256=model.sha256) for model in models]
    names = {prop.model.uri: prop.source.name for prop in props}
    names.update((model.uri, source.name) for source, model in statics)
    recipe = {**recipe, "token": uuid.uuid4().hex, "names": names, "notes": [], "output_mode": "POSE"}
    spec = v1.BakeSpec(scene=scene_message, assets=assets)
    taken = request.Request(spec, exporter.contents, props, recipe, [], found)
    return taken, placed.objects, free


def _items(recipe, count):
    """The settings that each prop had for the bake."""
    settings = recipe["settings"]
    items = [item for item in settings["props"] if item["object"]] if settings["prop_source"] == "LIST" else []
    items += [settings["prop_common"]] * (count - len(items))
    return [SimpleNamespace(**item) for item in items[:count]]


def _add_core(v1, scene_message, exporter, collection, recipe):
    """Adds the core of a pile that is a shell: the server makes it from the shape, without filling the shape again."""
    fill = recipe["settings"].get("fill", {})
    if not fill.get("use_shell"):
        return None
    control = collection.cairn.control
    shape = exporter.region(control) if control else None
    if shape is None:
        raise Fault("The shape is not in the file any more. It is needed to make the core that the pile lies on.")
    scene_message.control_mesh.path = shape.uri
    scene_message.fill.method = v1.FILL_METHOD_OFF
    scene_message.fill.shell = float(f"{fill['shell']:.7g}")
    # Dropped props are outside the pile's shape.
    scene_message.effects.region = scene_message.report.shape = v1.SWITCH_OFF
    return shape


def _ground(collection, settings):
    control = collection.cairn.control
    if settings.use_ground_height or control is None:
        return settings.ground_height
    return min((control.matrix_world @ Vector(corner)).z for corner in control.bound_box)


def _add_above(scene_message, placed, count, over, largest, metres):
    """Props that fall, from a box above the pile. `largest`: the size of the largest of them."""
    below = [body for body in over if body in placed.objects] or placed.objects
    if below:
        places = np.array([body.location for body in below])
        low, high = places.min(axis=0), places.max(axis=0)
        top = max(body.location.z for body in placed.objects)
    else:
        low, high, top = np.zeros(3), np.zeros(3), 0.0
    size = np.maximum(high - low + MARGIN * largest, largest) * (1, 1, 0) + (0, 0, largest)
    middle = np.array([*((low + high) / 2)[:2], top + (ABOVE + 0.5) * largest])
    drops = scene_message.emitters.add(rate=RATE, count=count)
    drops.center.extend(axes.points_to_server(middle, metres).tolist())
    drops.size.extend(np.abs(axes.points_to_server(size, metres)).tolist())


def _painted(context, exporter, collection, placed, region, largest):
    """A block in which props appear: above the painted region, and above the bodies there."""
    control = collection.cairn.control
    if control is None:
        raise Fault("The shape is not in the file any more, and neither is the painted region.")
    edge, corner, found = painted.cells(context, control, region, largest / CELLS)
    low, high = corner - largest, corner + edge * np.array(found.shape) + largest
    bodies = [body.location for body in placed.objects]
    near = [place.z for place in bodies if np.all(low < place[:2]) and np.all(place[:2] < high)]
    bottom = max(near, default=_ground(collection, context.scene.cairn)) + ABOVE * largest
    return exporter.mesh("region", *painted.block(edge, corner, found, bottom, bottom + largest))


def applied(context, collection, objects, free, motion, recipe, record):
    """A generator like `result.build`: moves the free bodies to their resting poses, and makes new ones."""
    moved = result.BodyMotion(motion, {**recipe, "props": [{**prop, "is_shown": True} for prop in recipe["props"]]})
    found = pointers.read(collection.cairn.pointers)
    sources = result.sources_of(recipe, found)
    count = len(objects)
    made = parts.make(context, sources, [Matrix(prop["local"]) for prop in recipe["props"]], as_collections=False)
    yield 0.5
    number = max((body.cairn.number for body in objects), default=0)
    root = roots.of(collection)
    # Nothing is written before this, so that a stop changes nothing.
    fallen = []
    for index in range(len(moved.props)):
        is_there = bool(moved.present[-1, index])
        if index >= count:
            if is_there:
                number += 1
                body = result.still_body(made, moved, index, number)
                collection.objects.link(body)
                if root is not None:
                    roots.adopt(root, body)
        elif free[index] and is_there:
            objects[index].location = moved.positions[-1, index]
            objects[index].rotation_quaternion = moved.rotations[-1, index]
        elif free[index]:
            fallen.append(objects[index])
    loose = {objects[index].cairn.number for index in range(count) if free[index]}
    bpy.data.batch_remove(fallen)
    before = running.report_of(collection)
    stay = _dots_that_stay(collection, before.get("dots", ()), loose)
    note = {**before, **record, "dots": stay, "body_count": len(belongings.bodies(collection))}
    note["settled"] = {"moved": len(loose), "kept": count - len(loose), "added": max(0, len(moved.props) - count)}
    collection.cairn.report = json.dumps(note)
    collection.cairn.bake_id = record.get("bake_id", "")
    collection.cairn.states = ""
    props = [body.cairn.prop for body in belongings.bodies(collection)]
    collection.cairn.counts = json.dumps(np.bincount(props, minlength=len(recipe["props"])).tolist())
    remember(collection)
    carry(collection)
    belongings.note_data(collection, made)
    for body in belongings.bodies(collection):
        belongings.mark(body)
    pointers.forget(recipe)
    return collection


def _dots_that_stay(collection, dots, loose):
    """Dots between bodies that did not move. After a collapse there are none."""
    if "collapse_frame" in running.report_of(collection):
        return []
    here = {body.cairn.number for body in belongings.bodies(collection)} - loose
    ends = [[number_of(collection, body) for body in (dot["body"], dot["other"])] for dot in dots]
    return [dot for dot, own in zip(dots, ends) if all(number is None or number in here for number in own)]
