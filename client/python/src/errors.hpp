// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

#include <regista/client/error.hpp>

namespace regista::python {

namespace py = pybind11;

/// The same as an object of regista.errors. Needs the GIL.
inline py::object to_exception(const client::Error& error) {
  const char* name = "Error";
  if (dynamic_cast<const client::ConnectionError*>(&error) != nullptr) name = "ConnectionError";
  if (dynamic_cast<const client::TimeoutError*>(&error) != nullptr) name = "TimeoutError";
  if (dynamic_cast<const client::RefusedError*>(&error) != nullptr) name = "RefusedError";
  const py::object type = py::module_::import("regista.errors").attr(name);
  const client::Error::Context& context = error.context();
  return type(error.what(), context.host, context.port, context.device, context.asked, error.reason());
}

/// Throws it, as Python does. Needs the GIL.
[[noreturn]] inline void raise(const client::Error& error) {
  const py::object exception = to_exception(error);
  PyErr_SetObject(py::type::handle_of(exception).ptr(), exception.ptr());
  throw py::error_already_set{};
}

}  // namespace regista::python
