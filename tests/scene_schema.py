"""scene_schema.py CAIRN: an editor that has the schema of `CAIRN schema` takes what Cairn takes, and marks what Cairn refuses.

Lines of layouts are as their schema says. Needs jsonschema.
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import tomllib

import jsonschema

cairn = pathlib.Path(sys.argv[1]).resolve()
root = pathlib.Path(__file__).parent.parent
schema = json.loads(subprocess.run([cairn, "schema"], capture_output=True, check=True).stdout)
validator = jsonschema.Draft7Validator(schema)
validator.check_schema(schema)

SCENE = {"control_mesh": "examples/assets/cone-small.glb", "props": ["examples/assets/stick.glb"]}
GOOD = [
    {},
    {"accuracy": "draft"},
    {"accuracy": "ACCURACY_FINE", "groundFriction": 0.5},
    {"control": "off", "fill": {"method": "pour", "fullBelow": 0.1}},
    {"props": [{"path": "examples/assets/stick.glb", "weight": 2}], "seed": 7},
    {"physics": {"step_seconds": 0.01}, "output": {"free_standing": True}},
]
BAD = [
    {"gravty": 9.81},
    {"gravity": "down"},
    {"gravity": 0},
    {"accuracy": "standart"},
    {"fill": {"count": 0}},
    {"fill": {"count": 1.5}},
    {"control": "glue"},
    {"props": [{"path": "examples/assets/stick.glb", "weight": -1}]},
    {"physics": {"step_seconds": 0.01, "step_natural": 0.05}},
]


def cairn_takes(scene):
    with tempfile.NamedTemporaryFile("w", suffix=".json", dir=root) as file:
        json.dump(scene, file)
        file.flush()
        return subprocess.run([cairn, "check", file.name], capture_output=True).returncode == 0


for scenes, good in [(GOOD, True), (BAD, False)]:
    for change in scenes:
        scene = SCENE | change
        errors = [error.message for error in validator.iter_errors(scene)]
        assert (not errors) == good, f"the schema says of {change}: {errors}"
        assert cairn_takes(scene) == good, f"cairn says otherwise of {change}"
files = [*root.glob("examples/*.toml"), *root.glob("examples/guide/*.toml"), *root.glob("tests/viewers/*.toml")]
assert files
for path in files:
    validator.validate(tomllib.loads(path.read_text()))
print(f"{len(GOOD) + len(BAD)} scenes and {len(files)} files judged alike")

# Lines of layouts, and the reader that gives them to simulators.
lines = jsonschema.Draft202012Validator(json.loads((root / "examples/clutter/layout.schema.json").read_text()))
sys.path.insert(0, str(root / "python/cairn"))
import clutter  # noqa: E402

with tempfile.TemporaryDirectory() as folder:
    command = [cairn, "clutter", root / "examples/clutter/bin.toml", "-n", "3", "-o", folder, "--sheet", "0"]
    subprocess.run([*command, "--progress", "none"], capture_output=True, check=True)
    layouts = list(clutter.read(folder, failed=True))
    assert all(layout.visible is None and layout.overlap is None and layout.target is None for layout in layouts)
    # The same with a camera and a target.
    text = (root / "examples/clutter/bin.toml").read_text().replace("../assets", str(root / "examples/assets"))
    looked = pathlib.Path(folder) / "looked"
    looked.mkdir()
    (looked / "bin.toml").write_text('camera = {}\ntarget = { label = "banana" }\n' + text)
    command[2:7] = [looked / "bin.toml", "-n", "1", "-o", looked]
    subprocess.run([*command, "--progress", "none"], capture_output=True, check=True)
    (seen,) = clutter.read(looked)
    assert len(seen.visible) == len(seen.bodies) and 0 <= seen.overlap <= 1
    assert seen.labels[seen.target] == "banana" and seen.visible[seen.target] == seen.line["view"]["target"]
    for layout in [*layouts, seen]:
        lines.validate(layout.line)
        assert len(layout.positions) == len(layout.labels) == len(layout.bodies)
        assert all(layout.prop(body)["solids"] for body in layout.bodies) and layout.place["solids"]
assert [layout.number for layout in layouts] == [0, 1, 2]
position, (w, x, y, z) = clutter.z_up([1, 2, 3], [0, 0, 0, 1])
assert position == [1, -3, 2] and abs(w - 0.5**0.5) < 1e-12 and abs(x - 0.5**0.5) < 1e-12 and y == z == 0
print(f"{len(layouts)} layouts are as their schema says")
