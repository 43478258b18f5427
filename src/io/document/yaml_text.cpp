#include "helix_arm/io/yaml_text.hpp"

#include "document.hpp"

namespace helix_arm::io {

std::string yamlText(const std::string& text) {
  Value value;
  value.kind = Value::Kind::kText;
  value.text = text;
  std::string out = writeDocument(value);
  out.pop_back();  // the end of the line
  return out;
}

}  // namespace helix_arm::io
