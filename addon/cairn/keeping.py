"""*Keep What Fits*: a bake that changes the pile's last one. The server keeps the bodies that nothing new is near, to
the bit; here, they keep their objects."""

import json

from . import belongings, dots, keyframes, parts, roots, running
from .client import Fault, Problem

# Why the server cannot use an earlier bake, as it names the reason; and what it says of one that goes on.
REFUSED, GOES_ON = "EARLIER_BAKE", "is not finished"
LOST = (
    "The server no longer has the last bake of this pile, so nothing can be kept. Untick “Keep What Fits” to fill the "
    "whole shape again."
)
LATER = "The last bake of this pile is still being measured. Try again in a moment."


def may_keep(pile):
    """Whether the next bake can change this pile: it was baked, and not edited by hand since."""
    return pile is not None and bool(pile.cairn.bake_id) and pile.cairn.is_whole and not pile.cairn.settled


def ask(context, taken):
    """Lets a request change the shape's pile, if the artist wants that."""
    from . import result

    control = context.scene.cairn.control_mesh
    pile = result.existing(context.scene, control)
    if may_keep(pile) and pile.cairn.use_keep:
        taken.spec.from_bake_id = pile.cairn.bake_id
        taken.recipe["keeps"] = True


def explained(fault):
    """A fault in the artist's words."""
    if fault.reason != REFUSED:
        return fault
    return Fault("", REFUSED, [Problem(LATER if GOES_ON in fault.message else LOST)])


def forget_problems():
    """The artist has answered."""
    running.problems = [problem for problem in running.problems if problem.text not in (LOST, LATER)]


def draw(layout, pile):
    """Draws the choice below the button."""
    if may_keep(pile):
        layout.prop(pile.cairn, "use_keep")


def said(report):
    """What became of the bodies of the pile before, in a few words; empty if the bake did not change one."""
    counts = report.get("counts", {}) if report.get("keeps") else {}
    return ", ".join(f"{counts.get(f'bodies_{what}', 0)} {what}" for what in ("kept", "moved", "new", "gone") if counts)


def labels(moved, recipe):
    """The numbers in the bodies' names. [n]: those of the server, counted from 1, where a pile was changed."""
    if recipe.get("keeps") and moved.numbers is not None:
        return (moved.numbers + 1).tolist()
    return list(range(1, len(moved.props) + 1))


def label_of(pile, number):
    """The number in the name of a body."""
    known = json.loads(pile.cairn.labels or "[]")
    return known[number - 1] if 0 < number <= len(known) else number


def objects_kept(before, own, others, made, moved, mode):
    """The objects of the pile before that go on, by the places of their bodies in the new one: what the bake made, and
    of what the artist changed, bodies that are where they were. `made`: the new objects."""
    if "POINTS" in (mode, before.cairn.mode):
        return {}
    known = json.loads(before.cairn.labels or "[]")

    def number(shown):
        own = shown.cairn.number
        return known[own - 1] - 1 if 0 < own <= len(known) else dots.body_of(before, own)

    is_unchanged = belongings.Unchanged(before)
    changed = [shown for shown in others if is_unchanged.first.get(shown.cairn.number) == shown]
    found = {number(shown): shown for shown in [*own, *changed]}
    own, kept, root = set(own), {}, roots.of(before)
    for place, new in enumerate(made):
        old = found.get(int(moved.numbers[place]))
        if old is not None and old.type == new.type and (old in own or _is_there(old, new, root)):
            kept[place] = old
    return kept


def _is_there(old, new, root):
    """Whether a body that the artist has changed is where the bake has it: its looks were changed alone."""
    places = [(*shown.location, *shown.rotation_quaternion, *shown.scale) for shown in (old, new)]
    is_still = all(shown.animation_data is None or not shown.animation_data.action for shown in (old, new))
    return is_still and old.parent == root and old.rotation_mode == new.rotation_mode and places[0] == places[1]


def hand_over(old, new, is_changed):
    """Gives an object of the pile before what the bake has for it. `is_changed`: by the artist, whose looks stay."""
    had_action = old.animation_data is not None and old.animation_data.action is not None
    old.cairn.number, old.cairn.prop, old.cairn.size = new.cairn.number, new.cairn.prop, new.cairn.size
    if not is_changed:
        if had_action or new.hide_viewport:
            old.hide_viewport, old.hide_render = new.hide_viewport, new.hide_render
        keyframes.move(new, old)
        old.location, old.rotation_quaternion, old.scale = new.location, new.rotation_quaternion, new.scale
        if old.data != new.data:
            old.data = new.data
        if old.instance_collection != new.instance_collection:
            old.instance_collection = new.instance_collection
        for mine, other in zip(old.material_slots, new.material_slots):
            if (mine.link, mine.material) != (other.link, other.material):
                mine.link, mine.material = other.link, other.material
        parts.carry(new, old)
    old.cairn.mark = new.cairn.mark
