"""The server's sentences in the artist's words: a parameter by its panel and name, each thing once."""

import re

from . import belongings, dots
from .schema import FIELDS, GROUPS, title

# The panel of each group of parameters.
PANELS = {
    "physics": "Advanced, Simulation",
    "base": "Advanced, Fill",
    "fill": "Advanced, Fill",
    "release": "Advanced, Release",
    "entrance": "Entrance",
    "control": "Advanced, Control",
    "glue": "Advanced, Glue",
    "hold": "Advanced, Release",
    "output": "Output",
    "effects": "Advanced, Solver Features",
    "report": "Advanced, Measures",
}
# Parameters that have another label, or another place than their group: where an artist finds them.
PLACES = {
    "fill.count": "“Count” in the panel Size and Order",
    "fill.gaps": "“Small Props Fill Gaps” in the panel Size and Order",
    "fill.heap": "“Heap” below the shape",
    "fill.layout": "“Mixture” in the panel Size and Order",
    "fill.level": "“Level” below the shape",
    "fill.order": "“Order” in the panel Size and Order",
    "fill.shake": "“Shake” in the panel Size and Order",
    "fill.share": "“Share” below the shape",
    "fill.surface": "“Surface” in the panel Size and Order",
    "glue.mode": "the panel Shape Support",
    "glue.strength": "“Glue Strength” in the panel Shape Support",
    "output.free_pour": "“Free Pour” in the panel Advanced, Measures",
    "output.free_standing": "“Free Standing” in the panel Advanced, Measures",
    "output.frames": "“Frames” in the panel Output",
}
GROUND = "in the panel Ground and Colliders"
MESSAGES = {name: message for message, name in GROUPS.items()}
FIELD = re.compile(r"`?\b(" + "|".join(PANELS) + r")\.([a-z_0-9]+)\b`?( = (?:\"\w+\"|[\w.]+))?")
# A thing of the scene by its number, and a body of the result with its prop's name.
COUNTED = re.compile(r"`?\b(?:(prop|static)s?[. \[]|(bodie|emitter)s[.\[])(\d+)\]?`?")
BODY = re.compile(r"\b(\d+) \(([^()]+)\)")
# A place, m, in the axes of glTF.
PLACE = re.compile(r"\baround \((-?[\d.]+), (-?[\d.]+), (-?[\d.]+)\)")
OTHERS = [
    # Two sentences of a plan and a report, which mean one thing.
    (re.compile(r"\b(the mesh is open: )it(s mass| is measured).*"), r"\1its mass and shape are estimated; close it"),
    # What the scene has, not each collider.
    (re.compile(r"`?statics\.\d+\.friction`? or the props'"), f"“Friction” {GROUND}, or in Prop Physics"),
    (re.compile(r"`?ground = true`?"), f"“Ground” {GROUND}"),
    (re.compile(r"\bset (?=“Ground”)"), "tick "),
    (re.compile(r"\badd statics or kept bodies\b"), "choose colliders"),
    (re.compile(r" \(ground_height\)"), ""),
    (re.compile(r"\bleave ground_height out\b"), f"untick “Height” {GROUND}"),
    (re.compile(r"\bshape_iou\b"), "“Shape Match”"),
    (re.compile(r"\baccuracy (?=[a-z])"), "quality "),
    (re.compile(r"smaller props reach farther \(`cairn plan` names a size\)"), "smaller props reach farther"),
    (re.compile(r"\bcontrol[ _]mesh\b"), "shape"),
    (re.compile(r"\bControl mesh\b"), "Shape"),
    (re.compile(r"`([^`]*)`"), r"“\1”"),
    (re.compile(r"(\d) %"), r"\1%"),
]


def said(text):
    """Translates one sentence."""
    text = PLACE.sub(_place, FIELD.sub(_parameter, text))
    for pattern, words in OTHERS:
        text = pattern.sub(words, text)
    return text[:1].upper() + text[1:]


def _place(found):
    """A place in Blender's axes."""
    x, y, z = (float(number) for number in found.groups())
    # No zero below zero.
    return f"around ({x:.2f}, {-z + 0.0:.2f}, {y:.2f})"


def _parameter(found):
    group, name, value = found.groups()
    place = PLACES.get(f"{group}.{name}")
    if place:
        return place + (f" ({title(value[3:].strip(chr(34)))})" if value else "")
    known = {field["name"] for field in FIELDS.get(MESSAGES[group], [])}
    if name not in known:
        return found[0]
    # The unit is not part of its name.
    words = f"“{title(name).split(' (')[0]}” in the panel {PANELS[group]}"
    return words + (f" ({title(value[3:].strip(chr(34)))})" if value else "")


def _counted(text, names):
    """A sentence with names instead of numbers, and these names: `props.3`, "prop 3"."""
    things = []

    def name(found):
        known = names.get(f"{found[1] or found[2]}s.{found[3]}")
        # A setting of a thing is in the panel, not in the thing.
        if known is None or text[found.end() :].startswith(".friction"):
            return found[0]
        things.append(known)
        return f"“{known}”"

    return COUNTED.sub(name, text), things


def with_bodies(texts, collection):
    """Sentences of a pile's report with the names of its bodies, which the server counts from 0."""
    objects = {shown.cairn.number: shown.name for shown in belongings.bodies(collection)}
    is_each = collection.cairn.mode != "POINTS"

    def name(found):
        number = dots.number_of(collection, int(found[1]))
        return f"“{objects[number]}”" if is_each and number in objects else f"{found[2]} {int(found[1]) + 1}"

    return [BODY.sub(name, text) for text in texts]


def gathered(texts, names):
    """Sentences, each once. `names`: the objects' names, by the server's names for them. Equal sentences about
    several objects become one. Gives pairs: the sentence, and the objects' names."""
    about = {}
    for text in texts:
        thing, colon, rest = text.partition(": ")
        # The longest name that the text begins with: names may have colons.
        known = [uri for uri in names if text.startswith(f"{uri}: ")]
        if known:
            thing = max(known, key=len)
            rest = text[len(thing) + 2 :]
        rest, counted = _counted(rest if known else text, names)
        things = about.setdefault(said(rest), [])
        for name in [*([names[thing]] if known else []), *counted]:
            if name not in things:
                things.append(name)
    # Names that are in the sentence already need not begin it.
    return [
        (_of([name for name in things if f"“{name}”" not in text]) + text, things) for text, things in about.items()
    ]


def _of(things):
    """The beginning of a sentence about objects, at most three by name."""
    if not things:
        return ""
    shown = ", ".join(f"“{name}”" for name in things[:3])
    more = len(things) - 3
    return f"{shown} and {more} more: " if more > 0 else f"{shown}: "
