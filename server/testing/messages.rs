//! For tests: messages held against the states that provoke them. `tests/cli/messages.toml` names these tests.

/// A state by its name, and the words of its messages: these and no others. Names begin with "when".
#[track_caller]
pub fn says_only(case: &str, said: &[String], words: &[&str]) {
    assert!(case.starts_with("when "), "{case}");
    let all = said.len() == words.len() && said.iter().zip(words).all(|(text, words)| text.contains(words));
    assert!(all, "{case}: {said:#?} instead of {words:#?}");
}
