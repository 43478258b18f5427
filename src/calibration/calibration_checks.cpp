#include "calibration_checks.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "basics/text.hpp"
#include "shape_model.hpp"

namespace helix_arm::estimation {
namespace {

// Pressures that differ by less count as the same, since regulators are not more accurate [Pa].
constexpr double kSamePressure = 5000.0;

bool same(const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  return a.size() == b.size() && (a - b).cwiseAbs().maxCoeff() <= kSamePressure;
}

// @param first  capture whose kind of reading all others share.
std::optional<std::string> faultOf(const Capture& capture, const ArmCaptures& arm,
                                   const Capture& first) {
  const std::string who = messageOf(arm.name, ", capture ", capture.number, ": ");
  if (capture.pressure.size() != arm.arm.actuatorCount()) {
    return messageOf(who, "has ", capture.pressure.size(), " pressures, but the arm has ",
                     arm.arm.actuatorCount(), " actuators; is it of another arm?");
  }
  for (int i = 0; i < capture.pressure.size(); ++i) {
    const model::Actuator& actuator = arm.arm.actuator(i);
    if (actuator.limits.contains(capture.pressure[i])) continue;
    return messageOf(who, "the pressure of ", actuator.name, " is ", capture.pressure[i] / 1e3,
                     " kPa; expected its limits, ", actuator.limits.lower / 1e3, " to ",
                     actuator.limits.upper / 1e3);
  }
  if (first.reading.index() == capture.reading.index()) return std::nullopt;
  return who +
         "has another kind of reading than the captures before it; calibrate with one kind at a "
         "time";
}

std::optional<std::string> unbalanced(const std::vector<ArmCaptures>& arms) {
  if (std::none_of(arms.begin(), arms.end(), [](const auto& arm) { return arm.isLoaded(); })) {
    return std::nullopt;
  }
  const std::vector<ArmCaptures> states = statesOf(arms);
  ShapeModel model(states, {});
  std::size_t next_state = arms.size();
  for (std::size_t a = 0; a < arms.size(); ++a) {
    for (const Capture& capture : arms[a].captures) {
      const Eigen::VectorXd lengths = arms[a].arm.lengths(capture.pressure);
      const std::size_t state = capture.payload ? next_state++ : a;
      if (model.at(static_cast<int>(state), lengths, nullptr).found) continue;
      return messageOf(
          arms[a].name, ", capture ", capture.number, ": at ", pressureText(capture.pressure),
          " the model finds no shape that balances the load; check the scene's load and "
          "K_eps");
    }
  }
  return std::nullopt;
}

// Tag poses whose nearest one is too far for metres; a single wrong one does not count.
std::optional<std::string> inMillimetres(const std::vector<ArmCaptures>& arms) {
  constexpr double kFarthest = 20;  // in lengths of the arm
  for (const ArmCaptures& arm : arms) {
    double least = std::numeric_limits<double>::infinity();
    for (const Capture& capture : arm.captures) {
      const auto* poses = std::get_if<std::vector<PoseObservation>>(&capture.reading);
      if (poses == nullptr) break;
      for (const PoseObservation& seen : *poses) {
        least = std::min(least, seen.X_BT.translation.norm());
      }
    }
    const double length = arm.arm.restLength();
    if (!std::isfinite(least) || least < kFarthest * length) continue;
    return messageOf(arm.name, ": every tag is ", least, " m or more from the base of an arm of ",
                     length, " m; expected positions in metres, and these seem to be millimetres");
  }
  return std::nullopt;
}

template <class Holds>
bool anyFitted(const CalibrationOptions& options, const Holds& holds) {
  return std::any_of(options.fit.begin(), options.fit.end(),
                     [&](FitParameter one) { return infoOf(one).block && holds(infoOf(one)); });
}

// "base, tags and border shift".
std::string rigWords() {
  std::vector<std::string> words;
  for (const FitParameterInfo& info : fitParameters()) {
    if (info.aboutRig()) words.emplace_back(info.word);
  }
  const std::string last = words.back();
  words.pop_back();
  return basics::joined(words) + " and " + last;
}

// Why readings of this kind cannot determine the requested parameters.
std::optional<std::string> unmet(const std::vector<ArmCaptures>& arms,
                                 const CalibrationOptions& options) {
  const ReadingKind kind = kindOf(arms);
  // The others tell the shape without load.
  const bool loaded =
      std::any_of(arms.begin(), arms.end(), [](const ArmCaptures& arm) { return arm.isLoaded(); });
  if (options.fits(FitParameter::kEps) && !loaded) {
    return "K_eps has an effect only under load; give the scene its `load`, with a tier that takes "
           "it into account, or do not fit K_eps";
  }
  if (!anyFitted(options, [](const FitParameterInfo&) { return true; })) {
    return "no parameter to fit was named; name at least one";
  }
  const bool tags = isMet(FitNeed::kTags, kind);
  const bool rig = anyFitted(options, [](const FitParameterInfo& info) { return info.aboutRig(); });
  if (rig && !tags) {
    return rigWords() + " need captures of tags; these are of curvatures or twists";
  }
  if (options.fits(FitParameter::kBorderShift) && !isMet(FitNeed::kCorners, kind)) {
    return "bleed needs captures of tag corners";
  }
  // White bleeds into black alike.
  const bool placed = options.fits(FitParameter::kBase) || options.fits(FitParameter::kTags);
  if (placed && arms.size() > 1) {
    return rigWords() + " belong to one rig; fit them for one arm at a time";
  }
  if (options.free_shapes && !tags) return "free shapes need captures of tags";
  return std::nullopt;
}

// Why an arm cannot share K_eps with the first one.
std::optional<std::string> unlikeEps(const ArmCaptures& arm, const ArmCaptures& first) {
  if (!arm.load) {
    return messageOf(arm.name, ": K_eps is fitted, but unknown; give arm.stiffness.K_eps_n");
  }
  if (!arm.load->tables.empty()) {
    return messageOf(
        arm.name,
        ": K_eps depends on pressure; the fit is of one number: give K_eps_n one, or do "
        "not fit K_eps");
  }
  for (std::size_t k = 0; k < arm.load->K_eps.size(); ++k) {
    const double one = first.load->K_eps.front(), other = arm.load->K_eps[k];
    if (other == one) continue;
    return messageOf(arm.name, ": K_eps of section ", k + 1, " is ", other, " N, but ", one,
                     " N of the first section of ", first.name,
                     "; one K_eps is fitted for all: give them the same one first");
  }
  return std::nullopt;
}

// Pressures that differ, but are so small against the limits that kilopascals are doubtful.
std::string inBar(const ArmCaptures& arm) {
  constexpr double kPascalsOfBar = 100;  // if they were read as kilopascals
  double most = 0, limit = 0;
  for (const Capture& capture : arm.captures) most = std::max(most, capture.pressure.maxCoeff());
  for (int i = 0; i < arm.arm.actuatorCount(); ++i) {
    limit = std::max(limit, arm.arm.actuator(i).limits.upper);
  }
  if (most <= 0 || kPascalsOfBar * most > limit) return "";
  return messageOf("; the highest is ", most / 1e3, " kPa, and ", kPascalsOfBar * most / 1e3,
                   " kPa if the pressures are in bar: expected kilopascals");
}

// Why arms that are fitted together cannot share the fitted parameters.
std::optional<std::string> unlike(const std::vector<ArmCaptures>& arms,
                                  const CalibrationOptions& options) {
  const bool ratios = anyFitted(options, [](const FitParameterInfo& info) {
    return info.isStiffness() && info.parameter != FitParameter::kEps;
  });
  const bool each =
      options.fits(FitParameter::kStrokeScaleEach) || options.fits(FitParameter::kLengthScaleEach);
  const model::Stiffness& first = arms.front().arm.actuator(0).stiffness;
  for (const ArmCaptures& arm : arms) {
    if (each && arm.arm.actuatorCount() != arms.front().arm.actuatorCount()) {
      return messageOf(arm.name, " has ", arm.arm.actuatorCount(), " actuators, ",
                       arms.front().name, " ", arms.front().arm.actuatorCount(),
                       "; a scale per actuator needs the same number on every arm, a common "
                       "scale does not");
    }
    if (options.fits(FitParameter::kContraction) && arm.arm.hasTables()) {
      return messageOf(arm.name,
                       ": K_kappa depends on pressure, which a length tells only on the scene's "
                       "curve: give K_kappa_m2 one number for a curve from captures");
    }
    if ((each || options.fits(FitParameter::kLengthScale)) && arm.arm.hasTables()) {
      return messageOf(arm.name,
                       ": K_kappa depends on pressure, which a length tells only at the scene's "
                       "scales: give K_kappa_m2 one number, or leave out length_scale, "
                       "length_scale_each and stroke_scale_each");
    }
    if (options.fits(FitParameter::kEps)) {
      if (const auto reason = unlikeEps(arm, arms.front())) return reason;
    }
    for (int i = 0; ratios && i < arm.arm.actuatorCount(); ++i) {
      const model::Stiffness& other = arm.arm.actuator(i).stiffness;
      if (other.kappa == first.kappa && other.gamma == first.gamma && other.tau == first.tau) {
        continue;
      }
      return messageOf(arm.name, ": the stiffness of ", arm.arm.actuator(i).name,
                       " is not that of ", arms.front().arm.actuator(0).name, " of ",
                       arms.front().name,
                       "; one stiffness is fitted for all: give them the same one first");
    }
  }
  return std::nullopt;
}

}  // namespace

ReadingKind kindOf(const std::vector<ArmCaptures>& arms) {
  const auto first = std::find_if(arms.begin(), arms.end(),
                                  [](const ArmCaptures& arm) { return !arm.captures.empty(); });
  return static_cast<ReadingKind>(first->captures.front().reading.index());
}

bool isMet(FitNeed need, ReadingKind kind) {
  const bool corners = kind == ReadingKind::kCorners;
  switch (need) {
    case FitNeed::kArm:
    case FitNeed::kLoad:
      return true;
    case FitNeed::kTags:
      return kind == ReadingKind::kPoses || corners;
    case FitNeed::kCorners:
      return corners;
    case FitNeed::kFreeLengths:
    case FitNeed::kSeries:
      break;
  }
  return false;
}

const char* unitOf(ReadingKind kind) {
  return kind == ReadingKind::kCurvature ? "rad" : kind == ReadingKind::kCorners ? "px" : "m";
}

std::string pressureText(const Eigen::VectorXd& pressure) {
  std::vector<std::string> parts;
  for (const double one : pressure) parts.push_back(messageOf(one / 1e3));
  return basics::joined(parts) + " kPa";
}

std::optional<Verdict> unsound(const std::vector<ArmCaptures>& arms) {
  const Capture* first = nullptr;
  for (const ArmCaptures& arm : arms) {
    for (const Capture& capture : arm.captures) {
      if (first == nullptr) first = &capture;
      const auto fault = faultOf(capture, arm, *first);
      if (fault) return Verdict{CalibrationStatus::kBadData, *fault};
    }
  }
  if (first == nullptr) {
    return Verdict{CalibrationStatus::kNoCaptures, "no capture has a reading; record some first"};
  }
  if (const auto fault = inMillimetres(arms)) return Verdict{CalibrationStatus::kBadData, *fault};
  if (const auto fault = unbalanced(arms)) return Verdict{CalibrationStatus::kBadData, *fault};
  return std::nullopt;
}

Groups groupByPressure(const std::vector<ArmCaptures>& arms) {
  Groups groups;
  for (const ArmCaptures& arm : arms) {
    for (const Capture& capture : arm.captures) {
      const auto known = std::find_if(
          groups.pressure.begin(), groups.pressure.end(),
          [&capture](const Eigen::VectorXd& other) { return same(other, capture.pressure); });
      groups.of.push_back(static_cast<int>(known - groups.pressure.begin()));
      if (known == groups.pressure.end()) groups.pressure.push_back(capture.pressure);
    }
  }
  return groups;
}

std::optional<Verdict> unfit(const std::vector<ArmCaptures>& arms,
                             const CalibrationOptions& options) {
  const Groups groups = groupByPressure(arms);
  if (groups.pressure.size() == 1 && !options.free_shapes) {
    return Verdict{
        CalibrationStatus::kOnePressure,
        messageOf("all captures were taken at ", pressureText(groups.pressure.front()),
                  ", where the parameters cannot be distinguished; capture at other pressures, too",
                  inBar(arms.front()))};
  }
  std::optional<std::string> reason = unmet(arms, options);
  if (!reason) reason = unlike(arms, options);
  if (!reason) return std::nullopt;
  return Verdict{CalibrationStatus::kNothingToFit, *reason};
}

}  // namespace helix_arm::estimation
