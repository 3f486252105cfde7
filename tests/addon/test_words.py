"""What an artist reads: US English, units, words instead of symbols, and no full stop at the end of a tooltip."""

import re

import bpy
import pytest

BRITISH = r"colour|neighbour|modell|metre\b|metres\b|grey\b|centre|mould|fibre|favour|behaviour|analyse|\w+ise[ds]?\b"
# Words of the same form that are the same everywhere.
SAME = {"otherwise", "noise", "precise", "raise", "raised", "raises", "crosswise", "rise", "exercise", "likewise"}
SYMBOLS = r"\bmu(_\w)?\b|\bEqs?\.|\bkappa\b|\bIoU\b|sqrt|\^|\bd/|_[a-z]|`|Table \d|\bet al\b"


def groups_of(rna, found):
    """The kinds of property groups below one, by name."""
    found[rna.identifier] = rna
    for prop in rna.properties:
        if prop.type in ("POINTER", "COLLECTION") and prop.identifier != "rna_type":
            inner = prop.fixed_type
            if inner.identifier.startswith("Cairn") and inner.identifier not in found:
                groups_of(inner, found)
    return found


@pytest.fixture
def groups(addon):
    """All property groups of the add-on, by name."""
    found = {}
    for owner in (bpy.types.Scene, bpy.types.Collection, bpy.types.Object):
        for prop in owner.bl_rna.properties:
            if prop.identifier.startswith("cairn") and prop.type in ("POINTER", "COLLECTION"):
                groups_of(prop.fixed_type, found)
    assert {"CairnSettings", "CairnFill", "CairnProp", "CairnResult"} <= set(found)
    return found


@pytest.fixture
def texts(addon, groups):
    """Each text that the add-on shows: where it is, label, tooltip."""
    found = []
    for name in dir(bpy.types):
        if name.startswith(("CAIRN_OT_", "CAIRN_PT_", "CAIRN_MT_")):
            cls = getattr(bpy.types, name)
            # Panels have no tooltip.
            tip = cls.bl_rna.description if name.startswith("CAIRN_OT_") else ""
            found.append((name, getattr(cls, "bl_label", ""), tip))
            groups = {**groups, name: cls.bl_rna} if name.startswith("CAIRN_OT_") else groups
    manager = [prop for prop in bpy.types.WindowManager.bl_rna.properties if prop.identifier.startswith("cairn_")]
    props = [(name, prop) for name, rna in groups.items() for prop in rna.properties]
    for name, prop in [*props, *(("WindowManager", prop) for prop in manager)]:
        if prop.identifier in ("rna_type", "name") or prop.identifier.startswith("bl_"):
            continue
        found.append((f"{name}.{prop.identifier}", prop.name, prop.description))
        if prop.type == "ENUM":
            found += [(f"{name}.{prop.identifier}.{i.identifier}", i.name, i.description) for i in prop.enum_items]
    # What is only kept in the file has no words.
    found = [one for one in found if one[2] or "." not in one[0]]
    assert len(found) > 250
    return found


def test_tooltips_have_no_full_stop_of_their_own(texts):
    """Blender adds one."""
    wrong = [(place, tip[-30:]) for place, _, tip in texts if tip.rstrip().endswith((".", "..", ":"))]
    assert not wrong


def test_us_english(texts):
    for place, label, tip in texts:
        for word in re.findall(rf"\b(?:{BRITISH})", f"{label} {tip}", re.I):
            assert word.lower() in SAME, (place, word)


def test_no_symbols_of_the_method(texts):
    wrong = [
        (place, found[0]) for place, label, tip in texts for found in [re.search(SYMBOLS, f"{label} {tip}")] if found
    ]
    assert not wrong


def test_a_tick_explains_its_parameter(addon):
    schema, settings = addon("schema"), bpy.context.scene.cairn
    for message, name in schema.GROUPS.items():
        group = getattr(settings, name)
        for field in schema.fields_of(message):
            tick = group.bl_rna.properties["use_" + field["name"]]
            assert tick.description == field["description"] != "", field["name"]


# What has a unit, by its label or its tooltip.
PHYSICAL = re.compile(r"Density|Gravity|Velocity|Mass|Rate|Tilt|.*Seconds")
UNITS = re.compile(r", (?:in|relative to) (?:prop diameters|characteristic times)\b|\bIn seconds\b|, s\b|kg|m/s")


def test_numbers_have_units(groups, addon):
    """A label has the unit in brackets, where the tooltip says that there is one."""
    for name, rna in groups.items():
        for prop in rna.properties:
            if prop.type not in ("FLOAT", "INT") or prop.unit != "NONE" or not prop.description:
                continue
            if ("Fill", prop.identifier) in addon("parameter_panels").DRAWN and name == "CairnFill":
                # Drawn with a label of its own.
                continue
            if prop.subtype not in ("TIME", "FACTOR") and (UNITS.search(prop.description) or PHYSICAL.match(prop.name)):
                assert "(" in prop.name, (name, prop.name)


def test_labels_are_the_agreed_ones(groups):
    panels = {getattr(bpy.types, name).bl_label for name in dir(bpy.types) if name.startswith("CAIRN_PT_")}
    assert {"Prop Physics", "Solver Features", "Build Around", "Advanced", "Simulation Quality"} <= panels
    assert not {"Material", "Effects", "Keep"} & panels
    labels = {getattr(bpy.types, name).bl_label for name in dir(bpy.types) if name.startswith("CAIRN_OT_")}
    assert {"Stop Baking", "Restore These Settings"} <= labels and not {"Cancel", "Use Its Settings"} & labels
    assert bpy.types.WindowManager.bl_rna.properties["cairn_seed_glue"].name == "Vary Glue"
    assert groups["CairnSettings"].properties["keep"].name == "Build Around"


def test_figures_are_those_that_an_artist_needs(addon):
    titles = [title for _, title, _ in addon("report_panels").FIGURES]
    assert "Kept Shape" in titles and not any("Nail" in title for title in titles)


def test_what_an_edit_did_is_said_in_words(addon):
    said = addon("weighing").said
    report = lambda before, after: {"settled": {"standing": (before, after), "kept": 9}}  # noqa: E731
    assert said(report(8, 8)) == said(report(7, 8)) == "The edit did not weaken the rest"
    assert said(report(8, 7)).endswith("1 untouched body is no longer certain to stand")
    assert "3 untouched bodies are" in said(report(8, 5)) and said({"settled": {}}) == ""


def test_places_are_in_axes_of_blender(addon):
    said = addon("wording").said("1 part is empty: 0.118 m thick around (0.52, 0.30, -0.18)")
    assert said.endswith("around (0.52, 0.18, 0.30)")
