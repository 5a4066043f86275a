// SPDX-License-Identifier: Apache-2.0
#include "messages.hpp"

#include <pybind11/numpy.h>

#include <regista/xdr/registry.hpp>

#include "names.hpp"

namespace regista::python {

namespace {

/// Objects that live as long as the interpreter are never given back: at exit there is nobody to give them to.
template <typename T>
PyObject* class_of() {
  static PyObject* const type = [] {
    const std::string module{module_name<T>()};
    const std::string name{class_name<T>()};
    return py::object{py::module_::import(("regista." + module).c_str()).attr(name.c_str())}.release().ptr();
  }();
  return type;
}

template <typename T>
PyObject* const* attributes_of() {
  static const auto names = [] {
    std::array<PyObject*, field_count<T>> list{};
    std::size_t i = 0;
    fields<T>.apply([&](const auto&... field) {
      ((list[i++] = PyUnicode_InternFromString(std::string{field.name}.c_str())), ...);
    });
    return list;
  }();
  return names.data();
}

py::object owned(PyObject* object) {
  if (object == nullptr) throw py::error_already_set{};
  return py::reinterpret_steal<py::object>(object);
}

// ---- To Python

template <typename T>
py::object convert(T&& value) {
  if constexpr (std::same_as<T, Empty>) {
    return py::none();
  } else if constexpr (Described<T>) {
    constexpr std::size_t size = field_count<T>;
    std::array<py::object, size> values;
    std::array<PyObject*, size + 1> arguments{};
    std::size_t i = 0;
    for_each_field(value, [&](const auto&, auto& member) {
      values[i] = convert(std::move(member));
      arguments[i + 1] = values[i].ptr();
      ++i;
    });
    return owned(PyObject_Vectorcall(class_of<T>(), &arguments[1], size | PY_VECTORCALL_ARGUMENTS_OFFSET, nullptr));
  } else if constexpr (std::same_as<T, Text>) {
    // Bytes that are no UTF-8 survive the way there and back.
    const std::string_view text = value.view();
    return owned(PyUnicode_DecodeUTF8(text.data(), static_cast<py::ssize_t>(text.size()), "surrogateescape"));
  } else if constexpr (std::same_as<T, std::vector<std::uint8_t>>) {
    return py::bytes(reinterpret_cast<const char*>(value.data()), value.size());
  } else if constexpr (is_vector<T>) {
    using Element = typename T::value_type;
    if constexpr (Described<Element>) {
      py::list list{value.size()};
      for (std::size_t i = 0; i < value.size(); ++i) list[i] = convert(std::move(value[i]));
      return list;
    } else {
      auto* const kept = new T{std::move(value)};
      const py::capsule owner{kept, [](void* memory) { delete static_cast<T*>(memory); }};
      return py::array_t<Element>{static_cast<py::ssize_t>(kept->size()), kept->data(), owner};
    }
  } else if constexpr (is_array<T>) {
    return py::array_t<typename T::value_type>{static_cast<py::ssize_t>(value.size()), value.data()};
  } else if constexpr (is_optional<T>) {
    return value ? convert(std::move(*value)) : py::none();
  } else if constexpr (std::is_enum_v<T>) {
    py::object number = py::int_(static_cast<long>(value));
    PyObject* const known = PyObject_CallOneArg(class_of<T>(), number.ptr());
    if (known != nullptr) return owned(known);
    PyErr_Clear();  // a value of a newer server
    return number;
  } else if constexpr (std::is_floating_point_v<T>) {
    return py::float_(static_cast<double>(value));
  } else {
    return py::int_(value);
  }
}

template <typename Variant>
py::object convert_any(Variant&& any) {
  return std::visit(
      []<typename T>(T&& message) -> py::object {
        if constexpr (module_name<std::remove_cvref_t<T>>() == "property") {
          // Of a property there is but the value; a `char` is a bool.
          if constexpr (!requires { message.value; }) {
            return py::none();
          } else if constexpr (std::same_as<decltype(message.value), std::int8_t>) {
            return py::bool_(message.value != 0);
          } else {
            return convert(std::move(message.value));
          }
        } else {
          return convert(std::remove_cvref_t<T>{std::forward<T>(message)});
        }
      },
      std::move(any));
}

// ---- From Python

[[noreturn]] void mismatch(PyObject* error, const std::string& path, const std::string& what) {
  PyErr_Clear();
  PyErr_SetString(error, (path + ": " + what).c_str());
  throw py::error_already_set{};
}

std::string type_of(const py::handle& value) { return Py_TYPE(value.ptr())->tp_name; }

/// Where an error happens, put together only when it does.
struct Path {
  const Path* outer;
  std::string_view name;
  [[nodiscard]] std::string text() const {
    return outer == nullptr ? std::string{name} : outer->text() + '.' + std::string{name};
  }
};

template <typename T>
void read(const py::handle& value, T& out, const Path& path) {
  if constexpr (Described<T>) {
    if (PyObject_IsInstance(value.ptr(), class_of<T>()) != 1) {
      mismatch(PyExc_TypeError, path.text(),
               "wants a " + std::string{class_name<T>()} + ", not '" + type_of(value) + "'");
    }
    std::size_t i = 0;
    for_each_field(out, [&](const auto& field, auto& member) {
      const py::object attribute = owned(PyObject_GetAttr(value.ptr(), attributes_of<T>()[i++]));
      read(attribute, member, Path{&path, field.name});
    });
  } else if constexpr (std::same_as<T, Text>) {
    if (!PyUnicode_Check(value.ptr())) {
      mismatch(PyExc_TypeError, path.text(), "wants a str, not '" + type_of(value) + "'");
    }
    const py::object bytes = owned(PyUnicode_AsEncodedString(value.ptr(), "utf-8", "surrogateescape"));
    out =
        Text{std::string_view{PyBytes_AS_STRING(bytes.ptr()), static_cast<std::size_t>(PyBytes_GET_SIZE(bytes.ptr()))}};
  } else if constexpr (std::same_as<T, std::vector<std::uint8_t>>) {
    Py_buffer view{};
    if (PyObject_GetBuffer(value.ptr(), &view, PyBUF_SIMPLE) != 0) {
      mismatch(PyExc_TypeError, path.text(), "wants bytes, not '" + type_of(value) + "'");
    }
    const auto* const first = static_cast<const std::uint8_t*>(view.buf);
    out.assign(first, first + view.len);
    PyBuffer_Release(&view);
  } else if constexpr (is_vector<T> || is_array<T>) {
    using Element = typename T::value_type;
    if constexpr (Described<Element>) {
      const py::object list = owned(PySequence_Fast(value.ptr(), (path.text() + ": wants a list").c_str()));
      out.resize(static_cast<std::size_t>(PySequence_Fast_GET_SIZE(list.ptr())));
      for (std::size_t i = 0; i < out.size(); ++i) {
        const std::string index = std::to_string(i);
        read(PySequence_Fast_GET_ITEM(list.ptr(), static_cast<py::ssize_t>(i)), out[i], Path{&path, index});
      }
    } else {
      const auto array = py::array_t<Element, py::array::c_style | py::array::forcecast>::ensure(value);
      if (!array || array.ndim() != 1) mismatch(PyExc_TypeError, path.text(), "wants a list of numbers");
      const auto size = static_cast<std::size_t>(array.size());
      if constexpr (is_vector<T>) {
        out.resize(size);
      } else if (size != out.size()) {
        mismatch(PyExc_ValueError, path.text(),
                 "wants " + std::to_string(out.size()) + " numbers, not " + std::to_string(size));
      }
      std::copy_n(array.data(), size, out.data());
    }
  } else if constexpr (is_optional<T>) {
    if (value.is_none()) return out.reset();
    read(value, out.emplace(), path);
  } else if constexpr (std::is_enum_v<T>) {
    std::underlying_type_t<T> number{};
    read(value, number, path);
    out = static_cast<T>(number);
  } else if constexpr (std::is_floating_point_v<T>) {
    const double number = PyFloat_AsDouble(value.ptr());
    if (number == -1 && PyErr_Occurred() != nullptr) {
      mismatch(PyExc_TypeError, path.text(), "wants a number, not '" + type_of(value) + "'");
    }
    out = static_cast<T>(number);
    if (std::isinf(out) && !std::isinf(number)) {
      mismatch(PyExc_ValueError, path.text(), std::to_string(number) + " is too large for 32 bits");
    }
  } else {
    int overflow = 0;
    const long long number =
        PyIndex_Check(value.ptr()) != 0 ? PyLong_AsLongLongAndOverflow(value.ptr(), &overflow) : -1;
    if (PyIndex_Check(value.ptr()) == 0 || PyErr_Occurred() != nullptr) {
      mismatch(PyExc_TypeError, path.text(), "wants a whole number, not '" + type_of(value) + "'");
    }
    static_assert(sizeof(T) < sizeof number);
    if (overflow != 0 || !std::in_range<T>(number)) {
      mismatch(PyExc_ValueError, path.text(),
               "wants a whole number from " + std::to_string(std::numeric_limits<T>::min()) + " to " +
                   std::to_string(std::numeric_limits<T>::max()) + ", not " + std::string{py::str(value)});
    }
    out = static_cast<T>(number);
  }
}

template <typename Any>
using Reader = Any (*)(const py::handle&);

/// By class. Subclasses of a message are no messages.
template <typename Any>
const std::unordered_map<PyObject*, Reader<Any>>& readers() {
  static const auto table = [] {
    std::unordered_map<PyObject*, Reader<Any>> map;
    for_each_message(typename Any::Messages{}, [&]<typename M>(std::size_t) {
      if constexpr (has_class<M>) {
        map[class_of<M>()] = [](const py::handle& object) -> Any {
          M message;
          static const std::string name = std::string{module_name<M>()} + '.' + std::string{class_name<M>()};
          read(object, message, Path{nullptr, name});
          return message;
        };
      }
    });
    return map;
  }();
  return table;
}

template <typename Any>
Any read_any(const py::handle& object, const char* wanted) {
  const auto& table = readers<Any>();
  const auto found = table.find(reinterpret_cast<PyObject*>(Py_TYPE(object.ptr())));
  if (found == table.end()) throw py::type_error{std::string{"wants a "} + wanted + ", not '" + type_of(object) + "'"};
  return found->second(object);
}

}  // namespace

py::object to_python(AnyData&& data) { return convert_any(std::move(data)); }
py::object to_python(AnyReply&& reply) { return convert_any(std::move(reply)); }
py::object to_python(player::Motion&& motion) { return convert(std::move(motion)); }
py::object to_python(player::Event&& event) { return convert(std::move(event)); }

std::uint8_t data_subtype(const py::handle& type, std::uint16_t interface) {
  const std::string name = py::isinstance<py::str>(type) ? py::cast<std::string>(type) : "";
  std::optional<std::uint8_t> subtype;
  any_message(AllMessages{}, [&]<typename M>() {
    if constexpr (DataType<M>) {
      if (M::message.interface == interface && (name.empty() ? class_of<M>() == type.ptr() : name == M::message.name)) {
        subtype = M::message.subtype;
      }
    }
    return subtype.has_value();
  });
  if (!subtype) {
    throw py::type_error{std::string{py::str(type)} + " is no data of interface " +
                         std::string{interface_name(interface)}};
  }
  return *subtype;
}

std::uint8_t first_data(std::uint16_t interface) {
  std::uint8_t subtype = 0;
  any_message(AllMessages{}, [&]<typename M>() {
    if constexpr (DataType<M>) {
      if (M::message.interface == interface) subtype = M::message.subtype;
    }
    return subtype != 0;
  });
  return subtype;
}

AnyCommand to_command(const py::handle& object) { return read_any<AnyCommand>(object, "command"); }
AnyRequest to_request(const py::handle& object) { return read_any<AnyRequest>(object, "request"); }

py::bytes frame(const py::handle& object, const xdr::Header& header) {
  std::vector<std::byte> bytes;
  const bool known = xdr::with_body_type(header, [&]<typename Body>() {
    if constexpr (module_name<Body>() != "property" && !std::same_as<Body, Empty>) {
      Body body;
      read(object, body, Path{nullptr, class_name<Body>()});
      bytes.resize(xdr::header_size + xdr::encoded_size(body));
      xdr::encode_message(header, body, bytes);
    }
  });
  if (!known || bytes.empty()) throw py::value_error{xdr::unknown_message(header).message()};
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

std::string_view name_of(const AnyCommand& command) {
  return std::visit([]<typename M>(const M&) { return M::message.name; }, command);
}
std::string_view name_of(const AnyRequest& request) {
  return std::visit([]<typename M>(const M&) { return M::message.name; }, request);
}

}  // namespace regista::python
