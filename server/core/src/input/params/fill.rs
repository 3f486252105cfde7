//! How props get into the container, and how they lie there.

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Fill {
    pub method: FillMethod,
    /// How tidily props lie, from 0 (as they fall) to 1 (stacked): how many lie on their largest flat side, and how little they are
    /// turned and shifted against the pile's axes.
    pub order: f64,
    /// What the surface is like, from 0 (loose, as if nothing had been around the pile) over 0.5 (natural: single props stand out or
    /// back) to 1 (cast: many lie flush).
    pub surface: f64,
    /// Which of several props goes where.
    pub mixture: Mixture,
    /// Small props come last, into the gaps of the large ones.
    pub gaps: bool,
    /// The filled container is shaken for this long, natural times, 0 to 100; 0: not at all. What makes the shape worse is taken back.
    pub shake: f64,
    /// Friction between props while filling, 0 to 2: it decides the density (0 packs densest).
    pub friction: f64,
    /// Number of bodies wanted; `None` fills until full.
    pub count: Option<u32>,
    /// Upper bound on bodies, 1 to 100000. Reaching it is told.
    pub max_bodies: u32,
    /// Step of an `insert` fill, natural times, 0.001 to 0.2; never shorter than that of the bake.
    pub step: f64,
    /// An `insert` fill adds at most this share of the expected bodies in a round, 0.01 to 1. Smaller rounds take longer, and the
    /// pile stands better by itself: what comes few at a time finds its place on what lies there.
    pub round: f64,
    /// A round (`insert`) or a batch (`pour`) that adds less than this share of the bodies means full.
    pub full_below: f64,
    /// A prop of an `insert` fill grows to its full size in this time, natural times, 0.05 to 10. In less of it, props make less room
    /// for each other: more overlap, or are taken out again.
    pub growth: f64,
    /// Settling in the closed container after the last prop, natural times.
    pub settle: f64,
    /// A body may stick out of the control mesh by this much more than `surface` lets it, relative to d; beyond it is removed. Parting
    /// what overlaps adds about as much as that overlapped.
    pub protrusion: f64,
    /// A body may overlap another by this share of the thinner one's thickness; beyond it is removed.
    pub overlap: f64,
    /// After the fill, bodies that overlap are parted until 95 of 100 touching pairs overlap by at most this share of the thinner
    /// one's thickness, 0.0005 to 1; 1: they stay as they are.
    pub residual_overlap: f64,
    /// The walls of a control mesh that is finer than the props need may be this far from it, relative to d, 0 to 0.5;
    /// 0: they are as they were modelled. Default 0.02.
    pub wall_tolerance: f64,
    /// Props lie no deeper below the control mesh's surface than this, relative to d, 0.05 to 1000: further in stands a core that
    /// is not seen. `None`: props everywhere.
    pub shell: Option<f64>,
}

/// The walls of the loosest surface, and those around single props that stand out, are this far outside of the control mesh, d; half of
/// the distance grid's margin.
const OUTSIDE: f64 = 0.15;
/// Share of the props that may stand out of the loosest surface.
const STANDING_OUT: f64 = 0.1;
/// Share of the places tried that are flat against the wall, where the surface is as cast.
const AT_WALL: f64 = 0.5;
/// From this order on, every prop of a stack lies flat.
const ALL_FLAT: f64 = 2.0 / 3.0;

impl Fill {
    /// How far the container's walls are outside of the control mesh, d.
    pub fn loosened(&self) -> f64 {
        OUTSIDE * (1.0 - 2.0 * self.surface).max(0.0)
    }

    /// The share of the props that may stand out of the walls.
    pub fn standing_out(&self) -> f64 {
        if self.method.traits().lets_stand_out { STANDING_OUT * (1.0 - self.surface) } else { 0.0 }
    }

    /// Share of a stack's props that lie on their largest flat side.
    pub fn lying(&self) -> f64 {
        (self.order / ALL_FLAT).min(1.0)
    }

    /// Share of the places tried for props that are thrown in that are flat against the wall: what fills up a stack does not look cast,
    /// the less the tidier that is.
    pub fn at_wall(&self) -> f64 {
        let disorder = if self.method.traits().has_order { 1.0 - self.lying() } else { 1.0 };
        AT_WALL * self.surface * disorder
    }

    /// How far outside of the control mesh some props may be, d.
    pub fn outside(&self) -> f64 {
        if self.standing_out() > 0.0 { OUTSIDE } else { self.loosened() }
    }
}

/// Which of several props goes where in a fill.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Mixture {
    pub layout: Layout,
    pub sort_by: SortBy,
    /// The largest, heaviest or last in the alphabet is below.
    pub descending: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Layout {
    /// Everything everywhere.
    Mixed,
    /// One above the other, each as high as its share of the volume.
    Bands,
    /// Bands that run into each other.
    Gradient,
    /// Each kind in nests of its own.
    Clusters,
}

/// What decides on the order of bands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum SortBy {
    Size,
    Mass,
    Name,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum FillMethod {
    /// Grown at free places inside the closed container.
    Insert,
    /// Dropped through the opening (Cho et al. 2007).
    Pour,
    /// Laid down one by one, each as low as it can lie.
    Stack,
    /// Not at all: the control mesh only says where the control acts.
    Off,
}

/// Properties of a fill method for parameters, plan and report. How it fills is in `stages::fill`.
#[derive(Clone, Copy, Debug)]
pub struct FillTraits {
    /// How it fills, for the list of effects.
    pub summary: &'static str,
    /// It fills the control mesh at all.
    pub fills: bool,
    /// Its props lie in order: [`Fill::order`] counts, and they pack as densely as stacked ones.
    pub has_order: bool,
    /// Single props may stand out of the container, by [`Fill::surface`].
    pub lets_stand_out: bool,
    /// Its props fall through the container's opening: the fill steps as the bake does, and places below overhangs stay empty. Props of
    /// other methods hardly fall: the fill may take the longer [`Fill::step`].
    pub falls: bool,
}

impl FillMethod {
    pub fn traits(self) -> FillTraits {
        const NONE: FillTraits =
            FillTraits { summary: "", fills: true, has_order: false, lets_stand_out: false, falls: false };
        match self {
            FillMethod::Insert => FillTraits {
                summary: "props grow at free places inside the closed container",
                lets_stand_out: true,
                ..NONE
            },
            FillMethod::Pour => {
                FillTraits { summary: "props are dropped through the container's opening", falls: true, ..NONE }
            }
            FillMethod::Stack => FillTraits {
                summary: "props are laid down one by one, each as low as it can lie",
                has_order: true,
                ..NONE
            },
            FillMethod::Off => FillTraits { fills: false, ..NONE },
        }
    }
}
