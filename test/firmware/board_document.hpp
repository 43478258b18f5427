#pragma once

#include <string>
#include <vector>

#include "helix_arm/io/scene.hpp"
#include "simulated_chip.hpp"

namespace helix_arm::test {

/// Pins of a board, per channel.
struct BoardWiring {
  std::vector<ChipPin> inlets, outlets;
  std::vector<int> sensors;  ///< channels of the converter
  ChipPin supply, led;
};

/// The wiring that docs/board.md gives a chip: what the tests solder is what a reader solders.
/// @param chip  "atmega328p" or "atmega2560"
/// @throws std::runtime_error naming what the document lacks.
BoardWiring readWiring(const std::string& chip);

/// config/scenes/demo_serial.yaml with the regulator and the safety rules that docs/board.md gives
/// a board, at this device.
/// @throws std::runtime_error, io::DocumentError if the document has none, or a faulty one.
io::Scene readScene(const std::string& device);

}  // namespace helix_arm::test
