#include "helix_arm/localization/placed_view.hpp"

#include <Eigen/Cholesky>
#include <cmath>

#include "twist_equations.hpp"

namespace helix_arm::estimation {
namespace {

// Factor on priors that are to say hardly anything.
constexpr double kWide = 30.0;

lie::Vector6 bothParts(double translation, double rotation) {
  lie::Vector6 out;
  out << Eigen::Vector3d::Constant(translation), Eigen::Vector3d::Constant(rotation);
  return out;
}

// Errors of all parameters of a fit by one standard deviation of each entry of the placements: six
// columns for each tag of the layout, six for the base. A tag that is not fitted has none.
template <class Model, class Observe>
std::optional<Eigen::MatrixXd> errorsOfFit(const PlacedView& placed, const model::Arm& arm,
                                           const model::Shape& shape, const std::vector<int>& tags,
                                           const Model& instrument, const Observe& observe) {
  TwistEquations equations(placed.view.layout, placed.view.sections, placed.fit);
  equations.expect(shape);
  FitPoint point;
  equations.start(shape.twists(), point);
  std::vector<typename Model::Observation> seen;
  seen.reserve(tags.size());
  for (const int tag : tags) seen.push_back(observe(point.shape, tag));
  NormalEquations system;
  equations.evaluate(instrument, seen, -1, point, system);
  if (!std::isfinite(point.cost)) return std::nullopt;

  const Eigen::LLT<Eigen::MatrixXd> factors(system.hessian);
  const Eigen::Index size = system.gradient.size();
  const auto count = static_cast<Eigen::Index>(placed.view.layout.tags.size());
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(size, 6 * (count + 1));
  const auto set = [&](Eigen::Index placement, const Eigen::MatrixXd& gradient,
                       const lie::Vector6& deviations) {
    out.middleCols<6>(6 * placement) = factors.solve(gradient) * deviations.asDiagonal();
  };
  Eigen::MatrixXd by_base = Eigen::MatrixXd::Zero(size, 6);
  for (const auto& one : seen) {
    const auto index = static_cast<std::size_t>(one.tag);
    const TagPlacement& tag = placed.view.layout.tags[index];
    const Eigen::MatrixXd by_motion = equations.gradientByMotion(instrument, one, point);
    set(one.tag, by_motion * motionsOf(tag, arm.restLength(tag.section), point.shape),
        placed.deviations.tags[index]);
    by_base += by_motion;
  }
  set(count, by_base, placed.deviations.base);
  return out;
}

std::optional<Eigen::MatrixXd> errorsOfFit(const PlacedView& placed, const model::Arm& arm,
                                           const model::Shape& shape,
                                           const std::vector<int>& tags) {
  return withInstrument(placed.view, placed.fit, [&](const auto& instrument, const auto& observe) {
    return errorsOfFit(placed, arm, shape, tags, instrument, observe);
  });
}

Eigen::MatrixXd covarianceOf(const Eigen::MatrixXd& errors) { return errors * errors.transpose(); }

}  // namespace

PlacementDeviations::PlacementDeviations(const TagLayout& layout, const TagPrior& tag,
                                         const BasePrior& base_prior)
    : tags(layout.tags.size(), bothParts(tag.translation, tag.rotation)),
      base(bothParts(base_prior.translation, base_prior.rotation)) {
  if (const int base_tag = layout.baseTag(); base_tag >= 0) {
    tags[static_cast<std::size_t>(base_tag)].setZero();
  }
}

std::optional<Eigen::MatrixXd> placementCovariance(const PlacedView& placed, const model::Arm& arm,
                                                   const model::Shape& shape,
                                                   const std::vector<int>& tags) {
  const auto errors = errorsOfFit(placed, arm, shape, tags);
  if (!errors) return std::nullopt;
  return covarianceOf(errors->topRows(6 * placed.view.sections));
}

std::optional<Eigen::MatrixXd> placementDifference(const PlacedView& placed, const model::Arm& arm,
                                                   const model::Shape& shape,
                                                   const std::vector<int>& tags,
                                                   const std::vector<int>& others) {
  const auto errors = errorsOfFit(placed, arm, shape, tags);
  const auto of_others = errorsOfFit(placed, arm, shape, others);
  if (!errors || !of_others) return std::nullopt;
  return covarianceOf((*of_others - *errors).topRows(6 * placed.view.sections));
}

std::optional<RigEstimate::Matrix> rigByPlacements(const PlacedView& placed, const model::Arm& arm,
                                                   const model::Shape& shape,
                                                   const std::vector<int>& tags) {
  PlacedView free = placed;
  free.deviations.base.setZero();
  free.fit.base_prior.translation *= kWide;
  free.fit.base_prior.rotation *= kWide;
  free.fit.border_shift_prior *= kWide;
  const auto errors = errorsOfFit(free, arm, shape, tags);
  if (!errors) return std::nullopt;
  RigEstimate::Matrix out = RigEstimate::Matrix::Zero();
  const int first = placed.fit.free_base ? 0 : 6;
  const int count = (placed.fit.free_base ? 6 : 0) + (placed.fit.free_border_shift ? 1 : 0);
  out.block(first, first, count, count) = covarianceOf(errors->bottomRows(count));
  return out;
}

}  // namespace helix_arm::estimation
