// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/messages.hpp>

/// What the structs of the interfaces are called in Python: the same, in a module of the interface's name. The
/// generator of the modules and the code that fills their classes read this.
namespace regista::python {

/// "regista::position2d::State": C++20 has no reflection, but the compilers spell template arguments out.
template <typename T>
consteval std::string_view full_name() {
  std::string_view text = __PRETTY_FUNCTION__;
  text.remove_prefix(text.find("T = ") + 4);
  return text.substr(0, text.find_first_of(";]"));
}

/// "State"
template <typename T>
consteval std::string_view class_name() {
  return full_name<T>().substr(full_name<T>().rfind(':') + 1);
}

/// "position2d"; the plain values of core are in "geometry".
template <typename T>
consteval std::string_view module_name() {
  constexpr std::string_view root = "regista::";
  constexpr std::string_view rest = full_name<T>().substr(root.size());
  constexpr std::size_t end = rest.find(':');
  return end == std::string_view::npos ? "geometry" : rest.substr(0, end);
}

/// The messages that Python knows as classes: what a program may send, ask or read. Properties have methods instead,
/// and a SYNCH is the connection's own.
template <MessageType M>
inline constexpr bool has_class = module_name<M>() != "property" && M::message.kind != Kind::synch;

}  // namespace regista::python
