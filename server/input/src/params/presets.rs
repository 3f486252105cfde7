//! The accuracy presets: `standard` has the defaults of the schema's comments, the others change some of them.

use super::*;

/// Properties of an accuracy preset besides its parameters.
#[derive(Clone, Copy, Debug)]
pub struct AccuracyTraits {
    /// A pile that is to be glued is first released without glue: what stands is not glued.
    pub seeks_natural: bool,
    /// The pile is compared with the control mesh as a camera sees them.
    pub measures_pictures: bool,
    /// The meshes of all bodies are held against their neighbours'; else those of a sample, in a large pile.
    pub looks_at_all: bool,
    /// Visible meshes that cut each other in the end are moved apart.
    pub separates: bool,
    /// The forces at the contacts of the final pile are solved for.
    pub measures_support: bool,
    /// Visible meshes touch up to this gap, in thicknesses of the thinner one: the collision shapes are no closer.
    pub visible_contact: f64,
    /// CPU time of a fill / that of a fill at `standard`: median over the study's scenes.
    pub fill_cost_factor: f64,
    /// CPU time of glue and its proof / that at `standard`.
    pub glue_cost_factor: f64,
    /// Number of glue joints / that at `standard`: median over the bakes.
    pub glue_joints_factor: f64,
    /// The preset whose collision shapes have about as many parts: estimates take them for this one's.
    pub shapes_like: Accuracy,
    /// The study's results: `visible_depth_p95_rel` of props whose collision shape is their own, a box, nearly a box,
    /// or a ball; of the other props, whose shapes hold the mesh. The mean over the piles, and what nine of ten do not
    /// exceed.
    pub overlaps: [[f64; 2]; 2],
    /// Likewise imbalance and shape, means over all piles. They differ less between the presets than between seeds.
    pub expected_errors: [f64; 2],
    /// How far from its exact distance a block slides down a slope in a second, relative to it, as the study of
    /// problems found it.
    pub speed_error: f64,
}

impl Accuracy {
    /// From the quickest to the most accurate. The paper's setting is not among them.
    pub const LADDER: [Accuracy; 5] =
        [Accuracy::Draft, Accuracy::Preview, Accuracy::Standard, Accuracy::Fine, Accuracy::Reference];

    pub fn traits(self) -> AccuracyTraits {
        const STANDARD: AccuracyTraits = AccuracyTraits {
            seeks_natural: true,
            measures_pictures: true,
            measures_support: true,
            looks_at_all: false,
            separates: false,
            visible_contact: 0.05,
            fill_cost_factor: 1.0,
            glue_cost_factor: 1.0,
            glue_joints_factor: 1.0,
            shapes_like: Accuracy::Standard,
            overlaps: [[0.011, 0.054], [0.0, 0.0]],
            expected_errors: [0.032, 0.039],
            speed_error: 0.002,
        };
        match self {
            Accuracy::Draft => AccuracyTraits {
                seeks_natural: false,
                measures_pictures: false,
                measures_support: false,
                looks_at_all: false,
                separates: false,
                visible_contact: 0.15,
                fill_cost_factor: 0.47,
                glue_cost_factor: 0.4,
                // Joints are chosen in fewer rounds.
                glue_joints_factor: 1.4,
                shapes_like: Accuracy::Draft,
                overlaps: [[0.034, 0.073], [0.00034, 0.0]],
                expected_errors: [0.044, 0.041],
                speed_error: 0.0047,
            },
            Accuracy::Preview => AccuracyTraits {
                measures_support: false,
                visible_contact: 0.1,
                fill_cost_factor: 0.5,
                overlaps: [[0.024, 0.1], [0.0011, 0.0]],
                expected_errors: [0.045, 0.037],
                speed_error: 0.0029,
                ..STANDARD
            },
            // The paper's setting is not part of the study.
            Accuracy::Standard | Accuracy::Paper => STANDARD,
            Accuracy::Fine => AccuracyTraits {
                looks_at_all: true,
                fill_cost_factor: 1.35,
                glue_cost_factor: 1.5,
                shapes_like: Accuracy::Fine,
                overlaps: [[0.0021, 0.0088], [0.0, 0.0]],
                expected_errors: [0.026, 0.033],
                speed_error: 0.00064,
                ..STANDARD
            },
            Accuracy::Reference => AccuracyTraits {
                looks_at_all: true,
                separates: true,
                fill_cost_factor: 2.1,
                glue_cost_factor: 3.0,
                shapes_like: Accuracy::Fine,
                overlaps: [[0.0, 0.0], [0.0, 0.0]],
                expected_errors: [0.024, 0.021],
                speed_error: 0.0012,
                ..STANDARD
            },
        }
    }
}

impl Params {
    /// The preset's complete parameters.
    pub fn new(accuracy: Accuracy) -> Params {
        let mut params = Params { accuracy, ..Params::standard() };
        match accuracy {
            Accuracy::Standard => {}
            Accuracy::Draft => {
                params.physics.step = Time::Natural(0.1);
                params.control.period = 3;
                params.physics.contact_frequency = 10.0;
                params.physics.shape_tolerance = 0.1;
                params.physics.shape_gap = 0.05;
                params.physics.max_parts = 6;
                params.fill.wall_tolerance = 0.05;
                // In larger rounds, small props take the room of large ones.
                params.fill.round = 0.5;
                params.fill.full_below = 0.3;
                params.fill.settle = 0.5;
                params.fill.residual_overlap = 0.04;
                params.release.layer = 1.0;
                // With more glue, the first trial shows more often that the pile stands.
                params.glue.friction_factor = 0.35;
                params.glue.rounds = 2;
            }
            Accuracy::Preview => {
                params.physics.step = Time::Natural(0.1);
                params.control.period = 3;
                params.physics.substeps = 12;
                params.physics.shape_gap = 0.03;
                params.physics.contact_frequency = 15.0;
                params.fill.round = 0.5;
                params.fill.full_below = 0.2;
                params.fill.settle = 1.0;
                params.fill.residual_overlap = 0.02;
            }
            Accuracy::Fine => {
                params.physics.substeps = 16;
                params.physics.contact_frequency = 60.0;
                params.physics.shape_tolerance = 0.02;
                params.physics.shape_gap = 0.01;
                params.physics.max_parts = 24;
                params.fill.wall_tolerance = 0.006;
                params.fill.growth = 1.2;
                params.fill.round = 0.2;
                params.fill.full_below = 0.025;
                params.fill.settle = 3.0;
                params.fill.residual_overlap = 0.002;
            }
            Accuracy::Reference => {
                params.physics.step = Time::Natural(0.02);
                params.control.period = 12;
                params.physics.substeps = 32;
                params.physics.contact_frequency = 120.0;
                params.physics.shape_tolerance = 0.01;
                params.physics.shape_gap = 0.006;
                params.physics.max_parts = 48;
                params.fill.wall_tolerance = 0.002;
                params.fill.step = 0.05;
                params.fill.growth = 1.6;
                params.fill.round = 0.15;
                params.fill.full_below = 0.02;
                params.fill.settle = 4.0;
                params.fill.residual_overlap = 0.0005;
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
                    spread: Spread::Area(0.5),
                    neighbours: Neighbours::All,
                    speed: f64::INFINITY,
                    resistance: 0.0,
                    nails_per_body: 1000,
                    ..params.control
                };
            }
        }
        params
    }

    /// The engine's settings for the fill: half the substeps, since nothing has to balance there, and nothing has to
    /// stop rolling; but no softer contacts, which squeeze out growing props. An insert fill takes longer steps, and
    /// sweeps nothing unless the scene asks for it: its props hardly fall.
    pub fn fill_physics(&self, characteristic_time: f64) -> Physics {
        let mut physics = Physics {
            substeps: self.physics.substeps.div_ceil(2),
            rolling_resistance: 0.0,
            // Whatever the pile's is: stiffer contacts make another fill of the same seed, and overlapping bodies are
            // separated afterwards by position.
            contact_frequency: Params::standard().physics.contact_frequency,
            ..self.physics.clone()
        };
        if !self.fill.method.traits().falls {
            physics.step =
                Time::Natural(self.fill.step.max(physics.step.seconds(characteristic_time) / characteristic_time));
            if physics.switches.continuous_collision == Switch::Auto {
                physics.switches.continuous_collision = Switch::Off;
            }
        }
        physics
    }
}
