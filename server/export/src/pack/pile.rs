//! A result as a pack takes it: its bodies, what they look like, and where they are in each frame.

use super::PackError;
use super::surface::Surfaces;
use crate::copy::Copier;
use cairn_gltf::document::{LocalTransform, Object, references};
use cairn_gltf::{Document, Resolver};
use cairn_render::{animation::Motion, nodes};
use glam::{DAffine3, DQuat, DVec3};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Triangles of all bodies together.
const MOST_TRIANGLES: usize = 20_000_000;
/// Frames times bodies.
const MOST_POSES: usize = 50_000_000;
/// Scales along the axes of a body that differ by more are no uniform scale.
const UNIFORM: f64 = 1e-5;

pub struct PackedPile<'a> {
    pub source: Copier<'a>,
    pub fps: f64,
    pub bodies: Vec<PackedBody>,
    pub kinds: Vec<BodyKind>,
    /// Shape `[frame][body]`.
    pub frames: Vec<Vec<BodyPose>>,
    /// Things that no pack holds, one sentence each.
    pub left_out: Vec<String>,
}

pub struct PackedBody {
    pub name: String,
    pub kind: usize,
}

/// Bodies that look the same.
pub struct BodyKind {
    pub name: String,
    /// In the frame of a body's node, at scale 1.
    pub surfaces: Surfaces,
    /// The largest scale of its bodies.
    pub scale: f64,
}

/// Where a body's node is.
#[derive(Clone, Copy)]
pub struct BodyPose {
    pub translation: DVec3,
    pub rotation: DQuat,
    /// 0: it is not there yet.
    pub scale: f64,
}

impl BodyPose {
    pub fn affine(&self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(DVec3::splat(self.scale), self.rotation, self.translation)
    }
}

impl<'a> PackedPile<'a> {
    pub fn read(bytes: &'a [u8], resolve: &'a Resolver<'a>) -> Result<PackedPile<'a>, PackError> {
        let document = Document::open(bytes, resolve)?;
        let (pile, node) = nodes::pile(&document).ok_or(PackError::NoPile)?;
        let (fps, count) = nodes::frame_clock(&document).ok_or(PackError::NoPile)?;
        let listed = references(node, "children");
        let count = usize::try_from(count.max(1)).unwrap_or(usize::MAX);
        if listed.len().saturating_mul(count) > MOST_POSES {
            return Err(PackError::TooMany("poses", MOST_POSES));
        }
        let still = nodes::locals(&document, 0.0)?;
        let is_moved = |node: usize| still[node] != DAffine3::IDENTITY;
        let parents = document.parents();
        let above = std::iter::successors(Some(pile), |&node| parents[node]).take(parents.len());
        if above.into_iter().any(is_moved) {
            return Err(PackError::Moved);
        }
        let mut left_out = Vec::new();
        let frames = frames(&document, &listed, fps, count, &mut left_out)?;

        let mut found: BTreeMap<Vec<(usize, [u64; 12])>, usize> = BTreeMap::new();
        let (mut kinds, mut bodies) = (Vec::<BodyKind>::new(), Vec::new());
        let mut is_kept = vec![false; listed.len()];
        let (mut budget, mut dropped) = (MOST_TRIANGLES, BTreeSet::new());
        for (body, &node) in listed.iter().enumerate() {
            let scale = frames.last().map_or(0.0, |poses| poses[body].scale);
            if scale == 0.0 {
                continue;
            }
            is_kept[body] = true;
            let placed = nodes::below(&document, node, &still)?;
            let key = placed.iter().map(|one| (one.mesh, one.world.to_cols_array().map(f64::to_bits))).collect();
            let name = document.get("nodes", node)?.get("name").and_then(Value::as_str).unwrap_or("body").to_owned();
            let kind = match found.get(&key) {
                Some(&kind) => kind,
                None => {
                    let surfaces = Surfaces::read(&document, &placed, &mut dropped)?;
                    let own = name.rsplit_once('.').map_or(name.as_str(), |(prop, _)| prop).to_owned();
                    kinds.push(BodyKind { name: own, surfaces, scale: 0.0 });
                    found.insert(key, kinds.len() - 1);
                    kinds.len() - 1
                }
            };
            let triangles = kinds[kind].surfaces.triangles();
            budget = budget.checked_sub(triangles).ok_or(PackError::TooMany("triangles", MOST_TRIANGLES))?;
            kinds[kind].scale = kinds[kind].scale.max(scale);
            bodies.push(PackedBody { name, kind });
        }
        if kinds.iter().all(|kind| kind.surfaces.triangles() == 0) {
            return Err(PackError::Empty);
        }
        let absent = is_kept.iter().filter(|kept| !**kept).count();
        if absent > 0 {
            left_out.push(format!("{absent} bodies that never appear are left out"));
        }
        if !dropped.is_empty() {
            let names: Vec<&str> = dropped.iter().map(String::as_str).collect();
            left_out.push(format!("{} of the props are left out of the pack", names.join(", ")));
        }
        if has_scenery(&document) {
            left_out.push("the scenery is left out of the pack: it stays in your level".into());
        }
        let kept =
            |poses: Vec<BodyPose>| poses.into_iter().zip(&is_kept).filter(|(_, k)| **k).map(|(p, _)| p).collect();
        let frames = frames.into_iter().map(kept).collect();
        Ok(PackedPile { source: Copier::new(document, resolve), fps, bodies, kinds, frames, left_out })
    }

    /// The poses of the last frame, in which the pile rests.
    pub fn rest(&self) -> &[BodyPose] {
        self.frames.last().map_or(&[], Vec::as_slice)
    }

    pub fn triangles(&self) -> usize {
        self.bodies.iter().map(|body| self.kinds[body.kind].surfaces.triangles()).sum()
    }
}

/// The poses of some nodes in each frame; each rotation in the half space of the one before it.
fn frames(
    document: &Document,
    nodes: &[usize],
    fps: f64,
    count: usize,
    left_out: &mut Vec<String>,
) -> Result<Vec<Vec<BodyPose>>, PackError> {
    let motion = Motion::read(document)?;
    let mut locals = Vec::with_capacity(document.array("nodes").len());
    for index in 0..document.array("nodes").len() {
        locals.push(LocalTransform::of(document.get("nodes", index)?));
    }
    let mut is_uniform = true;
    let mut frames: Vec<Vec<BodyPose>> = Vec::with_capacity(count);
    for frame in 0..count {
        motion.apply(frame as f64 / fps, &mut locals);
        let pose = |(body, &node): (usize, &usize)| {
            let local = locals.get(node).copied().unwrap_or(LocalTransform::of(&Object::new()));
            let scale = local.scale.x;
            is_uniform &= (local.scale - scale).abs().max_element() <= UNIFORM * scale.abs();
            let before = frames.last().map_or(DQuat::IDENTITY, |poses| poses[body].rotation);
            let rotation = if local.rotation.dot(before) < 0.0 { -local.rotation } else { local.rotation };
            BodyPose { translation: local.translation, rotation, scale }
        };
        let poses = nodes.iter().enumerate().map(pose).collect();
        frames.push(poses);
    }
    if !is_uniform {
        left_out.push("bodies that are scaled differently along their axes have the scale along X".into());
    }
    Ok(frames)
}

fn has_scenery(document: &Document) -> bool {
    document.array("nodes").iter().any(|node| node.get("name").and_then(Value::as_str) == Some("scenery"))
}
