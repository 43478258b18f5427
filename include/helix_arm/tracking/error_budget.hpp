#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "helix_arm/localization/placed_view.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/tracking/arm_filter.hpp"

namespace helix_arm::estimation {

/// Sources of the tip's uncertainty.
enum class BudgetPart {
  kCalibration,  ///< stiffness and lengths
  kUnexplained,  ///< the bias of the arm, and its correlation with stiffness and lengths
  kPressure,     ///< readings, and what unknown play and lags make of their last changes
  kPlacement,    ///< tags and base: it does not average out, and no filter sees it
  kCamera,       ///< one picture
};
inline constexpr int kBudgetPartCount = 5;  ///< number of parts
/// "calibration", "unexplained", "pressure", "placement" or "camera".
const char* nameOf(BudgetPart part);

/// Whether the budget explains the error.
enum class BudgetState {
  kInside,   ///< the scene's calibration explains what is measured
  kOutside,  ///< it does not: a load, slip or a changed muscle
};
/// "inside" or "outside".
const char* nameOf(BudgetState state);

/// Uncertainty of the tip's position, base frame.
struct TipSpread {
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< [m^2]
  /// Standard deviation along the worst direction [m]; 0 where no variance is positive.
  double deviation() const;
};

/// How far an error of the tip is from what its covariance explains.
struct TipDistance {
  double squared = 0.0;  ///< Mahalanobis distance, error' covariance^-1 error
  /// 99.9 % point of chi-square for the directions in which the tip is uncertain: 16.3 for 3, 13.8
  /// in a plane.
  double limit = 0.0;
};
/// @param error  [m]. @param covariance  of it [m^2]; directions without variance do not count.
TipDistance tipDistance(const Eigen::Vector3d& error, const Eigen::Matrix3d& covariance);

/// Where the tip's uncertainty comes from, at the pressures of one picture.
struct TipErrorBudget {
  double time = 0.0;  ///< of the picture [s]
  /// In the order of BudgetPart. kUnexplained may be negative along some directions: only its sum
  /// with kCalibration is a covariance.
  std::array<TipSpread, kBudgetPartCount> parts;
  TipSpread predicted;  ///< of the filter's tip: all parts except the camera's
  TipSpread open_loop;  ///< of the scene's tip: the same sum before anything was learnt
  Eigen::Vector3d tip = Eigen::Vector3d::Zero();    ///< the filter's, base frame [m]
  Eigen::Vector3d error = Eigen::Vector3d::Zero();  ///< measured tip minus that of the scene [m]
  /// error' (open_loop + camera)^-1 error, and the limit of that: see TipDistance.
  double distance2 = 0.0, limit = 0.0;
  /// Changes after kBudgetPatience pictures in a row that say so; kOutside at once while the tip
  /// drifts.
  BudgetState state = BudgetState::kInside;

  const TipSpread& part(BudgetPart which) const { return parts[static_cast<std::size_t>(which)]; }
};

/// Pictures in a row on one side of the limit that change the budget's state.
inline constexpr int kBudgetPatience = 5;

/// The live error budget of an arm that a filter watches.
///
/// The placements' part and the derivatives of the scene's model are computed anew when a pressure
/// has moved by 10 kPa or the tags in sight have changed.
class ErrorBudget {
 public:
  /// @param model    of the scene.
  /// @param options  of the filter: its deviations at the start are what the calibration promises.
  /// @param placed    nothing: the placements count as exact.
  /// @throws std::invalid_argument naming the value and its rule.
  ErrorBudget(const statics::ArmModel& model, const ArmFilterOptions& options,
              std::optional<PlacedView> placed = std::nullopt);

  /// Takes a picture that the filter has accepted.
  /// @param filter  of this arm, with the same rows and parameters.
  /// @param tags    indices of the fitted tags; nothing: those that face the camera.
  /// @param drifts  the tip has left what was learnt of the arm: see Drift.
  /// @return false if no shape balances the load at these pressures; the budget stays as it is.
  bool update(const ArmFilter& filter, const ArmFilter::Input& picture,
              const std::optional<std::vector<int>>& tags = std::nullopt, bool drifts = false);

  /// Nothing before the first picture.
  const std::optional<TipErrorBudget>& current() const { return current_; }
  /// Forgets the pictures.
  void reset();

 private:
  // Parts that change little from picture to picture.
  struct Slow {
    Eigen::VectorXd pressure;        // at which it holds (n) [Pa]
    std::vector<int> tags;           // in sight
    ArmFilter::Linearisation scene;  // the model of the scene
    Eigen::MatrixXd placement;       // (6 sections x 6 sections)
  };
  bool renew(const Eigen::VectorXd& pressure, const model::Shape& shape,
             const std::optional<std::vector<int>>& tags);
  void judge(TipErrorBudget& budget, bool drifts);

  const model::Arm arm_;
  const ArmFilter start_;  // learns nothing
  const std::optional<PlacedView> placed_;
  std::optional<Slow> slow_;
  int changes_ = 0;  // pictures in a row that contradict the state
  std::optional<TipErrorBudget> current_;
};

}  // namespace helix_arm::estimation
