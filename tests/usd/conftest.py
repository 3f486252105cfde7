"""Bakes that the tests look at, each made once, in every format."""

import json
import os
import pathlib
import subprocess

import pytest

ROOT = pathlib.Path(__file__).parents[2]
CAIRN = pathlib.Path(os.environ.get("CAIRN", ROOT / "target/release/cairn"))
LAYERS = ["usda", "usdc", "usdz"]

# Bodies that appear later, and scenery that moves.
LATE = """
region = "{assets}/heap.glb"
accuracy = "draft"
props = ["{assets}/banana.glb"]
emitters = [{{ mesh = "{assets}/heap.glb", rate = 20, count = 20 }}]
output.frames = 40

[[statics]]
path = "{assets}/cart.glb"
keyframes = [{{}}, {{ frame = 20, position = [0.5, 0.0, 0.0], rotation = [0.0, 0.1, 0.0, 1.0] }}]
"""


GLUED = """
control_mesh = "{assets}/letter-t.glb"
accuracy = "draft"
props = [{{ path = "{assets}/stick.glb", scale_min = 1.8, scale_max = 1.8 }}]
output.frames = 2
"""

# Boxes, hulls of several parts, scenery that is not convex and a body that the scene keeps; in inches, Z up.
SIMULATED = """
control_mesh = "{assets}/cone-small.glb"
accuracy = "draft"
props = ["{assets}/banana.glb", "{assets}/brick.glb", "{assets}/ball.glb"]
fill.count = 12
output.frames = 20
usd = {{ physics = true, up_axis = "z", meters_per_unit = 0.0254 }}

[[statics]]
path = "{assets}/cart.glb"

[[bodies]]
prop = "0"
position = [3.0, 1.0, 0.0]
kept = true
"""


class Bake:
    def __init__(self, folder, scene, endings=(*LAYERS, "glb", "json")):
        self.folder = folder
        for ending in endings:
            self.cairn("bake", scene, "-o", f"pile.{ending}", "--quiet", "--report", f"{ending}.report")
        self.table = json.loads((folder / "pile.json").read_text())
        self.report = json.loads((folder / "usdc.report").read_text())

    def cairn(self, *arguments):
        done = subprocess.run([CAIRN, *arguments], cwd=self.folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def path(self, ending):
        return str(self.folder / f"pile.{ending}")

    @property
    def frames(self):
        """Three frames to look at."""
        last = len(self.table["frames"]) - 1
        return [0, last // 2, last]


@pytest.fixture(scope="session")
def mixed(tmp_path_factory):
    """Props of several meshes with a picture, of compressed meshes, and scenery that is drawn four times."""
    return Bake(tmp_path_factory.mktemp("mixed"), ROOT / "tests/viewers/scene.toml")


@pytest.fixture(scope="session")
def late(tmp_path_factory):
    folder = tmp_path_factory.mktemp("late")
    scene = folder / "late.toml"
    scene.write_text(LATE.format(assets=ROOT / "examples/assets"))
    return Bake(folder, scene)


@pytest.fixture(scope="session")
def glued(tmp_path_factory):
    """A letter T, whose arms hang on glue."""
    folder = tmp_path_factory.mktemp("glued")
    scene = folder / "letter.toml"
    scene.write_text(GLUED.format(assets=ROOT / "examples/assets"))
    return Bake(folder, scene, ["usdc", "json"])


@pytest.fixture(scope="session")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulated")
    scene = folder / "simulated.toml"
    scene.write_text(SIMULATED.format(assets=ROOT / "examples/assets"))
    return Bake(folder, scene, ["usdc", "usda", "usdz", "json"])


@pytest.fixture(params=["glue=natural", "glue=as_modelled", "control=off"])
def still(request, tmp_path_factory):
    """Twelve sticks that fall, or hold."""
    folder = tmp_path_factory.mktemp("still")
    models = [f"--control={ROOT}/examples/assets/cone-small.glb", f"--prop={ROOT}/examples/assets/stick.glb"]
    bake = Bake.__new__(Bake)
    bake.folder = folder
    sets = [f"--set={name}" for name in ["fill.count=12", "output.frames=30", request.param]]
    bake.cairn("bake", *models, "--accuracy=draft", *sets, "-o", "pile.usdc", "--quiet")
    return bake


@pytest.fixture(params=["mixed", "late"])
def bake(request):
    return request.getfixturevalue(request.param)
