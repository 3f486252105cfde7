//! A composed stage: a layer with all that it takes from others. Long: what bounds a composition stands beside it.
//! Others are sublayers, references, payloads, variants and classes, its instances included. Files are read by their
//! paths from the first layer's folder.

#[cfg(test)]
mod tests;

use super::arcs::{LayerArcs, Layers, SiteCount};
use super::sound::{DAMAGED, check_file, file_in, first_file, is_sound, open_package};
use super::to_gltf::number;
use super::{CRATE, TEXT, ZIP, is_usd, text};
use cairn_gltf::Resolver as Files;
use cairn_gltf::media::media_type;
use openusd::ar::{Asset, ResolvedPath, Resolver};
use openusd::gf::f16;
use openusd::sdf::{FieldKey, Path, Specifier, TimeSampleMap, Value};
use openusd::usd::{self, Attribute, TimeCode};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::io::{Cursor, Error, ErrorKind};
use std::rc::Rc;
use std::time::{Duration, Instant};

/// Files of a stage, and the longest chain in which they name each other: more than any asset has.
const MOST_FILES: usize = 10_000;
const MOST_ROUNDS: usize = 64;
/// Layers take memory when they are opened, and a package may name the same bytes often: bytes of layers in a round,
/// and how often all bytes.
const MOST_OPENED: usize = 64 << 20;
const TIMES_OPENED: usize = 8;
const OPENED_TOO_OFTEN: &str = "its layers are opened too often for their size: save it flattened";
/// The longest composition, far more than any asset takes.
const LONGEST: Duration = Duration::from_secs(300);
/// The name of the first layer, and what follows the name of a package in that of a layer in it.
const ROOT: &str = "stage";
const IN_PACKAGE: &str = ".usdz/";

/// A stage, and what was read for it.
pub struct ComposedStage {
    stage: usd::Stage,
    files: Rc<RefCell<FileTable>>,
    sites: RefCell<SiteCount<TableResolver>>,
    begun: Instant,
    /// Why it is not composed further.
    fault: RefCell<Option<String>>,
}

/// The files that a stage has asked for.
#[derive(Default)]
struct FileTable {
    /// By path; `None`: there is none.
    found: BTreeMap<String, Option<Vec<u8>>>,
    wanted: BTreeSet<String>,
    /// Of the layers that were opened.
    arcs: HashMap<String, Rc<LayerArcs>>,
    /// Bytes of all files, and those that were opened in this round.
    bytes: usize,
    opened: usize,
}

/// What is wrong with a file that a stage names.
pub struct MissingLayer {
    pub name: String,
    pub why: String,
}

/// Runs `read` on the stage of these bytes until it has all files that it asks for. Gives them, too, by their paths.
pub fn compose<T>(
    bytes: &[u8],
    files: &Files,
    mut read: impl FnMut(&ComposedStage) -> Result<T, String>,
) -> Result<(T, BTreeMap<String, Vec<u8>>), String> {
    let ending = match bytes {
        _ if bytes.starts_with(TEXT) => "usda",
        _ if bytes.starts_with(CRATE) => "usdc",
        _ if bytes.starts_with(ZIP) => "usdz",
        _ => return Err(DAMAGED.into()),
    };
    let root = format!("{ROOT}.{ending}");
    let begun = Instant::now();
    check_file(bytes)?;
    let table = Rc::new(RefCell::new(FileTable::default()));
    table.borrow_mut().add(root.clone(), Some(bytes.to_vec()));
    for _ in 0..MOST_ROUNDS {
        table.borrow_mut().opened = 0;
        let stage = ComposedStage::open(&root, &table, begun)?;
        let done = read(&stage);
        if let Some(fault) = stage.fault.take() {
            return Err(fault);
        }
        let wanted = std::mem::take(&mut table.borrow_mut().wanted);
        if wanted.is_empty() {
            // The reason why it shows less, or nothing.
            if let Some(missing) = stage.missing_layers().into_iter().next() {
                return Err(format!("it takes {} by reference, which {}", missing.name, missing.why));
            }
            let done = done?;
            drop(stage);
            let mut found = std::mem::take(&mut table.borrow_mut().found);
            found.remove(&root);
            return Ok((done, found.into_iter().filter_map(|(name, bytes)| Some((name, bytes?))).collect()));
        }
        let mut table = table.borrow_mut();
        if table.found.len() + wanted.len() > MOST_FILES {
            return Err(format!("it names more than {MOST_FILES} files"));
        }
        for name in wanted {
            // Layers and pictures alone: what else it names is none of its business.
            let bytes = files(&name).ok().filter(|bytes| is_usd(bytes) || media_type(bytes).is_some());
            if let Some(bytes) = &bytes {
                check_file(bytes).map_err(|what| format!("{name}: {what}"))?;
            }
            table.add(name, bytes);
        }
    }
    Err(format!("its files name each other more than {MOST_ROUNDS} times in a row"))
}

impl ComposedStage {
    fn open(root: &str, files: &Rc<RefCell<FileTable>>, begun: Instant) -> Result<ComposedStage, String> {
        let resolver = || TableResolver(files.clone());
        let opened = usd::Stage::builder().resolver(resolver()).open(root);
        let stage = opened.map_err(|_| DAMAGED.to_owned())?;
        let sites = SiteCount::new(resolver(), root, files.borrow().bytes);
        Ok(ComposedStage { stage, files: files.clone(), sites: RefCell::new(sites), begun, fault: RefCell::default() })
    }

    /// Whether a prim may be composed: everything that is asked of a stage begins with this.
    fn may_compose(&self, path: &Path) -> bool {
        if self.fault.borrow().is_some() {
            return false;
        }
        let counted = self.sites.borrow_mut().count(&path.prim_path());
        let fault = match counted {
            Err(fault) => fault.to_string(),
            Ok(()) if self.begun.elapsed() > LONGEST => {
                format!("it takes longer than {} s to compose: save it flattened", LONGEST.as_secs())
            }
            Ok(()) if self.files.borrow().is_exhausted() => OPENED_TOO_OFTEN.into(),
            Ok(()) => return true,
        };
        *self.fault.borrow_mut() = Some(fault);
        false
    }

    /// Why it is not composed further, if it is not.
    pub fn check(&self) -> Result<(), String> {
        self.fault.borrow().clone().map_or(Ok(()), Err)
    }

    /// A field of a prim or property; of the stage itself, of its first layer.
    pub fn field(&self, path: &Path, key: &str) -> Option<Value> {
        if path.is_abs_root() {
            return self.stage.stage_metadata(key).ok()?;
        }
        self.may_compose(path).then_some(())?;
        self.stage.attribute(path.clone()).get_metadata::<Value>(key).ok()?
    }

    /// The value of an attribute at a time code: between samples where they lead, before the first one and after the
    /// last one theirs. Of the opinions of all layers the strongest counts, of one layer samples before the default.
    pub fn value(&self, prim: &Path, name: &str, time: f64) -> Option<Value> {
        self.may_compose(prim).then_some(())?;
        let attribute = self.stage.attribute(prim.append_property(name).ok()?);
        let value = match self.is_sampled(&attribute) {
            true => {
                let value = attribute.get_at::<Value>(TimeCode::new(time)).ok()?;
                value.or_else(|| self.held(&attribute, time)).map(|value| match value {
                    Value::Int64(_) | Value::Double(_) => between(&attribute, time).unwrap_or(value),
                    value => value,
                })
            }
            false => attribute.get::<Value>().ok()?,
        };
        value.filter(is_some)
    }

    /// The samples of an attribute, without those that take its value away. `None` where it does not change with time.
    pub fn samples(&self, prim: &Path, name: &str) -> Option<TimeSampleMap> {
        self.may_compose(prim).then_some(())?;
        let attribute = self.stage.attribute(prim.append_property(name).ok()?);
        let times = self.is_sampled(&attribute).then(|| attribute.time_sample_times().ok())??;
        let samples = match attribute.time_samples().ok()? {
            Some(samples) => samples,
            // They are in clips.
            None => times.into_iter().filter_map(|time| Some((time, self.value(prim, name, time)?))).collect(),
        };
        Some(samples.into_iter().filter(|(_, value)| is_some(value)).collect())
    }

    /// The value of the last sample before a time, if the next one takes the value away.
    fn held(&self, attribute: &Attribute, time: f64) -> Option<Value> {
        let samples = attribute.time_samples().ok()??;
        samples.into_iter().take_while(|(at, _)| *at <= time).last().map(|(_, value)| value)
    }

    /// Whether samples are the strongest opinion about an attribute.
    fn is_sampled(&self, attribute: &Attribute) -> bool {
        if !attribute.num_time_samples().is_ok_and(|count| count > 0) {
            return false;
        }
        let Ok(stack) = attribute.property_stack() else { return true };
        let strongest = stack.into_iter().find_map(|(layer, path)| {
            let layer = self.stage.layer(&layer)?;
            let has = |key: FieldKey| layer.data().has_field(&path, key.as_str());
            // Of one layer, samples count before the default.
            if has(FieldKey::TimeSamples) { Some(true) } else { has(FieldKey::Default).then_some(false) }
        });
        strongest.unwrap_or(true)
    }

    /// Targets of a relationship; where one is another relationship, its targets.
    pub fn targets(&self, prim: &Path, name: &str) -> Vec<Path> {
        let (mut found, mut seen) = (Vec::new(), BTreeSet::new());
        let mut open: Vec<Path> = prim.append_property(name).into_iter().collect();
        while let Some(path) = open.pop() {
            if !seen.insert(path.as_str().to_owned()) || !self.may_compose(&path) {
                continue;
            }
            let is_relationship = path.is_property_path()
                && (seen.len() == 1 || self.stage.relationship(path.clone()).has_authored_targets().unwrap_or(false));
            if is_relationship {
                let targets = self.stage.relationship(path).targets().unwrap_or_default();
                open.extend(targets.into_iter().rev());
            } else {
                found.push(path);
            }
        }
        found
    }

    /// Sources of an attribute.
    pub fn sources(&self, prim: &Path, name: &str) -> Vec<Path> {
        let Ok(path) = prim.append_property(name) else { return Vec::new() };
        if !self.may_compose(prim) {
            return Vec::new();
        }
        self.stage.attribute(path).connections().unwrap_or_default()
    }

    /// The defined prims right below one.
    pub fn children(&self, prim: &Path) -> Vec<Path> {
        if !self.may_compose(prim) {
            return Vec::new();
        }
        let names = match prim.is_abs_root() {
            true => self.stage.root_prims(),
            false => self.stage.prim(prim.clone()).child_names(),
        };
        let paths = names.unwrap_or_default().into_iter().filter_map(|name| prim.append_path(name.as_str()).ok());
        paths.filter(|path| self.is_shown(path)).collect()
    }

    /// Whether a prim is defined, and no class.
    pub fn is_shown(&self, prim: &Path) -> bool {
        self.may_compose(prim) && matches!(self.stage.prim(prim.clone()).specifier(), Ok(Some(Specifier::Def)))
    }

    /// The prim that a reference to the file takes.
    pub fn default_prim(&self) -> Option<Path> {
        let name = self.stage.default_prim()?;
        let path = match name.as_str().strip_prefix('/') {
            Some(_) => openusd::sdf::path(name.as_str()).ok()?,
            None => Path::abs_root().append_path(name.as_str()).ok()?,
        };
        self.is_shown(&path).then_some(path)
    }

    /// Size of all files that it is made of.
    pub fn bytes(&self) -> usize {
        self.files.borrow().bytes
    }

    /// A file that the stage has asked for.
    pub fn file(&self, name: &str) -> Option<Vec<u8>> {
        self.files.borrow().open(name)
    }

    fn missing_layers(&self) -> Vec<MissingLayer> {
        use openusd::pcp::Error as Fault;
        let missing = |fault: Fault| {
            let (name, why) = match fault {
                Fault::UnresolvedLayer { asset_path, .. } => (asset_path, "is not there".to_owned()),
                Fault::UnresolvedSublayer { asset_path, .. } => (asset_path, "is not there".to_owned()),
                Fault::MalformedLayer { asset_path, .. } => (asset_path, "is damaged, or no USD".to_owned()),
                Fault::MalformedSublayer { asset_path, .. } => (asset_path, "is damaged, or no USD".to_owned()),
                Fault::UnresolvedPrimPath { target_layer, prim_path, .. } => {
                    (target_layer, format!("has no prim {}", prim_path.as_str()))
                }
                Fault::MissingDefaultPrim { layer_id, .. } => (layer_id, "has no default prim".to_owned()),
                _ => return None,
            };
            Some(MissingLayer { name, why })
        };
        self.stage.composition_errors().into_iter().filter_map(missing).collect()
    }
}

impl FileTable {
    fn add(&mut self, name: String, bytes: Option<Vec<u8>>) {
        self.bytes += bytes.as_ref().map_or(0, Vec::len);
        self.found.insert(name, bytes);
    }

    fn is_exhausted(&self) -> bool {
        self.opened > MOST_OPENED + TIMES_OPENED * self.bytes
    }

    fn has(&self, name: &str) -> bool {
        match split_package(name) {
            None => self.found.get(name).is_some_and(Option::is_some),
            Some((package, inner)) => {
                let package = self.found.get(package).and_then(Option::as_deref);
                package.and_then(open_package).is_some_and(|archive| archive.index_for_name(inner).is_some())
            }
        }
    }

    /// A file, or one in a package.
    fn open(&self, name: &str) -> Option<Vec<u8>> {
        match split_package(name) {
            None => self.found.get(name)?.clone(),
            Some((package, inner)) => file_in(self.found.get(package)?.as_deref()?, inner),
        }
    }
}

/// The files of a table; what is not in it yet is wanted.
struct TableResolver(Rc<RefCell<FileTable>>);

impl Resolver for TableResolver {
    fn create_identifier(&self, asset_path: &str, anchor: Option<&ResolvedPath>) -> String {
        let path = asset_path.replace('\\', "/");
        // `kit.usdz[brick.usd]`
        let path = match path.split_once('[') {
            Some((package, inner)) if is_package(package) => format!("{package}/{}", inner.trim_end_matches(']')),
            _ => path,
        };
        let anchor = anchor.map(|anchor| anchor.to_string_lossy().into_owned()).unwrap_or_default();
        let own = if path.starts_with('/') || path.contains(':') {
            path
        } else if let Some((package, inner)) = split_package(&anchor) {
            // What is in a package names what is in it.
            format!("{package}/{}", join(inner, &path))
        } else {
            join(&anchor, &path)
        };
        if !is_package(&own) {
            return own;
        }
        // Of a package, its first layer.
        let table = self.0.borrow();
        let package = table.found.get(&own).and_then(Option::as_deref);
        match package.and_then(first_file) {
            Some(first) => format!("{own}/{first}"),
            None => own,
        }
    }

    fn resolve(&self, asset_path: &str) -> Option<ResolvedPath> {
        let mut table = self.0.borrow_mut();
        let file = split_package(asset_path).map_or(asset_path, |(package, _)| package);
        if file.is_empty() {
            return None;
        }
        if !table.found.contains_key(file) {
            table.wanted.insert(file.to_owned());
            return None;
        }
        table.has(asset_path).then(|| ResolvedPath::new(asset_path))
    }

    fn resolve_for_new_asset(&self, _: &str) -> Option<ResolvedPath> {
        None
    }

    /// Only what is sound: the crate's readers trust what they read.
    fn open_asset(&self, resolved: &ResolvedPath) -> std::io::Result<Box<dyn Asset>> {
        let name = resolved.to_string_lossy();
        let bytes = {
            let mut table = self.0.borrow_mut();
            if table.is_exhausted() {
                return Err(Error::other(OPENED_TOO_OFTEN));
            }
            let bytes = table.open(&name).ok_or(ErrorKind::NotFound)?;
            table.opened += bytes.len();
            bytes
        };
        if !is_sound(&bytes) {
            return Err(Error::other(DAMAGED));
        }
        Ok(Box::new(Cursor::new(if bytes.starts_with(CRATE) { bytes } else { text::readable(bytes) })))
    }

    fn get_modification_timestamp(&self, _: &str, _: &ResolvedPath) -> Option<std::time::SystemTime> {
        None
    }
}

impl Layers for TableResolver {
    fn arcs(&self, name: &str) -> Option<Rc<LayerArcs>> {
        if let Some(known) = self.0.borrow().arcs.get(name) {
            return Some(known.clone());
        }
        let bytes = self.0.borrow().open(name).filter(|bytes| is_sound(bytes))?;
        let arcs = Rc::new(LayerArcs::read(&*super::open(&bytes)?));
        self.0.borrow_mut().arcs.insert(name.to_owned(), arcs.clone());
        Some(arcs)
    }

    fn identifier(&self, path: &str, layer: &str) -> String {
        let anchor = (!layer.is_empty()).then(|| ResolvedPath::new(layer));
        self.create_identifier(path, anchor.as_ref())
    }
}

fn is_package(name: &str) -> bool {
    name.to_ascii_lowercase().ends_with(".usdz")
}

/// `kit.usdz/brick.usd` -> package and file in it.
fn split_package(name: &str) -> Option<(&str, &str)> {
    let at = name.to_ascii_lowercase().find(IN_PACKAGE)? + IN_PACKAGE.len();
    Some((&name[..at - 1], &name[at..]))
}

/// A path from the folder of a file, without `.`, and with `..` in front only.
fn join(from: &str, path: &str) -> String {
    let folder = from.rsplit_once('/').map_or("", |(folder, _)| folder);
    let mut parts: Vec<&str> = Vec::new();
    for part in folder.split('/').chain(path.split('/')) {
        match part {
            "" | "." => {}
            ".." if parts.last().is_some_and(|last| *last != "..") => drop(parts.pop()),
            part => parts.push(part),
        }
    }
    parts.join("/")
}

/// The number of an attribute between samples, of which the reader takes those in text for integers that look like one:
/// it does not lead from them to the next.
fn between(attribute: &Attribute, time: f64) -> Option<Value> {
    let kind = attribute.type_name().ok()??;
    if !["half", "float", "double"].contains(&kind.as_str()) {
        return None;
    }
    let samples = attribute.time_samples().ok()??;
    let numbers: Vec<(f64, f64)> = samples.into_iter().filter_map(|(at, value)| Some((at, number(value)?))).collect();
    let next = numbers.partition_point(|(at, _)| *at <= time);
    let (before, after) = (numbers.get(next.saturating_sub(1))?, numbers.get(next).or(numbers.last())?);
    let share = if after.0 > before.0 { ((time - before.0) / (after.0 - before.0)).max(0.0) } else { 0.0 };
    let number = before.1 + (after.1 - before.1) * share;
    Some(if kind == "half" { Value::Half(f16::from_f64(number)) } else { Value::Double(number) })
}

/// Whether it is a value, and none that takes one away.
fn is_some(value: &Value) -> bool {
    !matches!(value, Value::ValueBlock | Value::None)
}

/// A token as text.
pub fn token(value: Option<Value>) -> Option<String> {
    match value? {
        Value::Token(token) => Some(token.as_str().to_owned()),
        // A sample in text.
        Value::String(text) => Some(text),
        _ => None,
    }
}
