//! Remedies for the owner of a refused file: one sentence for each kind of problem.

use crate::problem::ProblemKind;

const EXPORT_AGAIN: &str = "Export the file again from the program that made it.";

/// The remedy for a kind of problem.
pub(crate) fn of(what: &ProblemKind) -> String {
    use ProblemKind::*;
    let text = match what {
        EmptyFile => "Export it again, and check that the export or download finished.",
        NotGltf { .. } => {
            "Export it as glTF 2.0 (.glb or .gltf); Blender and most modelling programs import this and \
                           export that."
        }
        Json { .. } => "Export the file again; if it was edited by hand, correct the place named.",
        Glb { .. } => "The file is cut off or damaged: copy, download or export it again.",
        Version { version } if version.starts_with('1') => {
            "Convert it to glTF 2.0, for instance with gltf-pipeline (`gltf-pipeline -i old.gltf -o new.gltf`)."
        }
        Version { .. } => "Export it as glTF 2.0.",
        Extension { name } | Compressed { extension: name, .. } => return extension(name),
        Limit { what, .. } => return format!("Use a simpler file, or raise the limit on {what}."),
        NoTriangles { .. } => {
            "Choose a file or node with a triangle mesh; in Blender, convert curves, text and empties \
                               with Object > Convert > Mesh before the export."
        }
        Missing | Type { .. } | Reference { .. } => EXPORT_AGAIN,
        Cycle { .. } | TwoParents { .. } => "Give each node one parent at most, and export again.",
        Transform { .. } => "Reset or apply the transform of that node, and export again.",
        UnknownNode { .. } => "Use the name of a node as it is in the file; capitals matter.",
        AmbiguousNode { .. } => "Give each of them a name of its own, or save the wanted one in a file of its own.",
        Uri { .. } => {
            "Put the buffer into the file's own folder and write its plain name as the URI, or export as one .glb file."
        }
        DataUri { .. } | NoData => "Export the file again, best as one .glb file.",
        External { .. } => "Put the .bin file that was exported with it beside it, or export as one .glb file.",
        ShortBuffer { .. } | OutOfBytes { .. } => {
            "The file and its .bin do not belong together or one is cut off: export or copy both again."
        }
        Format { .. } | Stride { .. } | Sparse { .. } | Index { .. } => EXPORT_AGAIN,
        NotFinite { .. } => {
            "Repair the mesh (in Blender: Mesh > Clean Up, or remove the modifier that makes the vertex), \
                             and export again."
        }
        TooFar { .. } => "Check the unit and the scale of the model: lengths are metres.",
        More { .. } => "Fix those above first.",
        Internal { .. } => "Please report this with the file.",
    };
    text.to_owned()
}

/// The export setting that avoids an extension.
fn extension(name: &str) -> String {
    match name {
        "KHR_draco_mesh_compression" => {
            "Export without mesh compression (in Blender: glTF export > Data > Compression off), or unpack it with \
             `gltf-transform copy in.glb out.glb`."
                .to_owned()
        }
        "EXT_meshopt_compression" | "KHR_meshopt_compression" => {
            "Export without meshopt compression (gltfpack: leave out -c and -cc), or unpack it with \
             `gltf-transform copy in.glb out.glb`."
                .to_owned()
        }
        "EXT_mesh_gpu_instancing" => {
            "Export without GPU instancing (in Blender: glTF export > Scene > GPU Instances off), so that each \
             instance is a node."
                .to_owned()
        }
        _ => format!("Export the file again without {name}."),
    }
}
