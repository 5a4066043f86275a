// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

#include <regista/interfaces/messages.hpp>
#include <regista/xdr/codec.hpp>

/// Messages to and from their classes in Python. All of this needs the GIL.
namespace regista::python {

namespace py = pybind11;

/// A new object that the caller owns alone. Vectors of numbers become arrays that hold the vector's own memory: moved,
/// not copied.
py::object to_python(AnyData&& data);
py::object to_python(AnyReply&& reply);
py::object to_python(player::Motion&& motion);
py::object to_python(player::Event&& event);

/// The subtype of a class of data, or of Player's name for it such as "STATE"; throws TypeError when it is none of this
/// interface.
std::uint8_t data_subtype(const py::handle& type, std::uint16_t interface);

/// The subtype of an interface's first data message: its state. 0: it has none.
std::uint8_t first_data(std::uint16_t interface);

/// Throw TypeError when the object is no command or request, or a field has another type; ValueError when a number does
/// not fit.
AnyCommand to_command(const py::handle& object);
AnyRequest to_request(const py::handle& object);
/// "SET_ODOM"
std::string_view name_of(const AnyCommand& command);
std::string_view name_of(const AnyRequest& request);

/// A message as it goes over the wire, header and body: the data, or the answer, that `header` names. Throws as above.
py::bytes frame(const py::handle& object, const xdr::Header& header);

}  // namespace regista::python
