#include "tip_error.hpp"

#include <utility>
#include <variant>

#include "helix_arm/basics/median.hpp"

namespace helix_arm::procedures {

std::optional<double> medianTipError(const io::Scene& scene,
                                     const std::vector<estimation::Capture>& captures) {
  using Corners = std::vector<estimation::CornerObservation>;
  using Poses = std::vector<estimation::PoseObservation>;
  if (!scene.tags) return std::nullopt;
  estimation::TwistFitter fitter(*scene.tags, scene.arm.sectionCount(), scene.vision.fit);
  std::vector<double> errors;
  for (const estimation::Capture& capture : captures) {
    const auto* const corners = std::get_if<Corners>(&capture.reading);
    const auto* const poses = std::get_if<Poses>(&capture.reading);
    const bool seen = (corners != nullptr && !corners->empty() && scene.camera) ||
                      (poses != nullptr && !poses->empty());
    if (!seen) continue;
    const statics::Solution model = scene.model.solve(capture.pressure);
    if (!model.converged()) continue;
    const estimation::TwistFit& fit =
        corners != nullptr
            ? fitter.fitCold(*corners, scene.X_CB(), scene.camera->model.focal(), model.shape)
            : fitter.fitCold(*poses, model.shape);
    if (fit.status != estimation::FitStatus::kConverged) continue;
    const lie::SE3 tip = fit.X_B0B * model::tipPose(fit.shape);
    errors.push_back((tip.translation - model.tip.translation).norm());
  }
  if (errors.empty()) return std::nullopt;
  return basics::medianOf(std::move(errors));
}

}  // namespace helix_arm::procedures
