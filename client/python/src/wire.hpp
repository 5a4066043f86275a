// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

namespace regista::python {

/// Whole messages, one after the other → the JSON of each, and how many bytes at the end are the beginning of one more.
/// Throws ValueError.
pybind11::tuple wire_decode(const pybind11::bytes& bytes);
/// The JSON of a message → its bytes. Throws ValueError.
pybind11::bytes wire_encode(const std::string& json);

}  // namespace regista::python
