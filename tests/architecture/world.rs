//! The order of the world's modules holds for calls, too: the methods of `World` are spread over them, and none calls
//! one that a module above its own defines.

use crate::layers::WORLD;
use crate::{files, read};
use std::collections::BTreeMap;
use std::path::Path;
use syn::visit::Visit;

const FOLDER: &str = "server/core/src/world";

/// The methods of `World` in a file, and those that it calls on `self`.
#[derive(Default)]
struct Methods {
    defined: Vec<String>,
    called: Vec<String>,
}

impl<'ast> Visit<'ast> for Methods {
    fn visit_item_impl(&mut self, item: &'ast syn::ItemImpl) {
        if matches!(&*item.self_ty, syn::Type::Path(of) if of.path.is_ident("World")) {
            syn::visit::visit_item_impl(self, item);
        }
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.defined.push(item.sig.ident.to_string());
        syn::visit::visit_impl_item_fn(self, item);
    }

    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        if matches!(&*call.receiver, syn::Expr::Path(of) if of.path.is_ident("self")) {
            self.called.push(call.method.to_string());
        }
        syn::visit::visit_expr_method_call(self, call);
    }
}

fn methods(text: &str) -> Methods {
    let mut found = Methods::default();
    let parsed = syn::parse_file(text).expect("the code compiles");
    // Only calls within `impl World` are on a world.
    parsed.items.iter().filter(|item| matches!(item, syn::Item::Impl(_))).for_each(|item| found.visit_item(item));
    found
}

/// The height of the layer of a file in the folder: the root file's methods are for all.
fn height(file: &Path) -> usize {
    let module = file.with_extension("");
    let module = module.iter().next().and_then(|name| name.to_str()).expect("a file has a name");
    match module {
        "mod" => 0,
        _ => 1 + WORLD.iter().position(|layer| layer.contains(&module)).expect("every module has a layer"),
    }
}

/// Every call from a layer to one above it. Files by their paths in the folder.
fn upward(files: &[(&Path, String)]) -> Vec<String> {
    let all: Vec<(&Path, Methods)> = files.iter().map(|(file, text)| (*file, methods(text))).collect();
    let defined = all.iter().flat_map(|(file, methods)| methods.defined.iter().map(move |name| (name, *file)));
    let home: BTreeMap<&String, &Path> = defined.collect();
    let calls = all.iter().flat_map(|(file, methods)| methods.called.iter().map(move |name| (*file, name)));
    let up = calls.filter(|(file, name)| home.get(name).is_some_and(|home| height(home) > height(file)));
    up.map(|(file, name)| format!("{} calls {name} of {}", file.display(), home[name].display())).collect()
}

#[test]
fn calls_inside_the_world_go_down() {
    let files = files(FOLDER, ".rs");
    let texts: Vec<(&Path, String)> =
        files.iter().map(|file| (file.strip_prefix(FOLDER).expect("in the folder"), read(file))).collect();
    assert!(texts.iter().map(|(_, text)| methods(text).defined.len()).sum::<usize>() > 50, "the methods are read");
    assert_eq!(upward(&texts), [""; 0]);
}

#[test]
fn a_call_upward_is_found() {
    let other = "impl Other { fn f(&self) { self.step() } }";
    let low = format!("impl World {{ fn pose(&self) {{ [1].map(|_| self.step()); other.step(); }} }} {other}");
    let high = "impl World { fn step(&self) { self.pose() } }";
    let files = [(Path::new("bodies/motion.rs"), low), (Path::new("stepping/mod.rs"), high.to_owned())];
    assert_eq!(upward(&files), ["bodies/motion.rs calls step of stepping/mod.rs"]);
}
