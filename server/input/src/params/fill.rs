//! Numbers that the fill derives from its parameters.

use super::{Fill, FillMethod};

/// The container of the loosest surface, and the one around single props that stand out, are this far outside of the
/// control mesh, d; half of the distance grid's margin.
const OUTSIDE: f64 = 0.15;
/// Share of the props that may stand out of the loosest surface.
const STANDING_OUT: f64 = 0.1;
/// Share of the tried places that are flat against the container, where the surface is as cast.
const AT_WALL: f64 = 0.5;
/// From this order on, every prop of a stack lies flat.
const ALL_FLAT: f64 = 2.0 / 3.0;

impl Fill {
    /// Distance of the container outside the control mesh, d.
    pub fn loosened(&self) -> f64 {
        OUTSIDE * (1.0 - 2.0 * self.surface).max(0.0)
    }

    /// The share of the props that may stand out of the container.
    pub fn standing_out(&self) -> f64 {
        if self.method.traits().lets_stand_out { STANDING_OUT * (1.0 - self.surface) } else { 0.0 }
    }

    /// Share of a stack's props that lie on their largest flat side.
    pub fn lying(&self) -> f64 {
        (self.order / ALL_FLAT).min(1.0)
    }

    /// Share of the places tried for inserted props that are flat against the container. The tidier a stack, the less
    /// the props that fill it up look cast.
    pub fn at_wall(&self) -> f64 {
        let disorder = if self.method.traits().has_order { 1.0 - self.lying() } else { 1.0 };
        AT_WALL * self.surface * disorder
    }

    /// Largest distance of props outside the control mesh, d.
    pub fn outside(&self) -> f64 {
        if self.standing_out() > 0.0 { OUTSIDE } else { self.loosened() }
    }
}

/// Properties of a fill method for parameters, plan and report. How it fills is in the room `core`.
#[derive(Clone, Copy, Debug)]
pub struct FillTraits {
    /// Its reason in the list of effects.
    pub summary: &'static str,
    /// It fills the control mesh at all.
    pub fills: bool,
    /// Its props lie in order: [`Fill::order`] counts, and they pack as densely as stacked ones.
    pub has_order: bool,
    /// Single props may stand out of the container, by [`Fill::surface`].
    pub lets_stand_out: bool,
    /// Its props fall through the container's opening: the fill steps as the bake does, and places below overhangs stay
    /// empty. Props of other methods hardly fall: the fill may take the longer [`Fill::step`].
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
