//! The data directory: what it keeps, ages, gives up, and notices.

use super::*;

/// An id in the form of a bake's.
fn id(name: &str) -> String {
    hex(&Sha256::digest(name))
}

fn bake(store: &Store, name: &str, bytes: usize, age: u64) {
    let id = &id(name);
    let folder = store.prepare(id, &BakeSpec::default(), "").unwrap();
    fs::write(folder.join("result.glb"), vec![0; bytes]).unwrap();
    let mut status = BakeStatus { bake_id: id.clone(), ..Default::default() };
    status.set_state(BakeState::Succeeded);
    store.write_status(&status).unwrap();
    let used = SystemTime::now() - Duration::from_secs(age);
    File::options().append(true).open(folder.join(STATUS)).unwrap().set_modified(used).unwrap();
}

/// Bakes of these owners, and one that is not finished.
struct Keeper<'a>(&'a Store, &'a [(&'a str, &'a str)], &'a str);

impl BakeKeeper for Keeper<'_> {
    fn account(&self, bake: &str) -> Account {
        let owner = self.1.iter().find(|(name, _)| id(name) == bake);
        Account::new("", owner.map_or("anna", |(_, owner)| owner))
    }
    fn is_shared(&self, _: &str) -> bool {
        false
    }
    fn remove(&self, bake: &str) -> Result<bool> {
        Ok(bake != id(self.2) && self.0.remove(bake).is_ok())
    }
    fn measured(&self, _: &str, _: u64) {}
    fn pass_on(&self, _: &str) -> bool {
        false
    }
}

fn none(_: &Account) -> [crate::access::CallerLimits; 2] {
    Default::default()
}

fn names(store: &Store) -> Vec<String> {
    let mut names: Vec<String> = store.load().unwrap().into_iter().map(|status| status.bake_id).collect();
    names.sort();
    names
}

#[test]
fn the_least_recently_used_is_removed_first() {
    let folder = tempfile::tempdir().unwrap();
    let config = Config { data: folder.path().join("data"), store_mib: 3, store_days: 1, ..Config::default() };
    let store = Store::open(&config).unwrap();
    for (name, age) in [("new", 0), ("older", 20), ("oldest", 30), ("at work", 40), ("past its days", 90_000)] {
        bake(&store, name, 1 << 20, age);
    }
    let keeper = Keeper(&store, &[], "at work");
    let left = store.trim(&keeper, &none).unwrap();
    let mut expected = [id("at work"), id("new")];
    expected.sort();
    assert_eq!(names(&store), expected);
    assert!((2 << 20..3 << 20).contains(&left), "{left}");
    store.touch(&id("at work"));
    assert_eq!(store.trim(&keeper, &none).unwrap(), left);
}

/// Anna has flooded the store: Ben's bake stays, old as it is.
#[test]
fn who_floods_the_store_pays_for_it() {
    let folder = tempfile::tempdir().unwrap();
    let config = Config { data: folder.path().join("data"), store_mib: 5, ..Config::default() };
    let store = Store::open(&config).unwrap();
    bake(&store, "of ben", 1 << 20, 1000);
    for number in 0..6 {
        let mut upload = store.upload().unwrap();
        let content = vec![number; 1 << 20];
        upload.write(&content).unwrap();
        assert!(store.keep(upload, &hex(&Sha256::digest(&content)), &Account::new("", "anna")).unwrap());
    }
    let left = store.trim(&Keeper(&store, &[("of ben", "ben")], ""), &none).unwrap();
    assert!(left <= 5 << 20, "{left}");
    assert_eq!(names(&store), [id("of ben")]);
    assert!((3 << 20..=4 << 20).contains(&store.owners.bytes(&Account::new("", "anna"))[0]));
}

/// A clock that has jumped by 40 days removes nothing.
#[test]
fn entries_age_by_the_time_of_the_store() {
    let folder = tempfile::tempdir().unwrap();
    let config = Config { data: folder.path().join("data"), ..Config::default() };
    bake(&Store::open(&config).unwrap(), "finished", 1000, 40 * 86_400);
    fs::remove_file(folder.path().join("data/clock")).unwrap();
    // As if it was used 40 days ago by the machine's clock, and the server did not run since.
    let store = Store::open(&config).unwrap();
    store.trim(&Keeper(&store, &[], ""), &none).unwrap();
    assert_eq!(names(&store), [id("finished")]);
    // 40 days of a server, by its own time.
    drop(store);
    let later = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_secs();
    fs::write(folder.path().join("data/clock"), format!("{later}\n")).unwrap();
    let store = Store::open(&config).unwrap();
    store.trim(&Keeper(&store, &[], ""), &none).unwrap();
    assert!(names(&store).is_empty());
}

/// While another folder is in its place, nothing is found damaged, and nothing is removed.
#[cfg(unix)]
#[test]
fn a_directory_that_is_away_is_no_damage() {
    let folder = tempfile::tempdir().unwrap();
    let config = Config { data: folder.path().join("data"), ..Config::default() };
    let store = Store::open(&config).unwrap();
    bake(&store, "finished", 1000, 0);
    let status = store.load().unwrap().remove(0);
    let away = folder.path().join("away");
    assert!(store.damage(&status, 1000).unwrap().is_some(), "it has no events");
    fs::rename(folder.path().join("data"), &away).unwrap();
    for is_empty_there in [false, true] {
        if is_empty_there {
            fs::create_dir_all(folder.path().join("data/bakes")).unwrap();
            fs::write(folder.path().join("data/lock"), "").unwrap();
        }
        assert_eq!(store.fault().as_deref(), Some(AWAY));
        assert_eq!(store.damage(&status, 1000).unwrap_err().kind(), ErrorKind::NotConnected);
        assert_eq!(store.remove(&status.bake_id).unwrap_err().kind(), ErrorKind::NotConnected);
        assert!(store.trim(&Keeper(&store, &[], ""), &none).is_err());
        assert!(store.prepare(&id("new"), &BakeSpec::default(), "").is_err());
    }
    assert!(!folder.path().join("data/bakes").join(id("new")).exists(), "no folder appears in its place");
    fs::remove_dir_all(folder.path().join("data")).unwrap();
    fs::rename(&away, folder.path().join("data")).unwrap();
    assert!(store.is_here() && store.fault().is_none());
}

/// Of many layouts, the one goes that was not used for longest.
#[test]
fn layouts_are_bounded_and_nobody_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let config = Config { data: folder.path().join("data"), ..Config::default() };
    let store = Store::open(&config).unwrap();
    bake(&store, "shots", 1000, 0);
    let bake = store.folder(&id("shots"));
    let layout = |number: usize| format!("{number:016x}");
    for number in 0..33 {
        store.keep_layout(&id("shots"), &layout(number), b"x").unwrap();
        fs::write(bake.join(format!("result-layout-{}.usdc", layout(number))), b"x").unwrap();
        // A colleague's first one is in use all the time.
        store.keep_layout(&id("shots"), &layout(0), b"x").unwrap();
    }
    let has = |number| bake.join(format!("result-layout-{}.usdc", layout(number))).exists();
    assert!(has(0) && !has(1) && has(2) && has(32));
    let all = fs::read_dir(&bake).unwrap().flatten();
    let kept = all.filter(|entry| entry.file_name().to_string_lossy().starts_with("usd-layout-")).count();
    assert_eq!(kept, 32);
}

#[test]
fn a_bake_keeps_its_assets() {
    let folder = tempfile::tempdir().unwrap();
    let config = Config { data: folder.path().join("data"), store_mib: 0, ..Config::default() };
    let store = Store::open(&config).unwrap();
    let mut upload = store.upload().unwrap();
    upload.write(b"a prop").unwrap();
    let sha256 = hex(&Sha256::digest(b"a prop"));
    let anna = Account::new("", "anna");
    assert!(store.keep(upload, &sha256, &anna).unwrap() && store.has(&sha256, ""));
    assert!(!store.has(&sha256, "another project"));
    let asset = cairn_wire::proto::AssetReference { uri: "prop.glb".into(), sha256: sha256.clone() };
    let bake = store.prepare("bake", &BakeSpec { assets: vec![asset], ..Default::default() }, "").unwrap();
    store.trim(&Keeper(&store, &[], "bake"), &none).unwrap();
    assert!(!store.has(&sha256, ""));
    assert_eq!(fs::read(bake.join(ASSETS).join(sha256)).unwrap(), b"a prop");
    assert!(Store::open(&config).is_err(), "one server at a time");
}
