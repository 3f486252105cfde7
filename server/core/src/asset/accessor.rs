//! Accessors: elements that are known to lie inside their buffer before the first one is read.

use std::collections::BTreeMap;
use std::rc::Rc;

use glam::DVec3;

use super::buffer::{Buffers, View};
use super::compressed::Attribute;
use super::json::{Json, element};
use super::log::{Checked, Log};
use super::problem::ProblemKind;

/// What an accessor is read as; it decides which formats it may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    /// Points in floats or, under KHR_mesh_quantization, in integers too.
    Position {
        quantized: bool,
    },
    Index,
    /// The translation or scale of an instance.
    Vector,
    /// The rotation of an instance: a quaternion, x y z w.
    Rotation,
}

impl Role {
    fn name(self) -> &'static str {
        match self {
            Role::Position { .. } => "POSITION",
            Role::Index => "indices",
            Role::Vector => "instances",
            Role::Rotation => "instance rotations",
        }
    }

    fn shape(self) -> (&'static str, usize) {
        match self {
            Role::Position { .. } | Role::Vector => ("VEC3", 3),
            Role::Index => ("SCALAR", 1),
            Role::Rotation => ("VEC4", 4),
        }
    }

    fn expected(self) -> &'static str {
        match self {
            Role::Position { quantized: false } => {
                "VEC3 of floats (5126), unless the file declares KHR_mesh_quantization"
            }
            Role::Position { quantized: true } => "VEC3 of floats or of 8 or 16 bit integers (5120 to 5123, 5126)",
            Role::Index => "SCALAR of unsigned integers (5121, 5123, 5125)",
            Role::Vector => "VEC3 of floats (5126)",
            Role::Rotation => "VEC4 of floats or signed integers (5126, 5120, 5122)",
        }
    }

    fn admits(self, component: Component) -> bool {
        use Component::*;
        match self {
            Role::Position { quantized: true } => component != U32,
            Role::Position { quantized: false } | Role::Vector => component == F32,
            Role::Index => matches!(component, U8 | U16 | U32),
            Role::Rotation => matches!(component, F32 | I8 | I16),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn from_code(code: u64) -> Option<Component> {
        use Component::*;
        Some(match code {
            5120 => I8,
            5121 => U8,
            5122 => I16,
            5123 => U16,
            5125 => U32,
            5126 => F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::U32 | Component::F32 => 4,
        }
    }

    /// The largest value: what 1 is to a normalised integer, and what restarts a strip.
    pub fn largest(self) -> u32 {
        match self {
            Component::I8 => 127,
            Component::U8 => 255,
            Component::I16 => 32767,
            Component::U16 => 65535,
            Component::U32 | Component::F32 => u32::MAX,
        }
    }

    /// The value at the front of `bytes`; 0 if they do not reach, which the checks exclude.
    fn read(self, bytes: &[u8]) -> f64 {
        fn front<const N: usize>(bytes: &[u8]) -> [u8; N] {
            bytes.first_chunk().copied().unwrap_or([0; N])
        }
        match self {
            Component::I8 => f64::from(i8::from_le_bytes(front(bytes))),
            Component::U8 => f64::from(u8::from_le_bytes(front(bytes))),
            Component::I16 => f64::from(i16::from_le_bytes(front(bytes))),
            Component::U16 => f64::from(u16::from_le_bytes(front(bytes))),
            Component::U32 => f64::from(u32::from_le_bytes(front(bytes))),
            Component::F32 => f64::from(f32::from_le_bytes(front(bytes))),
        }
    }
}

/// Elements at a fixed stride within a view.
struct Block<'a> {
    view: View<'a>,
    offset: usize,
    stride: usize,
}

impl Block<'_> {
    /// The bytes from component `lane` of element `i` on.
    fn at(&self, i: usize, lane: usize) -> &[u8] {
        self.view.bytes().get(self.offset + i * self.stride + lane..).unwrap_or(&[])
    }
}

/// Elements that replace others: `places` rises, `values` has as many.
struct Sparse<'a> {
    places: Vec<u64>,
    values: Block<'a>,
}

/// A checked accessor.
pub(super) struct Elements<'a> {
    pub count: u64,
    pub component: Component,
    normalized: bool,
    base: Option<Block<'a>>,
    sparse: Option<Sparse<'a>>,
}

impl Elements<'_> {
    /// Vertices of a compressed primitive, or why they cannot be `role`.
    pub fn decoded(attribute: Attribute, role: Role, normalized: bool) -> Result<Elements<'static>, ProblemKind> {
        let (_, width) = role.shape();
        let component = Component::from_code(attribute.component_type).filter(|&c| role.admits(c));
        let Some(component) = component.filter(|_| attribute.components == width) else {
            let found = format!("{} numbers of component type {}", attribute.components, attribute.component_type);
            return Err(ProblemKind::Format { what: role.name(), found, expected: role.expected() });
        };
        let stride = width * component.size();
        let count = (attribute.bytes.len() / stride) as u64;
        let view = View::fetched(attribute.bytes, None, String::new());
        let base = Some(Block { view, offset: 0, stride });
        Ok(Elements { count, component, normalized: normalized && component != Component::F32, base, sparse: None })
    }

    /// Component `lane` of element `i`, below `count`.
    fn component(&self, i: u64, lane: usize) -> f64 {
        let size = self.component.size();
        let replaced = self.sparse.as_ref().and_then(|s| Some((s, s.places.binary_search(&i).ok()?)));
        let bytes = match (replaced, &self.base) {
            (Some((sparse, k)), _) => sparse.values.at(k, lane * size),
            (None, Some(base)) => base.at(i as usize, lane * size),
            // Without a view, everything is zero.
            (None, None) => return 0.0,
        };
        let value = self.component.read(bytes);
        if self.normalized { (value / f64::from(self.component.largest())).max(-1.0) } else { value }
    }

    pub fn vector(&self, i: u64) -> DVec3 {
        DVec3::new(self.component(i, 0), self.component(i, 1), self.component(i, 2))
    }

    pub fn quaternion(&self, i: u64) -> [f64; 4] {
        [0, 1, 2, 3].map(|lane| self.component(i, lane))
    }

    pub fn index(&self, i: u64) -> u32 {
        self.component(i, 0) as u32
    }
}

/// All accessors asked for so far, each read and complained of once for each role.
pub(super) struct Accessors<'a, 'j> {
    root: &'j Json<'a>,
    pub buffers: Buffers<'a, 'j>,
    /// No accessor that is used has more elements.
    most: u64,
    known: BTreeMap<(u64, Role), Checked<Rc<Elements<'a>>>>,
    /// Extensions met on accessors.
    pub extensions: Vec<String>,
}

impl<'a, 'j> Accessors<'a, 'j> {
    pub fn new(root: &'j Json<'a>, buffers: Buffers<'a, 'j>, most: u64) -> Self {
        Accessors { root, buffers, most, known: BTreeMap::new(), extensions: Vec::new() }
    }

    /// Does accessor `index` have bytes of its own? Under a compression extension it may have none.
    pub fn has_data(&self, index: u64) -> bool {
        self.find(index).is_some_and(|a| a.get("bufferView").is_some())
    }

    /// Are the integers of accessor `index` fractions of one?
    pub fn is_normalized(&self, index: u64) -> bool {
        self.find(index).is_some_and(|a| matches!(a.get("normalized"), Some(Json::Bool(true))))
    }

    fn find(&self, index: u64) -> Option<&'j Json<'a>> {
        let items = self.root.get("accessors").and_then(Json::items)?;
        items.get(usize::try_from(index).ok()?)
    }

    pub fn get(&mut self, index: u64, role: Role, place: &str, log: &mut Log) -> Checked<Rc<Elements<'a>>> {
        if let Some(known) = self.known.get(&(index, role)) {
            return known.clone();
        }
        let place = format!("{place}, accessor {index} ({})", role.name());
        let elements = self.open(index, role, &place, log).map(Rc::new);
        self.known.insert((index, role), elements.clone());
        elements
    }

    fn open(&mut self, index: u64, role: Role, place: &str, log: &mut Log) -> Checked<Elements<'a>> {
        let (_, accessor, path) = element(self.root, "accessors", "accessor", index, place, log)?;
        self.extensions.extend(accessor.get("extensions").into_iter().flat_map(Json::keys).map(str::to_owned));

        let (shape, width) = role.shape();
        let code = accessor.required_at("componentType", &path, log);
        let count = accessor.required_at("count", &path, log);
        let view = accessor.natural_at("bufferView", &path, log);
        let offset = accessor.natural_at("byteOffset", &path, log);
        let (code, count, view, offset) = (code?, count?, view?, offset?.unwrap_or(0));
        let kind = accessor.get("type").and_then(Json::text).unwrap_or("(no type)");
        let component = Component::from_code(code).filter(|&c| role.admits(c) && kind == shape);
        let Some(component) = component else {
            let found = format!("{} of component type {code}", super::problem::clip(kind));
            let what = ProblemKind::Format { what: role.name(), found, expected: role.expected() };
            return Err(log.refuse(place, what));
        };
        if count > self.most {
            let what = ProblemKind::Limit { what: "elements of an accessor", found: count, limit: self.most };
            return Err(log.refuse(format!("{path}/count"), what));
        }

        let size = width * component.size();
        let base = match view {
            None => None,
            Some(view) => Some(self.block(view, offset, count, size, place, log)?),
        };
        let sparse = match accessor.get("sparse") {
            None => None,
            Some(sparse) => Some(self.sparse(sparse, count, size, place, &format!("{path}/sparse"), log)?),
        };
        let normalized = matches!(accessor.get("normalized"), Some(Json::Bool(true))) && component != Component::F32;
        // Rotations in integers are always fractions of one.
        let normalized = normalized || (role == Role::Rotation && component != Component::F32);
        Ok(Elements { count, component, normalized, base, sparse })
    }

    /// `count` elements of `size` bytes from `offset` on in a view, if they lie within it.
    fn block(
        &mut self,
        view: u64,
        offset: u64,
        count: u64,
        size: usize,
        place: &str,
        log: &mut Log,
    ) -> Checked<Block<'a>> {
        let view = self.buffers.view(view, place, log)?;
        let element = size as u64;
        let stride = view.stride.filter(|&s| s > 0).unwrap_or(element);
        if stride < element {
            return Err(log.refuse(place, ProblemKind::Stride { stride, element }));
        }
        let span = count.checked_sub(1).map_or(0, |last| last.saturating_mul(stride).saturating_add(element));
        let end = offset.saturating_add(span);
        if end > view.len() {
            let what =
                ProblemKind::OutOfBytes { what: "the accessor in its view", start: offset, end, available: view.len() };
            return Err(log.refuse(format!("{place}, {}", view.path), what));
        }
        // A stride beyond the view is only possible for one element, which it does not move.
        let stride = if count > 1 { stride } else { element };
        Ok(Block { view, offset: offset as usize, stride: stride as usize })
    }

    fn sparse(
        &mut self,
        sparse: &Json<'a>,
        total: u64,
        size: usize,
        place: &str,
        path: &str,
        log: &mut Log,
    ) -> Checked<Sparse<'a>> {
        let count = sparse.required_at("count", path, log)?;
        if count > total {
            let fault = format!("{count} sparse elements replace {total}");
            return Err(log.refuse(path, ProblemKind::Sparse { fault }));
        }
        let missing = Json::Null;
        let (i_path, v_path) = (format!("{path}/indices"), format!("{path}/values"));
        let indices = sparse.get("indices").unwrap_or(&missing);
        let values = sparse.get("values").unwrap_or(&missing);
        let i_view = indices.required_at("bufferView", &i_path, log);
        let i_offset = indices.natural_at("byteOffset", &i_path, log);
        let i_code = indices.required_at("componentType", &i_path, log);
        let v_view = values.required_at("bufferView", &v_path, log);
        let v_offset = values.natural_at("byteOffset", &v_path, log);
        let (i_view, i_offset, i_code) = (i_view?, i_offset?.unwrap_or(0), i_code?);
        let (v_view, v_offset) = (v_view?, v_offset?.unwrap_or(0));

        let component = Component::from_code(i_code).filter(|&c| Role::Index.admits(c)).ok_or_else(|| {
            let found = format!("component type {i_code}");
            log.refuse(&i_path, ProblemKind::Format { what: "indices", found, expected: Role::Index.expected() })
        })?;
        let block = self.block(i_view, i_offset, count, component.size(), place, log);
        let values = self.block(v_view, v_offset, count, size, place, log);
        let (block, values) = (block?, values?);
        let places: Vec<u64> = (0..count as usize).map(|i| component.read(block.at(i, 0)) as u64).collect();
        let rising = places.windows(2).all(|w| w[0] < w[1]);
        if !rising || places.last().is_some_and(|&last| last >= total) {
            let fault = format!("the sparse indices do not rise strictly, or reach beyond {total} elements");
            return Err(log.refuse(i_path, ProblemKind::Sparse { fault }));
        }
        Ok(Sparse { places, values })
    }
}
