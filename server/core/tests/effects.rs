//! Effects are decided once: the bake has the effects of its plan.

use super::common::{cone, disc, scene, stick};
use cairn_core::{bake, plan};
use cairn_geometry::mesh::TriMesh;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, Figures, Params, Switch};
use cairn_prepare::effects::{Count, EffectName};
use strum::VariantArray;

/// A box without its lid: open, so that its mass is that of its collision shape.
fn open_box() -> TriMesh {
    let mut mesh = stick();
    mesh.triangles.truncate(mesh.triangles.len() - 2);
    mesh
}

#[test]
fn the_plan_of_a_scene_is_that_of_its_bake() {
    let mut stiff = 0;
    for (name, light, heavy, density) in [
        ("sticks", stick(), stick(), 900.0),
        ("thin on heavy", disc(0.5, 0.02), stick(), 20_000.0),
        ("heavy on light", stick(), disc(0.5, 0.2), 100_000.0),
        ("open", open_box(), stick(), 50_000.0),
    ] {
        let mut scene = scene(cone(1.2, 1.6), light);
        let mut second = scene.props[0].clone();
        second.model.mesh = heavy;
        second.density = density;
        second.scale = [0.8, 1.1];
        scene.props.push(second);
        let mut params = Params::new(Accuracy::Draft);
        params.fill.count = Some(6);
        params.hold.patience = 2.0;
        let plan = plan(&scene, &params).unwrap();
        let report = bake(&scene, &params, &mut Silent).unwrap().report;
        assert_eq!(plan.effects, report.plan.effects, "{name}");
        let is_on = |effect: EffectName| plan.effects.iter().any(|e| e.name == effect && e.on);
        let steps = report.counts[&Count::StepsWithStiffContacts];
        assert_eq!(steps > 0, is_on(EffectName::StiffContacts), "{name}: {steps} steps");
        stiff += u32::from(steps > 0);
    }
    assert!((1..4).contains(&stiff), "some are stiff, some are not: {stiff}");
}

#[test]
fn a_plan_has_each_effect_once_in_the_order_of_the_list() {
    let scene = scene(cone(1.2, 1.6), stick());
    let effects = plan(&scene, &Params::new(Accuracy::Standard)).unwrap().effects;
    let names: Vec<EffectName> = effects.iter().map(|effect| effect.name).collect();
    assert_eq!(names, EffectName::VARIANTS);
    for effect in effects {
        assert_eq!(serde_json::to_value(effect.name).unwrap(), effect.name.name(), "serialized by its name");
        for count in effect.counters {
            assert_eq!(serde_json::to_value(count).unwrap(), count.name());
        }
    }
}

#[test]
fn figures_switched_off_are_not_measured() {
    let scene = scene(cone(0.6, 0.8), stick());
    let mut params = Params::new(Accuracy::Draft);
    params.fill.count = Some(20);
    params.hold.patience = 2.0;
    let mut measured = |shape: Switch, pictures: Switch, support: Switch, visible: Switch| {
        params.report = Figures { shape, pictures, support, visible };
        let report = bake(&scene, &params, &mut Silent).unwrap().report;
        let counts = [Count::ShapesMeasured, Count::PicturesMeasured, Count::SupportIterations, Count::VisiblePairs];
        let figures = ["shape_iou", "silhouette_iou", "unsupported_fraction", "visible_cut_share"];
        (counts.map(|count| report.counts[&count] > 0), figures.map(|name| report.measures[name].is_some()))
    };
    let (auto, on, off) = (Switch::Auto, Switch::On, Switch::Off);
    for (switches, wanted) in [
        ([auto, auto, auto, auto], [true, false, false, true]),
        ([off, auto, auto, off], [false; 4]),
        // Without shape figures, there are no pictures.
        ([off, on, on, on], [false, false, true, true]),
        ([on, on, on, off], [true, true, true, false]),
    ] {
        let [shape, pictures, support, visible] = switches;
        assert_eq!(measured(shape, pictures, support, visible), (wanted, wanted), "{switches:?}");
    }
}

/// The cost of a fill without a clock: steps, bodies that the engine moved, pairs that it kept.
#[test]
fn a_fill_does_no_more_work_than_it_did() {
    let mut params = Params::new(Accuracy::Standard);
    params.hold.patience = 1.0;
    params.report.shape = Switch::Off;
    let report = bake(&scene(cone(0.6, 1.0), stick()), &params, &mut Silent).unwrap().report;
    let of = |count: Count| report.counts[&count] as f64;
    let bodies = report.bodies as f64;
    let steps = of(Count::FillSteps);
    let (moved, pairs) = (of(Count::FillBodySteps) / bodies, of(Count::FillPairSteps) / of(Count::FillBodySteps));
    println!("{bodies} bodies, {steps} steps, {moved:.0} steps a body, {pairs:.1} pairs a body");
    assert!(bodies > 60.0, "{bodies} bodies");
    assert!(steps < 250.0 && moved < 350.0 && pairs < 26.0, "{steps} steps, {moved} a body, {pairs} pairs");
}
