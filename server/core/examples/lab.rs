use cairn_core::{container::Container, control::Control, fill, hold, observer::*, params::*, region::*, release, scene::*, shape::Shape, world::*};
use cairn_core::mesh::TriMesh;
use glam::DVec3;
use std::time::Instant;
fn prism(n: usize, r0: f64, r1: f64, h: f64) -> TriMesh {
    let mut m = TriMesh::default();
    for k in 0..n { let a = k as f64 / n as f64 * std::f64::consts::TAU; m.points.push(DVec3::new(r0*a.cos(), 0.0, r0*a.sin())); }
    for k in 0..n { let a = k as f64 / n as f64 * std::f64::consts::TAU; m.points.push(DVec3::new(r1*a.cos(), h, r1*a.sin())); }
    m.points.push(DVec3::ZERO); m.points.push(DVec3::new(0.0,h,0.0));
    let n = n as u32;
    for k in 0..n { let l=(k+1)%n; m.triangles.push([k, n+k, n+l]); m.triangles.push([k, n+l, l]); m.triangles.push([2*n, k, l]); m.triangles.push([2*n+1, n+l, n+k]); }
    m
}
fn boxm(h: DVec3) -> TriMesh {
    let mut m = TriMesh::default();
    for i in 0..8 { m.points.push(DVec3::new(if i&1==0 {-h.x} else {h.x}, if i&2==0 {-h.y} else {h.y}, if i&4==0 {-h.z} else {h.z})); }
    m.triangles = vec![[0,2,3],[0,3,1],[4,5,7],[4,7,6],[0,1,5],[0,5,4],[2,6,7],[2,7,3],[0,4,6],[0,6,2],[1,3,7],[1,7,5]];
    m
}
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let shape = args[1].as_str(); let seeds: u64 = args[2].parse().unwrap();
    let size: f64 = args.get(3).map_or(1.0, |s| s.parse().unwrap());
    let control = match shape { "cone" => prism(48, 1.45*size, 0.02, 2.8*1.45*size), "cyl" => prism(48, 1.2*size, 1.2*size, 3.0*size), _ => panic!() };
    assert!(control.signed_volume() > 0.0, "{}", control.signed_volume());
    let stick = boxm(DVec3::new(0.5, 0.05, 0.05));
    let name = |s: &str, mesh: TriMesh| Model { name: s.into(), mesh };
    let scene = Scene { control: name("control", control.clone()), props: vec![Prop { model: name("stick", stick.clone()), weight: 1.0, friction: 0.7, density: 500.0, restitution: 0.0, scale: [1.0, 1.0] }], statics: vec![] };
    for seed in 1..=seeds {
        let mut p = Params::new(Accuracy::Standard); p.seed = seed; p.output.frames = None;
        let mut variants: Vec<(String, Params)> = vec![];
        for v in args[4..].iter() {
            let mut q = p.clone();
            for kv in v.split(',') { let (k, x) = kv.split_once('=').unwrap_or((kv, "")); let f = || x.parse::<f64>().unwrap();
              match k { "off" => q.control.mode = ControlMode::Off, "nails" => q.control.mode = ControlMode::Nails, "hold" => {}, "damp" => q.release.damping = f(), "cdamp" => q.control.damping = f(), "layer" => q.release.layer = f(), "int" => q.release.interval = Time::Natural(f()), "speed" => q.control.speed = f(), "tol" => q.control.contact_tolerance = f(), "period" => q.control.period = f() as u32, "spread" => q.control.spread = Spread::Relative(f()), "mu" => q.control.kinetic_ratio = f(), "all" => q.control.selection = ContactSelection::All, "kappa" => q.control.kappa = f(), "freq" => q.physics.contact_frequency = f(), "ratio" => q.physics.contact_damping_ratio = f(), "sub" => q.physics.substeps = f() as u32, _ => panic!("{k}") } }
            variants.push((v.clone(), q));
        }
        let shapes = vec![Shape::new(&scene.props[0], true, &p.physics).unwrap()];
        let units = Units::new(shapes[0].diameter, shapes[0].mass, 9.81);
        let container = Container::new(&control, units.length, 0.0);
        let t = Instant::now();
        let filled = fill::run(&scene, &shapes, &p, units, &container, &mut Silent).unwrap();
        let vol = filled.bodies.len() as f64 * 0.01;
        let region = Region::new(&control);
        println!("{shape} seed {seed}: {} bodies {} frac {:.3} removed {:?} full {} steps {} {:.2}s expected {}", shapes[0].report.kind, filled.bodies.len(), vol / region.volume(), filled.removed, filled.full, filled.steps, t.elapsed().as_secs_f64(), fill::expected_bodies(&scene, &shapes, region.volume(), &p.fill));
        for (v, q) in &variants {
            let t = Instant::now();
            let c = Control::new(&q.control, 9.81, seed, &container.distance);
            let mut pile = release::turn_over(&scene, &shapes, q, units, &filled.bodies, 0.0, c).unwrap();
            release::run(&mut pile, q, &mut Silent).unwrap();
            let rs = pile.step;
            let h = hold::run(&mut pile, q, &mut Silent).unwrap();
            let first = &pile.recorder.frames[0]; let last = pile.recorder.frames.last().unwrap();
            let si = |f: &Vec<cairn_core::pose::Pose>| -> Vec<(usize, f64, cairn_core::pose::Pose)> { f.iter().map(|b| (0, 1.0, shapes[0].prop_pose(&units.pose_to_si(b), 1.0))).collect() };
            let hs = |f: &Vec<cairn_core::pose::Pose>| { let mut y: Vec<f64> = f.iter().map(|p| p.translation.y).collect(); y.sort_by(f64::total_cmp); y[(y.len() as f64*0.95) as usize] };
            let _ = si;
            let iou = cairn_core_iou(&control, &stick, &si(first), &si(last));
            let drift = { let mut d: Vec<f64> = first.iter().zip(last).map(|(a,b)| a.translation.distance(b.translation)).collect(); d.sort_by(f64::total_cmp); d[(d.len() as f64*0.95) as usize] };
            let depth = pile.world.touches(0.0).iter().map(|t| t.depth()).fold(0.0, f64::max) / pile.world.bodies()[0].thickness;
            let unsup = unsupported(&pile.world, q.control.contact_tolerance.min(0.05));
            println!("   {v:28} iou {:.3} -> {:.3} kept {:.3} h95 {:.3} move95 {:.2} rest {} v {:.4} rel {} steps {} held {} depth {:.3} unsup {:?} cand {:.2} brk {} act {:.2} {:.2}s", iou.0, iou.1, iou.1/iou.0, hs(last)/hs(first), drift, h.at_rest, h.resting_speed_max, rs, pile.step, pile.world.count(Role::Held), depth, unsup, pile.control.tally.candidates as f64 / pile.control.tally.analyses.max(1) as f64, pile.control.tally.holds_broken + pile.control.tally.nails_broken, pile.active_body_steps as f64/pile.step as f64/filled.bodies.len() as f64, t.elapsed().as_secs_f64());
        }
    }
}
fn unsupported(_w: &World, _tol: f64) -> f64 { -1.0 }
fn cairn_core_iou(control: &TriMesh, stick: &TriMesh, a: &[(usize, f64, cairn_core::pose::Pose)], b: &[(usize, f64, cairn_core::pose::Pose)]) -> (f64, f64) {
    let _ = (control, stick); 
    // crude: voxels 0.05, closing by 0.5 through dilation/erosion with brute EDT on grid
    let (lo, hi) = control.bounds(); let lo = lo - 1.2; let hi = hi + 1.2; let c = 0.07;
    let n = ((hi - lo) / c).ceil(); let (nx, ny, nz) = (n.x as usize, n.y as usize, n.z as usize);
    let region = Region::new(control);
    let grid = DistanceGrid::new(&region, 0.07, 4_000_000);
    let run = |bodies: &[(usize, f64, cairn_core::pose::Pose)]| {
        let mut v = vec![false; nx*ny*nz];
        for (_, _, p) in bodies { 
            let r = 0.52; let pl = ((p.translation - r - lo)/c).floor(); let ph = ((p.translation + r - lo)/c).ceil(); let inv = p.rotation.inverse();
            for x in pl.x.max(0.0) as usize..(ph.x.max(0.0) as usize).min(nx) { for y in pl.y.max(0.0) as usize..(ph.y.max(0.0) as usize).min(ny) { for z in pl.z.max(0.0) as usize..(ph.z.max(0.0) as usize).min(nz) {
                let q = inv * (lo + DVec3::new(x as f64+0.5, y as f64+0.5, z as f64+0.5)*c - p.translation);
                if q.x.abs() <= 0.5+c*0.3 && q.y.abs() <= 0.05+c*0.3 && q.z.abs() <= 0.05+c*0.3 { v[(x*ny+y)*nz+z] = true; } } } }
        }
        let edt = |v: &Vec<bool>, want: bool| -> Vec<f32> {
            let mut d: Vec<f32> = v.iter().map(|&b| if b == want {0.0} else {1e9}).collect();
            let mut pass = |n: usize, stride: usize, starts: Vec<usize>| { for s in starts { let f: Vec<f32> = (0..n).map(|i| d[s+i*stride]).collect(); for i in 0..n { let mut best = 1e9f32; let lo = i.saturating_sub(10); let hi = (i+11).min(n); for j in lo..hi { let e = (i as f32-j as f32).powi(2)+f[j]; if e<best {best=e;} } d[s+i*stride]=best; } } };
            pass(nz, 1, (0..nx*ny).map(|k| k*nz).collect());
            pass(ny, nz, (0..nx).flat_map(|x| (0..nz).map(move |z| x*ny*nz+z)).collect());
            pass(nx, ny*nz, (0..ny*nz).collect());
            d };
        let r = (0.5f64/c) as f32; 
        let dil: Vec<bool> = edt(&v, true).iter().map(|&d| d <= r*r).collect();
        let ero: Vec<bool> = edt(&dil, false).iter().map(|&d| d > r*r).collect();
        let (mut i, mut u) = (0, 0);
        for x in 0..nx { for y in 0..ny { for z in 0..nz { let p = lo + DVec3::new(x as f64+0.5, y as f64+0.5, z as f64+0.5)*c; if p.y < 0.0 {continue;} let a = ero[(x*ny+y)*nz+z]; let b = grid.signed_distance(p) <= 0.0; if a && b {i+=1;} if a||b {u+=1;} } } }
        i as f64/u as f64 };
    (run(a), run(b))
}
