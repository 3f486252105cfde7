//! The accuracy presets. The one home of defaults: `standard` stands whole, the others by what they change.

use super::*;

/// Stiffness of a fill's contacts, per natural time, whatever that of the pile's: stiffer ones make another fill of the same seed,
/// and what overlaps is parted afterwards by position.
const FILL_FREQUENCY: f64 = 22.0;

impl Params {
    /// The preset's complete parameters.
    pub fn new(accuracy: Accuracy) -> Params {
        let mut params = Params {
            seed: 1,
            accuracy,
            gravity: 9.81,
            ground: true,
            ground_friction: 0.7,
            ground_height: None,
            physics: Physics {
                step: Time::Natural(0.05),
                substeps: 8,
                contact_frequency: 22.0,
                contact_damping_ratio: 10.0,
                friction_model: FrictionModel::Simplified,
                rolling_resistance: 0.02,
                shape_tolerance: 0.04,
                max_parts: 12,
                switches: PhysicsSwitches::default(),
            },
            guard: Switch::Auto,
            base: Base { height: 0.02 },
            fill: Fill {
                method: FillMethod::Insert,
                order: 0.0,
                surface: 0.5,
                mixture: Mixture { layout: Layout::Mixed, sort_by: SortBy::Size, descending: false },
                gaps: false,
                shake: 0.0,
                friction: 0.0,
                count: None,
                max_bodies: 20_000,
                step: 0.1,
                round: 0.3,
                full_below: 0.04,
                growth: 0.8,
                settle: 2.2,
                protrusion: 0.05,
                overlap: 0.15,
                residual_overlap: 0.012,
                wall_tolerance: 0.02,
                shell: None,
            },
            release: Release { layer: 0.5, interval: Time::Natural(1.0), damping: 0.0, order: ReleaseOrder::BottomUp },
            glue: Glue {
                mode: GlueMode::Auto,
                strength: None,
                friction_factor: 0.5,
                normal_price: 0.02,
                rounds: 7,
                anchor: Switch::Auto,
                breaking: 4.0,
                proof: Switch::Auto,
            },
            control: Control {
                mode: ControlMode::Freeze,
                period: 5,
                selection: ContactSelection::Conservative,
                friction_reserve: FrictionReserve::Sharp,
                friction_cone: FrictionCone::Cone,
                kinetic_ratio: 6.0 / 7.0,
                contact_tolerance: 0.05,
                spread: Spread::Relative(0.05),
                neighbours: Neighbours::Either,
                speed: 0.1,
                damping: 6.4,
                kappa: 5.0,
                nails_per_body: 1,
                until: None,
                stand: Switch::Auto,
                switches: ControlSwitches::default(),
            },
            hold: Hold { patience: 120.0, least: 0.0 },
            output: Output {
                fps: 24.0,
                frames: None,
                free_standing: false,
                free_pour: false,
                keeps_frames: Switch::Auto,
            },
            report: Figures::default(),
        };
        match accuracy {
            Accuracy::Standard => {}
            Accuracy::Draft => {
                params.physics.step = Time::Natural(0.1);
                params.control.period = 3;
                params.physics.contact_frequency = 10.0;
                params.physics.shape_tolerance = 0.1;
                params.physics.max_parts = 6;
                params.fill.wall_tolerance = 0.05;
                // In larger rounds, what is small takes the room of what is large.
                params.fill.round = 0.5;
                params.fill.full_below = 0.3;
                params.fill.settle = 0.5;
                params.fill.residual_overlap = 0.06;
                params.release.layer = 1.0;
                // More glue takes the place of letting the pile go.
                params.glue.friction_factor = 0.35;
                params.glue.rounds = 2;
            }
            Accuracy::Preview => {
                params.physics.step = Time::Natural(0.1);
                params.control.period = 3;
                params.physics.substeps = 12;
                params.physics.contact_frequency = 15.0;
                params.fill.round = 0.5;
                params.fill.full_below = 0.2;
                params.fill.settle = 1.0;
                params.fill.residual_overlap = 0.025;
            }
            Accuracy::Fine => {
                params.physics.substeps = 16;
                params.physics.contact_frequency = 60.0;
                params.physics.friction_model = FrictionModel::Coulomb;
                params.physics.shape_tolerance = 0.02;
                params.physics.max_parts = 24;
                params.fill.wall_tolerance = 0.006;
                params.fill.growth = 1.2;
                params.fill.round = 0.2;
                params.fill.full_below = 0.03;
                params.fill.settle = 3.0;
                params.fill.residual_overlap = 0.004;
            }
            Accuracy::Reference => {
                params.physics.step = Time::Natural(0.02);
                params.control.period = 12;
                params.physics.substeps = 32;
                params.physics.contact_frequency = 120.0;
                params.physics.friction_model = FrictionModel::Coulomb;
                params.physics.shape_tolerance = 0.01;
                params.physics.max_parts = 48;
                params.fill.wall_tolerance = 0.002;
                params.fill.step = 0.05;
                params.fill.growth = 1.6;
                params.fill.round = 0.15;
                params.fill.full_below = 0.02;
                params.fill.settle = 4.0;
                params.fill.residual_overlap = 0.001;
            }
            Accuracy::Paper => {
                params.physics.step = Time::Seconds(1.0 / 240.0);
                params.physics.rolling_resistance = 0.0;
                params.fill.method = FillMethod::Pour;
                params.fill.friction = 0.7;
                params.fill.full_below = 0.004;
                params.fill.overlap = 0.25;
                params.fill.residual_overlap = 1.0;
                params.glue.mode = GlueMode::Natural;
                params.control = Control {
                    mode: ControlMode::Nails,
                    stand: Switch::Off,
                    period: 20,
                    friction_reserve: FrictionReserve::Paper,
                    friction_cone: FrictionCone::Pyramid,
                    spread: Spread::Paper(0.5),
                    neighbours: Neighbours::All,
                    speed: f64::INFINITY,
                    damping: 0.0,
                    nails_per_body: 1000,
                    ..params.control
                };
            }
        }
        params
    }

    /// The engine's settings for the fill: half the substeps, since nothing has to balance there, and nothing has to stop
    /// rolling; but no softer contacts, which squeeze out what grows. An insert fill steps farther, and sweeps nothing, unless asked to: its props hardly fall.
    pub fn fill_physics(&self, natural_time: f64) -> Physics {
        let mut physics = Physics {
            substeps: self.physics.substeps.div_ceil(2),
            rolling_resistance: 0.0,
            contact_frequency: FILL_FREQUENCY,
            ..self.physics.clone()
        };
        if !self.fill.method.traits().falls {
            physics.step = Time::Natural(self.fill.step.max(physics.step.seconds(natural_time) / natural_time));
            if physics.switches.continuous_collision == Switch::Auto {
                physics.switches.continuous_collision = Switch::Off;
            }
        }
        physics
    }
}
