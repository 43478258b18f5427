#pragma once

#include <string>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/follow_run.hpp"
#include "nlohmann/json.hpp"

namespace helix_arm::cli {

/// A simulated run with what was asked for.
struct FollowReport {
  const io::Scene& scene;
  std::string rig;  ///< file of the rig's scene; empty if that is `scene`
  const procedures::FollowPlan& plan;
  const procedures::FollowResult& result;
  std::string out, png;  ///< files; empty where there is none
};

/// Why there are no figures; empty if there are.
std::string failureOf(const FollowReport& report);
nlohmann::json toJson(const FollowReport& report);
/// One row a turn, after a comment.
std::string csvOf(const FollowReport& report);
void printText(const FollowReport& report);

/// What plot_report draws.
/// @param open  the same run with the loop open; null to draw the run alone.
nlohmann::json plotOf(const FollowReport& report, const procedures::FollowResult* open);

}  // namespace helix_arm::cli
