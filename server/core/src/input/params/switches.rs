//! The user's word on effects that have no parameter of their own. Which effects there are, and when they come on by themselves:
//! [`crate::prepare::effects`].

/// The user's word on an effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Switch {
    /// On where the scene calls for it.
    #[default]
    Auto,
    On,
    Off,
}

impl Switch {
    /// Whether the effect is on, given whether the scene calls for it.
    pub fn is_on(self, called_for: bool) -> bool {
        match self {
            Switch::Auto => called_for,
            Switch::On => true,
            Switch::Off => false,
        }
    }
}

/// Effects of shapes and engine that have no parameter of their own.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PhysicsSwitches {
    /// A prop that is a box or a ball is simulated as one. Off: as a hull.
    pub primitives: Switch,
    /// A nonconvex prop is split into convex parts. Auto: where one hull is farther from it than `physics.shape_tolerance`.
    /// On: whatever has no primitive. Off: one hull.
    pub decomposition: Switch,
    /// What moves by more than half of its thickness in a step is swept along its way, or, of several parts, meets its contacts
    /// a step ahead. On: by more than a tenth. Off: neither, not even against scenery.
    pub continuous_collision: Switch,
    /// Contacts as stiff as the ratio of the bodies' masses asks for. On: as for the largest ratio. Off: as given.
    pub stiff_contacts: Switch,
    /// Resistance to rolling. Auto: of round props. On: of all, on half of their thickness.
    pub rolling_resistance: Switch,
    /// Bodies bounce. Off: whatever their props say.
    pub restitution: Switch,
}

/// Effects of the control that have no parameter of their own.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ControlSwitches {
    /// What is about to be hit is let go before. Auto: where something flies, falls or moves.
    pub impact: Switch,
    /// What carries more than kappa allows lets go.
    pub breaking: Switch,
    /// Only bodies inside the control mesh or the region are controlled. Off: all are.
    pub region: Switch,
    /// A verdict holds as long as nothing that it rests on has changed. Off: all bodies are judged in every cycle.
    pub kept_verdicts: Switch,
}
