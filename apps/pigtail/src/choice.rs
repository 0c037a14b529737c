//! Options that take one of an enum's names.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::error::Error;
use std::ffi::OsStr;
use std::marker::PhantomData;
use strum::{EnumMessage, VariantArray};

/// An enum that is chosen from by name: its documentation is the option's help.
pub(crate) trait Named:
    VariantArray + EnumMessage + Copy + Send + Sync + Into<&'static str>
{
}

impl<T: VariantArray + EnumMessage + Copy + Send + Sync + Into<&'static str>> Named for T {}

/// Parses one of an enum's names.
pub(crate) fn choice<T: Named>() -> Choice<T> {
    Choice(PhantomData)
}

/// See [`choice`].
#[derive(Debug, Clone)]
pub(crate) struct Choice<T>(PhantomData<T>);

fn values<T: Named>() -> impl Iterator<Item = PossibleValue> {
    T::VARIANTS.iter().map(|&variant| {
        let name: &'static str = variant.into();
        PossibleValue::new(name).help(variant.get_documentation())
    })
}

impl<T: Named> TypedValueParser for Choice<T> {
    type Value = T;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&clap::Arg>,
        value: &OsStr,
    ) -> Result<T, Error> {
        let parser = PossibleValuesParser::new(values::<T>());
        let name = parser.parse_ref(command, argument, value)?;
        let named = T::VARIANTS.iter().find(|&&variant| {
            let of: &'static str = variant.into();
            of == name
        });
        Ok(*named.expect("the name of one of them"))
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(values::<T>()))
    }
}
