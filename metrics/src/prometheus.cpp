// SPDX-License-Identifier: Apache-2.0
#include <nlohmann/json.hpp>
#include <regista/metrics/prometheus.hpp>

namespace regista {

namespace {

using nlohmann::ordered_json;

void expose(std::string& out, const std::string& name, const std::string& labels, const ordered_json& json) {
  if (json.is_number() || json.is_boolean()) {
    const ordered_json value = json.is_boolean() ? ordered_json(json.get<bool>() ? 1 : 0) : json;
    out += name + (labels.empty() ? "" : '{' + labels + '}') + ' ' + value.dump() + '\n';
  } else if (json.is_object()) {
    for (const auto& [key, value] : json.items()) expose(out, name + '_' + key, labels, value);
  } else if (json.is_array()) {
    for (const ordered_json& element : json) {
      std::string label;
      for (const char* key : {"id", "device", "name", "group"}) {
        if (!element.is_object() || !element.contains(key)) continue;
        const ordered_json& value = element[key];
        label += (label.empty() ? "" : ",") + std::string{key} + '=' +
                 (value.is_string() ? value.dump() : '"' + value.dump() + '"');
      }
      expose(out, name, labels.empty() || label.empty() ? labels + label : labels + ',' + label, element);
    }
  }
}

}  // namespace

std::string prometheus_text(const std::string& prefix, const std::string& json) {
  std::string text;
  expose(text, prefix, "", ordered_json::parse(json));
  return text;
}

}  // namespace regista
