"""Certifies the untouched bodies of an edited pile, before and after the edit: the server analyzes all bodies at
their exact poses, without simulation."""

import json
from dataclasses import dataclass

import bpy
import numpy as np

from . import axes, job, running
from .messages import v1

# How often to poll for an answer, s.
TICK = 0.2

_under_way = []


def place(scene_message, state, metres, kept):
    """A body of a scene, by its state: prop, place, rotation, size."""
    prop, *numbers = state
    # Older files have no sizes.
    size = numbers[7] if len(numbers) > 7 else 1.0
    made = scene_message.bodies.add(prop=str(int(prop)), scale=round(size, 6), kept=kept)
    made.position.extend(axes.points_to_server(np.array(numbers[:3]), metres).tolist())
    made.rotation.extend(axes.rotations_to_server(np.array(numbers[3:7])).tolist())


def spec_of(taken, states):
    """A request that analyzes bodies, with the props and scenery of another request."""
    spec = v1.BakeSpec()
    spec.CopyFrom(taken.spec)
    scene_message = spec.scene
    del scene_message.bodies[:]
    del scene_message.emitters[:]
    for state in states:
        place(scene_message, state, taken.recipe["metres"], kept=True)
    # Everything that is not needed is left out.
    scene_message.accuracy = v1.ACCURACY_DRAFT
    scene_message.output.frames = 0
    scene_message.effects.frames = v1.SWITCH_OFF
    scene_message.report.shape = scene_message.report.pictures = v1.SWITCH_OFF
    scene_message.report.support = v1.SWITCH_ON
    return spec


@dataclass
class Weighing:
    """The same bodies, before and after. `before`: their states by number; `same`: the numbers of those that stay."""

    server: object
    taken: object
    before: dict
    same: set
    bake_id: str = ""
    numbers: tuple = ()
    jobs: tuple = ()

    def begin(self, bake_id, after):
        """`after`: the states by number, once the pile has settled. The analysis runs in the background."""
        self.bake_id = bake_id
        self.numbers = list(self.before), list(after)
        specs = (spec_of(self.taken, states.values()) for states in (self.before, after))
        self.jobs = tuple(job.Job(self.server, spec, self.taken.contents, has_fill=False) for spec in specs)
        for asked in self.jobs:
            asked.start()
        _under_way.append(self)
        if not bpy.app.timers.is_registered(_collect):
            bpy.app.timers.register(_collect, first_interval=TICK)

    def poll(self):
        """Whether both are known."""
        for asked in self.jobs:
            while not asked.messages.empty():
                asked.end = asked.messages.get()[0]
        return all(asked.end in ("done", "stopped", "failed") for asked in self.jobs)

    def standing(self):
        """How many untouched bodies are certified, before and after; None if unknown."""
        return [self._standing(*pair) for pair in zip(self.jobs, self.numbers)]

    def _standing(self, asked, numbers):
        if asked.report.get("measures", {}).get("unsupported_fraction") is None:
            return None
        return len(self.same - {numbers[body] for body in asked.report["unsupported"]})


def collect():
    """Writes finished analyses into the reports of the piles. Returns whether more are running."""
    for weighing in list(_under_way):
        if not weighing.poll():
            continue
        _under_way.remove(weighing)
        for collection in bpy.data.collections:
            if collection.cairn.settled and collection.cairn.bake_id == weighing.bake_id:
                note = running.report_of(collection)
                note["settled"]["standing"] = weighing.standing()
                collection.cairn.report = json.dumps(note)
    return bool(_under_way)


def _collect():
    is_more = collect()
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            area.tag_redraw()
    return TICK if is_more else None


def said(report):
    """A sentence about the certified bodies of a report; empty before they are known."""
    before, after = report["settled"].get("standing", (None, None))
    if before is None or after is None:
        return ""
    if after >= before:
        return "The edit did not weaken the rest"
    lost = before - after
    bodies = "1 untouched body is" if lost == 1 else f"{lost} untouched bodies are"
    return f"The edit weakened the rest: {bodies} no longer certain to stand"


def forget():
    """Called when another file is opened or the add-on ends."""
    for weighing in _under_way:
        for asked in weighing.jobs:
            asked.detach()
    _under_way.clear()
    if bpy.app.timers.is_registered(_collect):
        bpy.app.timers.unregister(_collect)
