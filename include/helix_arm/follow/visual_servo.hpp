#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "helix_arm/control/pressure_observer.hpp"
#include "helix_arm/control/tip_path.hpp"
#include "helix_arm/follow/visual_servo_config.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/tracking/arm_filter.hpp"
#include "helix_arm/tracking/error_budget.hpp"
#include "helix_arm/tracking/onset_hypotheses.hpp"
#include "helix_arm/tracking/response_estimator.hpp"

namespace helix_arm::follow {

enum class LoopState {
  kIdle,       ///< no target, or the arm is not enabled: nothing is commanded
  kOpen,       ///< the inverse with the last correction; the arm is not seen yet, or no longer
  kClosed,     ///< the correction follows the pictures
  kCoasting,   ///< as open, for a moment without pictures
  kYielding,   ///< something is seen to touch the arm: correction and path stand still
  kDiverging,  ///< the error grows although the target stands still: the correction is frozen
  kDoubtful,   ///< the pictures have left what was learnt of the arm: the correction is frozen
};
inline constexpr int kLoopStateCount = 7;
/// "idle", "open", "closed", "coasting", "yielding", "diverging" or "doubtful".
const char* nameOf(LoopState state);

/// Target of a VisualServo: base frame, [m]. A pose is weighed as InverseOptions say.
using Target = std::variant<Eigen::Vector3d, lie::SE3, model::Twists>;

/// Result of one turn; references are valid until the next turn.
struct Turn {
  LoopState state = LoopState::kIdle;
  bool commands = false;     ///< `pressure` is to be sent; else nothing is
  Eigen::VectorXd pressure;  ///< (n) inside the limits [Pa]
  /// Result of the inverse of the corrected model at the wanted place.
  statics::InverseStatus status = statics::InverseStatus::kReached;
  double residual = 0.0;        ///< norm of the weighted error [m]
  double position_error = 0.0;  ///< distance from its tip to the wanted place [m]
  /// Limits at which the actuators are, (n).
  std::vector<statics::Limit> limits;
  lie::SE3 wanted;  ///< tip at this time
  /// Tip of the corrected model at the present pressures, where a load that was found takes it.
  std::optional<lie::SE3> predicted;
  std::optional<double> path_time;  ///< since the path's start; negative on the way to it [s]
  /// Something touches the arm, or did when it was last seen, and OnContact asks the loop to stand
  /// still: correction and path do, in every state.
  bool held = false;
};

/// Shape of the corrected model at the present pressures, and how uncertain it is. The placements
/// of tags and base, which no filter sees, add to that: see TipErrorBudget.
struct Prediction {
  model::Shape shape;
  Eigen::MatrixXd covariance;      ///< (6 sections x 6 sections) of its mean twists
  Eigen::Matrix3d tip_covariance;  ///< of its tip's position, base frame [m^2]
};

/// Brings the tip where it is wanted, by comparing each measured shape with the model at the
/// pressures of the same instant and aiming with the corrected model: internal model control. There
/// is no integrator on the tip's error, so nothing winds up.
///
/// Without clock and threads: time is a number [s], given with the readings. Readings drive the
/// turns; pictures may arrive late. reading() does not allocate if nothing loads the arm.
class VisualServo {
 public:
  /// @param model  of the scene; copied.
  /// @throws std::invalid_argument naming the value and its rule.
  VisualServo(const statics::ArmModel& model, const VisualServoConfig& config);
  ~VisualServo();
  VisualServo(VisualServo&&) noexcept;
  VisualServo& operator=(VisualServo&&) noexcept;

  /// From the next turn on the arm goes there, and stays. Replaces a path.
  /// @throws std::invalid_argument as the InverseSolver does.
  void aimAt(const Target& target);
  /// From the next turn on the tip follows the path; from where it is now it first moves to the
  /// first point. After the last point it stays there. Replaces a target.
  void follow(control::TipPath path);
  /// No target: idle.
  void release();
  /// Keeps the present wanted place as target; ends a path.
  void hold();
  bool hasTarget() const;

  /// Whether the arm follows commands. While it does not, the loop is idle; when it does again, it
  /// starts from the present tip.
  void enable(bool enabled);
  /// False: the correction fades out, while the filters go on.
  void close(bool closed);
  /// Forgets what was learnt; the correction fades over a second.
  void reset();
  /// Reaction while something touches the arm, from now on.
  void setOnContact(OnContact reaction);
  /// Whether nothing counts as the begin of a contact, so that quiet() shows what would: see
  /// estimation::OnsetHypotheses::ignoreContacts().
  void ignoreContacts(bool ignores);
  /// Whether the arm is known not to move as its model says: no contact is looked for then, and one
  /// that was found ends.
  void distrustModel(bool distrusts);
  /// Score from which on something touches the arm.
  double contactLimit() const;

  /// One turn. @param set_point  (n) in force since the last turn [Pa]. @param reading  (n) [Pa].
  const Turn& reading(double time, const Eigen::VectorXd& set_point,
                      const Eigen::VectorXd& reading);

  /// A measured shape. @param stamp  time of the picture [s]. @param now  present time [s].
  /// @param twists  (6 x sections). @param covariance  (6 sections x 6 sections) of their errors.
  /// @param tags    indices in the layout of the tags that were fitted, outliers too, ascending;
  ///     nothing if unknown.
  /// @throws std::invalid_argument on a tag that the layout does not have.
  estimation::Observation picture(double stamp, double now, const model::Twists& twists,
                                  const Eigen::MatrixXd& covariance,
                                  const std::optional<std::vector<int>>& tags = std::nullopt);

  /// The last picture that was not refused for its stamp, with the effective pressures of its time
  /// and without swinging, whose uncertainty and that of lags are part of its noise.
  const estimation::ArmFilter::Input& seen() const;

  /// As of the last turn; nothing before the first one, or if no shape balances the load.
  std::optional<Prediction> prediction() const;
  LoopState state() const;
  const Turn& turn() const;  ///< the last one
  const control::PressureObserver& observer() const;
  const estimation::ArmFilter& tracker() const;
  const estimation::ArmFilter& watch() const;
  /// Mode of vibration that the loop reckons with, told or found in the pictures; nothing if the
  /// arm shows none.
  const std::optional<estimation::Mode>& mode() const;
  /// How the arm follows its pressures, by the pictures.
  const estimation::ResponseEstimator& response() const;
  /// Error budget of the watch, at the last accepted picture; nothing before the first.
  const std::optional<estimation::TipErrorBudget>& budget() const;
  /// Whether a picture was accepted within VisualServoConfig::coast_time before the last turn; else
  /// budget() and load() are out of date.
  bool sees() const;
  /// External load on the arm, as of the last picture.
  const estimation::ExternalLoad& load() const;
  /// Scores that would have counted as a contact since the last ignoreContacts(true).
  const estimation::QuietScore& quiet() const;
  /// Whether the pictures agree with what was learnt of the arm, as of the last one.
  const estimation::Drift& drift() const;
  /// Distance of the measured tip (with ExternalLoad::tip_beyond_fit) from the wanted one at the
  /// time of the last picture [m]; nothing if none was wanted then.
  std::optional<double> error() const;
  /// Standard deviation of the predicted tip along its worst direction [m]; infinite before the
  /// first picture.
  double tipDeviation() const;

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

}  // namespace helix_arm::follow
