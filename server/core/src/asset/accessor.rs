//! Accessors: elements that are known to lie inside their buffer before the first one is read.

use std::collections::BTreeMap;
use std::rc::Rc;

use glam::DVec3;
use gltf::accessor::util::{Item, ItemIter};
use gltf::accessor::{DataType, Dimensions};
use gltf::json::accessor::sparse::Sparse;
use gltf::json::validation::{Checked::Valid, USize64};
use gltf::json::{self, Index};

use super::buffer::{Buffers, View};
use super::compressed::Attribute;
use super::gate::{ACCESSORS, Gate, Kind, MAY, MUST, Member, NATURAL, NUMBER, Piece};
use super::log::{Checked, Log};
use super::problem::{ProblemKind, clip};

const ACCESSOR: &[Member] = &[
    ("componentType", NUMBER, MUST),
    ("count", NATURAL, MUST),
    ("bufferView", NUMBER, MAY),
    ("byteOffset", NATURAL, MAY),
    ("type", Kind::Word("(no type)"), MAY),
];

/// Read once the accessor itself is found good.
const SPARSE: &[Member] =
    &[("count", NATURAL, MUST), ("indices", Kind::Part(PLACES), MAY), ("values", Kind::Part(VALUES), MAY)];

const PLACES: &[Member] =
    &[("bufferView", NUMBER, MUST), ("byteOffset", NATURAL, MAY), ("componentType", NUMBER, MUST)];

const VALUES: &[Member] = &[("bufferView", NUMBER, MUST), ("byteOffset", NATURAL, MAY)];

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

    fn shape(self) -> Dimensions {
        match self {
            Role::Position { .. } | Role::Vector => Dimensions::Vec3,
            Role::Index => Dimensions::Scalar,
            Role::Rotation => Dimensions::Vec4,
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

    fn admits(self, component: DataType) -> bool {
        use DataType::*;
        match self {
            Role::Position { quantized: true } => component != U32,
            Role::Position { quantized: false } | Role::Vector => component == F32,
            Role::Index => matches!(component, U8 | U16 | U32),
            Role::Rotation => matches!(component, F32 | I8 | I16),
        }
    }

    fn misfit(self, found: String) -> ProblemKind {
        ProblemKind::Format { what: self.name(), found, expected: self.expected() }
    }
}

/// The number at the front of `bytes`, an integer that is `normalized` as a fraction of one; zero if they do not reach.
pub fn number(component: DataType, normalized: bool, bytes: &[u8]) -> f64 {
    fn front<T: Item>(bytes: &[u8]) -> T {
        ItemIter::new(bytes, size_of::<T>()).next().unwrap_or_else(T::zero)
    }
    let value = match component {
        DataType::I8 => f64::from(front::<i8>(bytes)),
        DataType::U8 => f64::from(front::<u8>(bytes)),
        DataType::I16 => f64::from(front::<i16>(bytes)),
        DataType::U16 => f64::from(front::<u16>(bytes)),
        DataType::U32 => f64::from(front::<u32>(bytes)),
        DataType::F32 => return f64::from(front::<f32>(bytes)),
    };
    if normalized { (value / f64::from(largest(component))).max(-1.0) } else { value }
}

/// The largest value: what 1 is to a normalised integer, and what restarts a strip.
pub(super) fn largest(component: DataType) -> u32 {
    match component {
        DataType::I8 => 127,
        DataType::U8 => 255,
        DataType::I16 => 32767,
        DataType::U16 => 65535,
        DataType::U32 | DataType::F32 => u32::MAX,
    }
}

/// The code of a component type that stands in an accessor, for a message.
fn code(piece: &Piece<'_>) -> u64 {
    piece.member("componentType").and_then(|code| code.natural()).unwrap_or_default()
}

/// Elements at a fixed stride within a view.
struct Block<'a> {
    view: View<'a>,
    offset: usize,
    stride: usize,
}

impl Block<'_> {
    /// The bytes from `lane` bytes into element `i` on.
    fn at(&self, i: usize, lane: usize) -> &[u8] {
        self.view.bytes().get(self.offset + i * self.stride + lane..).unwrap_or(&[])
    }
}

/// A checked accessor.
pub(super) struct Elements<'a> {
    pub count: u64,
    pub component: DataType,
    normalized: bool,
    base: Option<Block<'a>>,
    /// Elements that replace others: places that rise, and as many values.
    sparse: Option<(Vec<u64>, Block<'a>)>,
}

impl Elements<'_> {
    /// Vertices of a compressed primitive, or why they cannot be `role`.
    pub fn decoded(attribute: Attribute, role: Role, normalized: bool) -> Result<Elements<'static>, ProblemKind> {
        let (component, width) = (attribute.component_type, role.shape().multiplicity());
        if attribute.components != width || !role.admits(component) {
            let code = component.as_gl_enum();
            return Err(role.misfit(format!("{} numbers of component type {code}", attribute.components)));
        }
        let stride = width * component.size();
        let count = (attribute.bytes.len() / stride) as u64;
        let view = View::fetched(attribute.bytes, None, String::new());
        let base = Some(Block { view, offset: 0, stride });
        Ok(Elements { count, component, normalized, base, sparse: None })
    }

    /// Component `lane` of element `i`, below `count`.
    fn component(&self, i: u64, lane: usize) -> f64 {
        let lane = lane * self.component.size();
        let replaced = self.sparse.as_ref().and_then(|(places, values)| Some((values, places.binary_search(&i).ok()?)));
        let bytes = match (replaced, &self.base) {
            (Some((values, k)), _) => values.at(k, lane),
            (None, Some(base)) => base.at(i as usize, lane),
            (None, None) => return 0.0, // without a view, everything is zero
        };
        number(self.component, self.normalized, bytes)
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
pub(super) struct Accessors<'a, 'g> {
    gate: &'g Gate<'a>,
    pub buffers: Buffers<'a, 'g>,
    /// No accessor that is used has more elements.
    most: u64,
    known: BTreeMap<(usize, Role), Checked<Rc<Elements<'a>>>>,
}

impl<'a, 'g> Accessors<'a, 'g> {
    pub fn new(gate: &'g Gate<'a>, buffers: Buffers<'a, 'g>, most: u64) -> Self {
        Accessors { gate, buffers, most, known: BTreeMap::new() }
    }

    pub fn get(&mut self, index: usize, role: Role, place: &str, log: &mut Log) -> Checked<Rc<Elements<'a>>> {
        if let Some(known) = self.known.get(&(index, role)) {
            return known.clone();
        }
        let place = format!("{place}, accessor {index} ({})", role.name());
        let elements = self.open(index, role, &place, log).map(Rc::new);
        self.known.insert((index, role), elements.clone());
        elements
    }

    fn open(&mut self, index: usize, role: Role, place: &str, log: &mut Log) -> Checked<Elements<'a>> {
        let piece = self.gate.entry(ACCESSORS, index, place, log)?;
        self.gate.meet(&piece);
        let accessor: json::Accessor = self.gate.read(&piece, ACCESSOR, log)?;
        let component = match (accessor.component_type, accessor.type_) {
            (Valid(component), Valid(shape)) if shape == role.shape() && role.admits(component.0) => component.0,
            _ => {
                let kind = piece.member("type").and_then(|kind| kind.word()).unwrap_or_else(|| "(no type)".to_owned());
                let found = format!("{} of component type {}", clip(&kind), code(&piece));
                return Err(log.refuse(place, role.misfit(found)));
            }
        };
        let count = accessor.count.0;
        if count > self.most {
            let what = ProblemKind::Limit { what: "elements of an accessor", found: count, limit: self.most };
            return Err(log.refuse(format!("{}/count", piece.path), what));
        }
        let size = role.shape().multiplicity() * component.size();
        let offset = accessor.byte_offset.unwrap_or_default();
        let base = accessor.buffer_view.map(|view| self.block(view, offset, count, size, place, log)).transpose()?;
        let [sparse, normalized] = piece.members_of(["sparse", "normalized"]);
        let sparse = sparse.map(|sparse| self.sparse(&sparse, count, size, place, log));
        // Rotations in integers are always fractions of one.
        let normalized = role == Role::Rotation || normalized.is_some_and(|yes| yes.text == "true");
        Ok(Elements { count, component, normalized, base, sparse: sparse.transpose()? })
    }

    /// `count` elements of `size` bytes from `offset` on in a view, if they lie within it.
    fn block(
        &mut self,
        view: Index<json::buffer::View>,
        offset: USize64,
        count: u64,
        size: usize,
        place: &str,
        log: &mut Log,
    ) -> Checked<Block<'a>> {
        let view = self.buffers.view(view.value(), place, log)?;
        let (element, offset) = (size as u64, offset.0);
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
        piece: &Piece<'a>,
        total: u64,
        size: usize,
        place: &str,
        log: &mut Log,
    ) -> Checked<(Vec<u64>, Block<'a>)> {
        let Sparse { count: USize64(count), indices, values, .. } = self.gate.read(piece, SPARSE, log)?;
        if count > total {
            let fault = format!("{count} sparse elements replace {total}");
            return Err(log.refuse(piece.path.as_str(), ProblemKind::Sparse { fault }));
        }
        let path = format!("{}/indices", piece.path);
        let Valid(component) = indices.component_type else {
            let code = piece.member("indices").map_or(0, |indices| code(&indices));
            return Err(log.refuse(path, Role::Index.misfit(format!("component type {code}"))));
        };
        let component = component.0;
        let block = self.block(indices.buffer_view, indices.byte_offset, count, component.size(), place, log);
        let values = self.block(values.buffer_view, values.byte_offset, count, size, place, log);
        let (block, values) = (block?, values?);
        let places: Vec<u64> = (0..count as usize).map(|i| number(component, false, block.at(i, 0)) as u64).collect();
        let rising = places.windows(2).all(|w| w[0] < w[1]);
        if !rising || places.last().is_some_and(|&last| last >= total) {
            let fault = format!("the sparse indices do not rise strictly, or reach beyond {total} elements");
            return Err(log.refuse(path, ProblemKind::Sparse { fault }));
        }
        Ok((places, values))
    }
}
