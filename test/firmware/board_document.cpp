#include "board_document.hpp"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <optional>
#include <regex>
#include <sstream>
#include <stdexcept>

namespace helix_arm::test {
namespace {

constexpr char kDocument[] = HELIX_ARM_SOURCE_DIR "/docs/board.md";
constexpr char kArm[] = HELIX_ARM_SOURCE_DIR "/config/scenes/demo_serial.yaml";
constexpr char kBegin[] = "```yaml\n", kEnd[] = "```\n";

std::string lowered(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

std::string textOf(const char* path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

ChipPin pinOf(const std::string& port, const std::string& bit) {
  return {port.front(), std::stoi(bit)};
}

}  // namespace

BoardWiring readWiring(const std::string& chip) {
  const std::regex row(
      R"(\| (\d) \| P([A-L])([0-7]) \(D\d+\) \| P([A-L])([0-7]) \(D\d+\) \| P[CF]\d \(A(\d)\) \|.*)");
  const std::regex others(R"(Supply valve: P([A-L])([0-7]) .*LED: P([A-L])([0-7]) .*)");
  std::ifstream document(kDocument);
  BoardWiring wiring;
  std::optional<ChipPin> supply;
  bool in_section = false;
  for (std::string line; std::getline(document, line);) {
    if (line.rfind('#', 0) == 0) in_section = lowered(line).find(chip) != std::string::npos;
    std::smatch match;
    if (in_section && std::regex_match(line, match, row)) {
      if (std::stoul(match[1]) != wiring.inlets.size()) {
        throw std::runtime_error(std::string(kDocument) + ": channel " + match[1].str() + " of " +
                                 chip + " is out of order");
      }
      wiring.inlets.push_back(pinOf(match[2], match[3]));
      wiring.outlets.push_back(pinOf(match[4], match[5]));
      wiring.sensors.push_back(std::stoi(match[6]));
    } else if (in_section && std::regex_match(line, match, others)) {
      supply = pinOf(match[1], match[2]);
      wiring.led = pinOf(match[3], match[4]);
    }
  }
  if (wiring.inlets.empty() || !supply) {
    throw std::runtime_error(std::string(kDocument) +
                             " has no table of pins, or no supply valve and LED, of " + chip);
  }
  wiring.supply = *supply;
  return wiring;
}

io::Scene readScene(const std::string& device) {
  const std::string document = textOf(kDocument), arm = textOf(kArm);
  const std::size_t begin = document.find(kBegin), regulator = arm.find("\nregulator:");
  if (begin == std::string::npos || regulator == std::string::npos) {
    throw std::runtime_error(std::string(kDocument) + " has no scene, or " + kArm +
                             " no regulator");
  }
  const std::size_t first = begin + sizeof kBegin - 1;
  const std::string part = document.substr(first, document.find(kEnd, first) - first);
  const std::regex placeholder("/dev/serial/by-id/[^ ,\n]+");
  if (!std::regex_search(part, placeholder)) {
    throw std::runtime_error(std::string(kDocument) + " has a scene without a device");
  }
  return io::sceneOfText(
      arm.substr(0, regulator + 1) + std::regex_replace(part, placeholder, device), kDocument);
}

}  // namespace helix_arm::test
