#include "helix_arm/model/tier.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <sstream>

#include "helix_arm/model/exact.hpp"
#include "helix_arm/model/loaded.hpp"
#include "helix_arm/model/median_time.hpp"
#include "helix_arm/model/requirement.hpp"
#include "tier_solver.hpp"

namespace helix_arm::model {
namespace {

constexpr int kRandomSamples = 16;
// Where none of so many samples finds a balance, the others are not tried: each takes long.
constexpr int kHopeless = 4;
constexpr int kMostCornerActuators = 3;
// Inputs between the samples may be worse than they are.
constexpr double kMargin = 2.0;
// What the exact tier is good to, as a part of the arm's length.
constexpr double kExactTipError = 1e-9;

std::string percent(double part) {
  std::ostringstream text;
  text.precision(2);
  text << 100.0 * part << " %";
  return text.str();
}

std::string microseconds(double seconds) {
  std::ostringstream text;
  text.precision(3);
  text << 1e6 * seconds << " us";
  return text.str();
}

// Free lengths at random inputs within the limits, and at their corners: of the first actuators,
// the others with them in turn.
std::vector<Eigen::VectorXd> sampleLengths(const Arm& arm) {
  std::vector<Eigen::VectorXd> out;
  const int n = arm.actuatorCount();
  std::mt19937_64 generator(20240229);
  const int free = std::min(n, kMostCornerActuators);
  for (int sample = 0; sample < kRandomSamples + (1 << free); ++sample) {
    Eigen::VectorXd q(n);
    for (int i = 0; i < n; ++i) {
      const double fraction = sample < (1 << free)
                                  ? (sample >> (i % free)) & 1
                                  : static_cast<double>(generator() >> 11) * 0x1p-53;
      const Range& limits = arm.actuator(i).limits;
      q[i] = limits.lower + fraction * (limits.upper - limits.lower);
    }
    out.push_back(arm.lengths(arm.clamped(q)));
  }
  return out;
}

// Where the exact tier puts the tip.
struct Sample {
  Eigen::VectorXd lengths;
  Eigen::Vector3d tip;
};

struct Samples {
  std::vector<Sample> balanced;
  int unbalanced = 0;  // inputs where the load finds no balance
};

Samples sampleTips(const Arm& arm, const Load& load) {
  const ExactArm exact(arm, load);
  std::vector<Sample> out;
  int unbalanced = 0;
  SolveStatus refused = SolveStatus::kConverged;
  for (Eigen::VectorXd& lengths : sampleLengths(arm)) {
    if (out.empty() && unbalanced == kHopeless) break;
    const Solution solution = exact.solve(arm.twistsOfLengths(lengths));
    if (solution.converged()) {
      out.push_back({std::move(lengths), solution.tip.translation});
    } else {
      refused = solution.status;
      ++unbalanced;
    }
  }
  require(!out.empty(), "load: ",
          refused == SolveStatus::kUnsupported
              ? "it pulls along a motion that no actuator resists; give K_tau_m2 or K_kappa_m2 a "
                "value > 0"
              : "no shape balances it at any input; lower the masses and forces, or raise "
                "arm.stiffness.K_eps_n");
  return {std::move(out), unbalanced};
}

// Largest error of the tip, as a part of the arm's length.
double errorOf(const TierSolver& solver, const std::vector<Sample>& samples, double arm_length) {
  double error = 0.0;
  for (const Sample& sample : samples) {
    const Tip found = solver.tip(sample.lengths);
    if (found.status != SolveStatus::kConverged) return std::numeric_limits<double>::infinity();
    error = std::max(error, (found.tip.translation - sample.tip).norm() / arm_length);
  }
  return error;
}

double timeOf(const TierSolver& solver, const Eigen::VectorXd& lengths) {
  return medianTime([&] { solver.tip(lengths); });
}

// From the cheapest to the dearest.
std::vector<TierSetting> settingsOf(const TierRequest& request, bool planar) {
  std::vector<TierSetting> out;
  const auto wanted = [&request](Tier tier) { return !request.tier || *request.tier == tier; };
  if (planar && wanted(Tier::kPlanar)) out.push_back({Tier::kPlanar, 0});
  if (wanted(Tier::kLinear) && (!planar || request.tier)) out.push_back({Tier::kLinear, 0});
  for (int order = kLeastOrder; order <= kMostOrder && wanted(Tier::kLoaded); ++order) {
    if (!request.order || *request.order == order) out.push_back({Tier::kLoaded, order});
  }
  if (wanted(Tier::kExact)) out.push_back({Tier::kExact, 0});
  return out;
}

void checkRequest(const TierRequest& request) {
  const auto positive = [](const std::optional<double>& value) {
    return !value || (std::isfinite(*value) && *value > 0);
  };
  require(positive(request.tip_error), "accuracy.tip_error_percent: expected a value > 0");
  require(positive(request.time), "budget.time_us: expected a value > 0");
  require(!request.tip_error || !request.time,
          "accuracy and budget: expected one of them; the other follows from it");
  if (!request.order) return;
  requireValue(*request.order >= kLeastOrder && *request.order <= kMostOrder, "order", "it",
               *request.order, "2 to 8");
  require(request.tier == Tier::kLoaded, "order: it goes with tier: loaded");
}

TierChoice chooseUnloaded(const Arm& arm, const std::optional<PlanarArm>& planar,
                          const TierRequest& request) {
  const bool loaded = request.tier == Tier::kLoaded || request.tier == Tier::kExact;
  require(!loaded, "tier: ", nameOf(request.tier.value_or(Tier::kLinear)),
          " needs a load; give the scene the key load, or use tier: linear");
  const TierSetting setting{request.tier.value_or(planar ? Tier::kPlanar : Tier::kLinear), 0};
  if (request.time) {
    const double time = timeOf(TierSolver(arm, planar, {}, setting), arm.lengths(arm.inputAt(0.5)));
    require(time <= *request.time, "budget.time_us: the fastest tier, ", setting.name(), ", takes ",
            microseconds(time), "; allow that much");
  }
  if (request.tier) return {setting, 0.0, "asked for; nothing loads the arm"};
  return {setting, 0.0,
          planar ? "nothing loads the arm and it lies in a plane"
                 : "nothing loads the arm: a constant twist a section is all of it"};
}

}  // namespace

const char* nameOf(Tier tier) {
  switch (tier) {
    case Tier::kPlanar:
      return "planar";
    case Tier::kLinear:
      return "linear";
    case Tier::kLoaded:
      return "loaded";
    case Tier::kExact:
      break;
  }
  return "exact";
}

std::string TierSetting::name() const {
  return tier == Tier::kLoaded ? "loaded, order " + std::to_string(order) : nameOf(tier);
}

TierChoice chooseTier(const Arm& arm, const std::optional<PlanarArm>& planar,
                      const std::optional<Load>& load, const TierRequest& request) {
  checkRequest(request);
  require(request.tier != Tier::kPlanar || planar,
          "tier: planar needs arm.geometry: planar; this arm is spatial, use tier: linear");
  if (load) load->validate(arm.sectionCount());
  if (!load || (load->empty() && !request.tier)) return chooseUnloaded(arm, planar, request);

  const bool in_plane = planar && inPlane(*load);
  require(request.tier != Tier::kPlanar || in_plane,
          "tier: planar needs a load in the arm's x-y plane, and this one has a part across it; "
          "use tier: loaded, or turn arm.base");
  constexpr double kLeastError = kMargin * kExactTipError;
  require(!request.tip_error || *request.tip_error >= kLeastError,
          "accuracy.tip_error_percent: no tier errs by less than ", percent(kLeastError),
          " of the arm's length; ask for that or more");

  const Samples sampled = sampleTips(arm, *load);
  const std::vector<Sample>& samples = sampled.balanced;
  const double arm_length = arm.restLength();
  const std::vector<TierSetting> settings = settingsOf(request, in_plane);
  const bool one = settings.size() == 1;
  const double allowed = request.tip_error.value_or(kUsualTipError);
  std::optional<TierChoice> last;
  std::string cheapest;
  for (const TierSetting& setting : settings) {
    const TierSolver solver(arm, planar, load, setting);
    const double error =
        setting.tier == Tier::kExact ? kExactTipError : errorOf(solver, samples, arm_length);
    std::ostringstream errs;
    if (std::isfinite(error)) {
      errs << setting.name() << " errs by up to " << percent(error) << " of the arm's length";
    } else {
      errs << setting.name() << " finds no balance at some inputs";
    }
    if (sampled.unbalanced > 0) {
      errs << " (at " << sampled.unbalanced << " of " << sampled.unbalanced + samples.size()
           << " sampled inputs no shape balances the load)";
    }
    if (request.time) {
      const double time = timeOf(solver, samples.front().lengths);
      if (cheapest.empty()) cheapest = setting.name() + " takes " + microseconds(time);
      if (time > *request.time) continue;
      if (last && last->tip_error <= error) continue;
      last = TierChoice{setting, error,
                        errs.str() + " and takes " + microseconds(time) + " of the " +
                            microseconds(*request.time) + " allowed"};
    } else if (kMargin * error <= allowed || (one && !request.tip_error)) {
      return {setting, error,
              one ? "asked for; " + errs.str()
                  : errs.str() + ", the cheapest within " + percent(allowed)};
    } else if (!last || error < last->tip_error) {
      last = TierChoice{setting, error, errs.str()};
    }
  }
  if (request.time) {
    require(last.has_value(), "budget.time_us: the cheapest, ", cheapest, "; allow that much");
    return *last;
  }
  require(false, "accuracy.tip_error_percent: no tier asked for keeps within ", percent(allowed),
          " (with a margin of 2); ", last->reason, "; ask for less, or use tier: auto");
  return *last;
}

}  // namespace helix_arm::model
