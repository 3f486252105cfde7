//! Reads an earlier result of which a bake keeps what fits.

use super::models::SceneReader;
use crate::provenance::{self, Origin};
use crate::request;
use crate::sources::{InputFile, Reference};
use cairn_export::state::{self, PileState};
use cairn_files::problem::Problem;
use cairn_input::earlier::{EarlierBody, EarlierPile, EarlierProp};
use cairn_wire::proto;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// The farthest reach, d: a result holds scenery up to there.
const MOST_REACH: f64 = 3.0;
const FIELD: &str = "from.path";

impl SceneReader {
    /// The earlier pile of `given.from`. `props`: where the scene's props are.
    pub(super) fn former(&mut self, effective: &proto::Scene, props: &[Reference]) -> Option<EarlierPile> {
        let from = effective.from.as_ref()?;
        let (path, reach) = (from.path.clone(), from.reach());
        if !(0.0..=MOST_REACH).contains(&reach) {
            let field = "from.reach";
            let remedy = "Give a value from 0 to 3, in median prop diameters.";
            self.problems.push(Problem::new(field, format!("{reach} is out of range"), remedy).of_field(field));
        }
        let found = self
            .read_former(&path)
            .and_then(|(file, origin, state)| self.earlier_pile(&file, &origin, state, effective, props));
        match found {
            Ok(pile) => Some(EarlierPile { reach, ..pile }),
            Err(problem) => {
                // What could not be read before has said so.
                self.problems.extend(problem.map(|problem| problem.of_field(FIELD)));
                None
            }
        }
    }

    fn read_former(&mut self, path: &str) -> Result<(String, Origin, PileState), Option<Problem>> {
        if path.is_empty() {
            return Err(Some(Problem::new(FIELD, "it is empty", "Name a .glb that `cairn bake` wrote.")));
        }
        let reference = Reference::new(path);
        if !self.files.contains_key(&reference.file) {
            let file = InputFile::read(Path::new(&reference.file), &self.source).map_err(|mut problem| {
                problem.what = format!("{} (from)", problem.what);
                Some(problem)
            })?;
            self.files.insert(reference.file.clone(), file);
        }
        let file = &self.files[&reference.file];
        let problem = |what: String, remedy: &str| Some(Problem::new(&reference.name, what, remedy));
        if reference.node.is_some() {
            return Err(problem("it names a node of a result".into(), "Name the file alone."));
        }
        let remedy = "Name a .glb that this version of `cairn bake` wrote, of a control mesh that it filled.";
        let state = state::read(&file.bytes).map_err(|error| problem(error.to_string(), remedy))?;
        let origin = provenance::origin(&file.bytes);
        let origin = origin.ok_or_else(|| problem("it does not hold its scene".into(), remedy))?;
        Ok((file.name.clone(), origin, state))
    }

    fn earlier_pile(
        &self,
        name: &str,
        origin: &Origin,
        state: PileState,
        effective: &proto::Scene,
        props: &[Reference],
    ) -> Result<EarlierPile, Option<Problem>> {
        let own = cairn_wire::scene_file::SceneTree::from_message(effective).to_value();
        let list = |scene: &Value| scene.get("props").and_then(Value::as_array).cloned().unwrap_or_default();
        let (old, new) = (list(&origin.scene), list(&own));
        let mut same: Vec<Option<usize>> = Vec::new();
        for prop in &old {
            let is_free = |i: &usize| !same.contains(&Some(*i));
            let is_same = |i: &usize| self.is_same(prop, origin, &props[*i]);
            let index = same.len();
            let here = Some(index).filter(|i| *i < props.len() && is_free(i) && is_same(i));
            let found = here.or_else(|| (0..props.len()).filter(is_free).find(is_same));
            same.push(found);
        }
        let taken: BTreeSet<usize> = same.iter().flatten().copied().collect();
        let fate = |index: usize| match same.get(index) {
            Some(Some(now)) => EarlierProp::Same(*now),
            Some(None) if index < props.len() && !taken.contains(&index) => EarlierProp::Replaced(index),
            _ => EarlierProp::Gone,
        };
        let damaged = || Some(Problem::new(name, "its bodies and its props disagree", "Bake it again."));
        let body = |body: EarlierBody| match body.prop {
            EarlierProp::Same(index) if index < old.len() => Ok(EarlierBody { prop: fate(index), ..body }),
            _ => Err(damaged()),
        };
        let bodies = state.bodies.into_iter().map(body).collect::<Result<_, _>>()?;
        // How the shape is filled, and how often each prop is drawn.
        let drawn = |list: &[Value]| -> Vec<Value> {
            let keys = ["weight", "scale_min", "scale_max", "scale_skew"];
            list.iter().map(|prop| keys.iter().map(|key| prop.get(*key).cloned()).collect()).collect()
        };
        let is_filled_alike = origin.scene.get("fill") == own.get("fill")
            && origin.scene.get("piles").is_some() == own.get("piles").is_some();
        let refills = !is_filled_alike || drawn(&old) != drawn(&new);
        let (dots, shape, scenery, ground) = (state.dots, state.shape, state.scenery, state.ground);
        Ok(EarlierPile { name: name.to_owned(), bodies, dots, shape, scenery, ground, refills, reach: 0.0 })
    }

    /// Whether a prop of an earlier scene is this one: the same part of a file of the same content.
    fn is_same(&self, prop: &Value, origin: &Origin, now: &Reference) -> bool {
        let Some(path) = prop.get("path").and_then(Value::as_str) else { return false };
        let Some(file) = self.files.get(&now.file) else { return false };
        let (uri, node) = cairn_files::split_node(path);
        let is_known = |sha256: &String| origin.assets.iter().any(|asset| asset.sha256 == *sha256);
        let hashes: Vec<String> = request::assets(file).into_iter().map(|asset| asset.sha256).collect();
        let own = origin.assets.iter().find(|asset| asset.uri == uri).map(|asset| &asset.sha256);
        node == now.node.as_deref() && own == hashes.first() && hashes.iter().all(is_known)
    }
}
