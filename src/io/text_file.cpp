#include "text_file.hpp"

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
  return content.str();
}

}  // namespace helix_arm::io
