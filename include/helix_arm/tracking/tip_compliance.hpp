#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <vector>

#include "helix_arm/localization/arm_view.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/correction.hpp"

namespace helix_arm::estimation {

/// A place on the arm at which a force may act.
struct ForcePlace {
  int section = 0;  ///< counted from 0 at the base
  double s = 1.0;   ///< along that section, in [0, 1]
};

/// How the fitted mean twists change with a dead force (base frame) at the tip, or at another
/// place.
///
/// This is not the change of the strain's mean: a loaded curve is no constant twist, and the fit
/// weighs it by what the tags show. Without K_eps of the arm, forces are those on an arm of
/// kTypicalStiffness; divide them by it to get forces per K_eps.
class TipCompliance {
 public:
  /// K_eps of a McKibben muscle [N], for arms of unknown K_eps.
  static constexpr double kTypicalStiffness = 900.0;

  /// The mean of the strain counts: there is no camera.
  explicit TipCompliance(const statics::ArmModel& model);
  /// @param view  nominal, of this arm. @param fit  by which shapes are measured.
  TipCompliance(const statics::ArmModel& model, const ArmView& view, const TwistFitOptions& fit);
  ~TipCompliance();
  TipCompliance(TipCompliance&&) noexcept;
  TipCompliance& operator=(TipCompliance&&) noexcept;

  /// Whether K_eps of the arm is unknown.
  bool normalised() const;
  /// Least K_eps of the sections [N]; kTypicalStiffness if it is unknown.
  double stiffness() const;
  /// Quarters of each section from the base on; the last place is the tip, beyond a link. Only the
  /// tip if the arm has many sections, or as many loads inside them as a solver takes.
  const std::vector<ForcePlace>& places() const;

  /// Where the arm is now. What was computed elsewhere is forgotten if a pressure differs by 10 kPa
  /// from that, or if other tags are seen.
  /// @param pressure    (n) gauge [Pa]. @param correction  of the model.
  /// @param tags        indices of the fitted tags; nothing: those that face the camera.
  void moveTo(const Eigen::VectorXd& pressure, const statics::Correction& correction,
              const std::optional<std::vector<int>>& tags = std::nullopt);

  /// (6 sections x 3) change of the fitted mean twists by a force at a place, near where the arm
  /// is [m/N; rad/N]; a column is 0 if no shape balances such a force. After moveTo().
  const Eigen::MatrixXd& at(std::size_t place);
  const Eigen::MatrixXd& atTip() { return at(places().size() - 1); }
  /// How much farther such a force moves the tip, base frame, than the fitted twists say: they are
  /// those of an arm of constant twists [m/N]. 0 without a view of the arm: how its tip follows
  /// from measured twists is then unknown. Otherwise as at().
  const Eigen::Matrix3d& tipBeyondFit(std::size_t place);
  /// Whether a shape balances a force at the tip along every axis, so that no column of atTip() is
  /// 0 for want of one.
  bool complete();

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

}  // namespace helix_arm::estimation
