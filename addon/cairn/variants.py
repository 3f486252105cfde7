"""Variants: several seeds are baked one after the other, shown, and one is kept. The server has the results; the file
remembers their ids."""

import json
import time

import bpy

from . import client, export, job, pointers, preferences, preview, request, result, running
from .client import Fault
from .following import start_frame
from .messages import v1

# How often messages are read, and how long Blender may be busy at a time, s.
TICK = 0.1
SLICE = 0.015
# Edge of a thumbnail, pixels.
THUMBNAIL = 128

# Bake id of the variant that is drawn over the view; empty if none is.
shown = ""
_icons = None
_trials = None
# A bake that is being fetched: its id, and the generator that fetches it.
_fetched, _steps = "", None
# Last poses, and the props for drawing, of this session, by bake.
_poses, _drawn = {}, {}
_preview = None


class _Trials:
    """A queue of bakes for a scene."""

    def __init__(self, scene, wanted):
        self.scene, self.wanted = scene.name, list(wanted)
        self.count = len(self.wanted)
        self.slices = self._read(bpy.context, scene)
        self.taken = self.drawn = self.job = None
        self.progress = 0.0

    def _read(self, context, scene):
        with start_frame(context):
            taken = yield from request.taking(context)
        if taken.problems:
            raise Fault("", problems=taken.problems)
        drawn = yield from preview.drawn(taken.props)
        return taken, drawn

    def step(self):
        """Whether there is more to do."""
        if self.slices:
            if not request.advance(self.slices, SLICE, self._take):
                self.slices = None
        elif self.job:
            self._follow()
        elif self.wanted:
            self._start(*self.wanted.pop(0))
        else:
            return False
        return True

    def _take(self, value):
        self.taken, self.drawn = value

    def _start(self, name, change):
        spec = v1.BakeSpec()
        spec.CopyFrom(self.taken.spec)
        recipe = json.loads(json.dumps(self.taken.recipe))
        change(spec.scene, recipe["settings"])
        self.name, self.recipe, self.progress = name, recipe, 0.0
        self.job = job.Job(preferences.server(bpy.context), spec, self.taken.contents, has_fill=False)
        self.job.start()

    def _follow(self):
        while not self.job.messages.empty():
            kind, what = self.job.messages.get()
            if kind == "progress":
                self.progress = what.fraction
            elif kind == "failed":
                raise what
            elif kind == "done":
                self._done(what)
                self.job = None
                return

    def _done(self, summary):
        scene = bpy.data.scenes.get(self.scene)
        if scene is None:
            return
        entry = scene.cairn_variants.get(self.name) or scene.cairn_variants.add()
        entry.name, entry.bake_id, entry.recipe = self.name, self.job.bake_id, json.dumps(self.recipe)
        dots = summary.counts.get("glue_dots", 0)
        entry.summary = f"{summary.body_count} bodies, " + (f"{dots} dots" if dots else "no glue")
        pointers.write(entry.pointers, self.taken.pointers)
        remember(entry.bake_id, self.job.recording.frames[-1], self.drawn, self.recipe["metres"])

    def status(self):
        at = self.count - len(self.wanted)
        return "Reading props" if self.slices else f"Variant {at} of {self.count}, {self.progress:.0%}"

    def stop(self):
        if self.slices:
            self.slices.close()
        if self.job:
            self.job.stop()


def remember(bake_id, snapshot, drawn, metres):
    """Keeps a bake's pose and props for this session."""
    _poses[bake_id], _drawn[bake_id] = (snapshot, metres), drawn
    if not bpy.app.background:
        _thumbnail(bake_id)


def _thumbnail(bake_id):
    from bpy.utils import previews

    global _icons
    _icons = _icons or previews.new()
    (snapshot, metres), drawn = _poses[bake_id], _drawn[bake_id]
    pixels = preview.picture(drawn, metres, snapshot, THUMBNAIL)
    made = _icons[bake_id] if bake_id in _icons else _icons.new(bake_id)
    made.icon_size = made.image_size = THUMBNAIL, THUMBNAIL
    made.icon_pixels_float = made.image_pixels_float = pixels.ravel()


def icon(bake_id):
    """The number of a thumbnail; 0 if there is none."""
    return _icons[bake_id].icon_id if _icons and bake_id in _icons else 0


def is_trying():
    return _trials is not None


def status():
    """The progress of the trials, in one line."""
    return _trials.status() if _trials else ""


def begin(scene, wanted):
    """`wanted`: pairs of a name, and a function that changes the scene's message and the settings."""
    global _trials
    stop()
    _trials = _Trials(scene, wanted)
    if not bpy.app.background:
        bpy.app.timers.register(_turn, first_interval=0.0)


def finish():
    """Without a window: runs all trials, and raises their faults."""
    while _trials and _trials.step():
        if _trials.job:
            time.sleep(request.PAUSE)
    stop()


def _turn():
    try:
        is_more = _trials is not None and _trials.step()
    except Fault as fault:
        running.problems = fault.problems or [client.Problem(fault.message)]
        is_more = False
    if not is_more:
        stop()
    preview.redraw(bpy.context, "UI")
    return TICK if is_more else None


def stop():
    global _trials
    if _trials:
        _trials.stop()
    _trials = None


def is_here(entry):
    """Whether it can be shown without asking the server."""
    return entry.bake_id in _poses


def load(context, entry):
    """A generator: gets an earlier bake from the server. It yields `request.WAITING` while there is nothing to do."""
    recipe = json.loads(entry.recipe)
    sources = result.sources_of(recipe, pointers.read(entry.pointers))
    if None in sources:
        raise Fault(
            "Some props of this variant are not in the file any more. Bring them back, or bake the variant again."
        )
    exporter = export.Exporter(context)
    props = yield from exporter.props(sources, export.middles_of(recipe))
    drawn = yield from preview.drawn(props)
    fetched = job.Job(preferences.server(context), bake_id=entry.bake_id, has_fill=False)
    fetched.start()
    kind = ""
    try:
        while kind != "done":
            # Nothing to do before there are messages.
            yield request.WAITING
            kind, what = ("", None) if fetched.messages.empty() else fetched.messages.get()
            if kind == "failed":
                raise what
    finally:
        if kind != "done":
            fetched.detach()
    remember(entry.bake_id, fetched.recording.frames[-1], drawn, recipe["metres"])


def fetch(context, entry):
    """Gets an earlier bake in the background, and then draws it. It replaces one that is being fetched."""
    global _fetched, _steps
    forget_fetched()
    _fetched, _steps = entry.bake_id, load(context, entry)
    if not bpy.app.timers.is_registered(fetch_on):
        bpy.app.timers.register(fetch_on, first_interval=0.0)


def is_fetched(entry):
    """Whether it is being fetched."""
    return _steps is not None and entry.bake_id == _fetched


def is_at(entry):
    """Whether it is drawn, or will be."""
    return is_fetched(entry) or (bool(shown) and entry.bake_id == shown)


def fetch_on():
    """One tick of the timer."""
    global _steps
    if _steps is None:
        return None
    is_more = False
    try:
        is_more = request.advance(_steps, SLICE, lambda _: None)
        if not is_more:
            _steps = None
            show(_fetched)
    except (Fault, ReferenceError) as fault:
        # The entry's file or props may have gone meanwhile.
        _steps = None
        if isinstance(fault, Fault):
            running.problems = fault.problems or [client.Problem(fault.message)]
    preview.redraw(bpy.context)
    return TICK if is_more else None


def forget_fetched():
    global _steps
    if _steps is not None:
        _steps.close()
        _steps = None


def show(bake_id):
    """Draws one over the view; none, with an empty id."""
    global shown, _preview
    forget_fetched()
    if _preview:
        _preview.remove()
        _preview = None
    shown = bake_id if bake_id in _poses else ""
    if shown:
        (snapshot, metres), drawn = _poses[shown], _drawn[shown]
        _preview = preview.Preview(drawn, metres)
        _preview.update(snapshot)
    preview.redraw(bpy.context)


def forget():
    """Called when another file is opened or the add-on ends."""
    global _icons
    stop()
    show("")
    _poses.clear()
    _drawn.clear()
    if _icons:
        from bpy.utils import previews

        previews.remove(_icons)
        _icons = None
