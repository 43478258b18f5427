#include <cmath>
#include <cstdlib>
#include <set>

#include "basics/text.hpp"
#include "calibration_job.hpp"

namespace helix_arm::procedures {
namespace {

constexpr const char* kTag = "tag_";
constexpr const char* kBase = "base_";
constexpr int kMostDigits = 12;

// Digits of the value down to the second digit of its error.
int digitsOf(const estimation::Parameter& one) {
  if (!(one.standard_error > 0) || !std::isfinite(one.standard_error) || one.value == 0) return 6;
  const double orders =
      std::floor(std::log10(std::abs(one.value))) - std::floor(std::log10(one.standard_error));
  return static_cast<int>(std::fmin(std::fmax(orders + 2, 2), kMostDigits));
}

}  // namespace

std::vector<estimation::Parameter> parametersOf(const CalibrationOutcome& outcome) {
  std::vector<estimation::Parameter> out;
  if (outcome.calibration) out = outcome.calibration->parameters;
  if (outcome.series) out = outcome.series->parameters;
  const auto add = [&out](const std::vector<estimation::Parameter>& more) {
    out.insert(out.end(), more.begin(), more.end());
  };
  if (outcome.response) add(outcome.response->parameters);
  if (outcome.mode) add(outcome.mode->parameters);
  if (outcome.inertia) add(outcome.inertia->parameters);
  return out;
}

bool isJudged(const estimation::Parameter& one) { return !std::isnan(one.standard_error); }

Determined determinedOf(const CalibrationOutcome& outcome) {
  Determined out;
  std::set<int> tags;
  for (const estimation::Parameter& one : parametersOf(outcome)) {
    if (isJudged(one) && !one.identifiable) {
      ++out.omitted;
    } else if (one.name.rfind(kTag, 0) == 0) {
      tags.insert(std::atoi(one.name.c_str() + std::string(kTag).size()));
    } else {
      out.parameters.push_back(one);
    }
  }
  out.tags.assign(tags.begin(), tags.end());
  return out;
}

std::string textOf(const estimation::Parameter& one) {
  if (one.unit == "Pa") {
    return textOf({one.name, "kPa", 1e-3 * one.initial, 1e-3 * one.value, 1e-3 * one.standard_error,
                   one.identifiable});
  }
  std::string out = one.name + basics::format(" = %.*g", digitsOf(one), one.value);
  if (isJudged(one)) out += basics::format(" +- %.2g", one.standard_error);
  return out + (one.unit.empty() ? "" : " " + one.unit);
}

std::string textOf(const estimation::Combination& one) {
  if (one.relative_error < 1)
    return one.name + basics::format(" +- %.2g %%", 1e2 * one.relative_error);
  return one.name + basics::format(" +- a factor of %.2g", std::exp(one.relative_error));
}

std::vector<std::string> placementTexts(bool base, std::size_t tags) {
  std::vector<std::string> out;
  if (base) out.emplace_back("pose of the base");
  if (tags > 0) {
    out.push_back("places of " + std::to_string(tags) + (tags == 1 ? " tag" : " tags"));
  }
  return out;
}

std::string tipErrorText(const CalibrationOutcome& outcome) {
  if (!outcome.tip_error_before || !outcome.tip_error_after) return "";
  return basics::format("tip error %.1f mm before, %.1f mm after", 1e3 * *outcome.tip_error_before,
                        1e3 * *outcome.tip_error_after);
}

std::vector<std::string> textsOf(const std::vector<estimation::Suspect>& suspects) {
  std::vector<std::string> out;
  for (const estimation::Suspect& one : suspects) {
    out.push_back(
        basics::format("suspect %d: %s (%s) explains %.0f %% of what is beyond the noise: %s",
                       static_cast<int>(out.size()) + 1, one.cause.c_str(), one.where.c_str(),
                       100 * one.explains, one.remedy.c_str()));
  }
  return out;
}

std::string resultText(const std::string& scene, const CalibrationOutcome& outcome) {
  std::string out = tipErrorText(outcome);
  out += (out.empty() ? "" : "; ") + std::string("calibrated ") + scene;
  std::vector<std::string> list;
  for (const auto& [name, fit] : outcome.contractions) list.push_back("contraction " + name);
  const Determined found = determinedOf(outcome);
  bool base = false;
  for (const estimation::Parameter& one : found.parameters) {
    if (one.name.rfind(kBase, 0) == 0) {
      base = true;
    } else {
      list.push_back(textOf(one));
    }
  }
  if (outcome.calibration) {
    for (const estimation::Combination& one : outcome.calibration->combinations) {
      if (one.identifiable) list.push_back(textOf(one));
    }
  }
  for (const std::string& text : placementTexts(base, found.tags.size())) list.push_back(text);
  return out + ": " + (list.empty() ? "the data determined no parameter" : basics::joined(list));
}

}  // namespace helix_arm::procedures
