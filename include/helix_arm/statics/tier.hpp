#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"

namespace helix_arm::statics {

/// Model that computes the shape, in order of increasing cost.
enum class Tier {
  kPlanar,  ///< SE(2), closed form, no load
  kLinear,  ///< SE(3), closed form, no load
  kLoaded,  ///< strain in Legendre modes up to a given order
  kExact,   ///< shooting, to its integration tolerance
};
/// All tiers in order of increasing cost. Add a new tier here, too.
inline constexpr Tier kTiers[] = {Tier::kPlanar, Tier::kLinear, Tier::kLoaded, Tier::kExact};

/// "planar", "linear", "loaded" or "exact".
const char* nameOf(Tier tier);
/// The tier with this name; empty if there is none.
std::optional<Tier> tierNamed(const std::string& word);

/// Word for "no particular tier" wherever tier names are accepted.
inline constexpr char kAutoTier[] = "auto";
/// kAutoTier and the names of all tiers.
std::vector<std::string> tierWords();

/// Whether the tier accounts for loads: loaded and exact do.
bool takesLoad(Tier tier);

/// Request of the user. Without tier, tip error and time, the result is the cheapest tier that the
/// scene requires; under load, the cheapest whose tip error is at most kUsualTipError.
struct TierRequest {
  std::optional<Tier> tier;  ///< absent: automatic choice
  std::optional<int> order;  ///< order of Tier::kLoaded, with the range of LoadedArmOf
  std::optional<double>
      relative_tip_error;      ///< largest tip error, as a fraction of the arm's length, > 0
  std::optional<double> time;  ///< longest solution time, averaged over the samples [s], > 0
};
/// 0.1 % of the arm's length; a webcam cannot resolve a smaller error.
inline constexpr double kUsualTipError = 1e-3;

/// Assumed error of the exact tier, as a fraction of the arm's length. No tier is reported to be
/// more accurate, and no smaller error can be requested.
inline constexpr double kExactTipError = 1e-9;
/// Safety factor between the requested error and the largest error over the samples. It covers the
/// inputs between the samples, where the error may be larger. No bound is proven, but over random
/// scenes of 1 to 96 actuators the factor sufficed at thousands of other inputs (tier_test).
inline constexpr double kTipErrorMargin = 2.0;
/// Smallest tip error that can be requested.
inline constexpr double kLeastTipError = kTipErrorMargin * kExactTipError;

/// A tier and its order.
struct TierSetting {
  Tier tier = Tier::kLinear;
  int order = 0;  ///< order of Tier::kLoaded, else 0

  /// "linear", "loaded 5", ...
  std::string name() const;
};

/// The tier that is used for a scene, and why.
struct TierChoice {
  TierSetting setting;
  /// Largest tip error against the exact tier over the sampled inputs, as a fraction of the arm's
  /// length, at least kExactTipError; without load 0, or that of the steps of a taper.
  double relative_tip_error = 0.0;
  std::string reason;  ///< one sentence
};

/// The cheapest tier that meets the scene's needs and the request.
///
/// Without load: planar for an arm in a plane, otherwise linear. Under load, every tier is compared
/// with the exact one at sampleInputs(). The choice is the cheapest tier whose error is within
/// `relative_tip_error` at all samples, with the margin kTipErrorMargin. With `time`, it is the
/// most accurate tier whose mean time over these samples on this machine is within `time`. Samples
/// at which no shape balances the load are excluded from both; the reason states their number.
/// @param planar  the arm in its plane, if it lies in one.
/// @throws std::invalid_argument naming the scene's key and the remedy: a tier that does not apply
///     to the scene (planar for a spatial arm or with a load out of its plane; loaded or exact
///     without load), an accuracy that no tier reaches, or a time that no tier meets.
TierChoice chooseTier(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
                      const std::optional<Load>& load, const TierRequest& request);

/// Sample inputs that exercise every motion of an arm, for checks that rely on samples.
///
/// A section's map from lengths to twists (eq. 17) moves it along as many combinations of its
/// actuators as the rank of the map. They are the right singular vectors of the map multiplied by
/// the range of each length. The twists are largest at corners of the limits where a combination of
/// these vectors is largest. The samples are the corners along and against each vector (for all
/// sections at once, and for one section with the others at rest), and the corners along random
/// combinations in every section. The first two samples are the lower and the upper limits; the
/// last `inner` are uniform within the limits. The generator is seeded: the same arm gives the same
/// samples.
/// @param corners  number of random combinations, >= 0.
/// @param inner    number of uniform samples within the limits, >= 0.
/// @return inputs (n) of each sample.
std::vector<Eigen::VectorXd> sampleInputs(const model::Arm& arm, int corners, int inner);

}  // namespace helix_arm::statics
