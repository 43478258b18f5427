#include "helix_arm/calibration/calibration_parameters.hpp"

#include <algorithm>
#include <cstddef>
#include <stdexcept>
#include <utility>

#include "helix_arm/basics/text.hpp"

namespace helix_arm::estimation {
namespace {

using Options = CalibrationOptions;

constexpr FitPrior kStiffnessPrior{"the prior of the stiffness",
                                   [](const Options& o) { return o.stiffness_prior; }};
constexpr FitPrior kLengthScalePrior{"the prior of the length scale",
                                     [](const Options& o) { return o.length_scale_prior; }};
constexpr FitPrior kStrokeScalePrior{"the prior of the stroke scale",
                                     [](const Options& o) { return o.stroke_scale_prior; }};
constexpr FitPrior kBaseTranslation{"the base's prior of translation",
                                    [](const Options& o) { return o.base_prior.translation; }};
constexpr FitPrior kBaseRotation{"the base's prior of rotation",
                                 [](const Options& o) { return o.base_prior.rotation; }};
constexpr FitPrior kTagTranslation{"the tags' prior of translation",
                                   [](const Options& o) { return o.tag_prior.translation; }};
constexpr FitPrior kTagRotation{"the tags' prior of rotation",
                                [](const Options& o) { return o.tag_prior.rotation; }};
constexpr FitPrior kBorderShiftPrior{"the prior of the bleed",
                                     [](const Options& o) { return o.border_shift_prior; }};

FitParameterInfo stiffness(FitParameter parameter, const char* word, FitGroup group,
                           StiffnessEntry entry, const char* unit, bool Options::*flag) {
  const bool load = entry == StiffnessEntry::kEps;
  FitParameterInfo info{parameter, word, word, group, load ? FitNeed::kLoad : FitNeed::kArm};
  info.block = ParameterBlock::kStiffness;
  info.entry = entry;
  info.numbers = {{"", unit, kStiffnessPrior}};
  info.flag = flag;
  info.uncertain_if_held = !load;
  return info;
}

FitParameterInfo lengthScale(FitParameter parameter, const char* word, LengthScaling scaling) {
  FitParameterInfo info{parameter, word, "length_scale", FitGroup::kNone, FitNeed::kArm};
  info.block = ParameterBlock::kLengthScale;
  info.numbers = {{"", "", kLengthScalePrior}};
  info.scaling = scaling;
  return info;
}

FitParameterInfo strokeScale(FitParameter parameter, const char* word) {
  FitParameterInfo info{parameter, word, "stroke_scale", FitGroup::kNone, FitNeed::kArm};
  info.block = ParameterBlock::kStrokeScale;
  info.numbers = {{"", "", kStrokeScalePrior}};
  info.each_actuator = true;
  info.flag = &Options::stroke_scale;
  return info;
}

FitParameterInfo placement(FitParameter parameter, const char* word, const char* name, FitNeed need,
                           ParameterBlock block, std::vector<FitNumber> numbers,
                           bool Options::*flag) {
  FitParameterInfo info{parameter, word, name, FitGroup::kPlacement, need};
  info.block = block;
  info.numbers = std::move(numbers);
  info.flag = flag;
  info.implied = block == ParameterBlock::kBorderShift;
  info.uncertain_if_held = block != ParameterBlock::kBase;
  return info;
}

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
  return block == ParameterBlock::kStiffness || block == ParameterBlock::kLengthScale ||
         each_actuator;
}

bool FitParameterInfo::aboutRig() const {
  return need == FitNeed::kTags || need == FitNeed::kCorners;
}

const std::vector<FitParameterInfo>& fitParameters() {
  using Entry = StiffnessEntry;
  static const std::vector<FitParameterInfo> kTable{
      stiffness(FitParameter::kKappa, "K_kappa", FitGroup::kStiffness, Entry::kKappa, "m^2",
                &Options::K_kappa),
      stiffness(FitParameter::kGamma, "K_gamma", FitGroup::kStiffness, Entry::kGamma, "",
                &Options::K_gamma),
      stiffness(FitParameter::kTau, "K_tau", FitGroup::kNone, Entry::kTau, "m^2", &Options::K_tau),
      stiffness(FitParameter::kEps, "K_eps", FitGroup::kNone, Entry::kEps, "N", &Options::K_eps),
      lengthScale(FitParameter::kLengthScale, "length_scale", LengthScaling::kCommon),
      lengthScale(FitParameter::kLengthScaleEach, "length_scale_each", LengthScaling::kEach),
      strokeScale(FitParameter::kStrokeScaleEach, "stroke_scale_each"),
      {FitParameter::kContraction, "contraction", "contraction", FitGroup::kNone,
       FitNeed::kFreeLengths},
      {FitParameter::kResponse, "response", "response", FitGroup::kNone, FitNeed::kSeries},
      {FitParameter::kMode, "mode", "mode", FitGroup::kNone, FitNeed::kSeries},
      {FitParameter::kMass, "mass", "mass", FitGroup::kNone, FitNeed::kSeries},
      {FitParameter::kDamping, "damping", "damping", FitGroup::kNone, FitNeed::kSeries},
      {FitParameter::kRingRadius, "ring_radius", "ring_radius", FitGroup::kNone, FitNeed::kSeries},
      {FitParameter::kRingPhase, "ring_phase", "ring_phase", FitGroup::kNone, FitNeed::kSeries},
      placement(FitParameter::kBase, "base", "base", FitNeed::kTags, ParameterBlock::kBase,
                poseNumbers("_x", kBaseTranslation, kBaseRotation), &Options::base),
      placement(FitParameter::kTags, "tags", "tag", FitNeed::kTags, ParameterBlock::kTag,
                poseNumbers("_along", kTagTranslation, kTagRotation), &Options::tags),
      placement(FitParameter::kBorderShift, "bleed", "bleed", FitNeed::kCorners,
                ParameterBlock::kBorderShift, {{"", "m", kBorderShiftPrior}},
                &Options::border_shift)};
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

void setFitted(const std::set<FitParameter>& parameters, CalibrationOptions& options) {
  options.length_scale = LengthScaling::kNone;
  for (const FitParameterInfo& info : fitParameters()) {
    const bool fitted = parameters.count(info.parameter) > 0;
    if (info.flag != nullptr) options.*info.flag = fitted;
    // The last request wins: per actuator rather than one scale for all.
    if (info.scaling != LengthScaling::kNone && fitted) options.length_scale = info.scaling;
  }
}

bool isFitted(const FitParameterInfo& info, const CalibrationOptions& options) {
  if (info.flag != nullptr) return options.*info.flag;
  return info.scaling != LengthScaling::kNone && options.length_scale == info.scaling;
}

}  // namespace helix_arm::estimation
