#include "tier_reader.hpp"

#include <string>
#include <vector>

#include "helix_arm/statics/loaded.hpp"

namespace helix_arm::io {
namespace {

// statics::kLeastTipError in percent.
constexpr double kLeastPercent = 2e-7;
const NumberRule kTipError = within(kPositive, kLeastPercent, 100, " % of the arm's length");
const NumberRule kTime = within(kPositive, 1e-3, 1e9, " us");

// The number in a map with a single key.
std::optional<double> readOnly(const MapReader& scene, const Value& document,
                               const std::string& key, const std::string& number,
                               const NumberRule& rule, FaultList& faults) {
  const Value* value = document.find(key);
  if (value == nullptr) return std::nullopt;
  return MapReader(*value, scene.path(key), {number}, faults).number(number, rule);
}

// The words for tiers that a scene allows.
std::string allowed(bool planar, bool loaded) {
  std::vector<std::string> words = {statics::kAutoTier};
  for (const statics::Tier tier : statics::kTiers) {
    if (tier == statics::Tier::kPlanar && !planar) continue;
    if (loaded || !statics::takesLoad(tier)) words.emplace_back(statics::nameOf(tier));
  }
  return alternatives(words);
}

void checkSceneAllows(const MapReader& scene, statics::Tier tier, const ArmParts& arm) {
  const bool planar = arm.planar.has_value();
  if (tier == statics::Tier::kPlanar && !planar) {
    scene.fault("tier", allowed(false, true) + ", since arm.geometry is spatial");
  }
  if (statics::takesLoad(tier) && !scene.has("load") && arm.K_eps.empty()) {
    scene.fault("tier", allowed(planar, false) + ", since the scene has no key load; or add it");
  }
}

}  // namespace

statics::TierRequest readTierRequest(const MapReader& scene, const Value& document,
                                     const ArmParts* arm, FaultList& faults) {
  statics::TierRequest request;
  std::string tier = statics::kAutoTier;
  bool known = true;
  if (scene.has("tier")) {
    const auto word = scene.choice("tier", statics::tierWords());
    known = word.has_value();
    tier = word.value_or(tier);
    request.tier = statics::tierNamed(tier);
  }
  if (request.tier && arm) checkSceneAllows(scene, *request.tier, *arm);
  if (scene.has("order")) {
    if (const auto order = scene.integer("order", statics::kLeastOrder, statics::kMostOrder)) {
      request.order = static_cast<int>(*order);
    }
    if (known && tier != "loaded") {
      scene.complain("order", "applies to tier: loaded, but tier is " + tier +
                                  "; expected tier: loaded, or no order");
    }
  }
  const auto percent =
      readOnly(scene, document, "accuracy", "tip_error_percent", kTipError, faults);
  if (percent) request.relative_tip_error = *percent / 100;
  const auto us = readOnly(scene, document, "budget", "time_us", kTime, faults);
  if (us) request.time = *us * 1e-6;
  if (scene.has("accuracy") && scene.has("budget")) {
    scene.complain("budget", "is given together with accuracy; expected only one");
  }
  const bool chosen = tier != statics::kAutoTier && (tier != "loaded" || scene.has("order"));
  for (const char* key : {"accuracy", "budget"}) {
    if (!scene.has(key) || !known || !chosen) continue;
    const std::string what = tier + (tier == "loaded" ? " with an order" : "");
    scene.complain(key, "has no effect, since tier is " + what +
                            "; expected tier: auto, or loaded without an order");
  }
  return request;
}

}  // namespace helix_arm::io
