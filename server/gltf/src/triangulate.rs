//! Triangles of lists, strips and fans of vertices. Every index is in range.

use gltf::mesh::Mode;

use crate::accessor::{Elements, largest};
use crate::log::{Log, Logged};
use crate::problem::ProblemKind;

/// The most triangles that this number of corners makes.
pub(crate) fn at_most(mode: Mode, corners: u64) -> u64 {
    if mode == Mode::Triangles { corners / 3 } else { corners.saturating_sub(2) }
}

/// The triangles of a primitive. In a strip or fan, the largest index of the format begins a new strip, as in
/// graphics hardware; glTF itself forbids that index.
pub(crate) fn triangles(
    mode: Mode,
    positions: &Elements<'_>,
    indices: Option<&Elements<'_>>,
    place: &str,
    log: &mut Log,
) -> Logged<Vec<[u32; 3]>> {
    let corners = indices.map_or(positions.count, |i| i.count);
    let vertices = positions.count;
    let mut out = Vec::with_capacity(at_most(mode, corners) as usize);
    let read = |position: u64, log: &mut Log| -> Logged<u32> {
        // A vertex count is below 2^32: it is held against the limit of triangles.
        let vertex = indices.map_or(position as u32, |i| i.index(position));
        if u64::from(vertex) < vertices {
            return Ok(vertex);
        }
        let what = ProblemKind::Index { position, vertex: u64::from(vertex), vertices };
        Err(log.refuse(place, what))
    };
    if mode == Mode::Triangles {
        if !corners.is_multiple_of(3) {
            log.note("the number of its corners is not a multiple of three: the last ones are left out", place);
        }
        for first in (0..corners - corners % 3).step_by(3) {
            out.push([read(first, log)?, read(first + 1, log)?, read(first + 2, log)?]);
        }
        return Ok(out);
    }
    let restart = indices.map(|i| largest(i.component));
    let (mut a, mut b, mut length) = (0, 0, 0u64);
    for position in 0..corners {
        if restart.is_some() && restart == indices.map(|i| i.index(position)) {
            log.note("the largest index begins a new strip, which glTF forbids", place);
            length = 0;
            continue;
        }
        let c = read(position, log)?;
        match (mode, length) {
            (_, 0) => a = c,
            (_, 1) => b = c,
            (Mode::TriangleFan, _) => {
                out.push([b, c, a]);
                b = c;
            }
            // Every second triangle of a strip runs the other way round.
            (_, n) => {
                out.push(if n % 2 == 0 { [a, b, c] } else { [a, c, b] });
                (a, b) = (b, c);
            }
        }
        length += 1;
    }
    Ok(out)
}
