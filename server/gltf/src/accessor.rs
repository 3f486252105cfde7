//! Accessors: the numbers of a file, known to lie inside their buffers before the first one is read.
//!
//! [`Elements`] reads every kind: strided, sparse, and integers that stand for fractions of one.

use std::collections::BTreeMap;
use std::rc::Rc;

use glam::DVec3;
use gltf::accessor::util::{Item, ItemIter};
use gltf::accessor::{DataType, Dimensions};
use gltf::json::accessor::sparse;
use gltf::json::validation::{Checked::Valid, USize64};
use gltf::json::{self, Index};

use crate::buffer::{BufferView, Buffers};
use crate::compressed::{Attribute, CORNERS};
use crate::gate::{ACCESSORS, Gate, MAY, MUST, Member, MemberKind, NATURAL, NUMBER, Piece};
use crate::log::{Log, Logged};
use crate::problem::{ProblemKind, clip};

const ACCESSOR: &[Member] = &[
    ("componentType", NUMBER, MUST),
    ("count", NATURAL, MUST),
    ("bufferView", NUMBER, MAY),
    ("byteOffset", NATURAL, MAY),
    ("type", MemberKind::Word("(no type)"), MAY),
];

/// Read once the accessor itself is found good.
const SPARSE: &[Member] =
    &[("count", NATURAL, MUST), ("indices", MemberKind::Part(PLACES), MAY), ("values", MemberKind::Part(VALUES), MAY)];

const PLACES: &[Member] =
    &[("bufferView", NUMBER, MUST), ("byteOffset", NATURAL, MAY), ("componentType", NUMBER, MUST)];

const VALUES: &[Member] = &[("bufferView", NUMBER, MUST), ("byteOffset", NATURAL, MAY)];

/// Purpose of an accessor; it decides which formats are accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Purpose {
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

impl Purpose {
    fn name(self) -> &'static str {
        match self {
            Purpose::Position { .. } => "POSITION",
            Purpose::Index => "indices",
            Purpose::Vector => "instances",
            Purpose::Rotation => "instance rotations",
        }
    }

    fn shape(self) -> Dimensions {
        match self {
            Purpose::Position { .. } | Purpose::Vector => Dimensions::Vec3,
            Purpose::Index => Dimensions::Scalar,
            Purpose::Rotation => Dimensions::Vec4,
        }
    }

    fn expected(self) -> &'static str {
        match self {
            Purpose::Position { quantized: false } => {
                "VEC3 of floats (5126), unless the file declares KHR_mesh_quantization"
            }
            Purpose::Position { quantized: true } => "VEC3 of floats or of 8 or 16 bit integers (5120 to 5123, 5126)",
            Purpose::Index => "SCALAR of unsigned integers (5121, 5123, 5125)",
            Purpose::Vector => "VEC3 of floats (5126)",
            Purpose::Rotation => "VEC4 of floats or signed integers (5126, 5120, 5122)",
        }
    }

    fn admits(self, component: DataType) -> bool {
        use DataType::*;
        match self {
            Purpose::Position { quantized: true } => component != U32,
            Purpose::Position { quantized: false } | Purpose::Vector => component == F32,
            Purpose::Index => matches!(component, U8 | U16 | U32),
            Purpose::Rotation => matches!(component, F32 | I8 | I16),
        }
    }

    fn misfit(self, found: String) -> ProblemKind {
        ProblemKind::Format { what: self.name(), found, expected: self.expected() }
    }
}

/// The number at the front of `bytes`, a `normalized` integer as a fraction of one; zero if the bytes are too few.
#[inline]
fn number(component: DataType, normalized: bool, bytes: &[u8]) -> f64 {
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
pub(crate) fn largest(component: DataType) -> u32 {
    match component {
        DataType::I8 => 127,
        DataType::U8 => 255,
        DataType::I16 => 32767,
        DataType::U16 => 65535,
        DataType::U32 | DataType::F32 => u32::MAX,
    }
}

/// The code of an accessor's component type, for a message.
fn code(piece: &Piece<'_>) -> u64 {
    piece.member("componentType").and_then(|code| code.natural()).unwrap_or_default()
}

/// Elements at a fixed stride within a view.
pub(crate) struct Strided<'a> {
    view: BufferView<'a>,
    offset: usize,
    stride: usize,
}

impl<'a> Strided<'a> {
    /// `count` elements of `size` bytes from `offset` on in a view, if they lie within it.
    pub fn new(view: BufferView<'a>, offset: u64, count: u64, size: usize) -> Result<Strided<'a>, ProblemKind> {
        let element = size as u64;
        let stride = view.stride.filter(|&s| s > 0).unwrap_or(element);
        if stride < element {
            return Err(ProblemKind::Stride { stride, element });
        }
        let span = count.checked_sub(1).map_or(0, |last| last.saturating_mul(stride).saturating_add(element));
        let end = offset.saturating_add(span);
        if end > view.len() {
            let what = "the accessor in its view";
            return Err(ProblemKind::OutOfBytes { what, start: offset, end, available: view.len() });
        }
        // A stride beyond the view is only possible for one element, which it does not move.
        let stride = if count > 1 { stride } else { element };
        Ok(Strided { view, offset: offset as usize, stride: stride as usize })
    }

    /// The bytes from `lane` bytes into element `i` on.
    #[inline]
    fn at(&self, i: usize, lane: usize) -> &[u8] {
        self.view.bytes().get(self.offset + i * self.stride + lane..).unwrap_or(&[])
    }
}

/// Elements that replace others.
pub(crate) struct Sparse<'a> {
    /// Indices of the elements, ascending, each with the number of its value.
    places: Vec<(u32, u32)>,
    values: Strided<'a>,
}

impl<'a> Sparse<'a> {
    /// `values` for the `count` elements, of `total`, whose numbers stand in `places` as integers of this type. Where a
    /// number stands twice, the last value counts; `in_order` refuses any but ascending numbers.
    pub fn new(
        (places, component): (Strided<'_>, DataType),
        values: Strided<'a>,
        count: u64,
        total: u64,
        in_order: bool,
    ) -> Result<Sparse<'a>, ProblemKind> {
        let place = |i: u32| (number(component, false, places.at(i as usize, 0)) as u32, i);
        let mut places: Vec<(u32, u32)> = (0..count as u32).map(place).collect();
        let ascends = places.is_sorted_by(|a, b| a.0 < b.0);
        if in_order && !ascends || places.iter().any(|place| u64::from(place.0) >= total) {
            let fault = format!("the sparse indices do not ascend strictly, or reach beyond {total} elements");
            return Err(ProblemKind::Sparse { fault });
        }
        if !ascends {
            places.sort_unstable_by(|a, b| b.cmp(a));
            places.dedup_by_key(|place| place.0); // leaves the first, which has the last value
            places.reverse();
        }
        Ok(Sparse { places, values })
    }

    /// Refuses more sparse elements than there are elements.
    pub fn check_count(count: u64, total: u64) -> Result<u64, ProblemKind> {
        if count <= total {
            return Ok(count);
        }
        Err(ProblemKind::Sparse { fault: format!("{count} sparse elements replace {total}") })
    }

    /// The number of the value that replaces element `i`, if one does.
    fn find(&self, i: u64) -> Option<usize> {
        let at = self.places.binary_search_by_key(&i, |place| u64::from(place.0)).ok()?;
        Some(self.places[at].1 as usize)
    }
}

/// A checked accessor.
pub struct Elements<'a> {
    pub count: u64,
    pub(crate) component: DataType,
    pub(crate) normalized: bool,
    /// Without one, every number is zero.
    pub(crate) base: Option<Strided<'a>>,
    pub(crate) sparse: Option<Sparse<'a>>,
}

impl Elements<'_> {
    /// Vertices of a compressed primitive, or why they do not fit the purpose.
    pub(crate) fn decoded(
        attribute: Attribute,
        purpose: Purpose,
        normalized: bool,
    ) -> Result<Elements<'static>, ProblemKind> {
        let (component, width) = (attribute.component_type, purpose.shape().multiplicity());
        if attribute.components != width || !purpose.admits(component) {
            let code = component.as_gl_enum();
            return Err(purpose.misfit(format!("{} numbers of component type {code}", attribute.components)));
        }
        let stride = width * component.size();
        let count = (attribute.bytes.len() / stride) as u64;
        let view = BufferView::fetched(attribute.bytes, None, String::new());
        let base = Some(Strided { view, offset: 0, stride });
        Ok(Elements { count, component, normalized, base, sparse: None })
    }

    /// Component `lane` of element `i`, below `count`.
    #[inline]
    fn component(&self, i: u64, lane: usize) -> f64 {
        let lane = lane * self.component.size();
        let replaced = self.sparse.as_ref().and_then(|sparse| Some((sparse, sparse.find(i)?)));
        let bytes = match (replaced, &self.base) {
            (Some((sparse, k)), _) => sparse.values.at(k, lane),
            (None, Some(base)) => base.at(i as usize, lane),
            (None, None) => return 0.0,
        };
        number(self.component, self.normalized, bytes)
    }

    /// The first `N` components of element `i`, below `count`.
    #[inline]
    pub fn numbers<const N: usize>(&self, i: u64) -> [f64; N] {
        std::array::from_fn(|lane| self.component(i, lane))
    }

    /// Element `i` as a point or vector.
    #[inline]
    pub fn vector(&self, i: u64) -> DVec3 {
        self.numbers(i).into()
    }

    /// Element `i` as the number of a vertex.
    #[inline]
    pub(crate) fn index(&self, i: u64) -> u32 {
        self.component(i, 0) as u32
    }
}

/// All accessors that the geometry needs so far: each is read, and its faults reported, once for each purpose.
pub(crate) struct Accessors<'a, 'g> {
    gate: &'g Gate<'a>,
    pub buffers: Buffers<'a, 'g>,
    /// No accessor that is used has more elements.
    most: u64,
    known: BTreeMap<(usize, Purpose), Logged<Rc<Elements<'a>>>>,
}

impl<'a, 'g> Accessors<'a, 'g> {
    pub fn new(gate: &'g Gate<'a>, buffers: Buffers<'a, 'g>, most: u64) -> Self {
        Accessors { gate, buffers, most, known: BTreeMap::new() }
    }

    pub fn get(&mut self, index: usize, purpose: Purpose, place: &str, log: &mut Log) -> Logged<Rc<Elements<'a>>> {
        if let Some(known) = self.known.get(&(index, purpose)) {
            return known.clone();
        }
        let place = format!("{place}, accessor {index} ({})", purpose.name());
        let elements = self.open(index, purpose, &place, log).map(Rc::new);
        self.known.insert((index, purpose), elements.clone());
        elements
    }

    fn open(&mut self, index: usize, purpose: Purpose, place: &str, log: &mut Log) -> Logged<Elements<'a>> {
        let piece = self.gate.entry(ACCESSORS, index, place, log)?;
        self.gate.meet(&piece);
        let accessor: json::Accessor = self.gate.read(&piece, ACCESSOR, log)?;
        let component = match (accessor.component_type, accessor.type_) {
            (Valid(component), Valid(shape)) if shape == purpose.shape() && purpose.admits(component.0) => component.0,
            _ => {
                let kind = piece.member("type").and_then(|kind| kind.word()).unwrap_or_else(|| "(no type)".to_owned());
                let found = format!("{} of component type {}", clip(&kind), code(&piece));
                return Err(log.refuse(place, purpose.misfit(found)));
            }
        };
        let count = accessor.count.0;
        if count > self.most {
            // Three corners make a triangle.
            let (found, limit) = (count.div_ceil(CORNERS), self.most / CORNERS);
            let what = ProblemKind::Limit { what: "triangles", found, limit };
            return Err(log.refuse(format!("{}/count", piece.path), what));
        }
        let size = purpose.shape().multiplicity() * component.size();
        let offset = accessor.byte_offset.unwrap_or_default();
        let base = accessor.buffer_view.map(|view| self.strided(view, offset, count, size, place, log)).transpose()?;
        let [sparse, normalized] = piece.members_of(["sparse", "normalized"]);
        let sparse = sparse.map(|sparse| self.sparse(&sparse, count, size, place, log));
        // Rotations in integers are always fractions of one.
        let normalized = purpose == Purpose::Rotation || normalized.is_some_and(|yes| yes.text == "true");
        Ok(Elements { count, component, normalized, base, sparse: sparse.transpose()? })
    }

    fn strided(
        &mut self,
        view: Index<json::buffer::View>,
        offset: USize64,
        count: u64,
        size: usize,
        place: &str,
        log: &mut Log,
    ) -> Logged<Strided<'a>> {
        let view = self.buffers.view(view.value(), place, log)?;
        let path = format!("{place}, {}", view.path);
        Strided::new(view, offset.0, count, size).map_err(|what| match what {
            ProblemKind::Stride { .. } => log.refuse(place, what),
            _ => log.refuse(path, what),
        })
    }

    fn sparse(&mut self, piece: &Piece<'a>, total: u64, size: usize, place: &str, log: &mut Log) -> Logged<Sparse<'a>> {
        let sparse::Sparse { count, indices, values, .. } = self.gate.read(piece, SPARSE, log)?;
        let count = Sparse::check_count(count.0, total).map_err(|what| log.refuse(piece.path.as_str(), what))?;
        let path = format!("{}/indices", piece.path);
        let Valid(component) = indices.component_type else {
            let code = piece.member("indices").map_or(0, |indices| code(&indices));
            return Err(log.refuse(path, Purpose::Index.misfit(format!("component type {code}"))));
        };
        let component = component.0;
        let places = self.strided(indices.buffer_view, indices.byte_offset, count, component.size(), place, log);
        let values = self.strided(values.buffer_view, values.byte_offset, count, size, place, log);
        Sparse::new((places?, component), values?, count, total, true).map_err(|what| log.refuse(path, what))
    }
}
