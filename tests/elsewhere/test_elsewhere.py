"""What stands here stands in other engines, from the file alone."""

import json
import pathlib
import subprocess

import mujoco
import numpy as np
import pytest
import replay
import stage

ROOT = pathlib.Path(__file__).parents[2]
CAIRN = ROOT / "target/release/cairn"
ASSETS = ROOT / "examples/assets"

# Shapes that fall without glue: of boxes, of several convex parts, of balls. With the scale of the prop.
PILES = {
    "sticks": ["letter-t.glb", "stick.glb", 2.6],
    "bananas": ["letter-t.glb", "banana.glb", 7],
    "balls": ["tower.glb", "ball.glb", 0.45],
}


@pytest.fixture(scope="module", params=PILES)
def pile(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    control, prop, scale = PILES[request.param]
    command = [CAIRN, "bake", "--control", ASSETS / control, "--prop", ASSETS / prop, "--set", "output.frames=2"]
    command += [word for end in ("min", "max") for word in ("--set", f"props.0.scale_{end}={scale}")]
    for ending in ("xml", "json"):
        subprocess.run([*command, "--quiet", "-o", folder / f"pile.{ending}"], check=True)
    if request.param == "sticks":
        physics = ["--set", "usd.physics=true", "--set", "usd.up_axis=z"]
        subprocess.run([*command, *physics, "--quiet", "-o", folder / "pile.usda"], check=True)
    return replay.read(folder / "pile.xml"), json.loads((folder / "pile.json").read_text())


def test_a_glued_pile_stands(pile):
    pile, _ = pile
    seconds = 6 * pile.natural_time
    assert replay.in_mujoco(pile, seconds) >= 0.95
    assert replay.in_bullet(pile, seconds) >= 0.95


def test_it_falls_without_its_glue(pile):
    pile, _ = pile
    assert replay.in_bullet(pile.unglued(), 6 * pile.natural_time) < 0.7


def test_the_model_is_the_pile(pile):
    pile, table = pile
    model = mujoco.MjModel.from_xml_path(pile.path)
    clusters = table["glue"]["clusters"]
    assert len(pile.solids) == len(table["bodies"]) - sum(len(members) - 1 for members in clusters)
    assert sum(solid.is_fixed for solid in pile.solids) == sum(
        1
        for solid in pile.solids
        if solid.parts[0].body in {table["bodies"][i]["name"] for i in table["glue"]["anchored"]}
    )
    # Every body's middle is where the table has it, with Y up there and Z up here.
    middles = {}
    for solid in pile.solids:
        for part in solid.parts:
            corners = part.corners @ part.rotation.T + part.center
            middles.setdefault(part.body, []).append((corners @ solid.rotation.T + solid.center).mean(0))
    for body, (x, y, z, *_) in zip(table["bodies"], table["frames"][-1], strict=True):
        way = np.linalg.norm(np.mean(middles[body["name"]], 0) - [x, -z, y])
        assert way < 0.6 * pile.diameter, body["name"]
    free = [solid.mass for solid in pile.solids if not solid.is_fixed]
    assert np.isclose(model.body_mass[1:][model.body_dofnum[1:] > 0].sum(), sum(free))


def corners(solids):
    """Of each body, where they are."""
    found = {}
    for solid in solids:
        for part in solid.parts:
            places = (part.corners @ part.rotation.T + part.center) @ solid.rotation.T + solid.center
            found.setdefault(part.body.replace(".", "_"), []).append(places)
    return {body: np.concatenate(places) for body, places in found.items()}


@pytest.mark.parametrize("pile", ["sticks"], indirect=True)
def test_a_stage_stands_and_breaks_where_a_ball_hits(pile):
    pile, table = pile
    glued, joints = stage.read(pathlib.Path(pile.path).with_suffix(".usda"), pile.diameter)
    assert len(joints) == len(table["glue"]["dots"]) > 0
    # The bodies are those of the model.
    ours, theirs = corners(glued.solids), corners(pile.solids)
    assert ours.keys() == theirs.keys()
    for body, places in ours.items():
        away = np.linalg.norm(places[:, None] - theirs[body][None], axis=2)
        assert away.min(1).max() < 1e-5 * pile.diameter, body
    free = sum(solid.mass for solid in pile.solids if not solid.is_fixed)
    assert sum(solid.mass for solid in glued.solids) > free > 0
    seconds = 4 * pile.natural_time
    share, broken = stage.in_bullet(glued, joints, seconds)
    assert share >= 0.95 and not broken
    # Forty times the mass of a stick, as fast as from a fall of fifty diameters.
    middles = np.array([solid.center for solid in glued.solids])
    place = np.array([middles[:, 0].max() + 2 * pile.diameter, middles[:, 1].mean(), middles[:, 2].max()])
    velocity = np.array([-10 * pile.diameter / pile.natural_time, 0.0, 0.0])
    mass = 40 * np.median([solid.mass for solid in glued.solids])
    shot = stage.Shot(0.5 * pile.diameter, mass, place, velocity)
    share, broken = stage.in_bullet(glued, joints, seconds, shot)
    assert share < 0.7 and broken


def test_numpy_reads_the_states_of_a_pile_that_is_taken_apart(tmp_path):
    scene = ROOT / "examples/guide/pull-out.toml"
    pattern = tmp_path / "{seed}.glb"
    subprocess.run(
        [CAIRN, "batch", scene, "--seeds", "1", "--remove-sequences", "3", "--progress", "none", "-o", pattern],
        check=True,
        capture_output=True,
    )
    pile, report, arrays = (tmp_path / f"1.{ending}" for ending in ("glb", "report.json", "npz"))
    view = ["--size", "160x120", "--elevation", "70"]
    subprocess.run([CAIRN, "render", pile, "--removals", report, *view, "-o", arrays], check=True)
    said = json.loads(report.read_text())["removals"]
    with np.load(arrays) as data:
        data = dict(data)
    states, bodies = len(said) + 1, len(said[0]["before"])
    assert data["bodies"].shape == data["depth"].shape == (states, 120, 160)
    assert list(data["removed"]) == [removal["body"] for removal in said]
    for state, poses in enumerate([*(removal["before"] for removal in said), said[-1]["after"]]):
        flat = [[*pose["translation"], *pose["rotation"]] for pose in poses]
        np.testing.assert_array_equal(data["poses"][state], flat)
        # A book's middle is inside of it, a little behind what is seen of it; some are below others.
        points = np.c_[data["poses"][state, :, :3], np.ones(bodies)] @ np.linalg.inv(data["camera"]).T
        depth = -points[:, 2]
        pixels = (np.c_[points[:, 0], -points[:, 1], depth] / depth[:, None]) @ data["intrinsics"].T
        gone = set(data["removed"][:state])
        seen = 0
        for body in set(range(bodies)) - gone:
            column, row, _ = pixels[body]
            shown = data["bodies"][state, int(row), int(column)]
            if shown == body:
                seen += 1
                behind = depth[body] - data["depth"][state, int(row), int(column)]
                assert 0 < behind < 0.2
        assert seen >= 4
        # -1 beside the bodies that are there.
        assert set(np.unique(data["bodies"][state])) <= {-1, *range(bodies)} - gone
    touches = [
        [number, touch["body"], -1 if touch["other"] is None else touch["other"]]
        for number, removal in enumerate(said)
        for touch in removal["touches"]
    ]
    np.testing.assert_array_equal(data["touches"], touches)
