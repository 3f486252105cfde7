//! A USD layer while it grows: prims, their properties, and the file that comes of them.

use super::binary;
use super::layout::Layout;
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use openusd::gf;
use openusd::sdf::{self, ChildrenKey, FieldKey, ListOp, Path, Reference, SpecType, Specifier, Value, Variability};
use openusd::tf::Token;
use openusd::usda::TextWriter;
use std::collections::BTreeMap;
use std::io::{Error, Result};

/// Beyond what a few products of rotations are off by.
const ROUNDING: f64 = 1e-9;

/// How a layer is stored.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    Text,
    Crate,
}

/// The layer. Prims and properties stay in the order in which they were added.
pub struct Layer {
    encoding: Encoding,
    pub layout: Layout,
    data: sdf::Data,
    /// Names of each prim's children and properties.
    prims: BTreeMap<String, Vec<Token>>,
    properties: BTreeMap<String, Vec<Token>>,
}

impl Layer {
    pub fn new(encoding: Encoding, layout: Layout) -> Layer {
        let mut data = sdf::Data::new();
        data.create_spec(Path::abs_root(), SpecType::PseudoRoot);
        Layer { encoding, layout, data, prims: BTreeMap::new(), properties: BTreeMap::new() }
    }

    /// A text as the layer has to hold it: a reader of `.usda` takes a backslash for the beginning of an escape, and
    /// the writer writes none of these.
    pub fn text(&self, text: &str) -> String {
        match self.encoding {
            Encoding::Text => text.replace('\\', "\\\\"),
            Encoding::Crate => text.to_owned(),
        }
    }

    /// Makes a prim that of an asset: of a prim in it, or of its default prim.
    pub fn refer(&mut self, prim: &Path, asset: &str, target: Option<&str>) {
        let prim_path = target.and_then(|target| sdf::path(target).ok()).unwrap_or_default();
        let reference = Reference { asset_path: asset.to_owned(), prim_path, ..Default::default() };
        self.set(prim, FieldKey::References, Value::ReferenceListOp(ListOp::prepended([reference])));
    }

    /// Switches off a prim of what a prim refers to, by its path from there.
    pub fn switch_off(&mut self, prim: &Path, below: &str) {
        let mut at = prim.clone();
        for name in below.split('/') {
            let Ok(next) = at.append_path(name) else { return };
            let names = self.prims.entry(at.as_str().to_owned()).or_default();
            if names.iter().all(|known| known.as_str() != name) {
                names.push(Token::from(name));
                let spec = self.data.create_spec(next.clone(), SpecType::Prim);
                spec.add(FieldKey::Specifier, Value::Specifier(Specifier::Over));
            }
            at = next;
        }
        self.set(&at, FieldKey::Active, false);
    }

    /// Places a prim. Parts that are whole numbers but for rounding become that.
    pub fn transform(&mut self, prim: &Path, transform: DAffine3) {
        let whole = |x: f64| if (x - x.round()).abs() < ROUNDING { x.round() } else { x };
        let transform = DAffine3::from_cols_array(&transform.to_cols_array().map(whole));
        if transform.matrix3 == DMat3::IDENTITY {
            if transform.translation != DVec3::ZERO {
                let place = gf::Vec3d::from(transform.translation.to_array());
                self.attribute(prim, "double3 xformOp:translate", place);
                self.order(prim, &["xformOp:translate"]);
            }
            return;
        }
        // By rows, and points stand before their matrix: the same sixteen numbers.
        let matrix = DMat4::from(transform).to_cols_array();
        self.attribute(prim, "matrix4d xformOp:transform", gf::Matrix4d(matrix));
        self.order(prim, &["xformOp:transform"]);
    }

    /// Defines a prim below another one. Without a kind, it has that of what it refers to. `name` becomes one that USD
    /// takes and that no other child has; where that changes it, the prim is displayed by it.
    pub fn prim(&mut self, parent: &Path, name: &str, kind: &str) -> Path {
        let taken = self.prims.entry(parent.as_str().to_owned()).or_default();
        let plain = identifier(name);
        let numbered = (1..).map(|number| format!("{plain}_{number}"));
        let own = std::iter::once(plain.clone()).chain(numbered).find(|own| taken.iter().all(|t| t.as_str() != own));
        let own = own.expect("there are more numbers than children");
        taken.push(Token::from(&own));
        let path = parent.append_path(own.as_str()).expect("an identifier makes a path");
        let spec = self.data.create_spec(path.clone(), SpecType::Prim);
        spec.add(FieldKey::Specifier, Value::Specifier(Specifier::Def));
        if !kind.is_empty() {
            spec.add(FieldKey::TypeName, Value::Token(kind.into()));
        }
        if own != name {
            let shown = Value::String(self.text(name));
            self.set(&path, FieldKey::DisplayName, shown);
        }
        path
    }

    /// Sets a field of a prim, or of the layer itself.
    pub fn set(&mut self, path: &Path, field: impl AsRef<str>, value: impl Into<Value>) {
        self.data.spec_mut(path).expect("it was added").add(field, value);
    }

    /// Names the API schemas of a prim.
    pub fn apply(&mut self, prim: &Path, schema: &str) {
        match self.encoding {
            // The crate writes a list of one without its brackets, which USD does not read.
            Encoding::Text => self.set(prim, "prepend apiSchemas", vec![Token::from(schema)]),
            Encoding::Crate => {
                self.set(prim, FieldKey::ApiSchemas, Value::TokenListOp(ListOp::prepended([Token::from(schema)])));
            }
        }
    }

    /// Names the API schemas of a prim, all that it has.
    pub fn apply_all(&mut self, prim: &Path, schemas: &[&str]) {
        if let [one] = schemas {
            return self.apply(prim, one);
        }
        let schemas: Vec<Token> = schemas.iter().copied().map(Token::from).collect();
        match self.encoding {
            Encoding::Text => self.set(prim, "prepend apiSchemas", schemas),
            Encoding::Crate => self.set(prim, FieldKey::ApiSchemas, Value::TokenListOp(ListOp::prepended(schemas))),
        }
    }

    /// Adds an attribute, declared as in `.usda`: `uniform token subdivisionScheme`.
    pub fn attribute(&mut self, prim: &Path, declared: &str, value: impl Into<Value>) {
        let path = self.declare(prim, declared);
        self.set(&path, FieldKey::Default, value);
    }

    /// Adds a primvar, with its interpolation.
    pub fn primvar(&mut self, prim: &Path, declared: &str, interpolation: &str, value: impl Into<Value>) {
        let path = self.declare(prim, declared);
        self.set(&path, "interpolation", Token::from(interpolation));
        self.set(&path, FieldKey::Default, value);
    }

    /// Adds an attribute that changes with time, given by frames; one that does not is stored as such.
    pub fn animated(&mut self, prim: &Path, declared: &str, mut samples: Vec<(f64, Value)>) {
        let path = self.declare(prim, declared);
        samples.iter_mut().for_each(|(frame, _)| *frame = self.layout.time(*frame));
        if samples.windows(2).all(|pair| pair[0].1 == pair[1].1) {
            if let Some((_, value)) = samples.pop() {
                self.set(&path, FieldKey::Default, value);
            }
        } else {
            self.set(&path, FieldKey::TimeSamples, Value::TimeSamples(samples));
        }
    }

    /// Adds an attribute without a value.
    pub fn declare(&mut self, prim: &Path, declared: &str) -> Path {
        let mut words: Vec<&str> = declared.split(' ').collect();
        let name = words.pop().expect("a declaration ends in a name");
        let kind = words.pop().expect("a declaration has a type");
        let path = self.property(prim, name, SpecType::Attribute);
        self.set(&path, FieldKey::TypeName, Token::from(kind));
        for word in words {
            match word {
                "uniform" => self.set(&path, FieldKey::Variability, Value::Variability(Variability::Uniform)),
                "custom" => self.set(&path, FieldKey::Custom, true),
                _ => unreachable!("{word} is none of USD's words"),
            }
        }
        path
    }

    /// Adds an attribute that takes its value from another one.
    pub fn connect(&mut self, prim: &Path, declared: &str, source: &Path) {
        let path = self.declare(prim, declared);
        self.set(&path, FieldKey::ConnectionPaths, Value::PathListOp(ListOp::explicit([source.clone()])));
    }

    /// Adds a relationship.
    pub fn relationship(&mut self, prim: &Path, name: &str, targets: &[Path]) {
        let path = self.property(prim, name, SpecType::Relationship);
        // Text says so by itself.
        if self.encoding == Encoding::Crate {
            self.set(&path, FieldKey::Variability, Value::Variability(Variability::Uniform));
        }
        self.set(&path, FieldKey::TargetPaths, Value::PathListOp(ListOp::explicit(targets.iter().cloned())));
    }

    /// Names the transforms of a prim, the outermost first.
    pub fn order(&mut self, prim: &Path, ops: &[&str]) {
        let ops: Vec<Token> = ops.iter().copied().map(Token::from).collect();
        self.attribute(prim, "uniform token[] xformOpOrder", ops);
    }

    /// The rotations of an instancer at its moments. Beside the precise ones stand those in half precision, which older
    /// programs know alone; others prefer the precise ones, which may be left out.
    pub fn orientations(&mut self, instancer: &Path, samples: Vec<(f64, Vec<gf::Quatf>)>, is_precise: bool) {
        let half = |q: &gf::Quatf| gf::Quath::from([q.w, q.x, q.y, q.z].map(gf::f16::from_f32));
        let halves = samples.iter().map(|(time, all)| (*time, all.iter().map(half).collect::<Vec<_>>().into()));
        self.animated(instancer, "quath[] orientations", halves.collect());
        if is_precise {
            let samples = samples.into_iter().map(|(time, all)| (time, all.into())).collect();
            self.animated(instancer, "quatf[] orientationsf", samples);
        }
    }

    fn property(&mut self, prim: &Path, name: &str, kind: SpecType) -> Path {
        let path = prim.append_property(name).expect("a declaration has a name that USD takes");
        self.properties.entry(prim.as_str().to_owned()).or_default().push(Token::from(name));
        self.data.create_spec(path.clone(), kind);
        path
    }

    /// The bytes of the layer's file.
    pub fn encode(mut self) -> Result<Vec<u8>> {
        let children = [(self.properties, ChildrenKey::PropertyChildren), (self.prims, ChildrenKey::PrimChildren)];
        for (of, key) in children {
            for (path, names) in of {
                let path = sdf::path(path).expect("it was a path before");
                self.data.spec_mut(&path).expect("it was added").add(key, Value::TokenVec(names));
            }
        }
        match self.encoding {
            Encoding::Text => TextWriter::write_to_string(&self.data).map(String::into_bytes).map_err(Error::other),
            Encoding::Crate => binary::encode(&self.data),
        }
    }
}

pub fn vector(v: DVec3) -> gf::Vec3f {
    v.as_vec3().to_array().into()
}

pub fn quaternion(q: DQuat) -> gf::Quatf {
    let [x, y, z, w] = q.as_quat().to_array();
    gf::Quatf { w, x, y, z }
}

/// A model's name without its file's folder and ending; of a part of a file, the part's name.
pub fn short_name(name: &str) -> &str {
    if let (file, Some(node)) = cairn_files::split_node(name) {
        return if cairn_files::is_usd(file) { node.rsplit('/').next().unwrap_or(node) } else { node };
    }
    let file = name.rsplit(['/', '\\']).next().unwrap_or(name);
    file.rsplit_once('.').map_or(file, |(stem, _)| stem)
}

/// A name as a prim may have it in every version of USD.
fn identifier(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let mut own: String = name.chars().map(plain).collect();
    if own.is_empty() || own.starts_with(|c: char| c.is_ascii_digit()) {
        own.insert(0, '_');
    }
    own
}
