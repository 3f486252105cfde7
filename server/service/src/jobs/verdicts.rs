//! What was found of requests for bakes, so that the same scene with another seed is accepted without another plan:
//! farms ask for many seeds of one scene. Nothing that a plan says depends on the seed.

use crate::status::Fault;
use cairn_wire::proto::{Accepted, BakeSpec};
use prost::Message;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::OnceCell;

type Verdict = Arc<OnceCell<Accepted>>;

/// The verdicts on the requests that came last.
#[derive(Default)]
pub(super) struct Verdicts(Mutex<VecDeque<([u8; 32], Verdict)>>);

impl Verdicts {
    /// Verdicts that are kept.
    const KEPT: usize = 64;
    /// Most bytes of a request whose verdict is kept.
    const LARGEST: usize = 64 << 10;

    /// The verdict on a request, with the seed that it asks for: one of before, or else a new one. Requests that come
    /// while it is made wait for it.
    pub(super) async fn get_or_try_make(
        &self,
        spec: &BakeSpec,
        project: &str,
        make: impl Future<Output = Result<Accepted, Fault>>,
    ) -> Result<Accepted, Fault> {
        if spec.encoded_len() > Verdicts::LARGEST {
            return make.await;
        }
        let key = key(spec, project);
        let verdict = self.entry(key);
        let found = verdict.get_or_try_init(|| make).await;
        if found.is_err() {
            self.forget(key, &verdict);
        }
        let mut accepted = found?.clone();
        if let (Some(effective), Some(scene)) = (&mut accepted.effective_scene, &spec.scene) {
            effective.seed = scene.seed.or(effective.seed);
        }
        Ok(accepted)
    }

    fn entry(&self, key: [u8; 32]) -> Verdict {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let at = all.iter().position(|(of, _)| *of == key);
        let (_, verdict) = at.and_then(|at| all.remove(at)).unwrap_or_default();
        all.truncate(Verdicts::KEPT - 1);
        all.push_front((key, verdict.clone()));
        verdict
    }

    fn forget(&self, key: [u8; 32], verdict: &Verdict) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|(of, held)| *of != key || !Arc::ptr_eq(held, verdict));
    }
}

/// A hash of all that a verdict depends on.
fn key(spec: &BakeSpec, project: &str) -> [u8; 32] {
    let mut spec = spec.clone();
    if let Some(seed) = spec.scene.as_mut().and_then(|scene| scene.seed.as_mut()) {
        // One that is out of range is refused.
        *seed = (*seed).min(0);
    }
    let mut all = blake3::Hasher::new();
    all.update(blake3::hash(project.as_bytes()).as_bytes()).update(&spec.encode_to_vec());
    all.finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_wire::proto::{ControlMesh, Scene};
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn of(seed: Option<i64>, path: &str) -> BakeSpec {
        let control = ControlMesh { path: path.into() };
        let scene = Scene { seed, control_mesh: Some(control), ..Default::default() };
        BakeSpec { scene: Some(scene), ..Default::default() }
    }

    #[tokio::test]
    async fn a_scene_is_planned_once_for_all_its_seeds() {
        let (verdicts, made) = (Verdicts::default(), AtomicUsize::new(0));
        let ask = |spec: BakeSpec, project, is_right: bool| {
            let (verdicts, made) = (&verdicts, &made);
            async move {
                let make = async {
                    made.fetch_add(1, Ordering::Relaxed);
                    tokio::task::yield_now().await;
                    let accepted = Accepted { effective_scene: spec.scene.clone(), ..Default::default() };
                    if is_right { Ok(accepted) } else { Err(Fault::BakeCancelled) }
                };
                let accepted = verdicts.get_or_try_make(&spec, project, make).await.ok()?;
                let made = made.load(Ordering::Relaxed);
                Some((accepted.effective_scene.unwrap().seed, made))
            }
        };
        assert_eq!(ask(of(Some(1), "a"), "", false).await, None);
        assert_eq!(ask(of(Some(1), "a"), "", true).await, Some((Some(1), 2)), "a failure is not kept");
        assert_eq!(ask(of(Some(7), "a"), "", true).await, Some((Some(7), 2)));
        assert_eq!(ask(of(None, "a"), "", true).await, Some((None, 3)), "its seed is the default");
        assert_eq!(ask(of(Some(-1), "a"), "", false).await, None, "out of range");
        assert_eq!(ask(of(Some(7), "a"), "film", true).await, Some((Some(7), 5)), "files of another project");
        let both = tokio::join!(ask(of(Some(1), "b"), "", true), ask(of(Some(2), "b"), "", true));
        assert_eq!(both, (Some((Some(1), 6)), Some((Some(2), 6))), "the second waits for the first");
        for other in 0..Verdicts::KEPT {
            ask(of(None, &other.to_string()), "", true).await;
        }
        assert_eq!(verdicts.0.lock().unwrap().len(), Verdicts::KEPT);
        let large = ask(of(None, &"x".repeat(Verdicts::LARGEST)), "", true).await;
        assert!(large.is_some());
        let again = ask(of(Some(5), &"x".repeat(Verdicts::LARGEST)), "", true).await;
        assert_eq!(again.unwrap().1, large.unwrap().1 + 1, "a large one is not kept");
    }
}
