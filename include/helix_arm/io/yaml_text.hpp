#pragma once

#include <string>

namespace helix_arm::io {

/// A text as a YAML scalar of one line, quoted where YAML would read it otherwise.
std::string yamlText(const std::string& text);

}  // namespace helix_arm::io
