//! What examples share that look into a pile while it is released.

use anyhow::{Context, anyhow};
use cairn::job::Job;
use cairn::scene_file::SceneTree;
use cairn_core::Error;
use cairn_core::equilibrium::global;
use cairn_core::input::observer::Silent;
use cairn_core::prepare::check;
use cairn_core::prepare::check::Checked;
use cairn_core::prepare::container::Container;
use cairn_core::prepare::shape::{self, Shape};
use cairn_core::sim::control::Control;
use cairn_core::stages::fill::{self, Filled};
use cairn_core::stages::release::{self, Pile};
use cairn_core::world::{Side, Units, World};
use std::path::Path;

/// A scene whose container is full: any number of piles may be turned over from it.
pub struct Full {
    pub job: Job,
    checked: Checked,
    shapes: Vec<Shape>,
    units: Units,
    container: Option<Container>,
    filled: Option<Filled>,
}

impl Full {
    /// Reads a scene file, with assignments as `--set` takes them, and fills its container if it has one.
    pub fn of(scene: &Path, set: &[String]) -> anyhow::Result<Full> {
        let told = |problems: Vec<cairn::problem::Problem>| {
            anyhow!(problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))
        };
        let mut tree = SceneTree::load(scene).map_err(told).with_context(|| scene.display().to_string())?;
        for assignment in set {
            tree.set(assignment).map_err(told)?;
        }
        let job = Job::read(&tree.to_message()).map_err(told)?;
        let (scene, params) = (&job.scene, &job.params);
        let checked = check::run(scene, params).map_err(Error::Invalid)?;
        let shapes = shape::run(scene, params, &checked.sizes, &mut Silent)?;
        let units = Units::new(checked.diameter, shapes[0].mass, params.gravity);
        let mesh = checked.control.as_ref().filter(|_| scene.is_filled(params));
        let container = mesh.map(|c| Container::new(c, units.length, checked.ground, params.fill.wall_tolerance));
        let fill = |container| fill::run(scene, &shapes, params, units, container, &mut Silent);
        let filled = container.as_ref().map(fill).transpose()?;
        Ok(Full { job, checked, shapes, units, container, filled })
    }

    /// The pile right after turning over.
    pub fn turn_over(&self) -> anyhow::Result<Pile<'_>> {
        let (scene, params) = (&self.job.scene, &self.job.params);
        let inside = self.container.as_ref().map(|container| &container.distance);
        let control = Control::new(&params.control, params.gravity, params.seed, inside);
        let bodies = self.filled.as_ref().map_or(&[][..], |filled| &filled.bodies);
        Ok(release::turn_over(scene, &self.shapes, params, self.units, bodies, self.checked.ground, control)?)
    }
}

/// The global program over all contacts of a pile, up to a gap of 5 % of the thinner body's thickness. Bodies in the order of
/// [`World::present`].
pub fn whole(world: &World) -> Option<global::Report> {
    let present: Vec<usize> = world.present().collect();
    let index = |id: usize| present.binary_search(&id).ok();
    let body = |&id: &usize| {
        let b = &world.bodies()[id];
        global::Body { mass: b.mass, center_of_mass: world.pose(id).translation, radius: b.radius }
    };
    let bodies: Vec<global::Body> = present.iter().map(body).collect();
    let other = |side: Side| match side {
        Side::Body(b) => index(b),
        Side::Ground | Side::Scenery | Side::Moving => None,
    };
    let touches = world.touches(0.05);
    let contacts: Vec<global::Contact> = touches
        .iter()
        .filter_map(|t| Some((t, index(t.a)?)))
        .flat_map(|(t, body)| t.points.iter().map(move |p| (t, body, p)))
        .map(|(t, body, p)| global::Contact {
            body,
            other: other(t.b),
            point: p.point,
            normal: p.normal,
            friction: t.friction,
        })
        .collect();
    let pile = global::Pile { bodies: &bodies, contacts: &contacts, gravity: glam::DVec3::NEG_Y };
    global::analyse(&pile, global::Objective::SumOfNorms { sharpen: 0 }).ok()
}
