#include "least_tip_error.hpp"

#include <algorithm>
#include <utility>
#include <variant>
#include <vector>

namespace helix_arm::procedures {
namespace {

using estimation::ArmCaptures;
using estimation::Calibration;

// Twists fitted to the tags of each capture separately, if they determine one, with the calibrated
// placements.
ArmCaptures asTwists(const io::Scene& scene, const ArmCaptures& data,
                     const Calibration& calibration) {
  ArmCaptures out = data;
  out.captures.clear();
  model::Stiffness stiffness = calibration.stiffness.value();
  stiffness.kappa = data.arm.actuator(0).stiffness.kappa;
  out.arm = data.arm.withStiffness(stiffness);
  if (calibration.K_eps)
    std::fill(out.load->K_eps.begin(), out.load->K_eps.end(), *calibration.K_eps);
  estimation::TwistFitter fitter(calibration.layout, data.arm.sectionCount(), scene.vision.fit);
  const lie::SE3 X_BB0 = calibration.X_B0B.inverse(), X_CB = data.X_CB * calibration.X_B0B;
  for (std::size_t i = 0; i < data.captures.size(); ++i) {
    if (calibration.captures[i].outlier) continue;
    const estimation::Capture& capture = data.captures[i];
    const model::Shape& model = calibration.curves[i];
    estimation::Capture twists = capture;
    const auto* corners = std::get_if<std::vector<estimation::CornerObservation>>(&capture.reading);
    auto* poses = std::get_if<std::vector<estimation::PoseObservation>>(&twists.reading);
    if (poses != nullptr) {
      for (estimation::PoseObservation& seen : *poses) seen.X_BT = X_BB0 * seen.X_BT;
    }
    const estimation::TwistFit& fit = corners != nullptr
                                          ? fitter.fitCold(*corners, X_CB, data.focal, model)
                                          : fitter.fitCold(*poses, model);
    if (fit.status != estimation::FitStatus::kConverged) continue;
    twists.reading = estimation::TwistReading{fit.twists, fit.covariance};
    out.captures.push_back(std::move(twists));
  }
  return out;
}

}  // namespace

std::optional<estimation::LeastTipError> leastTipError(
    const io::Scene& scene, const ArmCaptures& data, const Calibration& calibration,
    const estimation::CalibrationOptions& options) {
  // The paper's definition has no other parameters.
  const bool fitted = options.K_kappa && calibration.stiffness;
  if (!fitted || options.length_scale != estimation::LengthScaling::kNone) return std::nullopt;
  const bool curvatures =
      std::holds_alternative<estimation::CurvatureReading>(data.captures.front().reading);
  if (curvatures) return estimation::fitLeastTipError({data});
  // The covariance of a planar twist is singular.
  if (data.planar) return std::nullopt;
  return estimation::fitLeastTipError({asTwists(scene, data, calibration)});
}

}  // namespace helix_arm::procedures
