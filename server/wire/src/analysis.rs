//! The answers of an analysis <-> messages.

use super::proto;
use super::to_proto::signed;
use cairn_analysis::{
    AnalysedBody, KnockOver, NeededDot, Nudge, PileAnalysis, Removal, Standing, TiltLimit, Touch, WholePile,
};

/// What the answers of an analysis are about: a node of a file.
pub struct NamedNode<'a> {
    pub name: &'a str,
    pub node: usize,
}

/// Bytes of bodies and touches in a message, about.
const PART: usize = 256 << 10;
/// Longest name in a message, bytes.
const LONGEST_NAME: usize = 1000;

impl From<Standing> for proto::Standing {
    fn from(standing: Standing) -> proto::Standing {
        match standing {
            Standing::Stands => proto::Standing::Stands,
            Standing::Pinned => proto::Standing::Pinned,
            Standing::FallsAlone => proto::Standing::FallsAlone,
            Standing::FallsWithOthers => proto::Standing::FallsWithOthers,
        }
    }
}

fn ids(list: &[usize]) -> Vec<i32> {
    list.iter().map(|&id| signed(id)).collect()
}

fn body(body: &AnalysedBody, node: &NamedNode) -> proto::AnalysedBody {
    let removal = |removal: &Removal| proto::RemovalForecast {
        is_safe: removal.is_safe,
        is_open: removal.is_open,
        moving: ids(&removal.moving),
    };
    proto::AnalysedBody {
        name: node.name[..node.name.floor_char_boundary(LONGEST_NAME)].to_owned(),
        node: signed(node.node),
        standing: proto::Standing::from(body.standing).into(),
        mass: body.mass,
        unbalanced: body.unbalanced,
        load: body.load,
        load_in_weights: body.load_in_weights,
        carries: ids(&body.carries),
        rests_on_it: ids(&body.rests_on_it),
        least_friction: body.least_friction,
        least_push: body.least_push,
        push_azimuth: body.push_azimuth,
        least_tilt: body.least_tilt,
        removal: body.removal.as_ref().map(removal),
    }
}

fn touch(touch: &Touch) -> proto::AnalysedTouch {
    proto::AnalysedTouch {
        body: signed(touch.body),
        other: touch.other.map(signed),
        point_count: signed(touch.points),
        point: touch.point.to_vec(),
        force: touch.force.to_vec(),
    }
}

fn margins(whole: &WholePile) -> proto::PileMargins {
    let tilt = |tilt: &TiltLimit| proto::TiltLimit {
        azimuth: tilt.azimuth,
        stands_to: tilt.stands_to,
        falls_from: tilt.falls_from,
    };
    let knock = |knock: &KnockOver| proto::KnockOver {
        body: signed(knock.body),
        azimuth: knock.azimuth,
        stands_to: knock.push[0],
        falls_from: knock.push[1],
        force: knock.force,
        moving: ids(&knock.moving),
        comes_down: ids(&knock.comes_down),
        tried: signed(knock.tried),
    };
    proto::PileMargins {
        tilts: whole.tilts.iter().map(tilt).collect(),
        stands_to: whole.tilt[0],
        falls_from: whole.tilt[1],
        azimuth: whole.azimuth,
        goes_first: ids(&whole.goes_first),
        weakest: whole.weakest.map(signed),
        friction_falls: whole.friction[0],
        friction_stands: whole.friction[1],
        programs: signed(whole.programs),
        knock_over: whole.knock_over.as_ref().map(knock),
    }
}

/// The messages of an analysis: bodies and touches in parts, last the whole. `about`: gravity, ground and notes.
pub fn to_messages<'a>(
    analysis: &PileAnalysis,
    nodes: impl IntoIterator<Item = NamedNode<'a>>,
    about: proto::PileAnalysis,
) -> Vec<proto::AnalysePileResponse> {
    use prost::Message;
    let mut parts = vec![proto::AnalysePileResponse::default()];
    let mut size = 0;
    let mut next = |parts: &mut Vec<proto::AnalysePileResponse>, bytes: usize| {
        size += bytes;
        if size > PART {
            size = bytes;
            parts.push(proto::AnalysePileResponse::default());
        }
    };
    for message in analysis.bodies.iter().zip(nodes).map(|(one, node)| body(one, &node)) {
        next(&mut parts, message.encoded_len());
        parts.last_mut().into_iter().for_each(|part| part.bodies.push(message.clone()));
    }
    for message in analysis.touches.iter().map(touch) {
        next(&mut parts, message.encoded_len());
        parts.last_mut().into_iter().for_each(|part| part.touches.push(message.clone()));
    }
    let dot = |dot: &NeededDot| proto::NeededDot {
        body: signed(dot.body),
        other: dot.other.map(signed),
        point: dot.point.to_vec(),
        force: dot.force,
    };
    let nudge = |nudge: &Nudge| proto::Nudge { body: signed(nudge.body), by: nudge.by.to_vec() };
    let pile = proto::PileAnalysis {
        stands: analysis.stands,
        imbalance: analysis.imbalance,
        order: ids(&analysis.order),
        stuck: ids(&analysis.stuck),
        margins: analysis.whole.as_ref().map(margins),
        glue: analysis.glue.iter().map(dot).collect(),
        beyond_glue: ids(&analysis.beyond_glue),
        nudges: analysis.nudges.iter().map(nudge).collect(),
        beyond_nudges: ids(&analysis.beyond_nudges),
        programs: signed(analysis.programs),
        ..about
    };
    parts.push(proto::AnalysePileResponse { pile: Some(pile), ..Default::default() });
    parts
}

/// The answers in these messages; `None` where they are not those of a whole analysis of so many bodies.
pub fn from_messages(parts: &[proto::AnalysePileResponse], count: usize) -> Option<PileAnalysis> {
    let pile = parts.iter().find_map(|part| part.pile.clone())?;
    let id = |id: i32| usize::try_from(id).ok().filter(|&id| id < count);
    let ids = |list: &[i32]| list.iter().map(|&one| id(one)).collect::<Option<Vec<usize>>>();
    let maybe = |one: Option<i32>| one.map_or(Some(None), |one| id(one).map(Some));
    let three = |list: &[f64]| <[f64; 3]>::try_from(list).ok();
    let number = |number: i64| u64::try_from(number).ok();
    let body = |body: &proto::AnalysedBody| {
        let removal = match &body.removal {
            Some(removal) => {
                Some(Removal { is_safe: removal.is_safe, is_open: removal.is_open, moving: ids(&removal.moving)? })
            }
            None => None,
        };
        Some(AnalysedBody {
            standing: match body.standing() {
                proto::Standing::Stands => Standing::Stands,
                proto::Standing::Pinned => Standing::Pinned,
                proto::Standing::FallsAlone => Standing::FallsAlone,
                proto::Standing::FallsWithOthers => Standing::FallsWithOthers,
                proto::Standing::Unspecified => return None,
            },
            mass: body.mass,
            unbalanced: body.unbalanced,
            load: body.load,
            load_in_weights: body.load_in_weights,
            carries: ids(&body.carries)?,
            rests_on_it: ids(&body.rests_on_it)?,
            least_friction: body.least_friction,
            least_push: body.least_push,
            push_azimuth: body.push_azimuth,
            least_tilt: body.least_tilt,
            removal,
        })
    };
    let touch = |touch: &proto::AnalysedTouch| {
        Some(Touch {
            body: id(touch.body)?,
            other: maybe(touch.other)?,
            points: usize::try_from(touch.point_count).ok()?,
            point: three(&touch.point)?,
            force: three(&touch.force)?,
        })
    };
    let knock = |knock: &proto::KnockOver| {
        Some(KnockOver {
            body: id(knock.body)?,
            azimuth: knock.azimuth,
            push: [knock.stands_to, knock.falls_from],
            force: knock.force,
            moving: ids(&knock.moving)?,
            comes_down: ids(&knock.comes_down)?,
            tried: usize::try_from(knock.tried).ok()?,
        })
    };
    let tilt = |tilt: &proto::TiltLimit| TiltLimit {
        azimuth: tilt.azimuth,
        stands_to: tilt.stands_to,
        falls_from: tilt.falls_from,
    };
    let whole = |margins: &proto::PileMargins| {
        let tilt_range = [margins.stands_to, margins.falls_from];
        Some(WholePile {
            tilts: margins.tilts.iter().map(tilt).collect(),
            tilt: tilt_range,
            shake: tilt_range.map(|degrees| libm::tan(degrees.to_radians())),
            azimuth: margins.azimuth,
            goes_first: ids(&margins.goes_first)?,
            weakest: maybe(margins.weakest)?,
            friction: [margins.friction_falls, margins.friction_stands],
            knock_over: match &margins.knock_over {
                Some(found) => Some(knock(found)?),
                None => None,
            },
            programs: number(margins.programs)?,
        })
    };
    let dot = |dot: &proto::NeededDot| {
        Some(NeededDot { body: id(dot.body)?, other: maybe(dot.other)?, point: three(&dot.point)?, force: dot.force })
    };
    let nudge = |nudge: &proto::Nudge| Some(Nudge { body: id(nudge.body)?, by: three(&nudge.by)? });
    let bodies: Vec<AnalysedBody> = parts.iter().flat_map(|part| &part.bodies).map(body).collect::<Option<_>>()?;
    (bodies.len() == count).then_some(())?;
    Some(PileAnalysis {
        bodies,
        touches: parts.iter().flat_map(|part| &part.touches).map(touch).collect::<Option<_>>()?,
        stands: pile.stands,
        imbalance: pile.imbalance,
        order: ids(&pile.order)?,
        stuck: ids(&pile.stuck)?,
        whole: match &pile.margins {
            Some(margins) => Some(whole(margins)?),
            None => None,
        },
        glue: pile.glue.iter().map(dot).collect::<Option<_>>()?,
        beyond_glue: ids(&pile.beyond_glue)?,
        nudges: pile.nudges.iter().map(nudge).collect::<Option<_>>()?,
        beyond_nudges: ids(&pile.beyond_nudges)?,
        programs: number(pile.programs)?,
    })
}
