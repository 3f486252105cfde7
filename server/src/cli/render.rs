//! `cairn render`: renders a still of a baked pile.

use super::allowed::{AllowArgs, check_refused};
use super::{Failure, interrupt, output, print_warning};
use cairn_export::arrays::Arrays;
use cairn_files::FileSource;
use cairn_files::problem::Problem;
use cairn_job::InputFile;
use cairn_job::removals::Removals;
use cairn_render::{Moment, RenderError, RenderModel, Settings, missing_pictures, render, views};
use image::{ImageFormat, RgbImage};
use std::borrow::Cow;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Renders a picture of a pile
///
/// The camera is fitted to the pile; light and ground are like in a photo studio. Works with any animated glTF file,
/// not only piles. Of a USD file, one layer is shown, with base colors and their pictures; glue is not.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn render pile.glb -o pile.png
  cairn render pile.glb -o start.png --frame 0 --control dome.glb
  cairn render pile.glb -o glue.png --glue
  cairn render pile.glb -o film-0100.png --frame 100 --fit 240 --wide 2
  cairn render pile.glb -o poster.png --size 3840x2160 --samples 128 --azimuth 60
  cairn render pile.glb -o view.npz --size 320x240      (which body each pixel shows, and how far it is)
  cairn render apart.glb -o apart.npz --removals apart.report.json

Needs no graphics card. The picture does not depend on the number of threads.")]
pub struct Args {
    /// The pile: .glb, .gltf, .usdc, .usda or .usdz
    #[arg(value_name = "PILE")]
    pile: PathBuf,

    /// Picture to write: .png or .jpg; or arrays for NumPy: .npz
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,

    /// Frame of the animation, from 0 [default: the last one]
    #[arg(long, value_name = "N", conflicts_with = "time")]
    frame: Option<u64>,

    /// Time in the animation, seconds
    #[arg(long, value_name = "SECONDS", value_parser = number)]
    time: Option<f64>,

    /// Fit the camera to this frame [default: the one that is shown]: so it stands still from picture to picture of a
    /// film
    #[arg(long, value_name = "N")]
    fit: Option<u64>,

    /// Show so many times as much around the pile, 0.01 to 100
    #[arg(long, value_name = "FACTOR", default_value_t = Settings::default().wide, value_parser = wide)]
    wide: f64,

    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1200x900", value_parser = size)]
    size: [u32; 2],

    /// Direction of the camera around the pile, degrees from +Z toward +X
    #[arg(long, value_name = "DEGREES", default_value_t = Settings::default().azimuth, value_parser = number,
        allow_negative_numbers = true)]
    azimuth: f64,

    /// Height of the camera, degrees above the horizon, -89 to 89
    #[arg(long, value_name = "DEGREES", default_value_t = Settings::default().elevation, value_parser = elevation,
        allow_negative_numbers = true)]
    elevation: f64,

    /// Rays per pixel, 1 to 65536: more rays take longer and give less grain
    #[arg(long, value_name = "N", default_value_t = Settings::default().samples,
        value_parser = clap::value_parser!(u32).range(1..=65536))]
    samples: u32,

    /// Also show this mesh, such as the control mesh, as frosted glass
    #[arg(long, value_name = "MESH")]
    control: Option<PathBuf>,

    /// Also show the dots of glue, through the bodies: redder ones carry more, black ones broke. Bodies glued to the
    /// ground are blue, bodies without glue pale
    #[arg(long)]
    glue: bool,

    /// Report of a pile that was taken apart: the arrays show it before each removal and after the last, beside what
    /// the report says of each
    #[arg(long, value_name = "REPORT", conflicts_with_all = ["frame", "time"])]
    removals: Option<PathBuf>,

    #[command(flatten)]
    allow: AllowArgs,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    let format = output_format(args)?;
    let inputs: Vec<PathBuf> = [&args.pile].into_iter().chain(&args.control).chain(&args.removals).cloned().collect();
    output::check(&args.output, &inputs)?;

    let settings = Settings {
        moment: match (args.frame, args.time) {
            (Some(frame), _) => Moment::Frame(frame),
            (None, Some(seconds)) => Moment::Seconds(seconds),
            (None, None) => Moment::End,
        },
        size: args.size,
        azimuth: args.azimuth,
        elevation: args.elevation,
        samples: args.samples,
        fit: args.fit.map(Moment::Frame),
        wide: args.wide,
        glue: args.glue,
    };
    let models: Vec<&PathBuf> = [&args.pile].into_iter().chain(&args.control).collect();
    let disk: Arc<dyn FileSource> = args.allow.disk(&models, false)?;
    let read = |path: &PathBuf| InputFile::read(path, &disk).map_err(Failure::input);
    let read = |path: &PathBuf| read(path).and_then(as_gltf);
    let pile = read(&args.pile)?;
    let Some(format) = format else { return write_arrays(args, &model(&pile), &settings) };
    let control = args.control.as_ref().map(read).transpose()?;
    let picture = render(&model(&pile), control.as_ref().map(model).as_ref(), &settings)?;
    check_refused(disk.refused())?;
    missing_pictures(&model(&pile)).iter().for_each(|sentence| print_warning(sentence));
    write(&args.output, &picture, format)
}

/// Writes the picture, complete or not at all.
fn write(path: &Path, picture: &RgbImage, format: ImageFormat) -> Result<(), Failure> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, format).map_err(|error| Failure::Internal(error.to_string()))?;
    write_bytes(path, bytes.get_ref())
}

fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let _guard = output::begin()?;
    cairn_files::write_atomically(path, bytes).map_err(|error| Failure::write(path, &error))
}

/// Writes what the camera sees as arrays, of one moment or of each state of a pile that is taken apart.
fn write_arrays(args: &Args, pile: &RenderModel, settings: &Settings) -> Result<(), Failure> {
    let removals = args.removals.as_ref().map(|path| Removals::read(path).map_err(Failure::input)).transpose()?;
    let moments = removals.as_ref().map_or(vec![settings.moment], Removals::moments);
    let seen = views(pile, &moments, settings)?;
    let mut arrays = Arrays::default();
    let [width, height] = seen.size.map(|side| side as usize);
    let shape = [moments.len(), height, width];
    // One moment has no axis of its own.
    let shape = if removals.is_some() { &shape[..] } else { &shape[1..] };
    arrays.add("bodies", shape, &seen.bodies);
    arrays.add("depth", shape, &seen.depths);
    arrays.add("camera", &[4, 4], &seen.camera);
    arrays.add("intrinsics", &[3, 3], &seen.intrinsics);
    if let Some(removals) = &removals {
        removals.add_to(&mut arrays);
    }
    let bytes = arrays.finish().map_err(|error| Failure::Internal(error.to_string()))?;
    write_bytes(&args.output, &bytes)
}

/// The file as the renderer reads it.
fn as_gltf(mut file: InputFile) -> Result<InputFile, Failure> {
    let read = cairn_export::as_gltf(&file.bytes, &*file.resolve).map(Cow::into_owned);
    file.bytes = read.map_err(|what| Failure::input(Problem::new(&file.name, what, "Choose another file.")))?;
    Ok(file)
}

fn model(file: &InputFile) -> RenderModel<'_> {
    RenderModel { name: &file.name, bytes: &file.bytes, resolve: &*file.resolve }
}

impl From<RenderError> for Failure {
    fn from(error: RenderError) -> Failure {
        let problem = vec![error.to_string().into()];
        match error {
            RenderError::File { .. } => Failure::Input(problem),
            RenderError::Settings(_) => Failure::Usage(problem),
        }
    }
}

/// `None`: arrays.
fn output_format(args: &Args) -> Result<Option<ImageFormat>, Failure> {
    let path = &args.output;
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npz")) {
        return match args.control.is_some() || args.glue {
            true => Err(Failure::Usage(vec![Problem::at(
                path,
                "arrays show bodies alone",
                "Leave out --control and --glue, or write a picture.",
            )])),
            false => Ok(None),
        };
    }
    if args.removals.is_some() {
        let (what, remedy) = ("a picture shows one state", "Name a file .npz, or leave out --removals.");
        return Err(Failure::Usage(vec![Problem::at(path, what, remedy)]));
    }
    let format = ImageFormat::from_path(path).ok();
    let format = format.filter(|format| [ImageFormat::Png, ImageFormat::Jpeg].contains(format)).ok_or_else(|| {
        Failure::Usage(vec![Problem::at(path, "not the name of a picture", "Use the extension .png, .jpg or .npz.")])
    });
    format.map(Some)
}

/// `1200x900`.
fn size(text: &str) -> Result<[u32; 2], String> {
    let side = |text: &str| text.parse::<u32>().ok().filter(|side| (1..=16384).contains(side));
    let sides = text.split_once(['x', 'X']).and_then(|(width, height)| Some([side(width)?, side(height)?]));
    sides.ok_or_else(|| "give width and height, 1 to 16384 each, such as 1200x900".into())
}

fn number(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|number: &f64| number.is_finite()).ok_or_else(|| "give a number".into())
}

fn wide(text: &str) -> Result<f64, String> {
    number(text).ok().filter(|factor| (0.01..=100.0).contains(factor)).ok_or_else(|| "give 0.01 to 100".into())
}

fn elevation(text: &str) -> Result<f64, String> {
    number(text).ok().filter(|degrees| degrees.abs() <= 89.0).ok_or_else(|| "give -89 to 89 degrees".into())
}
