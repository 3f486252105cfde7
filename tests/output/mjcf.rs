//! Models for MuJoCo. `tests/elsewhere/` opens them there.

use crate::files::{encode, no_files, pile_of, textured_cube, tumbling};
use cairn::model::export::{ExportScene, Format, SourceModel};
use cairn_core::report::BakedGlue;

#[test]
fn glued_bodies_are_one_body_of_the_model() {
    let cube = textured_cube();
    let prop =
        SourceModel { name: "a <\"b\"> & c", file: "prop", bytes: &cube, node: None, resolve: &no_files, asset: None };
    let scene = ExportScene { props: vec![prop], scenery: vec![], ..Default::default() };
    let mut pile = pile_of(&[(0, 1.0), (0, 2.0), (0, 1.0), (0, 1.0)], tumbling(4, 3));
    pile.glue = Some(BakedGlue { dots: vec![], clusters: vec![vec![0, 1]], anchored: vec![3] });
    let text = String::from_utf8(encode(Format::Mjcf, &pile, &scene).unwrap()).unwrap();
    let mut reader = quick_xml::Reader::from_str(&text);
    let (mut bodies, mut joints, mut geoms, mut masses) = (Vec::new(), 0, Vec::new(), Vec::new());
    loop {
        let event = reader.read_event().unwrap();
        if event == quick_xml::events::Event::Eof {
            break;
        }
        let (quick_xml::events::Event::Start(element) | quick_xml::events::Event::Empty(element)) = event else {
            continue;
        };
        let value = |key: &str| {
            let found = element.try_get_attribute(key).unwrap()?;
            Some(found.normalized_value(quick_xml::XmlVersion::default()).unwrap().into_owned())
        };
        match element.name().as_ref() {
            "body" => bodies.extend(value("name")),
            "freejoint" => joints += 1,
            "geom" => geoms.extend(value("name")),
            "inertial" => masses.push(value("mass").unwrap().parse::<f64>().unwrap()),
            _ => {}
        }
    }
    assert_eq!(bodies, ["cluster.0", "a <\"b\"> & c.0002", "a <\"b\"> & c.0003"]);
    assert_eq!(joints, 2, "one is glued to the ground");
    assert_eq!(geoms.len(), 1 + 4, "the ground, and a part of each body");
    assert_eq!(masses, [1.0 + 8.0, 1.0, 1.0], "mass grows with the cube of the scale");
}
