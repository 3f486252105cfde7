"""The bake that runs, for the operators that drive it and the panels that show it. One at a time."""

import copy
import json
import queue
import time

import bpy
import numpy as np

from . import dots, pending, pointers
from .job import Job
from .recording import Motion
from .time_left import TimeLeft, duration

STAGES = {
    "STAGE_SHAPE": "Splitting shapes",
    "STAGE_FILL": "Filling",
    "STAGE_GLUE": "Placing glue",
    "STAGE_RELEASE": "Releasing",
    "STAGE_HOLD": "Coming to rest",
    "STAGE_MEASURE": "Measuring",
}

# A body that moves less than this from a frame to the next, relative to the median diameter, is at rest.
REST = 1e-3

# How often a bake that only measures is polled, s.
TICK = 0.25

# The bake that runs or was stopped and waits for a decision; None if there is none.
bake = None
# The latest answer to "Check", for the panel; and whether the scene has changed since.
plan, plan_is_old = None, False
# Problems of the scene, for the panel; and the objects' names by the server's names for them.
problems, names = [], {}
# A bake of this file that was running when it was closed.
left = None
# Bakes whose pile is there already, while the server still measures it.
measuring = []
# Reports that arrived after their pile was made, by bake. Undo removes them from the collection.
_late = {}


class Bake:
    """A job with its progress."""

    def __init__(self, server):
        self.recipe = {}
        self.job = Job(server)
        self.state = "Reading props"
        self.accepted = self.progress = self.summary = self.fault = None
        self.left = TimeLeft()
        # "", "done", "stopped", "kept" or "failed".
        self.end = ""
        self.is_stopping = False
        # Whether the artist has ended it, because the pile rests enough.
        self.is_enough = False
        # What is drawn while a stopped bake waits for a decision.
        self.preview = None
        # What there was when it was stopped: more may still arrive.
        self.stopped_at = None
        # Share of the writing, once there is a result; and whether only what the pile replaces is left to be removed.
        self.written, self.is_closing = None, False
        self.began = time.monotonic()

    def ask(self, request):
        """Sets the request of the bake."""
        global names
        self.recipe = request.recipe
        names = request.recipe["names"]
        self.job.spec, self.job.contents, self.job.problems = request.spec, request.contents, request.problems
        if not request.problems:
            # Also of a file without a name: it may get one before the server has the request.
            self.job.kept = pending.request_folder(self.recipe)
            pending.note(self.recipe, "")

    def resume(self, recipe, bake_id):
        """Continues an earlier bake: the server has it, or its request is still kept."""
        self.recipe, self.job.bake_id = recipe, bake_id
        self.job.kept = pending.request_folder(recipe)

    def start(self):
        if not self.end:
            self.job.start()

    def stop(self):
        """Ends at once; the server is informed in the background."""
        self.is_stopping = True
        self.state = "Stopping"
        recording = copy.copy(self.job.recording)
        recording.frames = list(recording.frames)
        self.stopped_at = recording, self.job.latest
        self.job.stop()
        self.end = "stopped"
        self.summary = None
        pending.forget(self.recipe)

    @property
    def recording(self):
        return self.stopped_at[0] if self.stopped_at else self.job.recording

    @property
    def latest(self):
        return self.stopped_at[1] if self.stopped_at else self.job.latest

    def may_be_enough(self):
        """Whether there are frames that may be the whole result."""
        return self.frame_count > 1 and not self.end and not self.is_stopping and not self.is_closing

    def be_enough(self):
        """Ends the bake at the frames that there are, which are the result."""
        self.stop()
        self.is_enough = True
        self.keep()

    def hide(self):
        """Removes what is drawn of a stopped bake."""
        if self.preview:
            self.preview.remove()
            self.preview = None

    def kept_kind(self):
        """The text of the button that keeps the unfinished result; empty if there is none."""
        if self.frame_count:
            return f"Keep the {self.frame_count} Frames"
        latest = self.latest
        count = 0 if latest is None else int(latest.present.sum())
        return f"Keep the {count} Bodies as They Are" if count else ""

    def keep(self):
        """Uses the unfinished result as the result."""
        self.end, self.is_stopping = "kept", False
        if not self.frame_count:
            self.recipe = {**self.recipe, "output_mode": "POSE"}

    def motion(self):
        """The result; of a bake that was stopped during the fill, the bodies at their place in it."""
        return self.recording.motion() or Motion.of([self.latest])

    def poll(self, wait=0.0):
        """Reads the job's messages. Returns whether there were any."""
        is_new = False
        while not self.end:
            try:
                kind, what = self.job.messages.get(timeout=wait) if wait else self.job.messages.get_nowait()
            except queue.Empty:
                break
            is_new, wait = True, 0.0
            if kind == "state":
                self.state = what
            elif kind == "accepted":
                self.accepted, self.state = what, "Waiting for its turn"
                pending.note(self.recipe, what.bake_id)
            elif kind == "progress":
                self.progress = what
                known = what.remaining_seconds if what.HasField("remaining_seconds") else None
                self.left.hear(what.stage, known, time.monotonic())
            else:
                self.end = kind
                self.summary = what if kind == "done" else None
                self.fault = what if kind == "failed" else None
                pending.forget(self.recipe)
        return is_new

    @property
    def has_all_frames(self):
        """The pile can be made; only figures may be missing."""
        # The number is known before the last of them are here.
        is_measured = not self.end and 0 < self.frame_count == self.recording.count
        return self.end in ("done", "kept") or (is_measured and not self.is_stopping)

    @property
    def frame_count(self):
        """Frames of the result so far."""
        return len(self.recording.frames)

    def stage(self):
        if self.is_stopping or self.progress is None:
            return self.state
        from .messages import v1

        names = {getattr(v1, name): text for name, text in STAGES.items()}
        return names.get(self.progress.stage, self.state)

    def share(self):
        return self.progress.fraction if self.progress else 0.0

    def counts(self, most=None):
        """Counts of bodies by state, as one line of at most `most` figures."""
        progress = self.progress
        if progress is None or not progress.body_count:
            return ""
        parts = [f"{progress.body_count} bodies"]
        if 0 < progress.released_count < progress.body_count:
            parts.append(f"{progress.released_count} released")
        if progress.at_rest_count:
            parts.append(f"{progress.at_rest_count} at rest")
        if progress.nail_count:
            parts.append(f"{progress.nail_count} nails")
        return ", ".join(parts[:most])

    def time_left(self):
        if self.progress is None or self.is_stopping:
            return ""
        seconds = self.left.remaining(time.monotonic())
        if seconds is None:
            return "Time left: unknown"
        return f"{duration(seconds)} left in this stage" if seconds >= 1 else ""

    def line(self):
        """All of it, in one line."""
        if self.written is not None:
            return f"Making the objects, {self.written:.0%}"
        share = f"{self.share():.0%}" if self.progress and not self.is_stopping else ""
        left = self.time_left() if self.left.remaining(time.monotonic()) is not None else ""
        return ", ".join(part for part in (self.stage(), share, self.counts(), left) if part)

    def record(self):
        """Values that the result's collection remembers."""
        record = {
            "bake_id": self.job.bake_id,
            "is_whole": self.is_enough or (self.has_all_frames and self.end != "kept"),
        }
        record["warnings"] = []
        if self.recipe.get("keeps"):
            record["keeps"] = True
        if self.accepted:
            versions = self.accepted.versions
            record["versions"] = {"cairn": versions.cairn, "rapier3d": versions.rapier3d, "clarabel": versions.clarabel}
            record["warnings"] += self.accepted.plan.warnings
            record["accuracy"] = accuracy_names().get(self.accepted.effective_scene.accuracy, "")
        if self.summary:
            summary = self.summary
            record.update(
                result_hash=summary.result_blake3,
                body_count=summary.body_count,
                frame_count=summary.frame_count,
                frame_rate=summary.frame_rate,
                measures={
                    "at_rest_fraction": self.at_rest(),
                    **dict(sorted(summary.measures.items())),
                    "prop_diameter": self.prop_diameter(),
                },
                counts=dict(sorted(summary.counts.items())),
                warnings=list(summary.warnings),
                cpu_seconds=round(summary.cpu_seconds, 3),
                stage_seconds={name: round(value, 3) for name, value in sorted(summary.stage_seconds.items())},
                seconds=round(time.monotonic() - self.began, 3),
                dots=dots.remembered(self.job, self.job.report, self.recipe["metres"]),
            )
            if self.job.report.get("collapse"):
                record["collapse_frame"] = self.job.report["collapse"]["frame"]
        else:
            bodies = len(self.recording.props) if self.frame_count else int(self.latest.present.sum())
            record.update(body_count=bodies, frame_count=self.frame_count)
        if self.is_enough:
            share = self.at_rest()
            record["warnings"].append(
                f"the bake was ended at this frame by hand, with {share:.1%} of the bodies at rest"
            )
        record["warnings"] += self.recipe.get("notes", ())
        return record

    def at_rest(self):
        """Share of the bodies that did not move between the last two frames."""
        frames = self.recording.frames[-2:]
        before, after = frames[0], frames[-1]
        count = len(before.props)
        steps = np.linalg.norm(after.positions[:count] - before.positions[:count], axis=1)
        here = after.present[:count]
        return float((steps[here] < REST * self.prop_diameter()).mean()) if here.any() else 1.0

    def prop_diameter(self):
        """m. Without a fill, the measure of this name is 0."""
        measured = self.summary.measures.get("prop_diameter") if self.summary else 0.0
        return measured or self.accepted.plan.prop_diameter


def accuracy_names():
    """The names of the qualities, by their numbers in messages."""
    from .messages import v1

    return {number: name[9:] for name, number in vars(v1).items() if name.startswith("ACCURACY_")}


def report_of(collection):
    """The report that a result's collection stores."""
    try:
        report = json.loads(collection.cairn.report)
    except ValueError:
        report = {}
    return report if "measures" in report else _late.get(collection.cairn.bake_id, report)


def glue_of(report):
    """A summary of a pile's glue; empty if gluing was off."""
    share = report.get("measures", {}).get("glued_body_fraction")
    counts = report.get("counts", {})
    dots = counts.get("glue_dots", 0)
    if share is None:
        return ""
    if not dots:
        return "Nothing is glued."
    sentences = ["1 dot of glue joins" if dots == 1 else f"{dots} dots of glue join"]
    sentences[0] += f" {share:.0%} of the bodies."
    anchors = round(report["measures"].get("anchored") or 0)
    if anchors:
        dots_hold = "1 dot holds" if anchors == 1 else f"{anchors} dots hold"
        sentences.append(f"{dots_hold} the pile to the ground or to scenery.")
    broken = counts.get("glue_dots_broken", 0)
    if "collapse_frame" in report:
        # It ended all glue.
        sentences.insert(0, "Before the collapse:")
    elif broken:
        sentences.append(f"{broken} broke.")
    return " ".join(sentences)


def wait_for_report(made):
    """The pile of a bake is made without its report, which is added later."""
    measuring.append(made)
    if not bpy.app.timers.is_registered(_collect):
        bpy.app.timers.register(_collect, first_interval=TICK)


def _collect():
    for made in list(measuring):
        made.poll()
        if made.end:
            measuring.remove(made)
        if made.end == "done":
            record = _late[made.job.bake_id] = {**made.record(), **_by_hand(made.job.bake_id)}
            for collection in bpy.data.collections:
                if collection.cairn.is_result and collection.cairn.bake_id == made.job.bake_id:
                    collection.cairn.report = json.dumps(record)
                    collection.cairn.result_hash = record["result_hash"]
    for area in (area for window in bpy.context.window_manager.windows for area in window.screen.areas):
        if area.type == "VIEW_3D":
            area.tag_redraw()
    return TICK if measuring else None


def _by_hand(bake_id):
    """Data of edits by hand in the pile of a bake, which the bake does not have."""
    for collection in bpy.data.collections:
        if collection.cairn.is_result and collection.cairn.bake_id == bake_id and collection.cairn.settled:
            before = report_of(collection)
            return {name: before[name] for name in ("settled", "dots", "body_count") if name in before}
    return {}


def end():
    """Ends: no bake runs, and none waits for a decision."""
    global bake
    if bake is not None:
        pointers.forget(bake.recipe)
        bake.hide()
    bake = None


def forget_all():
    """Called when another file is opened or the add-on ends: the server continues, and nobody listens."""
    global bake, plan, left, problems
    for other in [bake, *measuring]:
        if other is not None:
            other.job.detach()
            other.hide()
    measuring.clear()
    bake = plan = left = None
    problems = []
    if bpy.app.timers.is_registered(_collect):
        bpy.app.timers.unregister(_collect)


def recipe_of(collection):
    try:
        return json.loads(collection.cairn.settings)
    except ValueError:
        return {}
