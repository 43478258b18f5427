#include "text_file.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>

namespace helix_arm::io {

std::optional<std::string> readTextFile(const std::string& path, FaultList& faults) {
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  std::ostringstream content;
  // A directory opens without complaint and fails at the first read, so both are looked at.
  const bool opened = file.is_open();
  if (opened && file.peek() != std::ifstream::traits_type::eof()) content << file.rdbuf();
  if (!opened || file.bad() || errno == EISDIR) {
    faults.add(0, std::string("cannot be read: ") + std::strerror(errno == 0 ? EIO : errno));
    return std::nullopt;
  }
  const std::string text = content.str();
  const auto binary = std::find_if(text.begin(), text.end(), [](char c) {
    return static_cast<unsigned char>(c) < 0x20 && c != '\t' && c != '\n' && c != '\r';
  });
  if (binary != text.end()) {
    const auto line = std::count(text.begin(), binary, '\n') + 1;
    faults.add(static_cast<int>(line), "holds a control character; expected a text file");
    return std::nullopt;
  }
  return text;
}

}  // namespace helix_arm::io
