//! What the Python package `pigtail` is made of, beneath its Python: arguments in, JSON and arrays out.
//!
//! The package's own interface, its types and its words are in `python/pigtail`.

#![expect(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    reason = "arguments are those of functions in Python, and owned as it hands them over"
)]

mod align;
mod bench;
mod campaign;
mod failure;
mod gym;
mod input;
mod jobs;
mod own_bench;
mod produce;
mod records;
mod rig;
mod runs;
mod twin;
mod wire;
mod work;

use pigtail_hal::{Channel, Side};
use pyo3::PyClass;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// A class, where Python can hold its values: Python's objects begin at multiples of two pointers, and what wants more,
/// as numbers do that a processor works on several at once, would be read at addresses that it must not have.
fn add_class<T: PyClass>(module: &Bound<'_, PyModule>) -> PyResult<()> {
    const { assert!(align_of::<T>() <= 2 * size_of::<usize>()) };
    module.add_class::<T>()
}

#[pymodule]
fn _pigtail(module: &Bound<'_, PyModule>) -> PyResult<()> {
    work::imported();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add(
        "CHANNELS",
        PyTuple::new(module.py(), Channel::ALL.map(Channel::name))?,
    )?;
    module.add(
        "SIDES",
        PyTuple::new(module.py(), Side::ALL.map(Side::name))?,
    )?;
    add_class::<rig::Rig>(module)?;
    add_class::<rig::Belief>(module)?;
    add_class::<twin::Twin>(module)?;
    add_class::<twin::Command>(module)?;
    add_class::<twin::Measurement>(module)?;
    module.add_function(wrap_pyfunction!(align::align, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::tune, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::identify, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::characterize, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::commission, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::simulate_joint, module)?)?;
    module.add_function(wrap_pyfunction!(produce::produce, module)?)?;
    module.add_function(wrap_pyfunction!(produce::produce_trays, module)?)?;
    add_class::<bench::BenchRig>(module)?;
    add_class::<bench::BenchTwin>(module)?;
    module.add_function(wrap_pyfunction!(bench::align_bench, module)?)?;
    module.add_function(wrap_pyfunction!(bench::peak_on, module)?)?;
    module.add_function(wrap_pyfunction!(bench::wilson, module)?)?;
    add_class::<gym::Environments>(module)?;
    module.add_function(wrap_pyfunction!(records::identify_servo, module)?)?;
    add_class::<campaign::Spec>(module)?;
    module.add_function(wrap_pyfunction!(campaign::campaign_resume, module)?)?;
    module.add_function(wrap_pyfunction!(campaign::campaign_shard, module)?)?;
    module.add_function(wrap_pyfunction!(campaign::campaign_merge, module)?)?;
    module.add_function(wrap_pyfunction!(runs::runs_list, module)?)?;
    module.add_function(wrap_pyfunction!(runs::runs_show, module)?)?;
    Ok(())
}
