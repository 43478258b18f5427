#include "text_file.hpp"

#include <algorithm>
#include <utility>

#include "helix_arm/basics/regular_file.hpp"

namespace helix_arm::io {

namespace {

std::optional<std::string> plainText(std::string text, FaultList& faults) {
  const auto binary = std::find_if(text.begin(), text.end(), [](char c) {
    return static_cast<unsigned char>(c) < 0x20 && c != '\t' && c != '\n' && c != '\r';
  });
  if (binary == text.end()) return text;
  const auto line = std::count(text.begin(), binary, '\n') + 1;
  faults.add(static_cast<int>(line), "holds a control character; expected a text file");
  return std::nullopt;
}

}  // namespace

std::optional<std::string> readTextFile(const std::string& path, std::size_t most,
                                        FaultList& faults) {
  basics::RegularFile file(path);
  std::optional<std::string> text = file.readAll(most);
  if (!text) {
    faults.add(0, file.fault() + (file.isOpen() ? "; expected a text file" : ""));
    return std::nullopt;
  }
  return plainText(std::move(*text), faults);
}

std::optional<std::string> readTextStream(std::istream& in, std::size_t most, FaultList& faults) {
  std::string text(most + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (text.size() > most) {
    faults.add(0, "has more than " + std::to_string(most) + " bytes; expected at most that");
    return std::nullopt;
  }
  return plainText(std::move(text), faults);
}

}  // namespace helix_arm::io
