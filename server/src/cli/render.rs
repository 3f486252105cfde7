//! `cairn render`: a still of a baked pile.

use crate::export::{check_folder, write_atomically};
use crate::render::{Model, Moment, RenderError, Settings, render};
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// Renders a still of a pile, or of any glTF file.
///
/// The camera is fitted to the pile. Light and ground are those of a photo studio. The picture needs no graphics card
/// and is the same on every machine.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// The pile: .glb or .gltf.
    #[arg(value_name = "PILE")]
    pub pile: PathBuf,
    /// The picture to write: .png or .jpg.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Which frame, from 0. Default: the end of the animation.
    #[arg(long, value_name = "N", conflicts_with = "time")]
    pub frame: Option<u64>,
    /// Which moment, in seconds.
    #[arg(long, value_name = "SECONDS")]
    pub time: Option<f64>,
    /// Width and height of the picture.
    #[arg(long, value_name = "WxH", default_value = "1200x900", value_parser = size)]
    pub size: [u32; 2],
    /// Where the camera stands around the pile: degrees from +Z towards +X.
    #[arg(long, value_name = "DEGREES", default_value_t = Settings::default().azimuth, allow_negative_numbers = true)]
    pub azimuth: f64,
    /// How far the camera stands above the ground: degrees, -89 to 89.
    #[arg(long, value_name = "DEGREES", default_value_t = Settings::default().elevation, allow_negative_numbers = true)]
    pub elevation: f64,
    /// Rays per pixel: more take longer and leave less grain.
    #[arg(long, value_name = "N", default_value_t = Settings::default().samples, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub samples: u32,
    /// A mesh to show around the pile as translucent white, such as its control mesh.
    #[arg(long, value_name = "MESH")]
    pub control: Option<PathBuf>,
}

const EXAMPLES: &str = "\
Examples:
  cairn render pile.glb -o pile.png
  cairn render pile.glb -o start.png --frame 0 --control dome.glb
  cairn render pile.glb -o poster.jpg --size 3840x2160 --samples 128 --azimuth 60 --elevation 8";

/// Renders, and writes the picture as a whole or not at all.
pub fn run(args: &Args) -> Result<(), RenderError> {
    let format = picture_format(&args.output)?;
    let moment = match (args.frame, args.time) {
        (Some(frame), _) => Moment::Frame(frame),
        (None, Some(seconds)) => Moment::Seconds(seconds),
        (None, None) => Moment::End,
    };
    let (size, azimuth, elevation, samples) = (args.size, args.azimuth, args.elevation, args.samples);
    let settings = Settings { moment, size, azimuth, elevation, samples };

    let pile = Input::read(&args.pile)?;
    let control = args.control.as_deref().map(Input::read).transpose()?;
    let (pile_files, control_files) = (beside(&args.pile), args.control.as_deref().map(beside));
    let control = control.as_ref().zip(control_files.as_ref()).map(|(input, files)| input.model(files));
    let picture = render(&pile.model(&pile_files), control.as_ref(), &settings)?;

    let write = |error| RenderError::Write { path: args.output.clone(), error };
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, format).map_err(|error| write(std::io::Error::other(error)))?;
    write_atomically(&args.output, bytes.get_ref()).map_err(write)
}

/// A file's name and content.
struct Input {
    name: String,
    bytes: Vec<u8>,
}

impl Input {
    fn read(path: &Path) -> Result<Input, RenderError> {
        let bytes = std::fs::read(path).map_err(|error| RenderError::Read { path: path.into(), error })?;
        Ok(Input { name: path.display().to_string(), bytes })
    }

    fn model<'a>(&'a self, resolve: &'a dyn Fn(&str) -> Result<Vec<u8>, String>) -> Model<'a> {
        Model { name: &self.name, bytes: &self.bytes, resolve }
    }
}

/// Reads files below the folder of `path`.
fn beside(path: &Path) -> impl Fn(&str) -> Result<Vec<u8>, String> + use<> {
    let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
    move |name| std::fs::read(folder.join(name)).map_err(|error| format!("{name}: {error}"))
}

fn picture_format(path: &Path) -> Result<image::ImageFormat, RenderError> {
    let format = image::ImageFormat::from_path(path).ok();
    let format = format.filter(|f| [image::ImageFormat::Png, image::ImageFormat::Jpeg].contains(f));
    let format = format.ok_or_else(|| RenderError::UnknownFormat(path.into()))?;
    check_folder(path).map_err(|problem| RenderError::Output(path.into(), problem))?;
    Ok(format)
}

/// `1200x900`.
fn size(text: &str) -> Result<[u32; 2], String> {
    let side = |text: &str| text.parse::<u32>().ok().filter(|side| (1..=16384).contains(side));
    let sides = text.split_once(['x', 'X', '×']).and_then(|(w, h)| Some([side(w)?, side(h)?]));
    sides.ok_or_else(|| "give width and height in pixels, 1 to 16384 each, such as 1200x900".into())
}
