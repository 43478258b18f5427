#include "ros_bridge/calibration/recording.hpp"

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/content_hash.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "ros_bridge/calibration/bag_captures.hpp"
#include "ros_bridge/common/file_access.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr char kRecorded[] = "recorded samples";
constexpr char kRecordedSeries[] = "recorded series";

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
  if (series.empty()) return out;
  out.tips = series;
  out.sources.push_back({kRecordedSeries, io::sha256Of(procedures::tipSeriesCsv(series, "")),
                         static_cast<int>(series.history.rows())});
  if (left_out > 0) {
    out.warnings.push_back("the series of the tip has no room for its last " +
                           std::to_string(left_out) + " rows; expected a run of fewer steps");
  }
  return out;
}

std::string Recording::table() const {
  return io::tagCornerCsv(numbered(samples, scene.arm), scene.arm.actuatorCount(),
                          kRecordedTitle + scene.name + ", " + procedures::utcNow());
}

std::string Recording::seriesTable() const {
  return procedures::tipSeriesCsv(series,
                                  kRecordedTitle + scene.name + ", " + procedures::utcNow());
}

}  // namespace helix_arm::ros_bridge
