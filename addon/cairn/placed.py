"""Parts of a scene besides the fill: moving scenery, a region, bodies that stay, are thrown or drop in."""

import numpy as np
from mathutils.geometry import interpolate_bezier

from . import axes, dots, keyframes, result
from .client import Problem
from .export import OWN
from .schema import knows

# A scale that changes by more than this while a collider moves cannot be followed.
SAME_SCALE = 1e-3
# Frames that are read before Blender may draw.
BATCH = 8
# Points of a curve between two of its own.
PIECES = 16


def is_animated(source):
    """Whether an object moves over time, by itself or with a parent."""
    while source:
        if source.animation_data and (source.animation_data.action or source.animation_data.drivers):
            return True
        if source.constraints or source.rigid_body:
            return True
        source = source.parent
    return False


def moving(context, colliders):
    """The colliders whose motion is followed."""
    if not knows("Keyframe"):
        return []
    view = set(context.view_layer.objects)
    # Blender does not evaluate hidden objects.
    return [source for source in colliders if is_animated(source) and source in view and source.visible_get()]


def comes_from_a_place(settings):
    """Whether bodies that come in come from one place."""
    entrance = settings.entrance
    return entrance.use_kind and entrance.kind in ("POUR", "THROW")


def follows_a_line(settings):
    """Whether bodies that come in land along a line."""
    entrance = settings.entrance
    is_used = entrance.use_kind and entrance.kind != "NONE"
    return is_used and entrance.use_order and entrance.order == "ALONG"


def line_of(curve):
    """Points of the first spline of a curve, in the scene's space."""
    spline = next(iter(curve.data.splines), None)
    if spline is None:
        return []
    points = [point.co.to_3d() for point in spline.points]
    for left, right in zip(spline.bezier_points, spline.bezier_points[1:]):
        points += interpolate_bezier(left.co, left.handle_right, right.handle_left, right.co, PIECES)
    return [curve.matrix_world @ point for point in points]


class Extras:
    """Adds these parts to a scene's message, and keeps their data for the caller."""

    def __init__(self, v1, scene_message, exporter, settings):
        self.v1, self.scene_message, self.exporter, self.settings = v1, scene_message, exporter, settings
        self.models, self.names = [], {}
        # The paths of colliders that move, by their objects.
        self.moved = {}
        # Props of bodies placed by hand alone, after those of the fill; and those of bodies that stay.
        self.props, self.kept = [], []

    def _add(self, model, source):
        self.models.append(model)
        self.names[model.uri] = source.name
        return model.uri

    def _frame(self, number):
        """A frame of the scene, as one of the result."""
        return max(0, number - self.settings.start_frame)

    def _pose(self, message, location, rotation):
        message.position.extend(axes.points_to_server(np.array(location), self.exporter.metres).tolist())
        message.rotation.extend(axes.rotations_to_server(np.array(rotation)).tolist())

    def add_region(self):
        if self.settings.region and knows("Body"):
            model = self.exporter.region(self.settings.region)
            if model:
                self.scene_message.region.path = self._add(model, self.settings.region)

    def add_drops(self):
        settings = self.settings
        if settings.drop_mesh and knows("Emitter"):
            model = self.exporter.region(settings.drop_mesh)
            if model is None:
                return
            place = self._add(model, settings.drop_mesh)
            drops = self.scene_message.emitters.add(
                mesh=place, rate=round(settings.drop_rate, 6), count=settings.drop_count
            )
            drops.velocity.extend(velocity(settings.drop_velocity))
            drops.start_frame = self._frame(settings.drop_frame)

    def add_entrance(self):
        """Where bodies that come in come from, and the line that they follow."""
        if not knows("Entrance"):
            return
        settings, entrance = self.settings, self.scene_message.entrance
        source, curve = settings.entrance_source, settings.entrance_curve
        if source and comes_from_a_place(settings):
            place = np.array(source.matrix_world.translation)
            entrance.source.extend(axes.points_to_server(place, self.exporter.metres).tolist())
        points = line_of(curve) if curve and follows_a_line(settings) else []
        if len(points) > 1:
            entrance.curve.extend(axes.points_to_server(np.array(points), self.exporter.metres).ravel().tolist())

    def add_collapse(self):
        """How the pile comes down in the end."""
        settings = self.settings
        if not settings.use_collapse or not knows("Collapse"):
            return
        collapse = self.scene_message.collapse
        # The server counts from Blender's -Y toward X.
        collapse.azimuth = round((settings.collapse_angle + 90.0 + 180.0) % 360.0 - 180.0, 6)
        if settings.use_collapse_first:
            pile = result.existing(settings.id_data, settings.control_mesh)
            collapse.number = dots.body_of(pile, settings.collapse_first)
        if settings.use_collapse_frame:
            collapse.start_frame = self._frame(settings.collapse_frame)

    def add_bodies(self, keep, impact):
        """Objects that stay, and objects that are thrown."""
        settings = self.settings
        if not knows("Body"):
            return
        for prop in (yield from self._placed(keep)):
            self._body(prop).kept = True
            self.kept.append(prop)
        for prop in (yield from self._placed(impact)):
            body = self._body(prop)
            body.velocity.extend(velocity(settings.impact_velocity))
            body.start_frame = self._frame(settings.impact_frame)
            if settings.use_impact_mass:
                body.mass = round(settings.impact_mass, 6)

    def _placed(self, sources):
        """Props that the fill does not use."""
        props = yield from self.exporter.props(sources, OWN)
        for prop in props:
            self.scene_message.props.add(path=self._add(prop.model, prop.source), weight=0.0)
        self.props += props
        return props

    def _body(self, prop):
        body = self.scene_message.bodies.add(
            prop=str(len(self.scene_message.props) - len(self.props) + self.props.index(prop))
        )
        location, rotation, _ = prop.frame.decompose()
        self._pose(body, location, rotation)
        return body

    def add_moving(self, context, sources):
        """Moving colliders, with a pose for each frame that interpolation between its neighbors does not give."""
        if not sources:
            return
        friction = round(self.settings.collider_friction, 6)
        models = yield from self.exporter.props(sources)
        sources = [model.source for model in models]
        positions, rotations = yield from self._poses(context, sources)
        keyed = keyframes.needed(positions, rotations)
        for number, prop in enumerate(models):
            self.moved[prop.source] = self._add(prop.model, prop.source)
            scenery = self.scene_message.statics.add(path=self.moved[prop.source], friction=friction)
            for frame in np.flatnonzero(keyed[:, number]):
                key = scenery.keyframes.add(frame=float(frame))
                self._pose(key, positions[frame, number], rotations[frame, number])

    def _poses(self, context, sources):
        """Positions [f, n, 3] and rotations [f, n, 4] in Blender's space, from the start frame on."""
        scene, settings = context.scene, self.settings
        last = settings.frame_count if settings.use_frame_count else scene.frame_end - settings.start_frame
        positions, rotations, sizes = [], [], []
        frames = range(settings.start_frame, settings.start_frame + max(last, 0) + 1)
        for first in range(0, len(frames), BATCH):
            # Between two batches, Blender shows its own frame again.
            try:
                for frame in frames[first : first + BATCH]:
                    scene.frame_set(frame)
                    graph = context.evaluated_depsgraph_get()
                    places = [source.evaluated_get(graph).matrix_world.decompose() for source in sources]
                    positions.append([tuple(location) for location, _, _ in places])
                    rotations.append([tuple(rotation) for _, rotation, _ in places])
                    sizes.append([tuple(scale) for _, _, scale in places])
            finally:
                scene.frame_set(settings.start_frame)
            yield
        changes = np.ptp(np.array(sizes), axis=0).max(axis=1)
        for source, change in zip(sources, changes):
            if change > SAME_SCALE:
                message = (
                    f"The collider “{source.name}” changes its size. Only its movement and rotation can be followed: "
                )
                self.exporter.problems.append(Problem(message + "remove the animation of its scale.", source.name))
        return np.array(positions), np.array(rotations)


def velocity(vector):
    """m/s, in the server's axes."""
    return [round(float(value), 6) for value in axes.points_to_server(np.array(vector))]
