//! How far a bake is, told on stderr; and its cancel and clock.

use super::interrupt;
use crate::job::machine;
use crate::job::pace::{Pace, name, overall};
use cairn_core::input::observer::{Observer, Progress};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;
use std::io::{IsTerminal, Write};
use std::ops::ControlFlow;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

/// How progress is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Mode {
    /// A bar on a terminal, else plain lines
    Auto,
    /// A line every second
    Plain,
    /// One JSON object per line, up to ten in a second
    Json,
    /// As Open Job Description has it, a line every second on stdout: openjd_progress, openjd_status, openjd_fail
    Openjd,
    /// Nothing
    None,
}

/// Watches a bake for the command line.
pub struct Reporter {
    show: Show,
    pace: Pace,
    told: Option<Instant>,
}

enum Show {
    /// The running stage's; none before the first.
    Bar(Option<ProgressBar>),
    Plain,
    Json,
    Openjd,
    Nothing,
}

impl Reporter {
    pub fn new(mode: Mode) -> Reporter {
        let show = match mode {
            Mode::Auto if std::io::stderr().is_terminal() => Show::Bar(None),
            Mode::Auto | Mode::Plain => Show::Plain,
            Mode::Json => Show::Json,
            Mode::Openjd => Show::Openjd,
            Mode::None => Show::Nothing,
        };
        Reporter { show, pace: Pace::default(), told: None }
    }

    fn tell(&mut self, progress: &Progress) {
        let began = self.pace.follow(progress);
        let pause = self.told.map_or(Duration::MAX, |told| told.elapsed());
        match &mut self.show {
            Show::Bar(bar) => {
                if began {
                    // The stage before stays on the screen as a full line.
                    bar.iter().for_each(fill);
                    *bar = Some(new_bar(name(progress.stage)));
                }
                if let Some(bar) = bar {
                    bar.set_message(counts(progress));
                    bar.set_position((progress.fraction * BAR_LENGTH as f64) as u64);
                }
            }
            Show::Plain if pause >= Duration::from_secs(1) => {
                eprintln!("{}", line(progress, &mut self.pace));
                self.told = Some(Instant::now());
            }
            Show::Openjd if began || pause >= Duration::from_secs(1) => {
                let percent = overall(progress) * 100.0;
                openjd("progress", &format!("{percent:.1}"));
                openjd("status", &line(progress, &mut self.pace));
                self.told = Some(Instant::now());
            }
            Show::Json if began || pause >= Duration::from_millis(100) => {
                let line = json!({
                    "stage": progress.stage,
                    "fraction": progress.fraction,
                    "bodies": progress.bodies,
                    "released": progress.released,
                    "at_rest": progress.at_rest,
                    "nails": progress.nails,
                    "seconds_left": self.pace.remaining_seconds(progress),
                });
                eprintln!("{line}");
                self.told = Some(Instant::now());
            }
            Show::Plain | Show::Json | Show::Openjd | Show::Nothing => {}
        }
    }

    /// Takes the bar off the screen, or fills it.
    pub fn finish(&mut self, done: bool) {
        if done && matches!(self.show, Show::Openjd) {
            openjd("progress", "100");
        }
        if let Show::Bar(Some(bar)) = &self.show {
            if done { fill(bar) } else { bar.finish_and_clear() }
        }
    }
}

impl Observer for Reporter {
    fn progress(&mut self, progress: &Progress) -> ControlFlow<()> {
        if interrupt::asked() {
            return ControlFlow::Break(());
        }
        self.tell(progress);
        ControlFlow::Continue(())
    }

    fn cpu_seconds(&mut self) -> f64 {
        machine::cpu_seconds()
    }
}

/// Reads, and tells so where it takes long.
pub fn while_reading<T>(mode: Mode, read: impl FnOnce() -> T) -> T {
    let show = Reporter::new(mode).show;
    // Most scenes are read before anybody wonders; a log wonders later.
    let pause = Duration::from_secs(if matches!(show, Show::Bar(_)) { 1 } else { 5 });
    let (done, is_done) = mpsc::channel::<()>();
    thread::scope(|scope| {
        scope.spawn(move || {
            let (began, bar) = (Instant::now(), ProgressBar::new_spinner().with_message("reading"));
            while is_done.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                let seconds = began.elapsed().as_secs();
                match &show {
                    Show::Bar(_) => bar.set_message(format!("reading the scene and its files, {seconds} s")),
                    Show::Plain => eprintln!("read: {seconds} s"),
                    Show::Json => eprintln!("{}", json!({ "stage": "read", "seconds": seconds })),
                    Show::Openjd => openjd("status", &format!("reading the scene and its files, {seconds} s")),
                    Show::Nothing => {}
                }
            }
            bar.finish_and_clear();
        });
        let read = read();
        drop(done);
        read
    })
}

const BAR_LENGTH: u64 = 1000;

fn new_bar(stage: &'static str) -> ProgressBar {
    ProgressBar::with_draw_target(Some(BAR_LENGTH), ProgressDrawTarget::stderr())
        .with_style(style("{elapsed}, {eta} left"))
        .with_prefix(stage)
}

/// Leaves the bar on the screen as that of a finished stage.
fn fill(bar: &ProgressBar) {
    bar.set_style(style("{elapsed}"));
    bar.set_position(BAR_LENGTH);
    bar.abandon();
}

fn style(time: &str) -> ProgressStyle {
    ProgressStyle::with_template(&format!("{{prefix:>8}} {{bar:24}} {{percent:>3}} %  {{msg}}  {time}"))
        .expect("the template is valid")
}

/// The stage and how far it is.
fn line(progress: &Progress, pace: &mut Pace) -> String {
    let percent = progress.fraction * 100.0;
    let left = pace.remaining_seconds(progress).map(|left| format!("{left:.0} s left"));
    let parts = [Some(format!("{percent:.0} %")), Some(counts(progress)).filter(|text| !text.is_empty()), left];
    format!("{}: {}", name(progress.stage), parts.into_iter().flatten().collect::<Vec<_>>().join(", "))
}

/// A line for the worker of a farm that speaks Open Job Description. Who does not read it any more misses nothing.
pub fn openjd(kind: &str, text: &str) {
    let mut stdout = std::io::stdout().lock();
    let _ = writeln!(stdout, "openjd_{kind}: {}", text.lines().collect::<Vec<_>>().join("; "));
    let _ = stdout.flush();
}

/// What there is so far; a count of which there is nothing is left out.
fn counts(progress: &Progress) -> String {
    let Progress { bodies, released, at_rest, nails, .. } = *progress;
    [(bodies, "bodies"), (released, "released"), (at_rest, "at rest"), (nails, "nails")]
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// How many of several bakes are done, on a terminal's stderr.
pub struct Tally {
    bar: ProgressBar,
    begun: u64,
}

impl Tally {
    pub fn new(bakes: usize) -> Tally {
        let style = ProgressStyle::with_template("{bar:24} {pos}/{len}  {msg}  {elapsed}, {eta} left");
        let bar = ProgressBar::with_draw_target(Some(bakes as u64), ProgressDrawTarget::stderr())
            .with_style(style.expect("the template is valid"));
        Tally { bar, begun: 0 }
    }

    /// The bake before is done.
    pub fn begin(&mut self, name: &str) {
        self.bar.set_position(self.begun);
        self.bar.set_message(name.to_owned());
        self.begun += 1;
    }

    /// Keeps the time running.
    pub fn tick(&self) {
        self.bar.tick();
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
