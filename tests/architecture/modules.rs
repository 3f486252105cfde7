//! The modules of a crate, and what each of them names: read from the syntax tree, never from the text.
//!
//! A path counts wherever it stands: in `use`, in signatures, in bodies, and in the arguments of macros. It counts for
//! every module on its way, so that a re-export hides nothing. What is compiled for tests only does not count.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use syn::buffer::{Cursor, TokenBuffer};
use syn::visit::Visit;

/// The names from the crate's root down; empty for the root itself.
pub type ModulePath = Vec<String>;

/// What one module names of another.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Import {
    pub from: ModulePath,
    pub to: ModulePath,
    /// As it is written, `use` trees made plain.
    pub text: String,
}

/// A module as it is parsed.
#[derive(Default)]
struct Module {
    file: PathBuf,
    /// What a `use` makes of a name: the whole path.
    names: BTreeMap<String, Vec<String>>,
    /// Every path that the code has.
    paths: BTreeSet<Vec<String>>,
}

/// All modules of a crate.
pub struct Crate {
    modules: BTreeMap<ModulePath, Module>,
}

impl Crate {
    /// Parses the root file and all that its `mod` items lead to; `read` gives the text of a file that exists.
    pub fn parse(root: &Path, read: &dyn Fn(&Path) -> Option<String>) -> Crate {
        let mut found = Crate { modules: BTreeMap::new() };
        let folder = root.parent().expect("a file is in a folder");
        found.add_file(Vec::new(), root, folder, read);
        found
    }

    /// `folder`: where the files of its child modules are.
    fn add_file(&mut self, path: ModulePath, file: &Path, folder: &Path, read: &dyn Fn(&Path) -> Option<String>) {
        let text = read(file).unwrap_or_else(|| panic!("{} cannot be read", file.display()));
        let parsed = syn::parse_file(&text).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        self.add_items(path, &parsed.items, file, folder, read);
    }

    fn add_items(
        &mut self,
        path: ModulePath,
        items: &[syn::Item],
        file: &Path,
        folder: &Path,
        read: &dyn Fn(&Path) -> Option<String>,
    ) {
        let mut reader = Reader::default();
        items.iter().for_each(|item| reader.visit_item(item));
        let Reader { names, paths, children } = reader;
        self.modules.insert(path.clone(), Module { file: file.to_owned(), names, paths });
        for child in children {
            let name = child.ident.to_string();
            let below = folder.join(&name);
            let path = [&path[..], std::slice::from_ref(&name)].concat();
            match child.content {
                Some((_, items)) => self.add_items(path, &items, file, &below, read),
                None => {
                    let beside = below.with_extension("rs");
                    let file = if read(&beside).is_some() { beside } else { below.join("mod.rs") };
                    self.add_file(path, &file, &below, read);
                }
            }
        }
    }

    /// The modules' paths, parents first.
    pub fn paths(&self) -> impl Iterator<Item = &ModulePath> {
        self.modules.keys()
    }

    pub fn file(&self, path: &ModulePath) -> &Path {
        &self.modules[path].file
    }

    /// Everything that a module names of another one.
    pub fn imports(&self) -> Vec<Import> {
        let mut imports = BTreeSet::new();
        for (from, module) in &self.modules {
            for path in &module.paths {
                let mut met = BTreeSet::new();
                self.follow(from, path, &mut met);
                met.remove(from);
                imports.extend(met.into_iter().map(|to| Import { from: from.clone(), to, text: path.join("::") }));
            }
        }
        imports.into_iter().collect()
    }

    /// Follows a path as `scope` writes it, through modules and re-exports, and puts every module that it names into
    /// `met`.
    fn follow(&self, scope: &ModulePath, path: &[String], met: &mut BTreeSet<ModulePath>) {
        let mut at = scope.clone();
        let mut rest = path;
        let is_keyword = |word: &str| matches!(word, "crate" | "self" | "super");
        let is_rooted = path.first().is_some_and(|first| is_keyword(first));
        while let Some((word, behind)) = rest.split_first().filter(|(word, _)| is_keyword(word)) {
            match word.as_str() {
                "crate" => at.clear(),
                "super" => drop(at.pop()),
                _ => {}
            }
            rest = behind;
        }
        loop {
            let name = rest.first();
            let child = name.map(|name| [&at[..], std::slice::from_ref(name)].concat());
            if let Some(child) = child.filter(|child| self.modules.contains_key(child)) {
                (at, rest) = (child, &rest[1..]);
                continue;
            }
            let is_named = is_rooted || rest.len() < path.len();
            let is_new = is_named && met.insert(at.clone());
            // A name that a `use` brought here leads on, unless it is that of another crate (`use anyhow::anyhow`) or
            // comes by again.
            if let Some(origin) = name.and_then(|name| self.modules[&at].names.get(name))
                && (is_new || !is_named)
                && origin.first() != name
            {
                self.follow(&at, &[origin, &rest[1..]].concat(), met);
            }
            return;
        }
    }
}

/// Gathers the paths of one module.
#[derive(Default)]
struct Reader {
    names: BTreeMap<String, Vec<String>>,
    paths: BTreeSet<Vec<String>>,
    children: Vec<syn::ItemMod>,
}

impl Reader {
    fn add_use(&mut self, before: &[String], tree: &syn::UseTree) {
        let with = |name: &syn::Ident| [before, &[name.to_string()]].concat();
        match tree {
            syn::UseTree::Path(path) => self.add_use(&with(&path.ident), &path.tree),
            syn::UseTree::Group(group) => group.items.iter().for_each(|tree| self.add_use(before, tree)),
            syn::UseTree::Glob(_) => drop(self.paths.insert(before.to_vec())),
            syn::UseTree::Name(name) if name.ident == "self" => {
                let last = before.last().cloned().unwrap_or_default();
                self.add_name(last, before.to_vec());
            }
            syn::UseTree::Name(name) => self.add_name(name.ident.to_string(), with(&name.ident)),
            syn::UseTree::Rename(name) => self.add_name(name.rename.to_string(), with(&name.ident)),
        }
    }

    fn add_name(&mut self, name: String, path: Vec<String>) {
        self.paths.insert(path.clone());
        self.names.insert(name, path);
    }

    /// The paths among a macro's tokens: names with `::` between them.
    fn add_tokens(&mut self, mut at: Cursor<'_>) {
        let mut path: Vec<String> = Vec::new();
        let mut joins = false;
        while !at.eof() {
            if let Some((name, next)) = at.ident() {
                if !joins {
                    self.add_path(std::mem::take(&mut path));
                }
                path.push(name.to_string());
                (joins, at) = (false, next);
                continue;
            }
            if let Some(next) = colon(at).and_then(colon).filter(|_| !path.is_empty()) {
                (joins, at) = (true, next);
                continue;
            }
            self.add_path(std::mem::take(&mut path));
            joins = false;
            if let Some((inside, _, _, next)) = at.any_group() {
                self.add_tokens(inside);
                at = next;
            } else {
                at = at.token_tree().expect("not at the end").1;
            }
        }
        self.add_path(path);
    }

    /// A name alone is a local one, or stands in a `use` of its own.
    fn add_path(&mut self, path: Vec<String>) {
        if path.len() > 1 {
            self.paths.insert(path);
        }
    }
}

/// What is behind a colon.
fn colon(at: Cursor<'_>) -> Option<Cursor<'_>> {
    at.punct().filter(|(mark, _)| mark.as_char() == ':').map(|(_, next)| next)
}

fn is_for_tests(attributes: &[syn::Attribute]) -> bool {
    let is_test = |a: &syn::Attribute| {
        a.path().is_ident("cfg") && a.parse_args::<syn::Path>().is_ok_and(|condition| condition.is_ident("test"))
    };
    attributes.iter().any(is_test)
}

impl<'a> Visit<'a> for Reader {
    fn visit_item(&mut self, item: &'a syn::Item) {
        let attributes = match item {
            syn::Item::Mod(item) => &item.attrs[..],
            syn::Item::Fn(item) => &item.attrs,
            syn::Item::Use(item) => &item.attrs,
            syn::Item::Impl(item) => &item.attrs,
            syn::Item::Const(item) => &item.attrs,
            syn::Item::Struct(item) => &item.attrs,
            syn::Item::Enum(item) => &item.attrs,
            _ => &[],
        };
        if !is_for_tests(attributes) {
            syn::visit::visit_item(self, item);
        }
    }

    fn visit_impl_item_fn(&mut self, item: &'a syn::ImplItemFn) {
        if !is_for_tests(&item.attrs) {
            syn::visit::visit_impl_item_fn(self, item);
        }
    }

    fn visit_item_mod(&mut self, item: &'a syn::ItemMod) {
        self.children.push(item.clone());
    }

    fn visit_item_use(&mut self, item: &'a syn::ItemUse) {
        // A path that begins with `::` leads out of the crate.
        if item.leading_colon.is_none() {
            self.add_use(&[], &item.tree);
        }
    }

    fn visit_path(&mut self, path: &'a syn::Path) {
        if path.leading_colon.is_none() {
            self.add_path(path.segments.iter().map(|segment| segment.ident.to_string()).collect());
        }
        syn::visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, item: &'a syn::Macro) {
        syn::visit::visit_macro(self, item);
        self.add_tokens(TokenBuffer::new2(item.tokens.clone()).begin());
    }

    /// Who may use something is no use.
    fn visit_visibility(&mut self, _: &'a syn::Visibility) {}

    /// What derives and documentation name is not looked at.
    fn visit_attribute(&mut self, _: &'a syn::Attribute) {}
}
