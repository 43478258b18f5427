#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"

namespace helix_arm::statics {

/// What computes the shape, from the cheapest to the dearest.
enum class Tier {
  kPlanar,  ///< SE(2), closed form, no load
  kLinear,  ///< SE(3), closed form, no load
  kLoaded,  ///< strain in Legendre modes up to an order
  kExact,   ///< shooting, to the tolerance of its integration
};
/// All of them, from the cheapest to the dearest. A new tier belongs here, too.
inline constexpr Tier kTiers[] = {Tier::kPlanar, Tier::kLinear, Tier::kLoaded, Tier::kExact};

/// "planar", "linear", "loaded" or "exact".
const char* nameOf(Tier tier);
/// The tier of such a word; nothing where it is none of them.
std::optional<Tier> tierNamed(const std::string& word);

/// What asks for no tier, where the words of tiers stand.
inline constexpr char kAutoTier[] = "auto";
/// kAutoTier and the words of all tiers.
std::vector<std::string> tierWords();

/// Whether the tier computes what a load does: loaded and exact.
bool takesLoad(Tier tier);

/// What a user asks for. With neither tier, tip error nor time: the cheapest tier that the scene
/// requires, and under load one that errs by kUsualTipError at most.
struct TierRequest {
  std::optional<Tier> tier;  ///< none: auto
  std::optional<int> order;  ///< of Tier::kLoaded, as LoadedArmOf has them
  std::optional<double>
      tip_error;               ///< largest error of the tip, as a part of the arm's length, > 0
  std::optional<double> time;  ///< longest time of a solution, the mean over the samples [s], > 0
};
/// 0.1 % of the arm's length: below it no webcam sees the difference.
inline constexpr double kUsualTipError = 1e-3;

/// What the exact tier is taken to be good to, as a part of the arm's length: no tier is said to
/// err by less, and none can be asked to.
inline constexpr double kExactTipError = 1e-9;
/// A tier is taken where its largest error over the samples is this factor less than what is asked.
/// That is what stands for the inputs between them, which may be worse: no bound is proven, but
/// over random scenes of 1 to 96 actuators they are not, at thousands of other inputs (tier_test).
inline constexpr double kTipErrorMargin = 2.0;
/// The least error that can be asked for.
inline constexpr double kLeastTipError = kTipErrorMargin * kExactTipError;

/// A tier with its setting.
struct TierSetting {
  Tier tier = Tier::kLinear;
  int order = 0;  ///< of Tier::kLoaded, else 0

  /// "linear", "loaded 5", ...
  std::string name() const;
};

/// The tier that serves a scene, and why.
struct TierChoice {
  TierSetting setting;
  /// Largest error of the tip against the exact tier over sampled inputs, as a part of the arm's
  /// length, at least kExactTipError; 0 where nothing loads the arm.
  double tip_error = 0.0;
  std::string reason;  ///< one sentence
};

/// The cheapest tier that a scene requires and a request allows.
///
/// Nothing loads the arm: planar for an arm in a plane, else linear. Under load every tier is
/// compared with the exact one at sampleInputs(), and the cheapest that keeps within `tip_error` at
/// all of them, with kTipErrorMargin to spare, is taken; with `time`, the most accurate whose mean
/// time over these inputs keeps within it on this machine. Inputs where no shape balances the load
/// count for neither, and the reason says how many they are.
/// @param planar  the arm in its plane, where it lies in one.
/// @throws std::invalid_argument naming the scene's key and the remedy: a tier that the scene
/// cannot have (planar for a spatial arm, or with a load out of its plane; loaded or exact without
/// load), an accuracy that no tier reaches, a time that none keeps.
TierChoice chooseTier(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
                      const std::optional<Load>& load, const TierRequest& request);

}  // namespace helix_arm::statics
