#include "curve_in_arm.hpp"

#include <algorithm>
#include <cmath>

#include "basics/text.hpp"
#include "helix_arm/localization/gaussian.hpp"

namespace helix_arm::procedures {
namespace {

using estimation::ArmCaptures;
using estimation::Calibration;

// The curve of a muscle is refused by either test in this share of calibrations.
constexpr double kFalseAlarms = 0.01;
// Largest residuals of captures that still tell of a muscle, in standard deviations of their noise.
constexpr double kMostMisfit = 2.0;
// Points at which curves are compared.
constexpr int kCompared = 101;
// Lengths that differ by less are the same, written with other digits [m].
constexpr double kSameLength = 1e-9;

double pointOf(const model::Range& range, int i) {
  return range.lower + (range.upper - range.lower) * i / (kCompared - 1);
}

bool isSame(const model::Contraction& a, const model::Contraction& b) {
  const model::Range &one = a.inputRange(), &other = b.inputRange();
  const double most = 1e-6 * (one.upper - one.lower);
  if (std::abs(one.lower - other.lower) > most || std::abs(one.upper - other.upper) > most) {
    return false;
  }
  const model::Range both{std::max(one.lower, other.lower), std::min(one.upper, other.upper)};
  for (int i = 0; i < kCompared; ++i) {
    const double p = pointOf(both, i);
    if (std::abs(a.lengthInside(p) - b.lengthInside(p)) > kSameLength) return false;
  }
  return true;
}

// The largest deviation of a curve from that of the free lengths, in standard errors of the latter,
// over the pressures of the captures.
void compareCurves(const std::vector<ArmCaptures>& arms, const estimation::ContractionSpline& free,
                   const estimation::ContractionSpline& in_arm, CurveInArm& out) {
  model::Range range{free.knots.back(), free.knots.front()};
  for (const ArmCaptures& arm : arms) {
    for (const estimation::Capture& capture : arm.captures) {
      for (int i = 0; arm.free_curve && i < capture.pressure.size(); ++i) {
        if (!arm.free_curve->actuators[i]) continue;
        range.lower = std::min(range.lower, capture.pressure[i]);
        range.upper = std::max(range.upper, capture.pressure[i]);
      }
    }
  }
  for (int i = 0; i < kCompared; ++i) {
    const double p = pointOf(range, i);
    const double deviation = free.weights(p) * (in_arm.lengths - free.lengths);
    const double errors = std::abs(deviation) / free.errorAt(p);
    if (errors <= out.standard_errors) continue;
    out.standard_errors = errors;
    out.deviation = deviation;
    out.pressure = p;
  }
}

// Student's test of the differences of the captures' squared errors: whether held-out captures are
// predicted worse by more than chance.
bool isWorse(const std::optional<estimation::HeldOut>& with,
             const std::optional<estimation::HeldOut>& without) {
  if (!with || !without || with->captures.size() < 2) return false;
  const auto count = static_cast<double>(with->captures.size());
  double sum = 0, square = 0;
  for (std::size_t c = 0; c < with->captures.size(); ++c) {
    const double more = std::pow(with->captures[c], 2) - std::pow(without->captures[c], 2);
    sum += more;
    square += more * more;
  }
  const double variance = (square - sum * sum / count) / (count - 1);
  if (!(sum > 0 && variance > 0)) return false;
  return estimation::tailOfF(sum * sum / count / variance, 1, count - 1) < 2 * kFalseAlarms;
}

std::string reasonAgainst(const CurveInArm& found, const Calibration& with,
                          const Calibration& alone) {
  if (with.status != estimation::CalibrationStatus::kCalibrated) return with.reason;
  if (found.probability < kFalseAlarms) {
    return basics::format(
        "the captures ask for a curve that is off by %.1f mm at %.0f kPa, %.1f standard errors of "
        "the free lengths; of one muscle, they differ by as much with a probability of %.2g; "
        "expected at least %.2g: the curve describes the arm, not the muscle (unequal lengths, "
        "friction)",
        1e3 * found.deviation, found.pressure / 1e3, found.standard_errors, found.probability,
        kFalseAlarms);
  }
  if (with.noise_scale > kMostMisfit) {
    return basics::format(
        "the residuals of the captures remain %.1f times as large as their noise; expected at most "
        "%.0f times: the curve describes the arm, not the muscle (unequal lengths, friction)",
        with.noise_scale, kMostMisfit);
  }
  const auto worse = [](const char* what, const estimation::HeldOut& a,
                        const estimation::HeldOut& b, const std::string& unit) {
    return basics::format("left-out %s are predicted worse with it, %.3g instead of %.3g %s", what,
                          a.error, b.error, unit.c_str());
  };
  if (isWorse(with.by_pressure, alone.by_pressure)) {
    return worse("pressures", *with.by_pressure, *alone.by_pressure, with.error_unit);
  }
  if (isWorse(with.by_arm, alone.by_arm)) {
    return worse("arms", *with.by_arm, *alone.by_arm, with.error_unit);
  }
  return {};
}

}  // namespace

std::vector<std::string> shareCurve(const model::Arm& before,
                                    const estimation::ContractionFit& curve,
                                    std::vector<ArmCaptures>& arms) {
  ArmCaptures& first = arms.front();
  first.free_curve = {curve.spline.value(), {}};
  std::vector<const model::Contraction*> old;
  for (int i = 0; i < first.arm.actuatorCount(); ++i) {
    const bool follows = isSame(first.arm.actuator(i).contraction, curve.curve.value());
    first.free_curve->actuators.push_back(follows);
    if (follows) old.push_back(&before.actuator(i).contraction);
  }
  std::vector<std::string> others;
  for (std::size_t a = 1; a < arms.size(); ++a) {
    ArmCaptures& arm = arms[a];
    arm.free_curve = {curve.spline.value(), {}};
    std::vector<bool>& follows = arm.free_curve->actuators;
    for (int i = 0; i < arm.arm.actuatorCount(); ++i) {
      const model::Contraction& own = arm.arm.actuator(i).contraction;
      follows.push_back(std::any_of(old.begin(), old.end(),
                                    [&own](const auto* one) { return isSame(*one, own); }));
    }
    if (std::find(follows.begin(), follows.end(), true) != follows.end()) continue;
    arm.free_curve.reset();
    others.push_back(arm.name);
  }
  return others;
}

CurveFit fitCurveInArm(const std::vector<ArmCaptures>& arms, estimation::CalibrationOptions options,
                       const estimation::ContractionFit& curve,
                       const std::vector<estimation::LengthSample>& lengths,
                       estimation::Branch branch, const Calibration& alone) {
  options.fit.insert(estimation::FitParameter::kContraction);
  CurveFit out;
  out.calibration = estimation::calibrate(arms, options);
  const Calibration& with = out.calibration;
  if (with.status == estimation::CalibrationStatus::kCalibrated) {
    compareCurves(arms, *curve.spline, *with.spline, out.verdict);
    out.verdict.probability = with.curve_test->probability;
    out.contraction = estimation::contractionOf(*with.spline, lengths, branch);
  }
  out.verdict.reason = reasonAgainst(out.verdict, with, alone);
  if (out.verdict.reason.empty()) out.verdict.reason = out.contraction.reason;
  out.verdict.taken = out.verdict.reason.empty();
  return out;
}

}  // namespace helix_arm::procedures
