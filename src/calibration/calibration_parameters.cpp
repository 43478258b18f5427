#include "helix_arm/calibration/calibration_parameters.hpp"

#include <algorithm>
#include <cstddef>
#include <stdexcept>
#include <utility>

#include "basics/text.hpp"

namespace helix_arm::estimation {
namespace {

using Options = CalibrationOptions;

double stiffnessPrior(const Options& o) { return o.stiffness_prior; }
double lengthScalePrior(const Options& o) { return o.length_scale_prior; }
double strokeScalePrior(const Options& o) { return o.stroke_scale_prior; }
double baseTranslation(const Options& o) { return o.base_prior.translation; }
double baseRotation(const Options& o) { return o.base_prior.rotation; }
double tagTranslation(const Options& o) { return o.tag_prior.translation; }
double tagRotation(const Options& o) { return o.tag_prior.rotation; }
double borderShiftPrior(const Options& o) { return o.border_shift_prior; }

// Three of a position and three of a rotation.
std::vector<FitNumber> poseNumbers(const char* x, FitPrior translation, FitPrior rotation) {
  return {{x, "m", translation},    {"_y", "m", translation}, {"_z", "m", translation},
          {"_rx", "rad", rotation}, {"_ry", "rad", rotation}, {"_rz", "rad", rotation}};
}

// "a, b, c", or "a and b".
std::string membersOf(FitGroup group) {
  std::vector<std::string> members;
  for (const FitParameterInfo& info : fitParameters()) {
    if (info.group == group) members.emplace_back(info.word);
  }
  return basics::joined(members, members.size() == 2 ? " and " : ", ");
}

}  // namespace

bool FitParameterInfo::aboutShape() const {
  return isStiffness() || block == ParameterBlock::kLengthScale || eachActuator();
}

bool FitParameterInfo::aboutRig() const {
  return need == FitNeed::kTags || need == FitNeed::kCorners;
}

bool FitParameterInfo::uncertainIfHeld() const {
  return (isStiffness() && parameter != FitParameter::kEps) || block == ParameterBlock::kTag ||
         block == ParameterBlock::kBorderShift;
}

const std::vector<FitParameterInfo>& fitParameters() {
  using P = FitParameter;
  using Block = ParameterBlock;
  constexpr FitGroup kNone = FitGroup::kNone, kRatio = FitGroup::kStiffness;
  constexpr FitGroup kPlacement = FitGroup::kPlacement;
  constexpr FitNeed kArm = FitNeed::kArm, kSeries = FitNeed::kSeries;
  const auto one = [](const char* unit, FitPrior prior) {
    return std::vector<FitNumber>{{"", unit, prior}};
  };
  static const std::vector<FitParameterInfo> kTable{
      {P::kKappa, "K_kappa", "K_kappa", kRatio, kArm, Block::kStiffness,
       one("m^2", stiffnessPrior)},
      {P::kGamma, "K_gamma", "K_gamma", kRatio, kArm, Block::kStiffness, one("", stiffnessPrior)},
      {P::kTau, "K_tau", "K_tau", kNone, kArm, Block::kStiffness, one("m^2", stiffnessPrior)},
      {P::kEps, "K_eps", "K_eps", kNone, FitNeed::kLoad, Block::kStiffness,
       one("N", stiffnessPrior)},
      {P::kLengthScale, "length_scale", "length_scale", kNone, kArm, Block::kLengthScale,
       one("", lengthScalePrior)},
      {P::kLengthScaleEach, "length_scale_each", "length_scale", kNone, kArm, Block::kLengthScale,
       one("", lengthScalePrior)},
      {P::kStrokeScaleEach, "stroke_scale_each", "stroke_scale", kNone, kArm, Block::kStrokeScale,
       one("", strokeScalePrior)},
      {P::kContraction, "contraction", "contraction", kNone, FitNeed::kFreeLengths},
      {P::kResponse, "response", "response", kNone, kSeries},
      {P::kMode, "mode", "mode", kNone, kSeries},
      {P::kMass, "mass", "mass", kNone, kSeries},
      {P::kDamping, "damping", "damping", kNone, kSeries},
      {P::kRingRadius, "ring_radius", "ring_radius", kNone, kSeries},
      {P::kRingPhase, "ring_phase", "ring_phase", kNone, kSeries},
      {P::kBase, "base", "base", kPlacement, FitNeed::kTags, Block::kBase,
       poseNumbers("_x", baseTranslation, baseRotation)},
      {P::kTags, "tags", "tag", kPlacement, FitNeed::kTags, Block::kTag,
       poseNumbers("_along", tagTranslation, tagRotation)},
      {P::kBorderShift, "bleed", "bleed", kPlacement, FitNeed::kCorners, Block::kBorderShift,
       one("m", borderShiftPrior)}};
  return kTable;
}

const FitParameterInfo& infoOf(FitParameter parameter) {
  return fitParameters().at(static_cast<std::size_t>(parameter));
}

const char* wordOf(FitGroup group) {
  return group == FitGroup::kStiffness   ? "stiffness"
         : group == FitGroup::kPlacement ? "placement"
                                         : "";
}

std::vector<std::string> fitWords() {
  std::vector<std::string> words;
  FitGroup last = FitGroup::kNone;
  for (const FitParameterInfo& info : fitParameters()) {
    if (info.group != FitGroup::kNone && info.group != last) words.emplace_back(wordOf(info.group));
    words.emplace_back(info.word);
    last = info.group;
  }
  return words;
}

std::string fitWordsText() {
  std::vector<std::string> words = fitWords();
  for (std::string& word : words) {
    for (const FitGroup group : {FitGroup::kStiffness, FitGroup::kPlacement}) {
      if (word == wordOf(group)) word += " (" + membersOf(group) + ")";
    }
    for (const FitParameterInfo& info : fitParameters()) {
      if (word == info.word && info.need == FitNeed::kLoad) word += " (under load)";
    }
  }
  return basics::joined(words);
}

std::set<FitParameter> fitParametersOf(const std::vector<std::string>& words, bool corners) {
  std::set<std::string> asked(words.begin(), words.end());
  if (asked.empty()) asked.insert(wordOf(kDefaultFitGroup));
  const std::vector<std::string> known = fitWords();
  for (const std::string& word : asked) {
    if (std::find(known.begin(), known.end(), word) != known.end()) continue;
    throw std::invalid_argument("\"" + word + "\" is not a parameter to fit; expected some of " +
                                basics::joined(known));
  }
  std::set<FitParameter> out;
  for (const FitParameterInfo& info : fitParameters()) {
    const bool met = corners || info.need != FitNeed::kCorners;
    const bool by_group = info.group != FitGroup::kNone && asked.count(wordOf(info.group)) > 0;
    if (asked.count(info.word) > 0 || (by_group && met)) out.insert(info.parameter);
  }
  return out;
}

}  // namespace helix_arm::estimation
