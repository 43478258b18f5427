#include "contact_watch.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>

#include "helix_arm/localization/twist_fit.hpp"

namespace helix_arm::follow {
namespace {

// Pictures with other tags until these are the usual ones.
constexpr int kUsual = 15;

estimation::TipCompliance complianceOf(const statics::ArmModel& model,
                                       const VisualServoConfig& config) {
  if (!config.placed) return estimation::TipCompliance(model);
  return {model, config.placed->view, config.placed->fit};
}

double largestDeviation(const Eigen::Matrix3d& covariance) {
  return std::sqrt(
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvalues().maxCoeff());
}

}  // namespace

ContactWatch::ContactWatch(const statics::ArmModel& model, const VisualServoConfig& config)
    : arm_(model.arm()),
      placed_(config.placed),
      compliance_(complianceOf(model, config)),
      forks_(config.contact) {}

void ContactWatch::see(estimation::ArmFilter::Input picture,
                       const std::optional<std::vector<int>>& tags, bool settled,
                       estimation::ArmFilter& watch) {
  // A picture that is not used, such as a repeated one, says nothing of the tags either.
  if (watch.check(picture) != estimation::ObservationFault::kNone) return;
  if (tags) takeTags(*tags, picture, watch);
  const estimation::Observation observation = watch.see(picture);
  if (!observation.accepted() && observation.fault != estimation::ObservationFault::kOutlier)
    return;
  compliance_.moveTo(picture.pressure, watch.correction(), tags);
  const model::Shape measured = model::shapeOf(arm_, picture.twists);
  const Eigen::Matrix3d tip = estimation::tipCovariance(measured, watch.twistCovariance(0.0));
  forks_.see(picture.time, largestDeviation(tip), measured, settled, watch, compliance_);
}

// Other tags have other placement errors; otherwise, occlusion would look like contact. Tags at the
// edge of sight come and go: until others stay, what they err differently is an error of single
// pictures, which persists until then. It must not add to the bias at each change.
void ContactWatch::takeTags(const std::vector<int>& tags, estimation::ArmFilter::Input& picture,
                            estimation::ArmFilter& watch) {
  if (!usual_tags_) usual_tags_ = tags;
  unusual_ = tags == *usual_tags_ ? 0 : unusual_ + 1;
  if (unusual_ == 0 || !placed_) return;
  const auto shape = watch.shape(picture.pressure);
  if (!shape) return;
  const auto difference =
      estimation::placementDifference(*placed_, arm_, *shape, *usual_tags_, tags);
  if (!difference) return;
  if (unusual_ < kUsual) {
    picture.covariance += kUsual * *difference;
    return;
  }
  forks_.growBias((*difference)(watch.rows(), watch.rows()), watch);
  usual_tags_ = tags;
  unusual_ = 0;
}

void ContactWatch::reset() {
  forks_.reset();
  usual_tags_.reset();
  unusual_ = 0;
}

}  // namespace helix_arm::follow
