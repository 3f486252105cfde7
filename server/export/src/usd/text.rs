//! Layers of text in words that the crate's reader knows.

/// Edits of a list.
const EDITS: [&str; 5] = ["prepend", "append", "add", "delete", "reorder"];
/// Lists whose edits the reader knows.
const KNOWN: [&str; 7] = ["apiSchemas", "references", "payload", "inherits", "specializes", "variantSets", "clipSets"];

/// The name under which an edit of a list is read, as a field of its own: `append inactiveIds = [2]` becomes
/// `append_inactiveIds = [2]`. The reader refuses the first.
pub fn edit_of(edit: &str, list: &str) -> String {
    format!("{edit}_{list}")
}

/// Edits of a list that are fields of their own.
pub fn edits() -> impl Iterator<Item = &'static str> {
    EDITS.into_iter()
}

/// A text with edits of lists under names of their own, as long as before.
pub fn readable(mut text: Vec<u8>) -> Vec<u8> {
    for edit in EDITS {
        let mut from = 0;
        while let Some(at) = find(&text, edit.as_bytes(), from) {
            from = at + edit.len();
            let is_word = at == 0 || text[at - 1].is_ascii_whitespace();
            let gap = text[from..].iter().take_while(|byte| matches!(byte, b' ' | b'\t')).count();
            let name = from + gap;
            let length = text[name..].iter().take_while(|byte| byte.is_ascii_alphanumeric() || **byte == b'_').count();
            let rest = text[name + length..].iter().find(|byte| !matches!(byte, b' ' | b'\t'));
            let is_known = KNOWN.iter().any(|known| known.as_bytes() == &text[name..name + length]);
            if is_word && gap > 0 && length > 0 && rest == Some(&b'=') && !is_known {
                text[from] = b'_';
                text.copy_within(name..name + length, from + 1);
                text[from + 1 + length..name + length].fill(b' ');
            }
        }
    }
    text
}

fn find(text: &[u8], word: &[u8], from: usize) -> Option<usize> {
    text.get(from..)?.windows(word.len()).position(|window| window == word).map(|at| from + at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_of_lists_have_names_of_their_own() {
        let same = |text: &str| String::from_utf8(readable(text.as_bytes().to_vec())).unwrap();
        assert_eq!(same("(\n  append  inactiveIds = [0]\n)"), "(\n  append_inactiveIds  = [0]\n)");
        assert_eq!(same("delete inactiveIds = [1, 2]"), "delete_inactiveIds = [1, 2]");
        for text in [
            "prepend apiSchemas = [\"A\"]",
            "append rel targets = </a>",
            "prepend token outputs:surface.connect = </a>",
            "def \"append\"",
            "append",
            "append ",
            "append inactiveIds",
        ] {
            assert_eq!(same(text), text);
        }
    }
}
