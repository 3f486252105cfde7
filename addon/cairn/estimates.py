"""What each accuracy is expected to cost. While the tab is seen, the server is asked whenever the scene has changed and
then was left alone for a moment. The scene is only read, object by object, so that nobody waits for it."""

import time

import bpy

from . import fingerprint, job, preferences, preview, request, running
from .client import Fault
from .messages import v1

# How often the scene is looked at, and how long after the tab was last drawn, s.
TICK = 0.7
SEEN = 5.0
# While it is read: how long at a time, and the pause between, s.
SLICE = 0.01
PAUSE = 0.02

_seen_at = 0.0
_answer = _slices = None
# The scene as it was last looked at, and as it was last asked about.
_before = _asked = None
# There is more of the scene than is read in passing.
is_too_much = False


def take(plan, accuracy):
    """A plan has come: the panel shows it."""
    running.plan_is_old = False
    names = {number: name[9:] for name, number in vars(v1).items() if name.startswith("ACCURACY_")}
    running.plan = {
        "accuracy": accuracy,
        "body_count": plan.expected_body_count,
        "step_count": plan.expected_step_count,
        "warnings": list(plan.warnings),
        "effects": [(effect.name, effect.on, effect.reason) for effect in plan.effects],
        "dots": {names[estimate.accuracy]: getattr(estimate, "glue_dots", 0.0) for estimate in plan.estimates},
        "kept": {
            names[estimate.accuracy]: (estimate.kept_shape_low, estimate.kept_shape_high) for estimate in plan.estimates
        },
        "estimates": {names[estimate.accuracy]: (estimate.cpu_seconds, estimate.factor) for estimate in plan.estimates},
        "overlaps": {names[estimate.accuracy]: getattr(estimate, "overlap", 0.0) for estimate in plan.estimates},
    }


def shown(context):
    """The tab is being drawn."""
    global _seen_at
    _seen_at = time.monotonic()
    chosen = preferences.of(context)
    # A scene is sent to another computer only on request.
    may_ask = chosen.server == "LOCAL" and chosen.estimates
    if may_ask and not bpy.app.background and not bpy.app.timers.is_registered(_look):
        bpy.app.timers.register(_look, first_interval=TICK)


def asked(context):
    """The button has asked about the scene as it is now."""
    global _asked
    _asked = fingerprint.of(context.scene)


def _look():
    """Now and then: takes an answer, reads on, or begins to ask."""
    global _before, _asked, _answer, is_too_much
    if time.monotonic() - _seen_at > SEEN and _answer is None:
        return None
    if _slices is not None:
        _read_on()
        return PAUSE
    context = bpy.context
    if _answer is not None:
        if _answer.done():
            answer, _answer = _answer, None
            _receive(answer)
        elif fingerprint.of(context.scene) != _asked:
            _give_up()
        return TICK
    if running.bake is not None or context.mode != "OBJECT" or request.missing(context.scene.cairn):
        return TICK
    now = fingerprint.of(context.scene)
    is_too_much = now is None
    if now != _asked:
        running.plan_is_old = True
        if now is None:
            # Old figures would stay for good.
            running.plan = None
        elif now == _before:
            _asked = now
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
        # The scene has changed on the way.
        _slices = None


def _receive(answer):
    try:
        take(answer.result().plan, bpy.context.scene.cairn.accuracy)
        # The problems have been fixed.
        running.problems = []
    except Fault:
        running.plan = None
    preview.redraw(bpy.context, "UI")


def stand_aside(scene):
    """A bake begins: nothing else may keep the server busy, and estimates of another scene are dropped."""
    if _asked != fingerprint.of(scene):
        running.plan_is_old = True
    _give_up()


def _give_up():
    global _answer, _asked, _slices
    if _answer is not None:
        _answer.cancel()
    if _answer is not None or _slices is not None:
        _answer = _asked = _slices = None


def forget():
    """Another file is opened, or the add-on ends."""
    global _before, _asked
    _give_up()
    _before = _asked = None
    if bpy.app.timers.is_registered(_look):
        bpy.app.timers.unregister(_look)
