#include "contact_watch.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>

#include "helix_arm/estimation/twist_fit.hpp"

namespace helix_arm::follow {
namespace {

// Both the old and the new set of tags have placement errors.
constexpr double kTagChange = 2.0;

estimation::TipCompliance complianceOf(const statics::ArmModel& model,
                                       const SightLoopConfig& config) {
  if (!config.sight) return estimation::TipCompliance(model);
  return {model, config.sight->view, config.sight->fit};
}

double largestDeviation(const Eigen::Matrix3d& covariance) {
  return std::sqrt(
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvalues().maxCoeff());
}

}  // namespace

ContactWatch::ContactWatch(const statics::ArmModel& model, const SightLoopConfig& config)
    : arm_(model.arm()),
      sight_(config.sight),
      compliance_(complianceOf(model, config)),
      forks_(config.contact) {}

void ContactWatch::see(const estimation::ArmFilter::Input& picture,
                       const std::optional<std::vector<int>>& tags, estimation::ArmFilter& watch) {
  // A picture that is not used, such as a repeated one, says nothing of the tags either.
  if (watch.check(picture) != estimation::SightingFault::kNone) return;
  if (tags) takeTags(picture, *tags, watch);
  const estimation::Sighting sighting = watch.see(picture);
  if (!sighting.accepted() && sighting.fault != estimation::SightingFault::kOutlier) return;
  compliance_.moveTo(picture.pressure, watch.correction(), tags);
  const Eigen::Matrix3d tip =
      estimation::tipCovariance(model::shapeOf(arm_, picture.twists), watch.twistCovariance(0.0));
  forks_.see(picture.time, largestDeviation(tip), watch, compliance_);
}

// Another set of tags has other placement errors; otherwise, occlusion would look like contact.
void ContactWatch::takeTags(const estimation::ArmFilter::Input& picture,
                            const std::vector<int>& tags, estimation::ArmFilter& watch) {
  const bool changed = tags_ && *tags_ != tags;
  tags_ = tags;
  if (!changed || !sight_) return;
  const auto shape = watch.shape(picture.pressure);
  if (!shape) return;
  const auto placement = estimation::placementCovariance(*sight_, arm_, *shape, tags);
  if (!placement) return;
  forks_.growBias(kTagChange * (*placement)(watch.rows(), watch.rows()), watch);
}

void ContactWatch::reset() {
  forks_.reset();
  tags_.reset();
}

}  // namespace helix_arm::follow
