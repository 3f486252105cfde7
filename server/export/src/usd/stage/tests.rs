//! What is counted while a stage is composed.

use super::*;

/// A stage of one prim, after a change of its table, begun so long ago.
fn fault(change: impl Fn(&mut FileTable), ago: Duration) -> Option<String> {
    let table = Rc::new(RefCell::new(FileTable::default()));
    table.borrow_mut().add("stage.usda".into(), Some(b"#usda 1.0\ndef \"a\" {}\n".to_vec()));
    let stage = ComposedStage::open("stage.usda", &table, Instant::now().checked_sub(ago)?).ok()?;
    change(&mut table.borrow_mut());
    let _ = stage.children(&Path::abs_root());
    stage.check().err()
}

#[test]
fn time_and_layers_are_counted() {
    assert_eq!(fault(|_| (), Duration::ZERO), None);
    let late = fault(|_| (), LONGEST + Duration::from_secs(1));
    assert!(late.is_none_or(|what| what.contains("it takes longer than 300 s to compose: save it flattened")));
    let often = fault(|table| table.opened = 2 * MOST_OPENED, Duration::ZERO);
    assert_eq!(often.as_deref(), Some("its layers are opened too often for their size: save it flattened"));
}
