#include "helix_arm/statics/tier.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <sstream>

#include "basics/fraction.hpp"
#include "basics/median.hpp"
#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"

namespace helix_arm::statics {
namespace {

constexpr int kCornerSamples = 40;  // per section
constexpr int kMostCornerSamples = 160;
constexpr int kInnerSamples = 16;
constexpr double kTaperedError = 1e-5;  // at which an arm stops doubling its Magnus steps
// If none of this many samples has a balance, the others are skipped, since each takes long.
constexpr int kHopeless = 6;

std::string rounded(double value, int digits, const char* unit) {
  return basics::format("%.*g%s", digits, value, unit);
}
std::string percent(double part) { return rounded(100.0 * part, 2, " %"); }
std::string microseconds(double seconds) { return rounded(1e6 * seconds, 3, " us"); }

std::vector<Eigen::VectorXd> samplesOf(const model::Arm& arm) {
  const int corners = std::min(kCornerSamples * arm.sectionCount(), kMostCornerSamples);
  return sampleInputs(arm, corners, kInnerSamples);
}

// Tip by the exact tier.
struct Sample {
  Eigen::VectorXd lengths;
  Eigen::Vector3d tip;
};

struct Samples {
  std::vector<Sample> balanced;
  int unbalanced = 0;  // number of inputs without a balance

  std::size_t count() const { return balanced.size() + unbalanced; }
};

Samples sampleTips(const model::Arm& arm, const Load& load) {
  const ExactArm exact(arm, load);
  std::vector<Sample> out;
  int unbalanced = 0;
  SolveStatus refused = SolveStatus::kConverged;
  for (const Eigen::VectorXd& q : samplesOf(arm)) {
    if (out.empty() && unbalanced == kHopeless) break;
    Eigen::VectorXd lengths = arm.lengths(q);
    const Solution solution = exact.solve(unloadedUnderOfLengths(arm, load, lengths));
    if (solution.converged()) {
      out.push_back({std::move(lengths), solution.tip.translation});
    } else {
      refused = solution.status;
      ++unbalanced;
    }
  }
  basics::requireKey(
      !out.empty(), "load",
      refused == SolveStatus::kUnsupported
          ? "it pulls along a motion that no actuator resists; give K_tau_m2 or K_kappa_m2 a "
            "value > 0"
          : "no shape balances it at any of the inputs tried; lower the masses and forces, or "
            "raise arm.stiffness.K_eps_n");
  return {std::move(out), unbalanced};
}

// Largest tip error, relative to the arm's length.
double errorOf(const ArmModel& model, const std::vector<Sample>& samples, double arm_length) {
  double error = 0.0;
  for (const Sample& sample : samples) {
    const Tip found = model.tipOfLengths(sample.lengths);
    if (!found.converged()) return std::numeric_limits<double>::infinity();
    error = std::max(error, (found.tip.translation - sample.tip).norm() / arm_length);
  }
  return std::max(error, kExactTipError);
}

// Mean time of a solution over the samples; times of inputs differ by a factor of two and more.
double meanTime(const ArmModel& model, const std::vector<Eigen::VectorXd>& lengths) {
  const double all = basics::medianTime([&] {
    for (const Eigen::VectorXd& one : lengths) model.tipOfLengths(one);
  });
  return all / static_cast<double>(lengths.size());
}

// From the cheapest to the most expensive.
std::vector<TierSetting> settingsOf(const TierRequest& request, const Load& load, bool planar) {
  std::vector<TierSetting> out;
  const auto wanted = [&request](Tier tier) { return !request.tier || *request.tier == tier; };
  // If it was requested, the loaded tier reports its own limits.
  const bool orders =
      wanted(Tier::kLoaded) && (request.tier || load.innerPlaces() <= kMaxInnerPoints);
  if (planar && wanted(Tier::kPlanar)) out.push_back({Tier::kPlanar, 0});
  if (wanted(Tier::kLinear) && (!planar || request.tier)) out.push_back({Tier::kLinear, 0});
  for (int order = kLeastOrder; order <= kMostOrder && orders; ++order) {
    if (!request.order || *request.order == order) out.push_back({Tier::kLoaded, order});
  }
  if (wanted(Tier::kExact)) out.push_back({Tier::kExact, 0});
  return out;
}

// An arm under a load, with the reference samples of its tiers.
struct Scale {
  const model::Arm& arm;
  const std::optional<model::PlanarArm>& planar;
  const std::optional<Load>& load;
  Samples samples;

  TierChoice judge(const ArmModel& model) const {
    const TierSetting& setting = model.choice().setting;
    TierChoice out{setting, kExactTipError, ""};
    std::ostringstream reason;
    reason << setting.name();
    if (setting.tier == Tier::kExact) {
      reason << ", the reference of the other tiers";
    } else {
      out.relative_tip_error = errorOf(model, samples.balanced, arm.restLength());
      if (std::isfinite(out.relative_tip_error)) {
        reason << " errs by up to " << percent(out.relative_tip_error) << " of the arm's length at "
               << samples.balanced.size() << " sampled inputs";
      } else {
        reason << " does not converge at some sampled inputs";
      }
    }
    if (!takesLoad(setting.tier)) reason << ", since it omits the load";
    if (samples.unbalanced > 0) {
      reason << " (at " << samples.unbalanced << " of " << samples.count()
             << " sampled inputs no shape balances the load)";
    }
    out.reason = reason.str();
    return out;
  }
};

TierChoice chooseWithin(double time, const Scale& scale, const std::vector<TierSetting>& settings) {
  std::optional<TierChoice> best;
  std::string cheapest;
  std::vector<Eigen::VectorXd> lengths;
  for (const Sample& sample : scale.samples.balanced) lengths.push_back(sample.lengths);
  for (const TierSetting& setting : settings) {
    const ArmModel model(scale.arm, scale.planar, scale.load, setting);
    const double taken = meanTime(model, lengths);
    if (cheapest.empty()) cheapest = setting.name() + ", takes " + microseconds(taken);
    if (taken > time) continue;
    TierChoice choice = scale.judge(model);
    if (best && best->relative_tip_error <= choice.relative_tip_error) continue;
    choice.reason += ", takes " + microseconds(taken) + " on average over them of the " +
                     microseconds(time) + " allowed";
    best = std::move(choice);
  }
  basics::requireKey(best.has_value(), "budget.time_us", "the cheapest tier, ", cheapest,
                     " on average over sampled inputs; allow twice that, since times vary");
  return *best;
}

TierChoice chooseAccurate(const TierRequest& request, const Scale& scale,
                          const std::vector<TierSetting>& settings) {
  const double allowed = request.relative_tip_error.value_or(kUsualTipError);
  if (settings.size() == 1 && !request.relative_tip_error) {
    TierChoice choice = scale.judge({scale.arm, scale.planar, scale.load, settings.front()});
    choice.reason = "requested; " + choice.reason;
    return choice;
  }
  std::string nearest;
  double least = std::numeric_limits<double>::infinity();
  for (const TierSetting& setting : settings) {
    TierChoice choice = scale.judge({scale.arm, scale.planar, scale.load, setting});
    if (kTipErrorMargin * choice.relative_tip_error <= std::max(allowed, kLeastTipError)) {
      choice.reason += ", the cheapest within " + percent(allowed);
      return choice;
    }
    if (nearest.empty() || choice.relative_tip_error < least) nearest = choice.reason;
    least = std::min(least, choice.relative_tip_error);
  }
  const std::string tier = request.tier ? nameOf(*request.tier) : kAutoTier;
  basics::requireKey(request.relative_tip_error.has_value(), "tier", tier, " does not meet the ",
                     percent(allowed), " that apply without accuracy; ", nearest,
                     "; use tier: exact, or give accuracy.tip_error_percent");
  throw basics::Requirement("accuracy.tip_error_percent",
                            "no requested tier meets " + percent(allowed) +
                                ", with a factor of 2 to spare; " + nearest +
                                "; allow a larger error, or use tier: auto");
}

void checkRequest(const TierRequest& request) {
  const auto positive = [](const std::optional<double>& value) {
    return !value || (std::isfinite(*value) && *value > 0);
  };
  basics::requireKey(positive(request.relative_tip_error), "accuracy.tip_error_percent",
                     "expected a value > 0");
  basics::requireKey(positive(request.time), "budget.time_us", "expected a value > 0");
  basics::require(!request.relative_tip_error || !request.time,
                  "accuracy and budget: expected only one of them");
  if (!request.order) return;
  basics::requireValue(*request.order >= kLeastOrder && *request.order <= kMostOrder, "order", "it",
                       *request.order, "2 to 8");
  basics::requireKey(request.tier == Tier::kLoaded, "order", "it needs tier: loaded");
}

TierChoice chooseUnloaded(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
                          const TierRequest& request) {
  const TierSetting setting{request.tier.value_or(planar ? Tier::kPlanar : Tier::kLinear), 0};
  basics::requireKey(!takesLoad(setting.tier), "tier", nameOf(setting.tier),
                     " needs a load; give the scene the key load, or use tier: linear");
  if (request.time) {
    std::vector<Eigen::VectorXd> lengths;
    for (const Eigen::VectorXd& q : samplesOf(arm)) {
      lengths.push_back(arm.lengths(q));
    }
    const double time = meanTime(ArmModel(arm, planar, {}, setting), lengths);
    basics::requireKey(time <= *request.time, "budget.time_us", "the cheapest tier, ",
                       setting.name(), ", takes ", microseconds(time),
                       " on average over sampled inputs; allow twice that, since times vary");
  }
  if (arm.tapered()) {
    return {setting, kTaperedError,
            "the arm has no load, so each of its cross-sections is in balance by itself"};
  }
  if (request.tier) return {setting, 0.0, "requested; the arm has no load"};
  return {setting, 0.0,
          planar ? "the arm has no load and lies in a plane"
                 : "the arm has no load, so a constant twist per section is exact"};
}

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kNoMotion = 1e-9;  // of a singular value, relative to the largest

// The combinations of a section's inputs that move it, orthonormal (n x rank).
MatrixXd motionsOf(const model::Arm& arm, const VectorXd& range, int k) {
  MatrixXd map = arm.equilibrium(k).map;
  map *= range.segment(arm.firstActuator(k), map.cols()).asDiagonal();
  map.topRows<lie::SE3::kSpace>() /= arm.freeLength(k);
  const Eigen::JacobiSVD<MatrixXd> svd(map, Eigen::ComputeThinV);
  const VectorXd& values = svd.singularValues();
  return svd.matrixV().leftCols((values.array() > kNoMotion * values[0]).count());
}

}  // namespace

const char* nameOf(Tier tier) {
  static constexpr std::array<const char*, 4> kNames = {"planar", "linear", "loaded", "exact"};
  return kNames[static_cast<std::size_t>(tier)];
}

std::optional<Tier> tierNamed(const std::string& word) {
  for (const Tier tier : kTiers) {
    if (word == nameOf(tier)) return tier;
  }
  return std::nullopt;
}

std::vector<std::string> tierWords() {
  std::vector<std::string> words = {kAutoTier};
  for (const Tier tier : kTiers) words.emplace_back(nameOf(tier));
  return words;
}

bool takesLoad(Tier tier) { return tier == Tier::kLoaded || tier == Tier::kExact; }

std::string TierSetting::name() const {
  return tier == Tier::kLoaded ? "loaded, order " + std::to_string(order) : nameOf(tier);
}

TierChoice chooseTier(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
                      const std::optional<Load>& load, const TierRequest& request) {
  checkRequest(request);
  basics::requireKey(request.tier != Tier::kPlanar || planar, "tier",
                     "planar needs arm.geometry: planar; this arm is spatial, use tier: linear");
  if (load) load->validate(arm.sectionCount());
  const bool solves_load = request.tier && takesLoad(*request.tier);
  if (!load || (load->empty() && !solves_load)) return chooseUnloaded(arm, planar, request);

  basics::requireKey(
      request.tier != Tier::kPlanar || inPlane(*load), "tier",
      "planar needs a load in the arm's x-y plane; this one has a component across it; "
      "use tier: loaded, or turn arm.base");
  constexpr double kRounding = 1e-12;  // of percents converted to fractions
  basics::requireKey(!request.relative_tip_error ||
                         *request.relative_tip_error >= (1.0 - kRounding) * kLeastTipError,
                     "accuracy.tip_error_percent", "no tier errs by less than ",
                     percent(kLeastTipError), " of the arm's length; allow that or more");
  const bool in_plane = planar && (request.tier == Tier::kPlanar || staysInPlane(arm, *load));
  const std::vector<TierSetting> settings = settingsOf(request, *load, in_plane);
  const Scale scale{arm, planar, load, sampleTips(arm, *load)};
  return request.time ? chooseWithin(*request.time, scale, settings)
                      : chooseAccurate(request, scale, settings);
}

std::vector<VectorXd> sampleInputs(const model::Arm& arm, int corners, int inner) {
  const int n = arm.actuatorCount(), sections = arm.sectionCount();
  const VectorXd range = arm.lengths(arm.inputAt(0.0)) - arm.lengths(arm.inputAt(1.0));
  std::vector<MatrixXd> motions;
  int most = 0;
  for (int k = 0; k < sections; ++k) {
    motions.push_back(motionsOf(arm, range, k));
    most = std::max(most, static_cast<int>(motions.back().cols()));
  }
  std::vector<VectorXd> out = {arm.inputAt(0.0), arm.inputAt(1.0)};
  VectorXd fraction(n);
  const auto toCorner = [&](int k, const VectorXd& direction) {
    fraction.segment(arm.firstActuator(k), direction.size()) =
        (direction.array() > 0).cast<double>();
  };
  for (int j = 0; j < most; ++j) {
    for (const double sign : {1.0, -1.0}) {
      fraction.setZero();
      for (int k = 0; k < sections; ++k) {
        if (j < motions[k].cols()) toCorner(k, sign * motions[k].col(j));
      }
      out.push_back(arm.inputAt(fraction));
      for (int k = 0; k < sections && sections > 1; ++k) {
        fraction.setZero();
        if (j >= motions[k].cols()) continue;
        toCorner(k, sign * motions[k].col(j));
        out.push_back(arm.inputAt(fraction));
      }
    }
  }
  std::mt19937_64 generator(20240229);
  for (int sample = 0; sample < corners; ++sample) {
    for (int k = 0; k < sections; ++k) {
      VectorXd share(motions[k].cols());
      for (double& one : share) one = 2.0 * basics::fractionOf(generator()) - 1.0;
      toCorner(k, motions[k] * share);
    }
    out.push_back(arm.inputAt(fraction));
  }
  for (int sample = 0; sample < inner; ++sample) {
    for (double& one : fraction) one = basics::fractionOf(generator());
    out.push_back(arm.inputAt(fraction));
  }
  return out;
}

}  // namespace helix_arm::statics
