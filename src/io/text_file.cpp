#include "text_file.hpp"

#include <algorithm>

#include "helix_arm/basics/regular_file.hpp"

namespace helix_arm::io {

std::optional<std::string> readTextFile(const std::string& path, std::size_t most,
                                        FaultList& faults) {
  basics::RegularFile file(path);
  std::optional<std::string> text = file.readAll(most);
  if (!text) {
    faults.add(0, file.fault() + (file.isOpen() ? "; expected a text file" : ""));
    return std::nullopt;
  }
  const auto binary = std::find_if(text->begin(), text->end(), [](char c) {
    return static_cast<unsigned char>(c) < 0x20 && c != '\t' && c != '\n' && c != '\r';
  });
  if (binary != text->end()) {
    const auto line = std::count(text->begin(), binary, '\n') + 1;
    faults.add(static_cast<int>(line), "holds a control character; expected a text file");
    return std::nullopt;
  }
  return text;
}

}  // namespace helix_arm::io
