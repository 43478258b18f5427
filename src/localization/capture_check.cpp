#include "helix_arm/localization/capture_check.hpp"

#include <cmath>
#include <cstddef>
#include <utility>

#include "basics/median.hpp"

namespace helix_arm::estimation {
namespace {

constexpr std::size_t kFewestCompared = 5;
// With fewer, the size of the residuals is mostly chance.
constexpr double kLeastScatterFreedom = 3.0;

// Standard deviation of a residual, as far as this capture tells.
std::optional<double> deviationOf(const std::optional<CaptureScatter>& capture) {
  if (!capture || capture->freedom < kLeastScatterFreedom) return std::nullopt;
  return capture->rms * std::sqrt(capture->residuals / capture->freedom);
}

}  // namespace

CaptureScatter scatterOf(const TwistFit& fit, int per_tag, bool planar) {
  const auto fitting = static_cast<double>(fit.tags.size()) - fit.outliers();
  const double parameters = (planar ? 3.0 : 6.0) * static_cast<double>(fit.twists.cols());
  const double residuals = per_tag * fitting;
  return {fit.rms, residuals - parameters, residuals};
}

CaptureCheck checkCaptures(const std::vector<std::optional<CaptureScatter>>& captures) {
  CaptureCheck out;
  out.apart.assign(captures.size(), false);
  std::vector<double> deviations, rms;
  for (const std::optional<CaptureScatter>& capture : captures) {
    const std::optional<double> deviation = deviationOf(capture);
    if (!deviation) continue;
    deviations.push_back(*deviation);
    rms.push_back(capture->rms);
  }
  if (deviations.size() < kFewestCompared) return out;
  out.usual = basics::medianOf(std::move(rms));
  const double most = kApart * basics::medianOf(std::move(deviations));
  for (std::size_t i = 0; i < captures.size(); ++i) {
    out.apart[i] = deviationOf(captures[i]).value_or(0) > most;
  }
  return out;
}

}  // namespace helix_arm::estimation
