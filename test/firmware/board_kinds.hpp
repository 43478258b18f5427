#pragma once

#include <ostream>
#include <string>

#include <gtest/gtest.h>

#include "simulated_board.hpp"

namespace helix_arm::test {

/// For messages of tests.
inline void PrintTo(const BoardKind& kind, std::ostream* out) { *out << kind.name(); }

/// Every build of the firmware.
inline const BoardKind kBoardKinds[] = {{"atmega328p", "solenoid"},
                                        {"atmega328p", "proportional"},
                                        {"atmega2560", "solenoid"},
                                        {"atmega2560", "proportional"}};
/// Each chip and each kind of valve once.
inline const BoardKind kEachPart[] = {kBoardKinds[0], kBoardKinds[3]};
inline const BoardKind kSmallBoard = kBoardKinds[0];
/// A build for fewer channels than the chip has.
inline const BoardKind kFiveChannels = {"atmega2560", "solenoid", 5};
/// A build that refuses lines without a checksum from the start.
inline const BoardKind kChecksumRequired = {"atmega328p", "solenoid", 0, true};

inline std::string nameOfKind(const testing::TestParamInfo<BoardKind>& info) {
  return info.param.name();
}

/// A board that was started and told to vent: it takes set points.
class ReadyBoard : public SimulatedBoard {
 public:
  explicit ReadyBoard(const BoardKind& kind = kSmallBoard, const Pneumatics::Config& muscles = {})
      : SimulatedBoard(kind, muscles) {
    advance(0.05);
    ventAll();
  }

  std::string order(int channel, const std::string& what) {
    return ask("p" + std::to_string(channel) + "=" + what);
  }
  void orderAll(const std::string& what) {
    for (int i = 0; i < channels(); ++i) order(i, what);
  }
  void ventAll() { orderAll("vent"); }
  /// Repeats an order of all channels for so long [s], as a host does that is alive.
  void keep(const std::string& what, double duration) {
    const double end = time() + duration;
    while (time() < end) orderAll(what);
  }
};

}  // namespace helix_arm::test
