#include "helix_arm/procedures/capture_scatter.hpp"

#include <cstddef>
#include <cstdio>
#include <optional>
#include <variant>

namespace helix_arm::procedures {

estimation::CaptureScatter scatterOfPoses(const estimation::TwistFit& fit, bool planar) {
  return estimation::scatterOf(fit, 3, planar);
}

std::string scatterText(double rms, double usual) {
  char text[256];
  std::snprintf(
      text, sizeof text,
      "no shape explains it: the tags that fit best are off by RMS %.1f mm, usual in this "
      "data set are %.1f mm; look for swapped or moved tags, or leave the capture out",
      1e3 * rms, 1e3 * usual);
  return text;
}

std::vector<std::string> warningsOfScatter(const io::Scene& scene,
                                           const std::vector<estimation::Capture>& captures) {
  if (!scene.tags) return {};
  estimation::TwistFitter fitter(*scene.tags, scene.arm.sectionCount(), scene.vision.fit);
  std::vector<std::optional<estimation::CaptureScatter>> scatter;
  for (const estimation::Capture& capture : captures) {
    scatter.emplace_back();
    const auto* const poses =
        std::get_if<std::vector<estimation::PoseObservation>>(&capture.reading);
    if (poses == nullptr || poses->empty()) continue;
    const statics::Solution model = scene.model.solve(capture.pressure);
    const estimation::TwistFit& fit =
        fitter.fitCold(*poses, statics::startingShape(scene.model, model, capture.pressure));
    if (fit.status != estimation::FitStatus::kConverged) continue;
    scatter.back() = scatterOfPoses(fit, scene.vision.fit.planar);
  }
  const estimation::CaptureCheck check = estimation::checkCaptures(scatter);
  std::vector<std::string> out;
  for (std::size_t i = 0; i < captures.size(); ++i) {
    if (!check.apart[i]) continue;
    out.push_back("capture " + std::to_string(captures[i].number) + ": " +
                  scatterText(scatter[i]->rms, *check.usual));
  }
  return out;
}

}  // namespace helix_arm::procedures
