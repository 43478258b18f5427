#include "contractions_json.hpp"

#include <utility>

namespace helix_arm::cli {
namespace {

using nlohmann::json;

constexpr std::pair<estimation::CurveKind, const char*> kCurveNames[] = {
    {estimation::CurveKind::kQuintic, "quintic"},
    {estimation::CurveKind::kTable, "table"},
    {estimation::CurveKind::kSpline, "spline"}};

const char* curveName(estimation::CurveKind wanted) {
  const char* found = "";
  for (const auto& [kind, name] : kCurveNames) found = kind == wanted ? name : found;
  return found;
}

// Points of a fitted curve, for drawing.
constexpr int kCurvePoints = 100;

json curveInArmJson(const std::optional<procedures::CurveInArm>& found) {
  if (!found) return nullptr;
  return {
      {"taken", found->taken},           {"reason", found->taken ? json() : json(found->reason)},
      {"deviation_m", found->deviation}, {"standard_errors", found->standard_errors},
      {"pressure_pa", found->pressure},  {"probability", found->probability}};
}

json verdictJson(estimation::ResponseVerdict verdict, const std::string& reason) {
  static const char* const kWords[] = {"found", "none", "not_determined"};
  return {{"verdict", kWords[static_cast<std::size_t>(verdict)]},
          {"reason", reason.empty() ? json() : json(reason)}};
}

json estimateJson(const estimation::Estimate& one, double scale = 1.0) {
  return {{"value", scale * one.value}, {"standard_error", scale * one.standard_error}};
}

}  // namespace

std::optional<estimation::CurveKind> curveKindOf(const std::string& word) {
  for (const auto& [kind, name] : kCurveNames) {
    if (word == name) return kind;
  }
  return std::nullopt;
}

json contractionsJson(const procedures::CalibrationOutcome& outcome) {
  json all = json::array();
  for (const auto& [name, fit] : outcome.contractions) {
    json samples = json::array(), curve = json::array();
    for (const estimation::LengthSample& sample : outcome.lengths) {
      samples.push_back({{"pressure_pa", sample.pressure}, {"length_m", sample.length}});
    }
    if (fit.curve) {
      const model::Range& range = fit.curve->inputRange();
      for (int i = 0; i <= kCurvePoints; ++i) {
        const double p = range.lower + (range.upper - range.lower) * i / kCurvePoints;
        curve.push_back({{"pressure_pa", p}, {"length_m", fit.curve->lengthInside(p)}});
      }
    }
    all.push_back({{"name", name},
                   {"kind", curveName(fit.kind)},
                   {"in_arm", curveInArmJson(outcome.curve_in_arm)},
                   {"rms_m", fit.rms},
                   {"constrained", fit.constrained},
                   {"hysteresis_m", toJson(fit.hysteresis)},
                   {"coefficients_m", fit.coefficients},
                   {"reference_pressure_pa", fit.reference_pressure},
                   {"samples", std::move(samples)},
                   {"curve", std::move(curve)}});
  }
  return all;
}

json responseJson(const std::optional<procedures::FittedResponse>& found) {
  if (!found) return nullptr;
  const estimation::ResponseFit& fit = found->fit;
  json reach = json::array(), weight = json::array();
  for (std::size_t j = 0; j < static_cast<std::size_t>(fit.response.play_count); ++j) {
    reach.push_back(estimateJson(fit.reach[j], 1e-3));
    weight.push_back(estimateJson(fit.weight[j]));
  }
  return {{"contractions", found->contractions},
          {"lag", verdictJson(fit.lag, fit.lag_reason)},
          {"play", verdictJson(fit.play, fit.play_reason)},
          {"rise_time_constant_s", estimateJson(fit.rise_time)},
          {"fall_time_constant_s", estimateJson(fit.fall_time)},
          {"play_kpa", std::move(reach)},
          {"play_weight", std::move(weight)},
          {"static_rms_m", fit.static_rms},
          {"rms_m", fit.rms}};
}

}  // namespace helix_arm::cli
