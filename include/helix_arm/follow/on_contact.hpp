#pragma once

#include <cstdint>

namespace helix_arm::follow {

/// What the loop does while something touches the arm.
enum class OnContact : std::uint8_t {
  kReport,  ///< goes on: a payload is carried
  kYield,   ///< correction and path stand still, so that the force does not grow
  kStop,    ///< gives the path up and holds the command
};
/// All reactions. Add a new one here, too.
inline constexpr OnContact kContactReactions[] = {OnContact::kReport, OnContact::kYield,
                                                  OnContact::kStop};

/// "report", "yield" or "stop".
constexpr const char* nameOf(OnContact reaction) {
  switch (reaction) {
    case OnContact::kYield:
      return "yield";
    case OnContact::kStop:
      return "stop";
    case OnContact::kReport:
      break;
  }
  return "report";
}

}  // namespace helix_arm::follow
