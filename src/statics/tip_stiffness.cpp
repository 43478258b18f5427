#include "tip_stiffness.hpp"

#include <limits>

#include "compliance.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::statics {
namespace {

constexpr double kSmallTurn = 0.02;  // of the whole arm by the force [rad]
constexpr int kOrder = 4;

}  // namespace

TipStiffness::TipStiffness(const ArmModel& model) {
  const model::Arm& arm = model.arm();
  basics::require(model.load().has_value(),
                  "preference: the tip's stiffness needs arm.stiffness.K_eps_n in every section");
  double bending = 0.0;
  for (int k = 0; k < arm.sectionCount(); ++k) {
    bending += complianceOf(arm, *model.load(), k).bottomRightCorner<3, 3>().norm();
  }
  force_ = kSmallTurn / (bending * arm.restLength());
  const TierSetting exact{Tier::kExact, 0};
  const TierSetting setting =
      model.choice().setting.tier == Tier::kExact ? exact : TierSetting{Tier::kLoaded, kOrder};
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {1.0, -1.0}) {
      Load load = *model.load();
      PointLoad tip;
      tip.section = arm.sectionCount() - 1;
      tip.offset = arm.link(tip.section).translation;
      tip.force = sign * force_ * Eigen::Vector3d::Unit(axis);
      load.points.push_back(tip);
      pushed_.emplace_back(arm, std::nullopt, std::move(load), setting);
    }
  }
}

double TipStiffness::compliance(const Eigen::VectorXd& lengths) const {
  double sum = 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    const Tip with = pushed_[2 * axis].tipOfLengths(lengths);
    const Tip against = pushed_[2 * axis + 1].tipOfLengths(lengths);
    if (!with.converged() || !against.converged()) return std::numeric_limits<double>::infinity();
    sum += (with.tip.translation - against.tip.translation)[axis] / (2.0 * force_);
  }
  return sum;
}

}  // namespace helix_arm::statics
