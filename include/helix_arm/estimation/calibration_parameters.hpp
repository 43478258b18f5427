#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "helix_arm/estimation/calibration.hpp"

/// The table of what a calibration can fit. The words of a request with their messages and help,
/// the options of the fit, and the names, units and priors of the fitted numbers derive from it.
namespace helix_arm::estimation {

/// In the order of the table, which is that of messages and help.
enum class FitParameter {
  kKappa,
  kGamma,
  kTau,
  kEps,
  kLengthScale,
  kLengthScaleEach,
  kContraction,
  kBase,
  kTags,
  kBleed,
};
constexpr int kFitParameterCount = static_cast<int>(FitParameter::kBleed) + 1;

/// Words of a request that stand for several parameters.
enum class FitGroup { kNone, kStiffness, kPlacement };
/// What a request without words asks for.
constexpr FitGroup kDefaultFitGroup = FitGroup::kStiffness;

/// What the data must be of to determine a parameter.
enum class FitNeed {
  kArm,          ///< any capture of an arm
  kLoad,         ///< captures of an arm under load
  kFreeLengths,  ///< free lengths of an actuator
  kTags,         ///< captures of tags; the parameter belongs to one rig
  kCorners,      ///< captures of tag corners; the parameter belongs to one rig
};

/// Blocks of the least squares that hold the numbers of parameters.
enum class ParameterBlock {
  kStiffness,    ///< logs of all fitted entries of the stiffness
  kLengthScale,  ///< logs of all length scales
  kBase,
  kBleed,
  kTag,    ///< of one tag
  kShape,  ///< twists of one capture; no parameter of a request
};

/// The entries of a stiffness that can be fitted; kEps is the one that the others are ratios to.
enum class StiffnessEntry { kKappa, kGamma, kTau, kEps };

/// What is known of a number before the fit.
struct FitPrior {
  const char* what;                                        ///< in messages
  double (*deviation)(const CalibrationOptions& options);  ///< standard deviation, > 0
};

/// One number of a parameter.
struct FitNumber {
  const char* suffix;  ///< of its name
  const char* unit;    ///< empty without one
  FitPrior prior;      ///< in this unit; of stiffness and length scales, of the log
};

/// A row of the table.
struct FitParameterInfo {
  FitParameter parameter;
  const char* word;  ///< in requests
  const char* name;  ///< of its numbers in results, before their suffixes
  FitGroup group;
  FitNeed need;
  /// None for contraction, which has a fit of its own.
  std::optional<ParameterBlock> block = {};
  std::optional<StiffnessEntry> entry = {};
  std::vector<FitNumber> numbers = {};  ///< of one actuator, tag or rig
  // The option that it sets: a flag, or the kind of length scaling; contraction sets none.
  bool CalibrationOptions::*flag = nullptr;
  LengthScaling scaling = LengthScaling::kNone;
  /// Fitted with tag corners whether requested or not: ignoring it causes an error of many standard
  /// errors.
  bool implied = false;
  /// What is unknown of it adds to the errors of the other parameters where it is not fitted. The
  /// others count as exact.
  bool uncertain_if_held = false;

  /// Stiffness or length scale: the shape of the arm depends on it, and its log is fitted.
  bool aboutShape() const;
  /// Its data shows the rig: base, tags and bleed.
  bool aboutRig() const;
};

/// The table: row i is that of the parameter with the value i.
const std::vector<FitParameterInfo>& fitParameters();
const FitParameterInfo& infoOf(FitParameter parameter);

/// All words of a request, groups before their members.
std::vector<std::string> fitWords();
/// All words as one text, each group with its members.
std::string fitWordsText();
/// "stiffness" or "placement"; empty for kNone.
const char* wordOf(FitGroup group);

/// The parameters that the words of a request name.
///
/// @param words  of fitWords(); none: kDefaultFitGroup.
/// @param corners  whether the captures are of tag corners. Without them a group leaves out its
/// members that need them.
/// @throws std::invalid_argument naming the first unknown word in alphabetical order.
std::set<FitParameter> fitParametersOf(const std::vector<std::string>& words, bool corners);

/// Sets the options to fit these parameters, and no others.
void setFitted(const std::set<FitParameter>& parameters, CalibrationOptions& options);
bool isFitted(const FitParameterInfo& info, const CalibrationOptions& options);

}  // namespace helix_arm::estimation
