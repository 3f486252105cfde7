//! How a body is treated has one writer: a stage with a reason calls the policy.

use crate::{files, read};
use std::path::Path;
use syn::visit::Visit;

/// What the world lets change of how a body is treated.
const TREATMENT: [&str; 4] = ["set_role", "set_resistance", "set_slippery", "keep_awake"];
/// Who may call these.
const WRITER: &str = "server/core/src/sim/policy.rs";

/// The calls of such methods in a file, by their names.
#[derive(Default)]
struct Calls(Vec<String>);

impl<'ast> Visit<'ast> for Calls {
    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        let name = call.method.to_string();
        if TREATMENT.contains(&&*name) {
            self.0.push(name);
        }
        syn::visit::visit_expr_method_call(self, call);
    }
}

fn calls(text: &str) -> Vec<String> {
    let mut found = Calls::default();
    found.visit_file(&syn::parse_file(text).expect("the code compiles"));
    found.0
}

#[test]
fn role_resistance_and_friction_have_one_writer() {
    assert!(!calls(&read(WRITER)).is_empty(), "{WRITER} writes");
    for path in files("server/core/src", ".rs").iter().filter(|path| !path.starts_with("server/core/src/world")) {
        let calls = calls(&read(path));
        assert!(
            path == Path::new(WRITER) || calls.is_empty(),
            "{} calls {calls:?}: call {WRITER} instead",
            path.display()
        );
    }
}

#[test]
fn a_second_writer_is_found() {
    assert_eq!(calls("fn f(world: &mut World) { if x { world.set_role(0, Role::Free); } }"), ["set_role"]);
    assert!(calls("fn f() { let set_role = 1; policy.freeze(world, set_role); }").is_empty());
}
