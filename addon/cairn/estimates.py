"""The expected cost of each accuracy. While the tab is visible, the add-on asks the server after each change of the
scene, once the scene stays unchanged for a moment. It only reads the scene, object by object, so that Blender
stays responsive."""

import os
import time

import bpy

from . import fingerprint, job, preferences, preview, request, running
from .client import Fault

# How often the scene is checked, and for how long after the tab was last drawn, s.
TICK = 0.7
SEEN = 5.0
# Reading: time per slice, and the pause between slices, s.
SLICE = 0.01
PAUSE = 0.02

_seen_at = 0.0
_answer = _slices = None
# The scene at the last check, at the last request, and the one that the figures are of.
_before = _asked = _planned = None
# The scene and the shape that figures and problems are of, by name.
_subject = None
# Whether the scene is too large to be read for estimates.
is_too_much = False


def take(answer):
    """Takes the answer about a plan for the panel."""
    global _planned
    running.plan_is_old, _planned = False, _asked
    plan, names, busy = answer.plan, running.accuracy_names(), waiting()
    running.plan = {
        # The preset that the bake would have; with the automatic quality, the server has chosen it.
        "accuracy": names[answer.effective_scene.accuracy],
        "warnings": list(plan.warnings),
        # The parts of the shape that are too thin for the props: how many, and their share of its volume.
        "thin": (len(plan.thin_parts), sum(part.volume_share for part in plan.thin_parts)),
        # How many times as large props fill these parts, too; 0 where no size is known.
        "fitting_scale": getattr(plan, "fitting_scale", 0.0),
        # The match with the shape that is expected; 0 where it is not known.
        "match": getattr(plan, "expected_match", 0.0),
        "dots": {names[estimate.accuracy]: getattr(estimate, "glue_dots", 0.0) for estimate in plan.estimates},
        "kept": {
            names[estimate.accuracy]: (estimate.kept_shape_low, estimate.kept_shape_high) for estimate in plan.estimates
        },
        # The time that nine of ten bakes do not exceed, s. Beside other work they may take longer.
        "times": {
            names[estimate.accuracy]: (getattr(estimate, "wall_seconds", 0.0) or estimate.cpu_seconds)
            * estimate.factor
            * busy
            for estimate in plan.estimates
        },
        # What else is expected of each: bodies, and CPU seconds.
        "others": {
            names[estimate.accuracy]: (estimate.body_count, estimate.cpu_seconds) for estimate in plan.estimates
        },
        "overlaps": {names[estimate.accuracy]: getattr(estimate, "overlap", 0.0) for estimate in plan.estimates},
    }


def preset_of(settings):
    """The chosen quality; of the automatic one, the preset that the server has chosen, or none yet."""
    if settings.accuracy != "AUTO":
        return settings.accuracy
    return running.plan["accuracy"] if running.plan else ""


def bodies(settings):
    """The expected number of bodies, of the chosen quality; 0 before it is known."""
    known = running.plan["others"].get(preset_of(settings)) if running.plan else None
    return known[0] if known else 0


def waiting():
    """By how much a bake on this machine may take longer, because other work is waiting for its processors."""
    try:
        return 1.0 + os.getloadavg()[0] / os.cpu_count()
    except (AttributeError, OSError):
        # Not every system says.
        return 1.0


def subject_of(scene):
    shape = scene.cairn.control_mesh
    return scene.name, shape.name if shape else ""


def shown(context):
    """Called when the tab is drawn."""
    global _seen_at, _subject
    _seen_at = time.monotonic()
    if _subject not in (None, subject_of(context.scene)):
        # Figures and problems go with their shape.
        running.plan, running.problems, _subject = None, [], subject_of(context.scene)
    if bpy.app.background or bpy.app.timers.is_registered(_look):
        return
    # Figures that were asked for by the button become old, too.
    if may_ask(context) or running.plan:
        bpy.app.timers.register(_look, first_interval=TICK)


def may_ask(context):
    """Whether the add-on asks by itself. A scene is sent to another computer only on request."""
    chosen = preferences.of(context)
    return chosen.server == "LOCAL" and chosen.estimates


def asked(context):
    """Called when the button has asked about the current scene."""
    global _asked, _subject
    _asked, _subject = fingerprint.of(context.scene), subject_of(context.scene)


def _look():
    """The timer: takes an answer, reads the next part, or starts a request. Figures of another scene become old."""
    global _before, _asked, _planned, _subject, _answer, is_too_much
    # What was begun is ended: nothing would call it again until the panel is drawn the next time.
    if time.monotonic() - _seen_at > SEEN and _answer is None and _slices is None:
        return None
    if _slices is not None:
        _read_on()
        return PAUSE
    context = bpy.context
    if running.bake is not None:
        return TICK
    now = fingerprint.of(context.scene)
    if context.mode != "OBJECT":
        # What is edited there is not seen.
        _asked = _planned = ""
    is_old = now != _planned
    if running.plan and running.plan_is_old != is_old:
        running.plan_is_old = is_old
        preview.redraw(context, "UI")
    if _answer is not None:
        if _answer.done():
            answer, _answer = _answer, None
            _receive(answer)
        elif now != _asked:
            _give_up()
        return TICK
    if context.mode != "OBJECT" or request.missing(context.scene.cairn) or not may_ask(context):
        return TICK
    is_too_much = now is None
    if now != _asked:
        if now is None:
            # Old figures would stay forever.
            running.plan = None
        elif now == _before:
            _asked, _subject = now, subject_of(context.scene)
            _begin(context)
        preview.redraw(context, "UI")
    _before = now
    return TICK


def _begin(context):
    global _slices
    _slices = request.taking(context, passive=True)


def _read_on():
    global _answer, _slices
    until = time.monotonic() + SLICE
    try:
        next(_slices)
        while time.monotonic() < until:
            next(_slices)
    except StopIteration as end:
        _slices = None
        try:
            taken = end.value
            if not taken.problems:
                running.names = taken.recipe["names"]
                _answer = job.plan(preferences.server(bpy.context), taken.spec, taken.contents)
        except Fault:
            # Check and Bake report it.
            running.plan = None
    except (Fault, ReferenceError):
        # The scene has changed meanwhile.
        _slices = None


def _receive(answer):
    try:
        take(answer.result())
        # The problems have been fixed.
        running.problems = []
    except Fault:
        running.plan = None
    preview.redraw(bpy.context, "UI")


def stand_aside(scene):
    """Called when a bake begins: stops requests that would keep the server busy, and marks estimates of another scene
    as old."""
    running.plan_is_old = _planned != fingerprint.of(scene)
    _give_up()


def _give_up():
    global _answer, _asked, _slices
    if _answer is not None:
        _answer.cancel()
    if _answer is not None or _slices is not None:
        _answer = _asked = _slices = None


def forget():
    """Called when another file is opened or the add-on ends."""
    global _before, _asked, _planned, _subject
    _give_up()
    _before = _asked = _planned = _subject = None
    if bpy.app.timers.is_registered(_look):
        bpy.app.timers.unregister(_look)
