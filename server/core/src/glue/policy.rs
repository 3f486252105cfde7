//! The policy of the glue search: what is tried, in which order, and every constant that steers it.
//!
//! Statics places joints on paper; a trial releases the glued pile and shows what moves. Each attempt is a placement
//! and its trial. What the trial shows decides the next attempt, in this order:
//!
//! | | the trial shows | next step | constants |
//! | --- | --- | --- | --- |
//! | 0 | it stands without glue | no glue; nor for heaps that stand, where others fall | [`SAGS`] |
//! | 0 | (no trial yet) | place; weld the pairs that are pressed into each other | [`PRESSED`] |
//! | 1 | the pile leans as a whole | glue all feet to the ground from now on, and try it again | [`LEANS`] |
//! | 2 | many moved, or it sags | weld the few pairs that slip, with trials, if it stands then | [`SLIPS`] |
//! | 3 | few moved, or prices are at the top | discount their friction; go on from these joints | [`IN_PLACES`] |
//! | 4 | at most [`LOCAL_MOVED`] moved, early on | raise the price around bodies that moved a little | [`LOCAL`] |
//! | 5 | many bodies moved | raise the price everywhere; start from no joints | [`PRICES`] |
//! | 6 | few moved; it stands, or is late, or 3 is exhausted | weld moving bodies to all they touch | [`WELD_FROM`] |
//! | 7 | the pile stands | end the search | [`MOST_MOVED`], [`SAGS`] |
//! | 8 | the next placement would be the same | one more attempt, whose trial runs to its end | |
//! | 9 | too many attempts | take the best attempt; weld it if it was not | [`ATTEMPTS`] |
//!
//! Rows 3, 4 and 5 exclude each other. To discount friction means: first no friction, then no contact forces either. A
//! pile that sags (mean displacement above [`SAGS`]) fails in many places. Rows 2 and 6 repeat with a trial each until
//! the pile stands, at most [`SLIP_ROUNDS`] and [`WELD_ROUNDS`] times.
//!
//! Glue of bounded strength is never welded: its weakness is what the caller asked for. Lengths in d, the median prop's
//! diameter; times in characteristic times sqrt(d / g).

use std::ops::Range;

// Where glue may be.

/// Statics knows nothing of overlaps: bodies that are pressed into each other by more than this share of the thinner
/// one's thickness are welded. A wall of fifteen overlapping cubes springs apart without that (`tests/glue.rs`).
pub const PRESSED: f64 = 0.2;

// Prices.

/// The price of normal forces is the caller's, and at least the next of these each time that the pile fails in many
/// places. Expensive normal forces let glue carry a load that stands on paper by wedging alone: placements without a
/// price wedge with 60 to 230 weights, and fall. A price of 0.3 from the start costs 28 to 48 % more joints.
pub const PRICES: [f64; 3] = [0.3, 0.6, 1.0];
/// After these attempts, only bodies that moved get a higher price, where no larger share than [`LOCAL_MOVED`] has. A
/// tenth fewer joints in the median of 54 piles.
pub const LOCAL: Range<usize> = 0..5;
/// Beyond this share of moved bodies, the price rises everywhere.
pub const LOCAL_MOVED: f64 = 0.3;
/// Guards against piles that come no nearer: most need one or two attempts, a standing man of bananas five.
pub const ATTEMPTS: usize = 8;

// Welds.

/// Two bodies slip if their site has come apart by more than this, d. Where many bodies move, few pairs part, and the
/// others move with them. If these are no more than the joints, they are glued at once: a new placement at a higher
/// price everywhere takes longer, and about as many joints in the end. (Where more slip, statics is wrong about most of
/// the pile: stairs of oranges stood by 750 dots so, by 398 after the prices had risen.)
pub const SLIPS: f64 = 0.1;
/// Rounds of welding pairs that slip. Piles that lean even so need joints that are stiffer, not more of them.
pub const SLIP_ROUNDS: usize = 3;
/// From this attempt on, bodies that move in few places are welded. Guards against discounting friction without end.
pub const WELD_FROM: usize = 6;
/// Rounds of welding: bodies that move next are welded, too. Without welding, carrots in a toy figure kept 0.980 of
/// their shape, with it 0.996.
pub const WELD_ROUNDS: usize = 3;

// Verdict of a trial.

/// Longest trial: a lean shows late. Most end earlier, by [`STILL`].
pub const TRIAL_TIME: f64 = 20.0;
/// A body has moved beyond this.
pub const MOVED: f64 = 0.25;
/// The pile stands if no larger share of its bodies has moved.
pub const MOST_MOVED: f64 = 0.01;
/// The pile leans as a whole, on a foot that is too narrow, if its bodies have moved by more than this in the mean.
/// Fixed by the T of sticks, which leaned by 0.13 while no body had moved beyond [`MOVED`]; more joints elsewhere did
/// not help, glued feet did.
pub const LEANS: f64 = 0.03;
/// The pile fails in few places if no larger share has moved.
pub const IN_PLACES: f64 = 0.1;
/// The pile sags, and a little more would bring it down, if its bodies have moved by more than this in the mean. Late
/// attempts at a standing man of 1,023 bananas sag by 0.054 to 0.065.
pub const SAGS: f64 = 0.06;
/// Steps between two looks at the pile.
pub const LOOK: u64 = 12;
/// The trial ends once this many looks in a row predict, at the pace of each, that the pile stands at the end of the
/// time, or that no body gets farther than [`STILL`] in the rest of it.
pub const STILL_LOOKS: u32 = 5;
/// The pace falls from look to look where a pile settles, and rises where it topples. Where it falls, the bodies count
/// as getting this many times as far as it promises. With 2, each of thirteen trials that ran on to their end came to
/// the same share of moved bodies.
pub const FADES: f64 = 2.0;
/// See [`STILL_LOOKS`]; d. Far less than [`MOVED`].
pub const STILL: f64 = 0.02;
/// A trial ends, too, once two looks find the pile to fail, or to sag by more than this factor beyond [`SAGS`].
pub const SURELY: f64 = 1.2;
/// The second trial tilts the ground by this to four sides, degrees. Half of friction leaves a cone of sticks standing
/// at 5 and 10.
pub const TILT: f64 = 5.0;
