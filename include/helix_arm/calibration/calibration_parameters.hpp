#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "helix_arm/calibration/calibration.hpp"

/// The table of what a calibration can fit. The words of a request with their messages and help,
/// and the names, units and priors of the fitted numbers derive from it.
namespace helix_arm::estimation {

/// Words of a request that stand for several parameters.
enum class FitGroup { kNone, kStiffness, kPlacement };
/// Default of a request without words.
constexpr FitGroup kDefaultFitGroup = FitGroup::kStiffness;

/// Data that is required to determine a parameter.
enum class FitNeed {
  kArm,          ///< any capture of an arm
  kLoad,         ///< captures of an arm under load
  kFreeLengths,  ///< free lengths of an actuator
  kSeries,       ///< free lengths, or positions of the tip, in the order taken
  kTags,         ///< captures of tags; the parameter belongs to one rig
  kCorners,      ///< captures of tag corners; the parameter belongs to one rig
};

/// Standard deviation of a number's prior, > 0.
using FitPrior = double (*)(const CalibrationOptions& options);

/// One number of a fit parameter.
struct FitNumber {
  const char* suffix;  ///< suffix of its name
  const char* unit;    ///< empty if unitless
  FitPrior prior;      ///< in this unit; for stiffness and scales, of the logarithm
};

/// One row of the table.
struct FitParameterInfo {
  FitParameter parameter;
  const char* word;  ///< word in requests
  const char* name;  ///< name of its numbers in results, without their suffixes
  FitGroup group;
  FitNeed need;
  /// Absent for contraction, response, mode, mass, damping and rings, which have separate fits.
  std::optional<ParameterBlock> block = {};
  std::vector<FitNumber> numbers = {};  ///< for one actuator, tag or rig

  /// Whether it is an entry of a stiffness: a ratio to K_eps, or K_eps.
  bool isStiffness() const { return block == ParameterBlock::kStiffness; }
  /// Whether it is a stiffness or a scale, which determines the shape of the arm and is fitted as a
  /// logarithm.
  bool aboutShape() const;
  /// Whether its block holds nothing else, unlike those of stiffness and length scales.
  bool hasOwnBlock() const { return aboutRig() || eachActuator(); }
  /// Whether it describes the rig: base, tags and border shift.
  bool aboutRig() const;
  /// Whether it is fitted for every actuator, in a block of its own.
  bool eachActuator() const { return block == ParameterBlock::kStrokeScale; }
  /// Whether it is fitted with tag corners, requested or not: ignoring it causes an error of many
  /// standard errors.
  bool implied() const { return block == ParameterBlock::kBorderShift; }
  /// Whether its prior uncertainty adds to the errors of the other parameters if it is not fitted.
  /// The others count as exact.
  bool uncertainIfHeld() const;
};

/// The table; row i describes the parameter with value i.
const std::vector<FitParameterInfo>& fitParameters();
const FitParameterInfo& infoOf(FitParameter parameter);  ///< row of a parameter

/// All words of a request, groups before their members.
std::vector<std::string> fitWords();
/// All words as one text, each group with its members.
std::string fitWordsText();
/// "stiffness" or "placement"; empty for kNone.
const char* wordOf(FitGroup group);

/// The parameters that the words of a request name.
///
/// @param words  elements of fitWords(); none: kDefaultFitGroup.
/// @param corners  whether the captures are of tag corners. Otherwise, a group omits its members
///     that need them.
/// @throws std::invalid_argument naming the first unknown word in alphabetical order.
std::set<FitParameter> fitParametersOf(const std::vector<std::string>& words, bool corners);

}  // namespace helix_arm::estimation
