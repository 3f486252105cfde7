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
    """A mesh of the hull of points, its triangles seen from outside."""
    from scipy.spatial import ConvexHull

    found = ConvexHull(points)
    corners = points[found.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = (normals * found.equations[:, :3]).sum(1) < 0
    found.simplices[inward] = found.simplices[inward][:, ::-1]
    return newton.Mesh(points, found.simplices.flatten(), compute_inertia=False)


def centers(model, state):
    """The bodies' centers of mass, m."""
    poses, own = state.body_q.numpy(), model.body_com.numpy()
    return np.array([wp.transform_point(wp.transform(*pose), wp.vec3(*com)) for pose, com in zip(poses, own)])


def drift(layout, seconds=2.0, step=1 / 240):
    """The largest way of a body's center of mass in Newton, m."""
    model = build(layout).finalize()
    # What the solver has no room for, it drops, and bodies fly. Each contact has up to four rows.
    most = max(4000, 100 * len(layout.bodies))
    # Newton finds the contacts: those that the solver finds itself are too few where hulls lie on faces, and all rocks.
    solver = newton.solvers.SolverMuJoCo(model, njmax=4 * most, nconmax=most, use_mujoco_contacts=False)
    states = [model.state(), model.state()]
    before = centers(model, states[0])
    pipeline, control = newton.CollisionPipeline(model), model.control()
    contacts = pipeline.contacts()
    for _ in range(int(seconds / step)):
        states[0].clear_forces()
        pipeline.collide(states[0], contacts)
        solver.step(states[0], states[1], control, contacts, step)
        states.reverse()
    return float(np.linalg.norm(centers(model, states[0]) - before, axis=1).max())


if __name__ == "__main__":
    layouts = {layout.number: layout for layout in cairn.clutter.read(sys.argv[1])}
    print(f"{1e3 * drift(layouts[int(sys.argv[2])]):.3f} mm")
