"""scene_schema.py CAIRN: an editor that has the schema of `CAIRN schema` takes what Cairn takes, and marks what Cairn refuses.

Needs jsonschema.
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
