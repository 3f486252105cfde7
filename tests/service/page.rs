//! `proto/README.md` and `examples/guide/scene.md` match the comments of the schema. `UPDATE_PAGE=1` writes them again.

use cairn_wire::scene_file::schema::{self, comment, plain};
use prost_reflect::{EnumDescriptor, FileDescriptor, Kind, MessageDescriptor, MethodDescriptor};
use std::fmt::Write;
use std::path::Path;

#[test]
fn the_pages_are_the_schema() {
    for (name, page) in [("proto/README.md", page()), ("examples/guide/scene.md", scene_page())] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(name);
        if std::env::var_os("UPDATE_PAGE").is_some() {
            std::fs::write(&path, &page).unwrap();
        }
        let written = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(written == page, "{name} is not that of the schema: UPDATE_PAGE=1 cargo test writes it");
    }
}

/// Every field, value and call has a comment.
#[test]
fn nothing_is_without_a_comment() {
    for name in ["service", "event"] {
        let file = schema::pool().get_file_by_name(&format!("cairn/v1/{name}.proto")).unwrap();
        let fields = file.messages().flat_map(|message| message.fields().collect::<Vec<_>>());
        let fields = fields.filter(|field| !field.parent_message().is_map_entry());
        let values = file.enums().flat_map(|of| of.values().collect::<Vec<_>>()).filter(|value| value.number() != 0);
        let methods = file.services().flat_map(|service| service.methods().collect::<Vec<_>>());
        let paths = (fields.map(|field| (field.full_name().to_owned(), field.path().to_owned())))
            .chain(values.map(|value| (value.full_name().to_owned(), value.path().to_owned())))
            .chain(methods.map(|method| (method.full_name().to_owned(), method.path().to_owned())));
        for (name, path) in paths {
            assert!(!comment(&file, &path).is_empty(), "{name} has no comment");
        }
    }
}

fn page() -> String {
    let pool = schema::pool();
    let files = ["service", "event"].map(|name| pool.get_file_by_name(&format!("cairn/v1/{name}.proto")).unwrap());
    let mut page = String::from("# The API of Cairn\n");
    let service = files[0].services().next().unwrap();
    write!(page, "\n{}\n\n## {}\n\n{}\n", head(&files[0]), service.full_name(), comment(&files[0], service.path()))
        .unwrap();
    for method in service.methods() {
        write!(page, "\n### {}\n\n{}\n\n{}\n", method.name(), signature(&method), comment(&files[0], method.path()))
            .unwrap();
    }
    for file in &files {
        write!(page, "\n## Messages of `{}`\n", file.name()).unwrap();
        file.messages().filter(|message| !message.is_map_entry()).for_each(|each| message(&mut page, &each));
        file.enums().for_each(|each| enumeration(&mut page, &each));
    }
    page.push_str(
        "\nThe scene is in [`scene.proto`](cairn/v1/scene.proto) and [`params.proto`](cairn/v1/params.proto).\n",
    );
    page
}

/// The reference of scene files.
fn scene_page() -> String {
    let files =
        ["scene", "params"].map(|name| schema::pool().get_file_by_name(&format!("cairn/v1/{name}.proto")).unwrap());
    let mut page = format!("# Scene files, field by field\n\n{}\n\n{}\n", head(&files[0]), head(&files[1]));
    for file in &files {
        file.messages().for_each(|each| message(&mut page, &each));
        file.enums().for_each(|each| enumeration(&mut page, &each));
    }
    page
}

fn signature(method: &MethodDescriptor) -> String {
    let stream = |is: bool| if is { "stream of " } else { "" };
    let (given, back) = (method.input(), method.output());
    format!(
        "{}[`{}`](#{}) → {}[`{}`](#{})",
        stream(method.is_client_streaming()),
        given.name(),
        given.name().to_lowercase(),
        stream(method.is_server_streaming()),
        back.name(),
        back.name().to_lowercase()
    )
}

fn message(page: &mut String, message: &MessageDescriptor) {
    let file = message.parent_file();
    write!(page, "\n### {}\n", message.name()).unwrap();
    paragraph(page, &comment(&file, message.path()));
    if message.fields().len() == 0 {
        return;
    }
    page.push_str("\n| field | type | |\n| --- | --- | --- |\n");
    for field in message.fields() {
        let kind = match field.kind() {
            Kind::Message(_) if field.is_map() => "map".into(),
            Kind::Message(of) => format!("`{}`", of.name()),
            Kind::Enum(of) => format!("`{}`", of.name()),
            scalar => format!("{scalar:?}"),
        };
        let many = if field.is_list() { "repeated " } else { "" };
        let about = comment(&file, field.path()).replace('\n', " ").replace('|', "\\|");
        writeln!(page, "| `{}` | {many}{kind} | {about} |", field.name()).unwrap();
    }
}

fn enumeration(page: &mut String, of: &EnumDescriptor) {
    let file = of.parent_file();
    write!(page, "\n### {}\n", of.name()).unwrap();
    paragraph(page, &comment(&file, of.path()));
    page.push_str("\n| value | |\n| --- | --- |\n");
    for value in of.values() {
        let about = comment(&file, value.path()).replace('\n', " ");
        writeln!(page, "| `{}` | {about} |", value.name()).unwrap();
    }
}

fn paragraph(page: &mut String, text: &str) {
    if !text.is_empty() {
        write!(page, "\n{text}\n").unwrap();
    }
}

/// The comment at the top of a file.
fn head(file: &FileDescriptor) -> String {
    let source = file.file_descriptor_proto().source_code_info.as_ref().expect("descriptors keep their comments");
    let syntax = source.location.iter().find(|location| location.path == [12]).expect("a file has a syntax");
    let above = syntax.leading_detached_comments.iter().map(String::as_str).chain([syntax.leading_comments()]);
    above.map(plain).filter(|text| !text.is_empty()).collect::<Vec<_>>().join("\n\n")
}
