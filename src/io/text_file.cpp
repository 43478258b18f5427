#include "text_file.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <vector>

namespace helix_arm::io {
namespace {

constexpr std::size_t kMostMegabytes = 256;

// A little more than is allowed at most: some files, such as /dev/zero, have no end.
std::string contentOf(std::ifstream& file) {
  std::string content;
  std::vector<char> block(1U << 16U);
  while (file && content.size() <= kMostMegabytes << 20U) {
    file.read(block.data(), static_cast<std::streamsize>(block.size()));
    content.append(block.data(), static_cast<std::size_t>(file.gcount()));
  }
  return content;
}

}  // namespace

std::optional<std::string> readTextFile(const std::string& path, FaultList& faults) {
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  // A directory opens without complaint and fails at the first read, so both are looked at.
  const bool opened = file.is_open();
  std::string text = opened ? contentOf(file) : std::string();
  if (!opened || file.bad() || errno == EISDIR) {
    faults.add(0, std::string("cannot be read: ") + std::strerror(errno == 0 ? EIO : errno));
    return std::nullopt;
  }
  if (text.size() > kMostMegabytes << 20U) {
    faults.add(0,
               "is larger than " + std::to_string(kMostMegabytes) + " MiB; expected a text file");
    return std::nullopt;
  }
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
