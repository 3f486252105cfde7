//! The progress of a run of layouts.

use crate::cli::progress::{Display, Mode, openjd};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;
use std::time::{Duration, Instant};

pub struct ClutterProgress {
    display: Display<ProgressBar>,
    first: u64,
    count: u64,
    done: u64,
    failed: u64,
    shown: Option<Instant>,
}

impl ClutterProgress {
    pub fn new(mode: Mode, first: u64, last: u64) -> ClutterProgress {
        let count = last + 1 - first;
        let bar = || {
            let style = ProgressStyle::with_template("{bar:24} {percent:>3} %  {msg}  {elapsed}, {eta} left");
            ProgressBar::with_draw_target(Some(count), ProgressDrawTarget::stderr())
                .with_style(style.expect("the template is valid"))
        };
        let display = mode.display(bar);
        ClutterProgress { display, first, count, done: 0, failed: 0, shown: None }
    }

    /// A layout is made.
    pub fn end(&mut self, number: u64, line: &str) {
        self.done = number + 1 - self.first;
        self.failed += u64::from(!line.ends_with("\"failed\":null}"));
        let pause = match &self.display {
            Display::Bar(_) | Display::Json => Duration::from_millis(100),
            Display::Plain | Display::Openjd => Duration::from_secs(1),
            Display::Nothing => return,
        };
        if self.shown.is_none_or(|shown| shown.elapsed() >= pause) || self.done == self.count {
            self.show();
        }
    }

    fn show(&mut self) {
        self.shown = Some(Instant::now());
        let ClutterProgress { first, count, done, failed, .. } = *self;
        let fraction = done as f64 / count.max(1) as f64;
        let text = match failed {
            0 => format!("{done}/{count} layouts"),
            _ => format!("{done}/{count} layouts, {failed} failed"),
        };
        match &self.display {
            Display::Bar(bar) => {
                bar.set_position(done);
                bar.set_message(text);
            }
            Display::Plain => eprintln!("{text}"),
            Display::Json => {
                let counts = json!({
                    "fraction": fraction,
                    "done": done,
                    "failed": failed,
                    "of": count,
                    "next": first + done,
                });
                eprintln!("{counts}");
            }
            Display::Openjd => {
                openjd("progress", &format!("{:.1}", fraction * 100.0));
                openjd("status", &text);
            }
            Display::Nothing => {}
        }
    }

    pub fn finish(&self) {
        if let Display::Bar(bar) = &self.display {
            bar.finish_and_clear();
        }
    }
}
