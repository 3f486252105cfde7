"""Simulates a layout of `cairn clutter` in Newton, with the solver of its choice: python with_newton.py layouts 3"""

import sys

import cairn
import newton
import numpy as np
import warp as wp


def build(layout):
    """A builder with the place and the bodies, Z up."""
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -layout.assets["gravity"]))

    def add(body, solids, friction, scale, xform):
        config = newton.ModelBuilder.ShapeConfig(density=0.0, mu=friction)
        for solid in solids:
            if solid["kind"] == "ball":
                own = wp.transform([scale * c for c in solid["center"]], wp.quat_identity())
                builder.add_shape_sphere(body, xform=xform * own, radius=scale * solid["radius"], cfg=config)
            elif solid["kind"] == "box":
                own = wp.transform([scale * c for c in solid["center"]], wp.quat(*solid["rotation"]))
                half = [scale * h for h in solid["half"]]
                builder.add_shape_box(body, xform=xform * own, hx=half[0], hy=half[1], hz=half[2], cfg=config)
            else:
                mesh = hull(np.array(solid["points"]) * scale)
                builder.add_shape_convex_hull(body, xform=xform, mesh=mesh, cfg=config)

    up = wp.transform([0.0, 0.0, 0.0], wp.quat_from_axis_angle(wp.vec3(1.0, 0.0, 0.0), wp.pi / 2))
    place = layout.place
    add(-1, place["solids"], place["friction"], 1.0, up)
    for line in layout.bodies:
        (position, (w, x, y, z)) = cairn.clutter.z_up(line["position"], line["rotation"])
        xx, yy, zz, xy, xz, yz = line["inertia"]
        body = builder.add_body(
            xform=wp.transform(position, wp.quat(x, y, z, w)),
            mass=line["mass"],
            com=wp.vec3(*line["center_of_mass"]),
            inertia=wp.mat33(xx, xy, xz, xy, yy, yz, xz, yz, zz),
            lock_inertia=True,
        )
        prop = layout.prop(line)
        add(body, prop["solids"], prop["friction"], line["scale"], wp.transform_identity())
    return builder


def hull(points):
    """A mesh of the hull of points."""
    from scipy.spatial import ConvexHull

    return newton.Mesh(points, ConvexHull(points).simplices.flatten(), compute_inertia=False)


def drift(layout, seconds=2.0, step=1 / 240):
    """The largest way of a body in Newton, m."""
    model = build(layout).finalize()
    solver = newton.solvers.SolverMuJoCo(model, njmax=8000, nconmax=4000)
    states = [model.state(), model.state()]
    before = states[0].body_q.numpy()[:, :3].copy()
    contacts, control = model.contacts(), model.control()
    for _ in range(int(seconds / step)):
        states[0].clear_forces()
        model.collide(states[0], contacts)
        solver.step(states[0], states[1], control, contacts, step)
        states.reverse()
    return float(np.linalg.norm(states[0].body_q.numpy()[:, :3] - before, axis=1).max())


if __name__ == "__main__":
    layouts = {layout.number: layout for layout in cairn.clutter.read(sys.argv[1])}
    print(f"{1e3 * drift(layouts[int(sys.argv[2])]):.3f} mm")
