//! The effective scene: all defaults are filled in.

use super::{parameters, proto};
use cairn_input::params::Params;

impl proto::UsdLayout {
    /// The layout with everything set that has a default.
    pub fn with_defaults(&self) -> proto::UsdLayout {
        use proto::{UpAxis, UsdKind, UsdMotion, UsdPurpose};
        let mut usd = self.clone();
        let enums: [(&mut i32, i32); 4] = [
            (&mut usd.up_axis, UpAxis::Y.into()),
            (&mut usd.kind, UsdKind::Auto.into()),
            (&mut usd.purpose, UsdPurpose::Default.into()),
            (&mut usd.motion, UsdMotion::Full.into()),
        ];
        for (value, default) in enums {
            if *value == 0 {
                *value = default;
            }
        }
        usd.meters_per_unit.get_or_insert(1.0);
        usd.start_frame.get_or_insert(0.0);
        usd.samples_per_frame.get_or_insert(1);
        usd.default_prim.get_or_insert_with(|| "Pile".into());
        usd.embed.get_or_insert(false);
        usd.physics.get_or_insert(false);
        usd
    }
}

impl proto::FormerResult {
    fn with_defaults(&self) -> proto::FormerResult {
        let mut former = self.clone();
        former.reach.get_or_insert(1.0);
        former
    }
}

impl proto::Collapse {
    fn with_defaults(&self) -> proto::Collapse {
        let mut collapse = self.clone();
        collapse.azimuth.get_or_insert(0.0);
        collapse
    }
}

/// The scene with every parameter and every prop's value set. It bakes to the same result.
pub fn effective(scene: &proto::Scene, params: &Params) -> proto::Scene {
    let mut effective = proto::Scene {
        control_mesh: scene.control_mesh.clone(),
        props: scene.props.clone(),
        statics: scene.statics.clone(),
        bodies: scene.bodies.clone(),
        emitters: scene.emitters.clone(),
        region: scene.region.clone(),
        piles: scene.piles.clone(),
        around: scene.around.clone(),
        from: scene.from.as_ref().map(proto::FormerResult::with_defaults),
        remove: scene.remove.clone(),
        collapse: scene.collapse.as_ref().map(proto::Collapse::with_defaults),
        goal: scene.goal,
        usd: scene.usd.as_ref().map(proto::UsdLayout::with_defaults),
        ..parameters::to_scene(params)
    };
    if let Some(fill) = &mut effective.fill {
        fill.into = scene.fill.as_ref().and_then(|fill| fill.into.clone());
    }
    effective.set_defaults();
    effective
}
