//! The earlier bake that a request names by its id in the place of a file: its .glb becomes an asset of the caller, and
//! the request is from then on as if the caller had uploaded it.

use super::Bakes;
use super::limits::account;
use crate::access::Caller;
use crate::blocking::on_disk;
use crate::folder::ResultKind;
use crate::seal::CHANGED;
use crate::status::Fault;
use cairn_export::Format;
use cairn_wire::proto::{AssetReference, BakeSpec, BakeState, FieldProblem};
use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;

const FIELD: &str = "spec.from_bake_id";
/// What a caller can do without the earlier bake.
const REMEDY: &str = "upload its .glb and name it in scene.from, or leave from_bake_id out to bake all of it afresh";

fn unusable(what: String) -> Fault {
    Fault::EarlierBake(vec![FieldProblem { field: FIELD.into(), description: what }])
}

fn absent(id: &str) -> String {
    format!("there is no bake {id} on this server: it was never requested, was deleted, or is too old; {REMEDY}")
}

impl Bakes {
    /// The request with the result of the bake that `from_bake_id` names among its assets.
    pub async fn with_earlier(self: &Arc<Self>, caller: &Caller, mut spec: BakeSpec) -> Result<BakeSpec, Fault> {
        let asked = std::mem::take(&mut spec.from_bake_id);
        if asked.is_empty() {
            return Ok(spec);
        }
        self.accepts_work()?;
        let entry = self.find(caller, &asked).map_err(|fault| match fault {
            Fault::BakeNotFound(id) => unusable(absent(&id)),
            Fault::RequestInvalid(problems) => {
                let here = |problem| FieldProblem { field: FIELD.into(), ..problem };
                Fault::RequestInvalid(problems.into_iter().map(here).collect())
            }
            fault => fault,
        })?;
        let id = entry.id();
        let uri = {
            let path = &mut spec.scene.get_or_insert_default().from.get_or_insert_default().path;
            if path.is_empty() {
                *path = format!("{id}.glb");
            }
            path.clone()
        };
        if spec.assets.iter().any(|asset| Path::new(&asset.uri) == Path::new(&uri)) {
            let what = format!("assets has {uri}, too, which scene.from names; give one of them");
            return Err(Fault::field(FIELD, what));
        }
        let (bakes, of) = (self.clone(), entry.clone());
        on_disk(move || bakes.check_files(&of)).await??;
        let status = entry.state().status.clone();
        let why = || status.failure.as_ref().map(|failure| failure.message.clone()).unwrap_or_default();
        match status.state() {
            BakeState::Succeeded => {}
            BakeState::Failed => {
                let what = format!("the bake {id} has failed ({}); name one that has succeeded, or {REMEDY}", why());
                return Err(unusable(what));
            }
            BakeState::Cancelled => {
                let what =
                    format!("the bake {id} was cancelled; name one that has succeeded, or leave from_bake_id out");
                return Err(unusable(what));
            }
            _ => return Err(unusable(format!("the bake {id} is not finished; wait for its end by WatchBake"))),
        }
        self.store.touch(&id);
        let damaged = |fault: Fault| match fault {
            Fault::BakeDamaged(_) | Fault::FormatUnavailable(_) => unusable(format!("{fault}; or {REMEDY}")),
            fault => fault,
        };
        let kind = ResultKind::of(Format::Glb);
        let head = self.result(caller, &entry, &kind, None).await.map_err(damaged)?.result;
        let most = self.config.asset_bytes();
        if head.size_bytes.unsigned_abs() > most {
            let what =
                format!("the .glb of the bake {id} is larger than this server's limit of {most} bytes for assets");
            return Err(unusable(format!(
                "{what}; ask the operator for a higher asset_mib, or leave from_bake_id out"
            )));
        }
        let (bakes, of, caller, sha256) = (self.clone(), entry.clone(), caller.clone(), head.sha256.clone());
        let path = self.store.folder(&id).join(kind.result_name());
        let adopt = move || {
            if bakes.store.has(&sha256, caller.project()) {
                return Ok(());
            }
            let room = bakes.make_room(&caller, head.size_bytes.unsigned_abs())?;
            let adopted = bakes.store.adopt(&path, &sha256, &account(&caller));
            drop(room);
            match adopted {
                Ok(true) => Ok(()),
                Ok(false) => Err(bakes.mark_damaged(&of, format!("its result: {CHANGED}"))),
                // It was deleted at this moment.
                Err(error) if error.kind() == ErrorKind::NotFound => Err(unusable(absent(&of.id()))),
                Err(error) => Err(error.into()),
            }
        };
        on_disk(adopt).await?.map_err(damaged)?;
        self.request_trim();
        spec.assets.push(AssetReference { uri, sha256: head.sha256 });
        Ok(spec)
    }
}
