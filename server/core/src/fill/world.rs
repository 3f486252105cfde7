//! The part of the physics world that a fill needs, and nothing else of it.
//!
//! Units of the engine throughout: lengths in d, the diameter of the median prop; times in the characteristic time
//! sqrt(d / g); speeds in d per characteristic time; a gravity of 1 is that of the scene. Scales are the props' own: 1
//! is the size of the file.

use cairn_engine::invariants;
use cairn_engine::shape::Shape;
use cairn_engine::world::{
    BodyId, ContactPair, Insertion, PairSide, ReservedPlaces, Role, WallId, World, WorldBody, WorldCounters,
};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::params::Physics;
use cairn_motion::instance::Instance;
use cairn_motion::policy::Policy;
use cairn_prepare::container::SceneryMesh;
use glam::DVec3;

/// The world of a fill. Loose bodies were added by the fill, which may remove them; pinned bodies were placed by the
/// scene.
pub struct FillWorld {
    world: World,
    /// Bodies that were taken out, by the fill or by the engine.
    removed: usize,
    /// Bodies lie in each other, as dishes do: walls may be as near to each other as their collision shapes are coarse.
    nests: bool,
}

/// Keeps the bodies in: the container, its core where there is one, and a floor.
pub struct Enclosure {
    walls: Vec<WallId>,
    /// Each with the friction that it has for the pile.
    scenery: Vec<(WallId, f64)>,
}

/// The meshes of an [`Enclosure`], engine units.
pub struct EnclosureMeshes<'a> {
    /// Triangles face inward.
    pub container: &'a TriMesh,
    /// Around the container: as far out as bodies get that [`FillWorld::allow_outside`] named.
    pub outer: Option<&'a TriMesh>,
    /// Triangles face outward.
    pub core: Option<&'a TriMesh>,
    /// Height of the floor.
    pub floor: f64,
    /// Seen from both sides.
    pub scenery: &'a [SceneryMesh],
}

impl FillWorld {
    /// `world`: without bodies. `nests`: bodies lie in each other.
    pub fn new(world: World, nests: bool) -> FillWorld {
        FillWorld { world, removed: 0, nests }
    }

    /// What overlaps are shares of: the thickness of the thinner one's material, or, where bodies nest, its own.
    fn thickness(&self, pair: &ContactPair) -> f64 {
        if self.nests { self.world.pair_thickness(pair) } else { self.world.pair_wall(pair) }
    }

    /// Steps taken, those of the depenetration included.
    pub fn steps(&self) -> u64 {
        self.world.steps
    }

    pub fn step_length(&self) -> f64 {
        self.world.step_length()
    }

    pub fn counters(&self) -> WorldCounters {
        self.world.counters
    }

    pub fn set_gravity(&mut self, gravity: DVec3) {
        self.world.set_gravity(gravity);
    }

    /// See [`World::use_contacts_of`].
    pub fn use_contacts_of(&mut self, physics: &Physics, thickness: f64) {
        self.world.use_contacts_of(physics, thickness);
    }

    /// One step. The engine takes out bodies whose state became non-finite.
    pub fn step(&mut self) {
        self.removed += self.world.step().len();
    }

    /// Adds an enclosure without friction, and its scenery, in the engine's order behind places for this number of
    /// bodies. See [`World::add_behind`].
    pub fn enclose(&mut self, bodies: usize, meshes: &EnclosureMeshes) -> Result<Enclosure, Error> {
        self.world
            .add_behind(bodies, |world| {
                let container = world.add_container(meshes.container, 0.0)?;
                let outer = meshes.outer.map(|mesh| world.add_walls_around(mesh, container)).transpose()?;
                let core = meshes.core.map(|mesh| world.add_container(mesh, 0.0)).transpose()?;
                let floor = world.add_wall(DVec3::new(0.0, meshes.floor, 0.0), DVec3::Y, 0.0);
                let walls = [Some(container), outer, core, Some(floor)].into_iter().flatten().collect();
                let piece = |piece: &SceneryMesh| Ok((world.add_piece(&piece.mesh, 0.0)?, piece.friction));
                let scenery = meshes.scenery.iter().map(piece).collect::<Result<_, String>>()?;
                Ok(Enclosure { walls, scenery })
            })
            .map_err(Error::Internal)
    }

    pub fn remove_enclosure(&mut self, Enclosure { walls, scenery }: Enclosure) {
        let scenery = scenery.into_iter().map(|(piece, _)| piece);
        walls.into_iter().chain(scenery).for_each(|wall| self.world.remove_wall(wall));
    }

    /// Gives the scenery its own friction.
    pub fn use_scenery_friction(&mut self, enclosure: &Enclosure) {
        enclosure.scenery.iter().for_each(|&(piece, friction)| self.world.set_wall_friction(piece, friction));
    }

    /// Loose bodies that reach into scenery by more than `limit` of their material, ascending.
    pub fn cutting_scenery(&mut self, limit: f64) -> Vec<BodyId> {
        self.update_contacts();
        let pairs = self.world.static_contact_pairs(0.0);
        let deep = pairs.iter().filter(|pair| pair.depth() > limit * self.thickness(pair));
        let mut bodies: Vec<BodyId> = deep.map(|pair| pair.a).filter(|&id| self.is_loose(id)).collect();
        bodies.dedup();
        bodies
    }

    /// Adds a loose body, whether there is room or not.
    pub fn insert(&mut self, shape: &Shape, body: Instance, friction: f64) -> Result<BodyId, Error> {
        let Instance { prop, scale, pose } = body;
        let insertion = Insertion { prop, scale, pose, friction, restitution: 0.0 };
        self.world.insert(shape, &insertion).map_err(Error::Internal)
    }

    pub fn pin(&mut self, id: BodyId) {
        Policy::pin(&mut self.world, id);
    }

    pub fn remove(&mut self, id: BodyId) {
        self.world.remove(id);
        self.removed += 1;
    }

    /// Gives a body another scale, about its centre of mass.
    pub fn rescale(&mut self, id: BodyId, shape: &Shape, scale: f64) {
        self.world.rescale(id, shape, scale);
    }

    /// Puts a body back to where it was, at rest.
    pub fn put_back(&mut self, id: BodyId, pose: &Pose) {
        self.world.put_back(id, pose);
    }

    /// Takes away a body's velocity.
    pub fn stop(&mut self, id: BodyId) {
        self.world.launch(id, DVec3::ZERO, DVec3::ZERO);
    }

    pub fn set_friction(&mut self, id: BodyId, friction: f64) {
        self.world.set_friction(id, friction);
    }

    /// Lets a body through the container, up to the outer mesh.
    pub fn allow_outside(&mut self, id: BodyId) {
        self.world.allow_outside(id);
    }

    /// The id that the next body gets: ids ascend, and none is used twice.
    pub fn next_id(&self) -> BodyId {
        self.world.bodies().len()
    }

    pub fn body(&self, id: BodyId) -> &WorldBody {
        &self.world.bodies()[id]
    }

    /// Of the centre of mass.
    pub fn pose(&self, id: BodyId) -> Pose {
        self.world.pose(id)
    }

    pub fn instance(&self, id: BodyId) -> Instance {
        let body = self.body(id);
        Instance { prop: body.prop, scale: body.scale, pose: self.pose(id) }
    }

    pub fn is_present(&self, id: BodyId) -> bool {
        self.world.is_present(id)
    }

    /// Bodies that were not taken out, ascending.
    pub fn present(&self) -> impl Iterator<Item = BodyId> + '_ {
        self.world.present()
    }

    /// Bodies that the fill put there and did not take out, ascending.
    pub fn loose(&self) -> impl Iterator<Item = BodyId> + '_ {
        self.present().filter(|&id| self.is_loose(id))
    }

    pub fn is_loose(&self, id: BodyId) -> bool {
        self.body(id).role != Role::Pinned
    }

    /// Mean speed downward of the loose bodies.
    pub fn falling_speed(&self) -> f64 {
        let speeds = || self.loose().map(|id| -self.world.velocity(id).y);
        speeds().sum::<f64>() / speeds().count().max(1) as f64
    }

    /// Makes [`FillWorld::reserve`] and [`FillWorld::overlapping`] know of bodies that were added, moved or removed
    /// since the last step.
    pub fn update_contacts(&mut self) {
        self.world.zero_step();
    }

    /// Whether a shape placed here would be free of bodies and of reserved places (not of the container). If so, its
    /// place is reserved.
    pub fn reserve(&self, shape: &Shape, scale: f64, pose: &Pose, reserved: &mut ReservedPlaces) -> bool {
        self.world.reserve(shape, scale, pose, reserved)
    }

    /// Pairs of bodies that overlap by more than `limit` of the thinner one's material, ascending; the lower id first.
    pub fn overlapping(&mut self, limit: f64) -> Vec<(BodyId, BodyId)> {
        self.update_contacts();
        let too_deep = |pair: &ContactPair| match pair.b {
            PairSide::Body(b) => (pair.depth() > limit * self.thickness(pair)).then_some((pair.a, b)),
            PairSide::Ground | PairSide::Scenery | PairSide::Moving => None,
        };
        self.world.contact_pairs(0.0).iter().filter_map(too_deep).collect()
    }

    /// Parts overlapping bodies by position. See [`World::depenetrate`]. Returns the steps.
    pub fn depenetrate<E>(&mut self, residual: f64, going: impl FnMut(u64) -> Result<bool, E>) -> Result<u64, E> {
        let before = self.present().count();
        let steps = self.world.depenetrate(residual, going);
        self.removed += before - self.present().count();
        steps
    }

    /// Where invariants are checked: the counts agree, no more than `limit` bodies are loose, and every body is
    /// somewhere.
    pub fn validate(&self, limit: usize) {
        if !invariants::are_checked() {
            return;
        }
        let (present, loose) = (self.present().count(), self.loose().count());
        assert_eq!(
            present + self.removed,
            self.next_id(),
            "bodies there and bodies taken out are all that were inserted"
        );
        assert!(loose <= limit, "{loose} loose bodies, and no more than {limit} are wanted");
        for id in self.present() {
            let pose = self.pose(id);
            assert!(pose.translation.is_finite() && pose.rotation.is_finite(), "body {id} is at {pose:?}");
        }
    }
}
