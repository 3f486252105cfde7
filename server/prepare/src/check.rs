//! Checks a scene before anything runs: all problems at once, the warnings, and the sizes that the rest is measured in.

mod added;
mod crowded;
mod entrance;
mod shell;
mod standing;
#[cfg(test)]
mod tests;

use crate::container::core::Core;
use crate::extremes;
use crate::surroundings::Surroundings;
use cairn_engine::shape::Size;
use cairn_geometry::ClosedMesh;
use cairn_geometry::interior::MeshInterior;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::thickness::LocalThickness;
use cairn_geometry::topology::{self, WELD_TOLERANCE};
use cairn_input::error::{SceneProblem, counted};
use cairn_input::params::Params;
use cairn_input::scene::{Model, Prop, Scene};
use glam::DVec3;

/// A scene without problems, and the findings of the check.
#[derive(Debug)]
pub struct CheckedScene {
    /// d: the median prop diameter (bounding sphere, scaled, by weight), m.
    pub diameter: f64,
    /// Height of the ground, m.
    pub ground: f64,
    /// The control mesh, where there is one.
    pub control: Option<ClosedMesh>,
    /// The mesh inside which the control acts, where that is not the control mesh.
    pub region: Option<ClosedMesh>,
    /// The core of a pile of which only the surface is made of props.
    pub core: Option<Core>,
    /// Several shapes, each by itself.
    pub piles: Vec<CheckedScene>,
    /// Scenery that moves carries the pile.
    pub rides: bool,
    /// Shares of the control mesh's volume and surface that scenery leaves, where there is some.
    room: Option<(f64, f64)>,
    /// The scenery around the control mesh, where there is some and it is to be filled.
    pub surroundings: Option<Surroundings>,
    /// One per prop.
    pub sizes: Vec<Size>,
    /// Share of each prop among the drawn bodies or, if none is drawn, among the placed ones.
    pub shares: Vec<f64>,
    pub warnings: Vec<String>,
}

impl CheckedScene {
    /// The control mesh, where it is to be filled.
    pub fn filled(&self, scene: &Scene, params: &Params) -> Option<&ClosedMesh> {
        self.control.as_ref().filter(|_| scene.is_filled(params))
    }

    /// sqrt(d / g), s.
    pub fn characteristic_time(&self, params: &Params) -> f64 {
        (self.diameter / params.gravity).sqrt()
    }

    /// The shape that the pile is measured against.
    pub fn target(&self) -> Option<&ClosedMesh> {
        self.control.as_ref().or(self.region.as_ref())
    }
}

/// The findings so far.
struct Findings {
    problems: Vec<SceneProblem>,
    warnings: Vec<String>,
}

impl Findings {
    fn problem(&mut self, field: impl Into<String>, text: impl Into<String>) {
        self.problems.push(SceneProblem::new(field, text));
    }

    /// Checks of the values below a field; `whose`: the name of the model that has it, or nothing.
    fn below(&mut self, field: &str, whose: &str) -> FieldChecks<'_> {
        let whose = if whose.is_empty() { String::new() } else { format!(" ({whose})") };
        FieldChecks { field: field.into(), whose, findings: self }
    }
}

/// Checks of the values below one field of the scene.
struct FieldChecks<'a> {
    field: String,
    whose: String,
    findings: &'a mut Findings,
}

impl FieldChecks<'_> {
    fn problem(&mut self, name: &str, text: &str) {
        let field = format!("{}.{name}", self.field);
        let text = format!("{field}{}: {text}", self.whose);
        self.findings.problem(field, text);
    }

    fn range(&mut self, name: &str, value: f64, [lo, hi]: [f64; 2]) {
        if !(lo..=hi).contains(&value) {
            self.problem(name, &format!("{value} is out of range; give a value from {lo} to {hi}"));
        }
    }
}

/// Checks scene and parameters.
pub fn run(scene: &Scene, params: &Params) -> Result<CheckedScene, Vec<SceneProblem>> {
    crowded::check(scene)?;
    let piles = piles(scene, params)?;
    let mut found = Findings { problems: params.problems(), warnings: Vec::new() };
    let control = scene.control.as_ref().and_then(|model| closed("control_mesh", "control mesh", model, &mut found));
    let region = scene.region.as_ref().and_then(|model| closed("region", "region", model, &mut found));
    if scene.control.is_none() && scene.bodies.is_empty() && scene.emitters.is_empty() {
        let text = "control_mesh: the scene has none; give a closed mesh to fill, or bodies or emitters without one";
        found.problem("control_mesh", text);
    }
    if !params.ground && scene.statics.is_empty() && scene.bodies.iter().all(|body| !body.pinned) {
        let text = "ground: the scene has none, so that every body falls forever; set ground = true, or add statics or \
                    kept bodies to fall on";
        found.problem("ground", text);
    }
    if scene.props.is_empty() {
        found.problem("props", "props: none given; name at least one prop, such as a stick or a book");
    }
    for (i, prop) in scene.props.iter().enumerate() {
        prop_values(&mut found.below(&format!("props.{i}"), &prop.model.name), prop);
    }
    for (i, model) in scene.statics.iter().enumerate() {
        let (field, name) = (format!("statics.{i}"), &model.model.name);
        found.below(&field, name).range("friction", model.friction, [0.0, 2.0]);
        if model.model.mesh.triangles.is_empty() {
            found.problem(field, format!("{name}: the static geometry has no triangles; remove it or give it a mesh"));
        }
    }
    added::check(scene, params, &mut found);
    entrance::check(scene, params, &mut found);
    let sizes: Vec<Size> = scene.props.iter().map(|p| Size::of(&p.model.mesh)).collect();
    for (i, (prop, size)) in scene.props.iter().zip(&sizes).enumerate() {
        if let Err(text) = prop_mesh(scene, params, prop, size, &mut found.warnings) {
            found.problem(format!("props.{i}"), text);
        }
    }
    if found.problems.is_empty() {
        room(scene, params, control.as_ref(), &sizes, &mut found);
        found.problems.extend(shell::too_thin(scene, params, &sizes));
    }
    let Findings { problems, mut warnings } = found;
    if !problems.is_empty() {
        return Err(problems);
    }
    let method = params.fill.method.traits();
    if params.fill.order > 0.0 && method.fills && !method.has_order {
        let text = "fill.order: only stacked props lie in order; leave fill.method out, or set it to \"stack\"";
        warnings.push(text.into());
    }
    let low = control.as_ref().map(|c| c.mesh.bounds().0.y);
    let shares = added::shares(scene, params);
    let diameter = median_diameter(&scene.props, &sizes, &shares);
    let standing = control.as_ref().map(|control| standing::of(scene, params, control, diameter, &shares, &sizes));
    let standing = standing.unwrap_or_default();
    let ground = params.ground_height.or(standing.ground).or(low).unwrap_or(0.0);
    if let Some(model) = scene.control.as_ref().filter(|_| control.is_some()) {
        let below = ground - low.unwrap_or(ground);
        if below > 0.0 {
            let text = format!("{}: its lowest {below:.3} m lie below the ground and stay empty", model.name);
            warnings.push(text);
        }
    }
    if let (Some(model), Some(control)) = (&scene.control, &control) {
        let gap = control.mesh.bounds().0.y - ground;
        if standing.room.is_some() {
            warnings.extend(standing.warnings);
        } else if gap <= FLOATING * diameter {
            warnings.extend(standing::base(&model.name, &control.mesh, ground, params.base.height));
        } else if scene.statics.is_empty() && params.ground {
            warnings.push(format!(
                "{}: it floats {gap:.3} m above the ground (ground_height): the pile starts there and falls; leave \
                 ground_height out, move the control mesh down, or add scenery below it",
                model.name
            ));
        }
    }
    let core =
        control.as_ref().and_then(|control| shell::core(scene, params, control, ground, diameter, &mut warnings));
    warnings.extend(added::energy_warnings(scene, params, ground, diameter));
    let mass = |i: usize| sizes[i].volume * scene.props[i].density;
    warnings.extend(extremes::warnings(scene, params, |i| sizes[i].diameter, mass));
    let (room, rides) = (standing.room, standing.rides);
    let ground_plane = params.ground.then_some(ground);
    let on_ground = |around: Option<Surroundings>| around.map(|around| around.on_ground(ground_plane));
    let own =
        |pile: CheckedScene| CheckedScene { diameter, ground, surroundings: on_ground(pile.surroundings), ..pile };
    let piles = piles.into_iter().map(own).collect();
    let surroundings = on_ground(standing.around);
    Ok(CheckedScene {
        diameter,
        ground,
        control,
        region,
        core,
        piles,
        rides,
        room,
        surroundings,
        sizes,
        shares,
        warnings,
    })
}

/// Checks each of several shapes by itself.
fn piles(scene: &Scene, params: &Params) -> Result<Vec<CheckedScene>, Vec<SceneProblem>> {
    let (mut checked, mut problems) = (Vec::new(), Vec::<SceneProblem>::new());
    for index in 0..scene.piles.len() {
        match run(&scene.of_pile(index), params) {
            Ok(pile) => checked.push(pile),
            Err(found) => problems.extend(found.into_iter().map(|problem| match &*problem.field {
                "control_mesh" => SceneProblem { field: format!("piles.{index}"), ..problem },
                _ => problem,
            })),
        }
    }
    let mut known = std::collections::BTreeSet::new();
    problems.retain(|problem| known.insert(problem.text.clone()));
    if problems.is_empty() { Ok(checked) } else { Err(problems) }
}

/// A closed mesh as it will be used: welded, its parts facing outward. Every repair is a warning.
fn closed(field: &str, what: &str, model: &Model, found: &mut Findings) -> Option<ClosedMesh> {
    let name = &model.name;
    let welded = topology::weld(&model.mesh, WELD_TOLERANCE);
    let (mesh, repair) = topology::oriented(&welded);
    let topology = topology::inspect(&mesh);
    found.warnings.extend(repair.describe().into_iter().map(|t| format!("{name}: {t}")));
    if mesh.triangles.is_empty() {
        let text = format!("{name}: the {what} has no triangles; model the pile's rough shape as a closed mesh");
        found.problem(field, text);
        return None;
    }
    if !topology.closed {
        let Some((closed, holes)) = without_holes(&mesh) else {
            let text = format!(
                "{name}: the {what} is open: {} to one face only; fill its holes (in Blender: Mesh, Clean Up, Fill \
                 Holes)",
                counted(topology.boundary_edges, "edge belongs", "edges belong")
            );
            found.problem(field, text);
            return None;
        };
        found.warnings.push(format!("{name}: {}", holes.describe()));
        return Some(closed);
    }
    if is_hollow(&mesh) {
        found.problem(field, format!("{name}: the {what} encloses next to no volume; give it thickness"));
    }
    Some(ClosedMesh::new(topology, mesh))
}

/// An open mesh with its holes closed, if they can be closed and it then has an inside.
fn without_holes(mesh: &TriMesh) -> Option<(ClosedMesh, topology::Holes)> {
    let (whole, holes) = topology::close_holes(mesh)?;
    let (mesh, _) = topology::oriented(&whole);
    let topology = topology::inspect(&mesh);
    (topology.closed && !is_hollow(&mesh)).then(|| (ClosedMesh::new(topology, mesh), holes))
}

/// Whether a closed mesh has next to no inside.
fn is_hollow(mesh: &TriMesh) -> bool {
    let (low, high) = mesh.bounds();
    let size = high - low;
    mesh.signed_volume().abs() < MIN_CONTROL_FILL * size.x * size.y * size.z || size.min_element() <= 0.0
}

/// If less of the control mesh than this share is as thick as the thinnest prop, the scene is refused: the pile would
/// have another shape.
const LEAST_THICK: f64 = 0.1;
/// The user is warned where less than this share of the underside lies on the ground.
const MOST: f64 = 0.5;

/// A control mesh that is farther above the ground than this, in d, does not stand on it.
pub const FLOATING: f64 = 0.1;

/// Props count as this much thinner than they are: a rounded one fits where its box does not.
pub const ROUNDED: f64 = 0.9;

/// Whether the control mesh is thick enough for the props.
fn room(scene: &Scene, params: &Params, control: Option<&ClosedMesh>, sizes: &[Size], found: &mut Findings) {
    let (Some(model), Some(control)) = (&scene.control, control.filter(|_| scene.is_filled(params))) else { return };
    let thickness = least_extents(scene, sizes).x;
    if mean_thickness(control) > ROUNDED * thickness {
        return;
    }
    let local = LocalThickness::new(&MeshInterior::new(&control.mesh));
    // A ball that just fits: rounding must not decide.
    let share = local.share(0.999 * ROUNDED * thickness);
    if share < LEAST_THICK {
        let percent = if share < 0.01 { "less than 1".into() } else { format!("only {:.0}", 100.0 * share) };
        let text = format!(
            "{}: {percent} % of the control mesh is as thick as the thinnest prop ({thickness:.3} m), so that next to \
             none would find room; make it thicker (is it a hollow shell?), or the props smaller",
            model.name
        );
        found.problem("control_mesh", text);
    }
}

/// The least extents of the props that are drawn, m.
pub fn least_extents(scene: &Scene, sizes: &[Size]) -> DVec3 {
    let drawn = scene.props.iter().zip(sizes).filter(|(prop, _)| prop.weight > 0.0);
    drawn.fold(DVec3::INFINITY, |least, (prop, size)| least.min(size.extents * prop.scale[0]))
}

/// Of a slab, its thickness; of a ball, a third of its diameter.
pub fn mean_thickness(control: &ClosedMesh) -> f64 {
    2.0 * control.volume / control.topology.area
}

/// A control mesh that fills less of its own box than this has no inside to speak of.
const MIN_CONTROL_FILL: f64 = 1e-4;

fn prop_values(checks: &mut FieldChecks, prop: &Prop) {
    let [lo, hi] = prop.scale;
    for (field, value, bounds) in [
        ("weight", prop.weight, [0.0, 1e9]),
        ("friction", prop.friction, [0.0, 2.0]),
        ("density", prop.density, [1e-3, 1e6]),
        ("restitution", prop.restitution, [0.0, 1.0]),
        ("scale_min", lo, [1e-6, 1e6]),
        ("scale_max", hi, [1e-6, 1e6]),
        ("tilt_max", prop.tilt_max, [0.0, 180.0]),
        ("scale_skew", prop.scale_skew, [-1.0, 1.0]),
    ] {
        checks.range(field, value, bounds);
    }
    if lo > hi {
        checks.problem("scale_min", &format!("the smallest scale {lo} is above the largest {hi}"));
    }
}

fn prop_mesh(
    scene: &Scene,
    params: &Params,
    prop: &Prop,
    size: &Size,
    warnings: &mut Vec<String>,
) -> Result<(), String> {
    let name = &prop.model.name;
    if prop.model.mesh.triangles.is_empty() || size.diameter <= 0.0 {
        return Err(format!("{name}: the prop has no triangles with area; give it a mesh"));
    }
    if !size.closed {
        warnings.push(format!(
            "{name}: the mesh is open: its mass is computed from its collision shape, and its figures with its holes \
             capped; close it for the exact ones"
        ));
    }
    let filled = scene.control.as_ref().filter(|_| scene.is_filled(params) && prop.weight != 0.0);
    let filled = filled.filter(|model| !model.mesh.triangles.is_empty());
    let Some((lo, hi)) = filled.map(|model| model.mesh.bounds()) else { return Ok(()) };
    let mut room = (hi - lo).to_array();
    room.sort_by(f64::total_cmp);
    let prop_extents = size.extents * prop.scale[1];
    if (0..3).any(|k| prop_extents[k] > room[k]) {
        let remedy = match prop.model.is_skinned {
            true => "its skin is not applied, so that it has the size as modelled: apply the armature before export",
            false => "scale one of them, and check that both files are in metres",
        };
        return Err(format!(
            "{name}: at {:.3} x {:.3} x {:.3} m the prop is larger than the control mesh ({:.3} x {:.3} x {:.3} m); \
             {remedy}",
            prop_extents.x, prop_extents.y, prop_extents.z, room[0], room[1], room[2]
        ));
    }
    Ok(())
}

/// By share, at the middle of each scale range.
pub fn median_diameter(props: &[Prop], sizes: &[Size], shares: &[f64]) -> f64 {
    let mut all: Vec<(f64, f64)> = (props.iter().zip(sizes).zip(shares))
        .map(|((p, s), &share)| (s.diameter * (p.scale[0] + p.scale[1]) / 2.0, share))
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = all.iter().map(|a| a.1).sum::<f64>() / 2.0;
    let mut sum = 0.0;
    let middle = all.iter().find(|a| {
        sum += a.1;
        sum >= half && a.1 > 0.0
    });
    middle.or(all.last()).map_or(1.0, |a| a.0)
}
