// SPDX-License-Identifier: Apache-2.0
// generate FOLDER: write the Python modules of the interfaces, position2d.py and so on, from the descriptions of their
// messages.
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <regista/interfaces/messages.hpp>
#include <set>
#include <sstream>

#include "names.hpp"

namespace {

using namespace regista;
using python::class_name;
using python::module_name;

struct Module {
  std::set<std::string> imports;
  std::set<std::string_view> classes;
  std::ostringstream text;
};

std::map<std::string_view, Module> modules;

template <typename T>
consteval const char* dtype() {
  if constexpr (std::same_as<T, float>) return "np.float32";
  if constexpr (std::same_as<T, double>) return "np.float64";
  if constexpr (std::same_as<T, std::int32_t>) return "np.int32";
}

/// How a type of Python is written, and the default of a field.
struct Spelling {
  std::string type;
  std::string standard;
};

template <typename T>
void write_class();

template <typename E, auto value>
consteval std::string_view enumerator() {
  std::string_view text = __PRETTY_FUNCTION__;
  text.remove_prefix(text.find("value = ") + 8);
  text = text.substr(0, text.find_first_of(";]"));
  return text.starts_with('(') ? "" : text.substr(text.rfind(':') + 1);
}

/// Call `visit(name, number)` for each value of an enumeration below 32.
template <typename E, typename Visit>
void for_each_enumerator(Visit visit) {
  const auto call = [&]<auto value>() {
    constexpr std::string_view name = enumerator<E, value>();
    if (!name.empty()) visit(name, static_cast<int>(value));
  };
  [&]<std::size_t... i>(std::index_sequence<i...>) {
    (call.template operator()<static_cast<E>(i)>(), ...);
  }(std::make_index_sequence<32>{});
}

template <typename E>
std::string name_of(E value) {
  std::string found;
  for_each_enumerator<E>([&](std::string_view name, int number) {
    if (number == static_cast<int>(value)) found = name;
  });
  return found;
}

template <typename E>
void write_enum() {
  Module& module = modules[module_name<E>()];
  if (!module.classes.insert(class_name<E>()).second) return;
  module.imports.insert("from enum import IntEnum");
  module.text << "\n\nclass " << class_name<E>() << "(IntEnum):\n";
  for_each_enumerator<E>(
      [&](std::string_view name, int number) { module.text << "    " << name << " = " << number << '\n'; });
}

template <typename T>
std::string quoted(std::string_view from) {
  const bool here = from == module_name<T>();
  if (!here)
    modules[from].imports.insert("from regista." + std::string{module_name<T>()} + " import " +
                                 std::string{class_name<T>()});
  return std::string{class_name<T>()};
}

template <typename T>
Spelling spell(const T& value, std::string_view from) {
  Module& module = modules[from];
  if constexpr (Described<T>) {
    write_class<T>();
    module.imports.insert("from dataclasses import dataclass, field");
    const std::string name = quoted<T>(from);
    return {name, "field(default_factory=" + name + ")"};
  } else if constexpr (std::same_as<T, Text>) {
    return {"str", "\"" + std::string{value.view()} + "\""};
  } else if constexpr (std::same_as<T, std::vector<std::uint8_t>>) {
    module.imports.insert("import builtins");  // a field may be called bytes
    return {"builtins.bytes", "b\"\""};
  } else if constexpr (is_vector<T> || is_array<T>) {
    using Element = typename T::value_type;
    module.imports.insert("from dataclasses import dataclass, field");
    if constexpr (Described<Element>) {
      write_class<Element>();
      return {"list[" + quoted<Element>(from) + "]", "field(default_factory=list)"};
    } else {
      module.imports.insert("import numpy as np");
      module.imports.insert("import numpy.typing as npt");
      const std::string type = dtype<Element>();
      return {"npt.NDArray[" + type + "]",
              "field(default_factory=lambda: np.zeros(" + std::to_string(value.size()) + ", " + type + "))"};
    }
  } else if constexpr (is_optional<T>) {
    return {spell(typename T::value_type{}, from).type + " | None", "None"};
  } else if constexpr (std::is_enum_v<T>) {
    write_enum<T>();
    // A newer server may say what we have no name for, and 0 is none of all enumerations.
    const std::string name = name_of(value);
    return {quoted<T>(from) + " | int",
            name.empty() ? std::to_string(static_cast<int>(value)) : std::string{class_name<T>()} + "." + name};
  } else if constexpr (std::is_floating_point_v<T>) {
    std::ostringstream number;
    number << value;
    const bool whole = number.str().find_first_of(".e") == std::string::npos;
    return {"float", number.str() + (whole ? ".0" : "")};
  } else {
    return {"int", std::to_string(value)};
  }
}

template <typename M>
std::string reply_of() {
  using Reply = typename M::Reply;
  if constexpr (std::same_as<Reply, Empty>) {
    return "None";
  } else if constexpr (std::same_as<Reply, M>) {
    return '"' + std::string{class_name<M>()} + '"';
  } else {
    write_class<Reply>();
    return quoted<Reply>(module_name<M>());
  }
}

template <typename T>
void write_class() {
  constexpr std::string_view from = module_name<T>();
  Module& module = modules[from];
  if (module.classes.contains(class_name<T>())) return;
  module.classes.insert(class_name<T>());
  module.imports.insert("from dataclasses import dataclass");

  std::string base = "message.Struct";
  std::string constants;
  std::string title{class_name<T>()};
  if constexpr (MessageType<T>) {
    constexpr Message m = T::message;
    constexpr std::array<std::string_view, 4> kinds{"", "Data", "Command", "Request"};
    base = "message." + std::string{kinds[static_cast<std::size_t>(m.kind)]};
    title = std::string{kinds[static_cast<std::size_t>(m.kind)]} + " `" + std::string{m.name} + "` of " +
            std::string{interface_name(m.interface)};
    if constexpr (m.kind == Kind::command) {
      title += m.flow == Flow::set_point ? ": the newest counts" : ": happens once";
      title += ", group " + std::string{m.group};
    }
    module.imports.insert("from typing import ClassVar");
    constants = "\n    INTERFACE: ClassVar[str] = \"" + std::string{interface_name(m.interface)} +
                "\"\n    NAME: ClassVar[str] = \"" + std::string{m.name} +
                "\"\n    SUBTYPE: ClassVar[int] = " + std::to_string(m.subtype) + "\n";
    if constexpr (RequestType<T>) base += "[" + reply_of<T>() + "]";
  }
  module.imports.insert("from regista import message");

  std::ostringstream body;
  std::ostringstream docs;
  for_each_field(T{}, [&](const auto& field, const auto& value) {
    const auto [type, standard] = spell(value, from);
    body << "    " << field.name << ": " << type << " = " << standard << '\n';
    std::string doc{field.doc};
    if (!field.unit.empty()) doc = "[" + std::string{field.unit} + "] " + doc;
    if (field.max_count != unlimited) doc += (doc.empty() ? "" : "; ") + ("at most " + std::to_string(field.max_count));
    docs << "        " << field.name << ':' << (doc.empty() ? "" : " ") << doc.substr(0, doc.find_last_not_of(' ') + 1)
         << '\n';
  });
  module.text << "\n\n@dataclass(slots=True, eq=False)\nclass " << class_name<T>() << '(' << base << "):\n    \"\"\""
              << title << '.';
  if (field_count<T> > 0) module.text << "\n\n    Attributes:\n" << docs.str() << "    ";
  module.text << "\"\"\"\n" << constants << (body.str().empty() ? "" : "\n") << body.str();
}

template <InterfaceType I>
bool write_interface() {
  [&]<typename... Ms>(TypeList<Ms...>) {
    (
        [] {
          if constexpr (python::has_class<Ms>) write_class<Ms>();
        }(),
        ...);
  }(typename I::Messages{});
  return false;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: generate FOLDER\n", stderr);
    return 2;
  }
  const std::filesystem::path folder{argv[1]};
  std::filesystem::create_directories(folder);
  any_message(Interfaces{}, []<typename I>() { return write_interface<I>(); });
  for (const auto& [name, module] : modules) {
    std::ofstream file{folder / (std::string{name} + ".py")};
    file << "# SPDX-License-Identifier: Apache-2.0\n"
            "# Generated from the descriptions of the messages, interfaces/include/regista/interfaces: change them "
            "there.\n"
         << "\"\"\"";
    if (name == "geometry") {
      file << "Plain values of several interfaces.";
    } else {
      file << "The messages of interface " << name << " (" << interface_code(name) << ").";
    }
    file << "\"\"\"\n\n";
    const bool longer = module.imports.contains("from dataclasses import dataclass, field");
    for (const std::string& line : module.imports) {
      if (!longer || line != "from dataclasses import dataclass") file << line << '\n';
    }
    file << module.text.str();
    if (!file.flush()) {
      std::fprintf(stderr, "cannot write to %s\n", argv[1]);
      return 1;
    }
  }
}
