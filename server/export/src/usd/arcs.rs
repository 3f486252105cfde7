//! How many sites of layers make up a prim, counted before it is composed: references of two each double them at every
//! step, so that some thousand bytes would take all memory.
//!
//! A site is a prim in a file with its sublayers. From each site, arcs lead to others: references, payloads, inherits,
//! specializes and relocations, its own and those of the prims above it. All variants count, of which one is selected;
//! a class counts in each layer stack on the way to it, as it is composed there.

use openusd::sdf::expr::{evaluate_string, stack_expression_variables};
use openusd::sdf::{AbstractData, FieldKey, Path, Value};
use std::collections::{BTreeMap, HashMap, HashSet};
use std::rc::Rc;

/// Sites of all prims of a small stage, and bytes of its files for each further one. A site takes a kilobyte.
const FEW_SITES: usize = 50_000;
const BYTES_OF_A_SITE: usize = 16;
/// Sites of one prim, more than any asset's has: the time of its composition grows with their square.
const MOST_SITES_OF_A_PRIM: usize = 1000;
/// Arcs in a row.
const MOST_STEPS: usize = 200;
/// Clips that a pattern of file names stands for.
const MOST_CLIPS: f64 = 10_000.0;

/// Why a stage is not composed.
#[derive(Clone, Debug)]
pub enum TooMuch {
    Sites(usize),
    SitesOfAPrim,
    Steps,
    Clips,
}

impl std::fmt::Display for TooMuch {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            TooMuch::Sites(most) => {
                write!(f, "its references multiply to more than {most} parts of few bytes: it is not composed")
            }
            TooMuch::SitesOfAPrim => {
                write!(f, "the references of a prim multiply to more than {MOST_SITES_OF_A_PRIM}: it is not composed")
            }
            TooMuch::Steps => write!(f, "its prims refer to each other more than {MOST_STEPS} times in a row"),
            TooMuch::Clips => write!(f, "its value clips are more than {MOST_CLIPS} files"),
        }
    }
}

/// Gives the arcs of layers, and the name of a file that a layer names.
pub trait Layers {
    fn arcs(&self, name: &str) -> Option<Rc<LayerArcs>>;
    fn identifier(&self, path: &str, layer: &str) -> String;
}

/// Counts the sites of a stage.
pub struct SiteCount<L> {
    layers: L,
    known: HashMap<String, Option<Rc<LayerArcs>>>,
    stacks: HashMap<String, Rc<Stack>>,
    counted: HashSet<Path>,
    root: String,
    most: usize,
    left: usize,
    left_of_prim: usize,
}

/// The arcs of a layer.
pub struct LayerArcs {
    arcs: HashMap<Path, Vec<Arc>>,
    sublayers: Vec<String>,
    default_prim: Option<Path>,
    variables: HashMap<String, Value>,
    too_many_clips: bool,
}

#[derive(Clone)]
struct Arc {
    /// Empty: in the same layers.
    asset: String,
    /// `None`: the default prim.
    prim: Option<Path>,
    is_class: bool,
}

/// A layer and its sublayers, strongest first.
struct Stack {
    layers: Vec<(String, Rc<LayerArcs>)>,
    variables: HashMap<String, Value>,
}

type Site = (Rc<Stack>, Path);

impl LayerArcs {
    pub fn read(data: &dyn AbstractData) -> LayerArcs {
        let root = Path::abs_root();
        let field = |path: &Path, key: FieldKey| Some(data.try_field(path, key.as_str()).ok()??.into_owned());
        let sublayers = match field(&root, FieldKey::SubLayers) {
            Some(Value::StringVec(names)) => names,
            _ => Vec::new(),
        };
        let default_prim = match field(&root, FieldKey::DefaultPrim) {
            Some(Value::Token(name)) => prim_of_name(name.as_str()),
            _ => None,
        };
        let variables = stack_expression_variables(data, &HashMap::new()).unwrap_or_default();
        let mut read = LayerArcs { arcs: HashMap::new(), sublayers, default_prim, variables, too_many_clips: false };
        for path in data.spec_paths().into_iter().filter(|path| !path.is_property_path()) {
            let mut arcs = Vec::new();
            let prim = |path: &Path| Some(path.strip_all_variant_selections()).filter(|path| !path.is_empty());
            if let Some(Value::ReferenceListOp(list)) = field(&path, FieldKey::References) {
                arcs.extend(list.iter().map(|to| Arc {
                    asset: to.asset_path.clone(),
                    prim: prim(&to.prim_path),
                    is_class: false,
                }));
            }
            let payload = |to: &openusd::sdf::Payload| Arc {
                asset: to.asset_path.clone(),
                prim: prim(&to.prim_path),
                is_class: false,
            };
            match field(&path, FieldKey::Payload) {
                Some(Value::Payload(to)) => arcs.push(payload(&to)),
                Some(Value::PayloadListOp(list)) => arcs.extend(list.iter().map(payload)),
                _ => {}
            }
            for key in [FieldKey::InheritPaths, FieldKey::Specializes] {
                if let Some(Value::PathListOp(list)) = field(&path, key) {
                    arcs.extend(list.iter().map(|to| Arc { asset: String::new(), prim: prim(to), is_class: true }));
                }
            }
            if !arcs.is_empty() {
                read.arcs.entry(path.strip_all_variant_selections()).or_default().extend(arcs);
            }
            // A prim at the second path is the one that was at the first.
            for key in [FieldKey::LayerRelocates, FieldKey::Relocates] {
                let Some(Value::Relocates(pairs)) = field(&path, key) else { continue };
                for (from, to) in pairs {
                    let arc = Arc { asset: String::new(), prim: prim(&from), is_class: false };
                    read.arcs.entry(to.strip_all_variant_selections()).or_default().push(arc);
                }
            }
            if let Some(Value::Dictionary(sets)) = field(&path, FieldKey::Clips) {
                read.too_many_clips |= sets.values().any(has_too_many_clips);
            }
        }
        read
    }
}

/// Whether a set of clips stands for too many files.
fn has_too_many_clips(set: &Value) -> bool {
    let Value::Dictionary(set) = set else { return false };
    let number = |key: &str| match set.get(key) {
        Some(Value::Double(number)) => Some(*number),
        Some(Value::Float(number)) => Some(f64::from(*number)),
        Some(Value::Int(number)) => Some(f64::from(*number)),
        _ => None,
    };
    let listed = match set.get("assetPaths") {
        Some(Value::AssetPathVec(paths)) => paths.len() as f64,
        _ => 0.0,
    };
    let template = (|| {
        let (start, end) = (number("templateStartTime")?, number("templateEndTime")?);
        Some((end - start) / number("templateStride")?)
    })();
    listed > MOST_CLIPS || template.is_some_and(|clips| clips.is_nan() || clips > MOST_CLIPS)
}

/// A root prim, by its name or path.
fn prim_of_name(name: &str) -> Option<Path> {
    let path = if name.starts_with('/') { name.to_owned() } else { format!("/{name}") };
    openusd::sdf::path(&path).ok()
}

impl<L: Layers> SiteCount<L> {
    /// Of a stage with this first layer, of whose files there are so many bytes.
    pub fn new(layers: L, root: &str, bytes: usize) -> SiteCount<L> {
        let most = FEW_SITES + bytes / BYTES_OF_A_SITE;
        SiteCount {
            known: HashMap::new(),
            stacks: HashMap::new(),
            counted: HashSet::new(),
            root: layers.identifier(root, ""),
            layers,
            most,
            left: most,
            left_of_prim: 0,
        }
    }

    /// Counts the sites of a prim, and of those above it, if they are not counted yet.
    pub fn count(&mut self, prim: &Path) -> Result<(), TooMuch> {
        if prim.is_abs_root() || !self.counted.insert(prim.clone()) {
            return Ok(());
        }
        if let Some(above) = prim.parent() {
            self.count(&above)?;
        }
        self.left_of_prim = MOST_SITES_OF_A_PRIM;
        let stack = self.stack(&self.root.clone(), &HashMap::new())?;
        self.site(stack, prim.clone(), &mut Vec::new())
    }

    /// A site, and all to which arcs lead from it. `way`: the sites that lead to it.
    fn site(&mut self, stack: Rc<Stack>, path: Path, way: &mut Vec<Site>) -> Result<(), TooMuch> {
        self.left = self.left.checked_sub(1).ok_or(TooMuch::Sites(self.most))?;
        self.left_of_prim = self.left_of_prim.checked_sub(1).ok_or(TooMuch::SitesOfAPrim)?;
        // A circle is not composed further.
        if way.iter().any(|(other, at)| Rc::ptr_eq(other, &stack) && *at == path) {
            return Ok(());
        }
        if way.len() > MOST_STEPS {
            return Err(TooMuch::Steps);
        }
        way.push((stack.clone(), path.clone()));
        let mut from = Some(path.clone());
        while let Some(prim) = from.filter(|prim| !prim.is_abs_root()) {
            for (layer, arcs) in &stack.layers {
                for arc in arcs.arcs.get(&prim).into_iter().flatten() {
                    self.follow(arc, &stack, layer, (&prim, &path), way)?;
                }
            }
            from = prim.parent();
        }
        way.pop();
        Ok(())
    }

    /// The sites to which an arc leads. `prim`: where it stands; `path`: that prim, or one below it, which is composed.
    fn follow(
        &mut self,
        arc: &Arc,
        stack: &Rc<Stack>,
        layer: &str,
        (prim, path): (&Path, &Path),
        way: &mut Vec<Site>,
    ) -> Result<(), TooMuch> {
        let target = if arc.asset.is_empty() {
            stack.clone()
        } else {
            let Some(asset) = evaluate_string(&arc.asset, &stack.variables).value else { return Ok(()) };
            self.stack(&self.layers.identifier(&asset, layer), &stack.variables)?
        };
        let default = || target.layers.first().and_then(|(_, arcs)| arcs.default_prim.clone());
        let Some(to) = arc.prim.clone().or_else(default) else { return Ok(()) };
        let Some(mut to) = path.replace_prefix(prim, &to) else { return Ok(()) };
        self.site(target, to.clone(), way)?;
        if arc.is_class {
            // It is composed in the layers that lead here, too, under the name that it has there.
            for at in (1..way.len()).rev() {
                to = to.replace_prefix(&way[at].1, &way[at - 1].1).unwrap_or(to);
                let stack = way[at - 1].0.clone();
                self.site(stack, to.clone(), &mut way[..at].to_vec())?;
            }
        }
        Ok(())
    }

    /// A layer with its sublayers. `variables`: those that the layers before it give.
    fn stack(&mut self, name: &str, variables: &HashMap<String, Value>) -> Result<Rc<Stack>, TooMuch> {
        let own = self.layer(name)?.map(|layer| layer.variables.clone()).unwrap_or_default();
        let variables: HashMap<String, Value> = own.into_iter().chain(variables.clone()).collect();
        let sorted: BTreeMap<_, _> = variables.iter().map(|(name, value)| (name, format!("{value:?}"))).collect();
        let key = format!("{name} {sorted:?}");
        if let Some(known) = self.stacks.get(&key) {
            return Ok(known.clone());
        }
        let (mut layers, mut names) = (Vec::new(), vec![name.to_owned()]);
        let mut seen: HashSet<String> = names.iter().cloned().collect();
        while let Some(name) = names.pop() {
            let Some(layer) = self.layer(&name)? else { continue };
            for sublayer in layer.sublayers.iter().rev() {
                let Some(path) = evaluate_string(sublayer, &variables).value else { continue };
                let sublayer = self.layers.identifier(&path, &name);
                if seen.insert(sublayer.clone()) {
                    names.push(sublayer);
                }
            }
            layers.push((name, layer));
        }
        let stack = Rc::new(Stack { layers, variables });
        self.stacks.insert(key, stack.clone());
        Ok(stack)
    }

    fn layer(&mut self, name: &str) -> Result<Option<Rc<LayerArcs>>, TooMuch> {
        if let Some(known) = self.known.get(name) {
            return Ok(known.clone());
        }
        let layer = self.layers.arcs(name);
        self.known.insert(name.to_owned(), layer.clone());
        match layer {
            Some(layer) if layer.too_many_clips => Err(TooMuch::Clips),
            layer => Ok(layer),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One layer.
    struct Text(String);

    impl Layers for Text {
        fn arcs(&self, name: &str) -> Option<Rc<LayerArcs>> {
            let read = || LayerArcs::read(&openusd::usda::parse(&self.0).expect("it is USD"));
            (name == "root").then(|| Rc::new(read()))
        }

        fn identifier(&self, path: &str, _: &str) -> String {
            path.to_owned()
        }
    }

    fn sites(prims: &str, prim: &str) -> Result<usize, TooMuch> {
        let mut count = SiteCount::new(Text(format!("#usda 1.0\n{prims}")), "root", 0);
        count.count(&openusd::sdf::path(prim).expect("a path"))?;
        Ok(count.most - count.left)
    }

    #[test]
    fn sites_are_counted_along_every_arc() {
        let count = |prims: &str, prim: &str| sites(prims, prim).unwrap_or(0);
        assert_eq!(count("def \"a\" {}", "/a"), 1);
        assert_eq!(count("def \"a\" {}\ndef \"b\" (references = [</a>, </c>]) {}\ndef \"c\" {}", "/b"), 3);
        assert_eq!(count("def \"a\" { def \"x\" {} }\ndef \"b\" (payload = </a>) {}", "/b/x"), 2 + 2);
        assert_eq!(count("def \"a\" (references = </b>) {}\ndef \"b\" (references = </a>) {}", "/a"), 3);
        // A class that a referred prim inherits counts where the reference stands, too.
        let class = "class \"c\" {}\ndef \"a\" (inherits = </c>) {}\ndef \"b\" (references = </a>) {}";
        assert_eq!(count(class, "/b"), 4);
        let variants = "def \"a\" (variantSets = \"v\") { variantSet \"v\" = { \"x\" (references = </b>) {} } }";
        assert_eq!(count(&format!("{variants}\ndef \"b\" {{}}"), "/a"), 2);
    }

    #[test]
    fn what_doubles_at_every_step_ends() {
        for arc in ["references", "payload", "inherits", "specializes"] {
            let mut prims = String::from("def \"a0\" {}\ndef \"b0\" {}\n");
            for n in 1..30 {
                for name in ["a", "b"] {
                    let before = n - 1;
                    prims += &format!("def \"{name}{n}\" ({arc} = [</a{before}>, </b{before}>]) {{}}\n");
                }
            }
            let Err(TooMuch::SitesOfAPrim) = sites(&prims, "/a29") else { panic!("{arc}: it is counted") };
        }
        // Many prims of some sites each.
        let many = format!("def \"a0\" {{}}\n{}", "def \"b\" (references = </a0>) {}\n");
        let mut count = SiteCount::new(Text(format!("#usda 1.0\n{many}")), "root", 0);
        let all = (0..FEW_SITES).map(|n| count.count(&openusd::sdf::path(format!("/b/c{n}")).expect("a path")));
        let what = all.filter_map(Result::err).next().expect("it is counted").to_string();
        assert!(what.contains("its references multiply to more than 50000 parts of few bytes: it is not composed"));
        let chain: String = (1..400).map(|n| format!("def \"a{n}\" (references = </a{}>) {{}}\n", n - 1)).collect();
        let what = sites(&chain, "/a399").expect_err("it is too long").to_string();
        assert!(what.contains("its prims refer to each other more than 200 times in a row"));
    }

    #[test]
    fn clips_without_an_end_are_refused() {
        let clips = |end: &str, stride: &str| {
            let set = format!(
                "string templateAssetPath = \"a.#.usda\"\ndouble templateStartTime = 0\n\
                 double templateEndTime = {end}\n\
                 double templateStride = {stride}\n"
            );
            sites(&format!("def \"a\" (clips = {{ dictionary default = {{\n{set}}} }}) {{}}"), "/a")
        };
        assert!(clips("100", "1").is_ok());
        for (end, stride) in [("1e300", "1"), ("inf", "1"), ("1", "1e-9"), ("1", "0")] {
            assert!(matches!(clips(end, stride), Err(TooMuch::Clips)), "{end} {stride}");
        }
    }
}
