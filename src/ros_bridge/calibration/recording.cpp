#include "helix_arm/ros_bridge/calibration/recording.hpp"

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/content_hash.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "helix_arm/ros_bridge/calibration/bag_captures.hpp"
#include "helix_arm/ros_bridge/common/file_access.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr char kRecorded[] = "recorded samples";

}  // namespace

procedures::CalibrationData Recording::data() const {
  const std::vector<io::TagCornerCapture> seen = numbered(samples, scene.arm);
  basics::require(
      !seen.empty(),
      "no sample was recorded; call record_sample or run_calibration first, or name data "
      "sets");
  procedures::CalibrationData out;
  out.captures = procedures::makeCaptures(scene, seen, kRecorded).captures;
  out.sources.push_back({kRecorded,
                         io::sha256Of(io::tagCornerCsv(seen, scene.arm.actuatorCount(), "")),
                         static_cast<int>(seen.size())});
  return out;
}

std::string Recording::table() const {
  return io::tagCornerCsv(numbered(samples, scene.arm), scene.arm.actuatorCount(),
                          kRecordedTitle + scene.name + ", " + procedures::utcNow());
}

}  // namespace helix_arm::ros_bridge
