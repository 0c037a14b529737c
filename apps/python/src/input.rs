//! What comes from Python, checked.

use pigtail_hal::AxisName;
use std::fmt::Display;
use strum::VariantArray;

/// An argument that is not what is accepted.
pub(crate) struct Refused {
    pub(crate) argument: String,
    pub(crate) value: String,
    pub(crate) message: String,
}

/// That an argument has a value that is not accepted, and what is.
pub(crate) fn refused(argument: &str, value: impl Display, message: impl Into<String>) -> Refused {
    Refused {
        argument: argument.to_owned(),
        value: value.to_string(),
        message: message.into(),
    }
}

/// One of an enum's names.
pub(crate) fn choice<T>(argument: &str, name: &str) -> Result<T, Refused>
where
    T: VariantArray + Copy + Into<&'static str>,
{
    let names = || T::VARIANTS.iter().map(|&variant| (variant, variant.into()));
    let found = names().find(|(_, of)| *of == name);
    found.map(|(variant, _)| variant).ok_or_else(|| {
        let names: Vec<&str> = names().map(|(_, name)| name).collect();
        refused(
            argument,
            name,
            format!("is \"{name}\"; accepted is one of {names:?}"),
        )
    })
}

/// An axis by its name.
pub(crate) fn axis(name: &str) -> Result<AxisName, Refused> {
    name.parse()
        .map_err(|why: String| refused("axis", name, why))
}
