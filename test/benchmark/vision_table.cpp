// What speed costs in accuracy: time, tags and errors of every way to search a picture, on rendered
// pictures of 720p of a moving arm, with clutter behind it. One thread.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <vector>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "support/picture_series.hpp"

namespace {

using namespace helix_arm;

struct Quality {
  const char* name;
  double blur, noise;  // [px], [gray levels]
};

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

void printRow(const test::PictureSeries& series, const char* quality, const char* mode_name,
              vision::TrackingMode mode, double decimate) {
  vision::LocalizerConfig config;
  config.detector.quad_decimate = decimate;
  config.tracking = mode;
  vision::ArmLocalizer localizer(series.view, config);
  std::vector<double> times, tip_errors;
  double found = 0, there = 0, square = 0;
  for (std::size_t i = 0; i < series.pictures.size(); ++i) {
    const auto begin = std::chrono::steady_clock::now();
    const vision::Observation& observation = localizer.locate(series.pictures[i], series.model[i]);
    times.push_back(
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin)
            .count());
    const auto visible = estimation::visibleTags(series.view, series.truth[i], 0.35);
    there += static_cast<double>(visible.size());
    for (const auto& tag : visible) {
      const int id = series.view.layout.tags[tag.tag].id;
      for (const auto& detection : observation.detections) {
        if (detection.id != id) continue;
        found += 1;
        square += (detection.corners - tag.corners).squaredNorm() / 4;
      }
    }
    if (observation.state != vision::ObservationState::kMeasured) continue;
    tip_errors.push_back(1e3 * (model::tipPose(observation.fit.twists).translation -
                                model::tipPose(series.truth[i]).translation)
                                   .norm());
  }
  std::printf("%-8s %-8s %8.1f %9.2f %7.0f %9.3f %11.2f %9.0f\n", quality, mode_name, decimate,
              median(times), 100 * found / there, std::sqrt(square / found),
              tip_errors.empty() ? NAN : median(tip_errors),
              100.0 * static_cast<double>(tip_errors.size()) / series.pictures.size());
}

}  // namespace

int main() {
  std::printf("%-8s %-8s %8s %9s %7s %9s %11s %9s\n", "picture", "tracking", "decimate", "ms",
              "tags %", "corner px", "tip med mm", "measured %");
  for (const Quality& quality : {Quality{"typical", 0.8, 3.0}, Quality{"bad", 1.5, 8.0}}) {
    simulation::SimulatedCameraConfig config;
    config.blur = quality.blur;
    config.noise = quality.noise;
    config.clutter = 12;
    const test::PictureSeries series(test::sampleView(0.8, 1, 20), 90, config);
    for (const double decimate : {1.0, 1.5, 2.0, 4.0}) {
      printRow(series, quality.name, "full", vision::TrackingMode::kFull, decimate);
    }
    for (const double decimate : {1.0, 2.0}) {
      printRow(series, quality.name, "edges", vision::TrackingMode::kEdges, decimate);
    }
  }
  return 0;
}
