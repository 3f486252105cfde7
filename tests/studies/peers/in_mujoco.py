"""MuJoCo. The larger friction of a pair counts, and all have the same."""

import mujoco
import numpy as np

import scene as piles

HEAVY = 1e6
"""Mass of scenery that moves, kg."""


def numbers(values):
    return " ".join(f"{value:.9g}" for value in values)


def wxyz(rotation):
    return [rotation[3], *rotation[:3]]


def model_of(scene, arguments):
    """The pile as MuJoCo's own XML: what is loaded so is what its documentation describes."""
    meshes, geoms = [], []
    for number, shape in enumerate(scene.shapes):
        kind, what = next(iter(shape["solid"].items()))
        if kind == "box":
            geoms.append(f'<geom type="box" size="{numbers(what)}"/>')
            continue
        if kind == "ball":
            geoms.append(f'<geom type="sphere" size="{what:.9g}"/>')
            continue
        for part, points in enumerate(what):
            flat = numbers(np.ravel(points))
            meshes.append(f'<mesh name="m{number}_{part}" vertex="{flat}"/>')
        geoms.append("".join(f'<geom type="mesh" mesh="m{number}_{part}"/>' for part in range(len(what))))
    bodies, apart = [], []
    for number, one in enumerate(scene.scenery):
        place, velocity = one["place"], one["velocity"]
        at = f'pos="{numbers(place["position"])}" quat="{numbers(wxyz(place["rotation"]))}"'
        # What moves slides along its way, so heavy that nothing slows it. Its velocity is set later.
        slide = f'<joint type="slide" axis="{numbers(velocity)}"/>' if any(velocity) else ""
        heavy = f'<inertial pos="0 0 0" mass="{HEAVY}" diaginertia="{HEAVY} {HEAVY} {HEAVY}"/>' if slide else ""
        bodies.append(f'<body name="scenery{number}" {at}>{slide}{heavy}{geoms[place["shape"]]}</body>')
        # The ground must not slow it.
        apart += [f'<exclude body1="world" body2="scenery{number}"/>'] if slide else []
    for body in scene.bodies:
        shape = scene.shapes[body["shape"]]
        bodies.append(
            f'<body pos="{numbers(body["position"])}" quat="{numbers(wxyz(body["rotation"]))}"><freejoint/>'
            f'<inertial pos="0 0 0" mass="{shape["mass"]:.9g}" diaginertia="{numbers(shape["inertia"])}"/>'
            f"{geoms[body['shape']]}</body>"
        )
    return (
        f'<mujoco><option timestep="{1 / arguments.hz:.12g}" gravity="0 {-scene.gravity} 0" '
        f'iterations="{arguments.iterations}" cone="{arguments.cone}" impratio="{arguments.impratio}"/>'
        f'<size memory="2G"/><default><geom friction="{scene.friction} 0.005 0.0001"/></default>'
        f"<asset>{''.join(meshes)}</asset><worldbody>"
        # A plane's normal is its Z axis.
        f'<geom type="plane" size="100 100 1" pos="0 {scene.ground} 0" zaxis="0 1 0"/>'
        f"{''.join(bodies)}</worldbody><contact>{''.join(apart)}</contact></mujoco>"
    )


def main():
    parser, given = piles.arguments(__doc__)
    parser.add_argument("--cone", default="pyramidal", choices=["pyramidal", "elliptic"])
    parser.add_argument("--impratio", type=float, default=1, help="stiffness of friction against that of contacts")
    arguments = parser.parse_args(given)
    scene = piles.read(arguments.scene)
    model = mujoco.MjModel.from_xml_string(model_of(scene, arguments))
    data = mujoco.MjData(model)
    moving = [np.linalg.norm(one["velocity"]) for one in scene.scenery if any(one["velocity"])]
    # Scenery comes first, with one coordinate each.
    data.qvel[: len(moving)] = moving
    velocities = data.qvel[len(moving) :].reshape(-1, 6)
    for launch in scene.launched:
        # Its angular velocity is in the body's own axes.
        back, own = np.zeros(4), np.zeros(3)
        mujoco.mju_negQuat(back, wxyz(scene.bodies[launch["body"]]["rotation"]))
        mujoco.mju_rotVecQuat(own, launch["angular_velocity"], back)
        velocities[launch["body"]] = [*launch["velocity"], *own]

    def poses():
        placed = data.qpos[len(moving) :].reshape(-1, 7)
        return placed[:, :3], placed[:, [4, 5, 6, 3]]

    def step():
        mujoco.mj_step(model, data)

    cpu, seconds, motion = piles.simulate(step, scene, arguments.hz, arguments.limit, poses)
    piles.write(scene, arguments, f"MuJoCo {mujoco.__version__}", cpu, seconds, *poses(), motion=motion)


main()
