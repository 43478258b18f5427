#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calibration_checks.hpp"
#include "helix_arm/calibration/suspects.hpp"

/// Mistakes that are usual on a rig, and what the data would be without each of them. Captures and
/// recorded motions are fitted under every hypothesis (suspects.cpp).
namespace helix_arm::estimation {

/// Data and request of a calibration; mistakes are those of the first arm.
struct CalibrationInput {
  std::vector<ArmCaptures> arms;
  CalibrationOptions options;
};

/// Sizes of a mistake, of which the best is searched; a mistake without a size has one of them.
struct FaultSize {
  std::vector<double> grid = {0.0};  ///< ascending, where the search begins
  double neutral = 0.0;              ///< the size that changes nothing
  double least = 0.0;                ///< a size closer than this to the neutral one is no mistake

  bool isSearched() const { return grid.size() > 1; }
};

/// A mistake that may have been made, with one of these corrections.
struct FaultHypothesis {
  std::string cause;
  std::string subject;  ///< empty: the muscle whose fitted length is the odd one
  /// Remedy, by a calibration without the mistake; nothing if that shows that there was none.
  /// Remedies of mistakes in pressures or in a recording do not depend on the calibration.
  std::function<std::optional<std::string>(double size, const Calibration&)> remedy;

  /// From the pressures that were read to those in the muscles (rows x actuators) [Pa].
  std::function<void(double size, Eigen::MatrixXd&)> correct_pressures = nullptr;
  std::function<void(double size, CalibrationInput&)> correct_captures = nullptr;
  /// In the scene, or by parameters that are fitted as well.
  std::function<void(double size, CalibrationInput&)> correct_scene = nullptr;
  std::function<void(TipSeries&)> correct_recording = nullptr;

  FaultSize size = {};
  bool of_all = false;  ///< one size for all channels
  int freed = 0;        ///< parameters that are fitted beyond those requested
  /// From the tags of the scene to those on the arm, if the mistake is one of them.
  std::function<void(double size, TagLayout&)> correct_tags = nullptr;
};

/// A remedy that no calibration changes.
inline auto always(std::string remedy) {
  return [remedy = std::move(remedy)](double, const Calibration&) { return std::optional(remedy); };
}

/// Exchanged channels, another unit, gains and offsets of one channel or all (offsets in parts of
/// the range), channels without pressure.
std::vector<FaultHypothesis> pressureHypotheses(const model::Arm& arm);

/// Tags, pictures, pose of base or camera, lengths, load: those that these readings can show and
/// that the request does not fit.
std::vector<FaultHypothesis> rigHypotheses(const ArmCaptures& arm,
                                           const CalibrationOptions& options, ReadingKind kind);
/// A tag that is glued turned.
/// @param tag  index in the layout.
std::vector<FaultHypothesis> turnHypotheses(int tag, const TagLayout& layout);

/// Deviations of a base or camera that was knocked.
constexpr BasePrior kMovedBase{0.3, 0.6};
/// Angle of a pose's rotation [rad].
double turnOf(const lie::SE3& pose);
/// Index of the muscle whose scale differs most from the others'.
int oddMuscle(const Eigen::VectorXd& scales);

}  // namespace helix_arm::estimation
