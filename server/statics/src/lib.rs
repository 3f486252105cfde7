//! Static equilibrium of rigid bodies with friction, exact and certified.
//!
//! A block on a slope stands below tan(angle) = mu and slides above:
//!
//! ```
//! use cairn_statics::local::{Analyser, LocalContact, LocalProblem, Options};
//! use glam::DVec3;
//!
//! // The slope's own frame: y is its normal, gravity leans towards x. Four corners carry the block.
//! let friction: f64 = 0.5;
//! let corners = [(-0.1, -0.1), (-0.1, 0.1), (0.1, 0.1), (0.1, -0.1)];
//! let contacts =
//!     corners.map(|(x, z)| LocalContact { point: DVec3::new(x, 0.0, z), normal: DVec3::Y, friction });
//!
//! let mut analyser = Analyser::new();
//! let mut stands = |angle: f64| {
//!     let block = LocalProblem {
//!         contacts: &contacts,
//!         mass: 3.0,
//!         center_of_mass: DVec3::new(0.0, 0.05, 0.0),
//!         radius: 0.15,
//!         gravity: 9.81 * DVec3::new(angle.sin(), -angle.cos(), 0.0),
//!     };
//!     analyser.analyse(&block, &Options::default()).map(|verdict| verdict.is_stable())
//! };
//! let limit = friction.atan();
//! assert!(stands(limit - 1e-6)?);
//! assert!(!stands(limit + 1e-6)?);
//! # Ok::<(), cairn_statics::local::ProblemError>(())
//! ```
//!
//! A post carries an arm that only touches its side. Nothing presses the two together, so that friction cannot hold the
//! arm; one glue joint can:
//!
//! ```
//! use cairn_statics::global::{self, GlobalBody, GlobalContact, GlobalProblem, Objective};
//! use cairn_statics::glue::{self, GlueOptions, GlueProblem, GlueSite, MOST_ROUNDS};
//! use glam::DVec3;
//! use std::ops::ControlFlow;
//!
//! let gravity = DVec3::new(0.0, -9.81, 0.0);
//! let bodies = [
//!     GlobalBody { mass: 8.0, center_of_mass: DVec3::new(0.0, 0.5, 0.0), radius: 0.6 },
//!     GlobalBody { mass: 1.0, center_of_mass: DVec3::new(0.4, 0.8, 0.0), radius: 0.3 },
//! ];
//! let square = [(-0.2, -0.2), (-0.2, 0.2), (0.2, 0.2), (0.2, -0.2)];
//! let foot = square.map(|(u, v)| GlobalContact {
//!     body: 0,
//!     other: None,
//!     point: DVec3::new(u, 0.0, v),
//!     normal: DVec3::Y,
//!     friction: 0.8,
//! });
//! let side = square.map(|(u, v)| GlobalContact {
//!     body: 1,
//!     other: Some(0),
//!     point: DVec3::new(0.2, 0.8 + u, v),
//!     normal: DVec3::X,
//!     friction: 0.8,
//! });
//! let contacts = [foot, side].concat();
//!
//! let pile = GlobalProblem { bodies: &bodies, contacts: &contacts, gravity };
//! assert!(!global::analyse(&pile, Objective::default())?.stands());
//!
//! let site = |body, other, contacts, center| GlueSite {
//!     body,
//!     other,
//!     contacts,
//!     center,
//!     arm: 0.1,
//!     may_glue: true,
//!     normal_price: 0.0,
//! };
//! let sites = [site(0, None, 0..4, DVec3::ZERO), site(1, Some(0), 4..8, DVec3::new(0.2, 0.8, 0.0))];
//! let problem = GlueProblem { bodies: &bodies, contacts: &contacts, sites: &sites, gravity };
//! let options = GlueOptions { friction_factor: 0.5, normal_price: 0.02, strength: None, rounds: MOST_ROUNDS };
//! let placement = glue::place(&problem, &options, &mut || ControlFlow::Continue(()))?;
//! assert!(placement.stands());
//! assert_eq!(placement.joints.iter().map(|joint| joint.site).collect::<Vec<_>>(), [1]);
//! // Of the arm's weight, the joint lifts the share that friction between the two does not.
//! let lift = placement.joints[0].force.y;
//! assert!(lift > 0.0 && lift < 9.81, "{lift}");
//! # Ok::<(), glue::GlueError>(())
//! ```
//!
//! # Modules
//!
//! - [`local`]: one body among fixed neighbours. A verdict takes microseconds and carries its proof: contact forces, or
//!   the motion in which the body starts to fall. Also margins, ranks, and which bodies may be held.
//! - [`global`]: all bodies of a pile at once, where each force has its reaction. A cone program with a lower bound on
//!   the weight that nothing supports.
//! - [`limit`]: by what factor a load may grow until the pile falls, such as a tilt of its ground, with both proofs.
//! - [`removal`]: what stands once a body is taken away.
//! - [`glue`]: the fewest joints, about, with which the pile stands; what contacts alone leave unsupported; and the
//!   loads of the joints in a cluster that moves.
//!
//! # Conventions
//!
//! Units: any consistent system, such as SI. Frame: any right-handed one, the same for all points of a problem. Normals
//! point into the contact's first body. Friction is Coulomb's, one coefficient for each contact. All answers are
//! functions of their input alone: no clock, no hashing, no threads, no global state.
//!
//! # What a certificate means
//!
//! No verdict rests on a solver's word. Forces are substituted into the balance of every body and into the friction
//! law; a proof of instability is substituted as a virtual motion (Farkas' lemma): gravity does work with it, and no
//! admissible contact force resists it. The code that substitutes knows nothing of the solvers, and its tolerances are
//! public constants.
//!
//! The method, and the literature behind it, are in each module's documentation.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod global;
pub mod glue;
pub mod limit;
pub mod local;
mod program;
pub mod removal;

/// The examples of the README compile, and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
