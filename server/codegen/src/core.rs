//! Types, defaults and ranges, for `cairn_input::params`.

use crate::{Group, Parameter, Range, Schema, Value, camel, measure, variants};
use std::fmt::Write;

const DERIVES: &str = "#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]";
const ENUM_DERIVES: &str = "#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]\n\
                            #[serde(rename_all = \"snake_case\")]";
/// Of these, the first value is the default wherever one is.
const WITH_DEFAULT: [&str; 2] = ["Switch", "Turns"];

impl Schema {
    /// The code that `params.rs` of the core includes.
    pub fn core(&self) -> String {
        let mut code = String::new();
        for of in &self.enums {
            let about = crate::comment(&of.parent_file(), of.path());
            let has_default = WITH_DEFAULT.contains(&of.name());
            let derives = if has_default { "#[derive(Default)]\n" } else { "" };
            writeln!(code, "/// {about}\n{derives}{ENUM_DERIVES}\npub enum {} {{", of.name()).unwrap();
            for (n, (name, about)) in variants(of).iter().enumerate() {
                let default = if n == 0 && has_default { "#[default]\n" } else { "" };
                writeln!(code, "/// {about}\n{default}{name},").unwrap();
            }
            code.push_str("}\n");
        }
        for group in &self.groups {
            writeln!(code, "/// {}\n{DERIVES}\npub struct {} {{", group.comment, group.type_name).unwrap();
            for parameter in &group.parameters {
                writeln!(code, "/// {}\npub {}: {},", parameter.comment, parameter.name, type_of(parameter)).unwrap();
            }
            for (name, child) in self.children(group) {
                writeln!(code, "pub {name}: {},", child.type_name).unwrap();
            }
            code.push_str("}\n");
        }
        let ranges: String =
            self.groups.iter().flat_map(|group| group.parameters.iter().filter_map(|p| row(group, p))).collect();
        writeln!(
            code,
            "impl Params {{\n\
             /// The parameters of the accuracy `standard`.\nfn standard() -> Params {{ {} }}\n\
             /// Every number that is there, with its name and range.\n\
             fn ranges(&self) -> Vec<Ranged> {{ vec![{ranges}] }}\n}}",
            self.defaults(&self.groups[0])
        )
        .unwrap();
        code
    }

    fn defaults(&self, group: &Group) -> String {
        let mut code = format!("{} {{ ", group.type_name);
        for parameter in &group.parameters {
            write!(code, "{}: {}, ", parameter.name, default(parameter)).unwrap();
        }
        for (name, child) in self.children(group) {
            write!(code, "{name}: {}, ", self.defaults(child)).unwrap();
        }
        code + "}"
    }
}

fn type_of(parameter: &Parameter) -> String {
    let one = match &parameter.value {
        Value::Number => "f64".into(),
        Value::Numbers => "Vec<f64>".into(),
        Value::Count { bits } => format!("u{bits}"),
        Value::Flag => "bool".into(),
        Value::FlagOrAuto => "Switch".into(),
        Value::Choice(of) => of.name().into(),
        Value::Measure(of) => measure(of).0,
        Value::Moment => return "Option<f64>".into(),
    };
    if parameter.is_optional { format!("Option<{one}>") } else { one }
}

fn default(parameter: &Parameter) -> String {
    let Parameter { value, default, is_optional, .. } = parameter;
    match value {
        _ if *is_optional => "None".into(),
        Value::Number => format!("{default}_f64"),
        Value::Numbers => "Vec::new()".into(),
        Value::Count { .. } | Value::Flag => default.clone(),
        Value::FlagOrAuto => "Switch::Auto".into(),
        Value::Choice(of) => format!("{}::{}", of.name(), camel(default)),
        Value::Measure(of) => {
            let (type_name, fields) = measure(of);
            let is_given = |field: &_| !crate::stated(&crate::of_field(field), "Default: ").is_empty();
            let (unit, _) = fields.iter().find(|(_, field)| is_given(field)).expect("one of the units has the default");
            format!("{type_name}::{unit}({default}_f64)")
        }
        Value::Moment => "None".into(),
    }
}

/// A row of the table of ranges; those of 64 bits are bounded by their type.
fn row(group: &Group, parameter: &Parameter) -> Option<String> {
    let Range { low, is_low_excluded, high } = parameter.range.as_ref()?;
    let place = group.place("self", &parameter.name);
    let low = format!("Bound::{}({low}_f64)", if *is_low_excluded { "Excluded" } else { "Included" });
    let high = high.as_ref().map_or("Bound::Unbounded".into(), |high| format!("Bound::Included({high}_f64)"));
    let range = format!("({low}, {high})");
    let value = match &parameter.value {
        Value::Number | Value::Moment if type_of(parameter) == "Option<f64>" => place,
        Value::Number => format!("Some({place})"),
        Value::Numbers => format!("outside(&{place}, {range})"),
        Value::Count { bits: 32 } if parameter.is_optional => format!("{place}.map(f64::from)"),
        Value::Count { bits: 32 } => format!("Some(f64::from({place}))"),
        Value::Measure(_) => format!("Some({place}.number())"),
        _ => return None,
    };
    Some(format!("(\"{}\", {value}, {range}),\n", group.place("", &parameter.name)))
}
