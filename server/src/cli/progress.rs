//! Progress of a bake on stderr, its cancellation and its clock.

use super::interrupt;
use cairn_input::observer::{Observer, Progress};
use cairn_job::machine;
use cairn_job::pace::{StagePace, name, overall};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;
use std::io::{IsTerminal, Write};
use std::ops::ControlFlow;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

/// The form of progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Mode {
    /// A bar on a terminal, otherwise plain lines
    Auto,
    /// A line every second
    Plain,
    /// One JSON object per line, up to ten per second
    Json,
    /// Open Job Description, a line every second on stdout: openjd_progress, openjd_status, openjd_fail
    Openjd,
    /// Nothing
    None,
}

#[derive(clap::Args)]
pub struct ProgressArgs {
    /// Form of the progress on stderr, unless stated otherwise
    #[arg(long = "progress", value_name = "PROGRESS", value_enum, default_value_t = Mode::Auto)]
    pub mode: Mode,

    /// Print only errors
    #[arg(short, long)]
    pub quiet: bool,
}

impl ProgressArgs {
    pub fn shown(&self) -> Mode {
        if self.quiet { Mode::None } else { self.mode }
    }
}

/// The form of progress: [`Mode`] without `Auto`. `B`: the bar.
pub enum Display<B> {
    Bar(B),
    Plain,
    Json,
    Openjd,
    Nothing,
}

impl Mode {
    pub fn display<B>(self, bar: impl FnOnce() -> B) -> Display<B> {
        match self {
            Mode::Auto if std::io::stderr().is_terminal() => Display::Bar(bar()),
            Mode::Auto | Mode::Plain => Display::Plain,
            Mode::Json => Display::Json,
            Mode::Openjd => Display::Openjd,
            Mode::None => Display::Nothing,
        }
    }
}

/// Observes a bake for the command line.
pub struct Reporter {
    /// Its bar is that of the running stage; `None` before the first.
    display: Display<Option<ProgressBar>>,
    pace: StagePace,
    shown: Option<Instant>,
}

impl Reporter {
    pub fn new(mode: Mode) -> Reporter {
        Reporter { display: mode.display(|| None), pace: StagePace::default(), shown: None }
    }

    fn show(&mut self, progress: &Progress) {
        let began = self.pace.follow(progress);
        let pause = self.shown.map_or(Duration::MAX, |shown| shown.elapsed());
        match &mut self.display {
            Display::Bar(bar) => {
                if began {
                    // The bar of the previous stage stays on the screen, filled.
                    bar.iter().for_each(fill);
                    *bar = Some(new_bar(name(progress.stage)));
                }
                if let Some(bar) = bar {
                    bar.set_message(counts(progress));
                    bar.set_position((progress.fraction * BAR_LENGTH as f64) as u64);
                }
            }
            Display::Plain if pause >= Duration::from_secs(1) => {
                eprintln!("{}", line(progress, &mut self.pace));
                self.shown = Some(Instant::now());
            }
            Display::Openjd if began || pause >= Duration::from_secs(1) => {
                let percent = overall(progress) * 100.0;
                openjd("progress", &format!("{percent:.1}"));
                openjd("status", &line(progress, &mut self.pace));
                self.shown = Some(Instant::now());
            }
            Display::Json if began || pause >= Duration::from_millis(100) => {
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
                self.shown = Some(Instant::now());
            }
            Display::Plain | Display::Json | Display::Openjd | Display::Nothing => {}
        }
    }

    /// Fills the bar, or removes it from the screen.
    pub fn finish(&mut self, done: bool) {
        if done && matches!(self.display, Display::Openjd) {
            openjd("progress", "100");
        }
        if let Display::Bar(Some(bar)) = &self.display {
            if done { fill(bar) } else { bar.finish_and_clear() }
        }
    }
}

impl Observer for Reporter {
    fn progress(&mut self, progress: &Progress) -> ControlFlow<()> {
        if interrupt::is_requested() {
            return ControlFlow::Break(());
        }
        self.show(progress);
        ControlFlow::Continue(())
    }

    fn cpu_seconds(&mut self) -> f64 {
        machine::cpu_seconds()
    }
}

/// Reads, and shows the time if it takes long.
pub fn while_reading<T>(mode: Mode, read: impl FnOnce() -> T) -> T {
    let display = mode.display(|| ());
    // Most scenes are read faster than this. A log can wait longer than a person.
    let pause = Duration::from_secs(if matches!(display, Display::Bar(_)) { 1 } else { 5 });
    let (done, is_done) = mpsc::channel::<()>();
    thread::scope(|scope| {
        scope.spawn(move || {
            let (began, bar) = (Instant::now(), ProgressBar::new_spinner().with_message("reading"));
            while is_done.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                let seconds = began.elapsed().as_secs();
                match &display {
                    Display::Bar(_) => bar.set_message(format!("reading the scene and its files, {seconds} s")),
                    Display::Plain => eprintln!("read: {seconds} s"),
                    Display::Json => eprintln!("{}", json!({ "stage": "read", "seconds": seconds })),
                    Display::Openjd => openjd("status", &format!("reading the scene and its files, {seconds} s")),
                    Display::Nothing => {}
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

/// Leaves the bar on the screen, filled.
fn fill(bar: &ProgressBar) {
    bar.set_style(style("{elapsed}"));
    bar.set_position(BAR_LENGTH);
    bar.abandon();
}

fn style(time: &str) -> ProgressStyle {
    ProgressStyle::with_template(&format!("{{prefix:>8}} {{bar:24}} {{percent:>3}} %  {{msg}}  {time}"))
        .expect("the template is valid")
}

/// The stage and its progress.
fn line(progress: &Progress, pace: &mut StagePace) -> String {
    let percent = progress.fraction * 100.0;
    let left = pace.remaining_seconds(progress).map(|left| format!("{left:.0} s left"));
    let parts = [Some(format!("{percent:.0} %")), Some(counts(progress)).filter(|text| !text.is_empty()), left];
    format!("{}: {}", name(progress.stage), parts.into_iter().flatten().collect::<Vec<_>>().join(", "))
}

/// Prints a line of Open Job Description for a farm's worker. Errors are ignored, as a closed pipe has no reader.
pub fn openjd(kind: &str, text: &str) {
    let mut stdout = std::io::stdout().lock();
    let _ = writeln!(stdout, "openjd_{kind}: {}", text.lines().collect::<Vec<_>>().join("; "));
    let _ = stdout.flush();
}

/// The counts so far, without zeros.
fn counts(progress: &Progress) -> String {
    let Progress { bodies, released, at_rest, nails, .. } = *progress;
    [(bodies, "bodies"), (released, "released"), (at_rest, "at rest"), (nails, "nails")]
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// Counts finished bakes on a terminal's stderr.
pub struct RunCounter {
    bar: ProgressBar,
    begun: u64,
}

impl RunCounter {
    pub fn new(bakes: usize) -> RunCounter {
        let style = ProgressStyle::with_template("{bar:24} {pos}/{len}  {msg}  {elapsed}, {eta} left");
        let bar = ProgressBar::with_draw_target(Some(bakes as u64), ProgressDrawTarget::stderr())
            .with_style(style.expect("the template is valid"));
        RunCounter { bar, begun: 0 }
    }

    /// Shows that the previous bake has ended and this one begins.
    pub fn begin(&mut self, name: &str) {
        self.bar.set_position(self.begun);
        self.bar.set_message(name.to_owned());
        self.begun += 1;
    }

    /// Updates the time.
    pub fn tick(&self) {
        self.bar.tick();
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
