// A contraction curve fitted to free lengths and captures together, over many simulated sets: the
// curve of a sound muscle is refused as rarely as is said, that of a wrong one is refused, and
// K_kappa holds its error whichever curve is kept.
#include "procedures/curve_in_arm.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "support/sample_rig.hpp"
#include "support/test_size.hpp"

namespace helix_arm::procedures {
namespace {

using namespace estimation;
using test::Random;

// A muscle that shortens as braided ones do.
struct Muscle {
  double length, stroke, scale;  // [m], [m], [Pa]
  double friction = 0;           // pressure that does nothing in an arm [Pa]

  explicit Muscle(Random& random)
      : length(0.42 + 0.01 * random.normal()),
        stroke(0.09 + 0.005 * random.normal()),
        scale((200 + 15 * random.normal()) * 1e3) {}

  double at(double p) const {
    const double acting = std::max(0.0, p - friction) / scale;
    return length - stroke * (1 - std::exp(-acting * acting));
  }
};

struct Kind {
  const char* name;
  int muscles;
  double radius;  // [m]
  double noise;   // of curvatures [rad]
};
constexpr Kind kKinds[] = {{"planar", 2, 0.0381, 0.02},
                           {"spatial", 3, 0.0254, 0.02},
                           {"planar, precise", 2, 0.0381, 0.005},
                           {"spatial, precise", 3, 0.0254, 0.005}};

struct Set {
  estimation::ContractionFit curve;
  std::vector<LengthSample> lengths;
  std::vector<ArmCaptures> arms;
  double K_kappa;  // true
  double noise;

  // @param friction  of the muscles in the arm, but not of the one measured alone.
  Set(const Kind& kind, double friction, unsigned seed) : noise(kind.noise) {
    Random random(seed);
    Muscle muscle(random);
    for (int i = 0; i <= 14; ++i) {
      const double p = test::kMaxPressure * i / 14;
      lengths.push_back({p, muscle.at(p) + estimation::kFreeLengthNoise * random.normal()});
    }
    curve = estimation::fitContraction(lengths, {estimation::CurveKind::kSpline});
    muscle.friction = friction;
    test::Ring ring{kind.muscles, kind.radius, 0, {10.0, 0.0, 1.38e-4}};
    const model::Arm known({test::ringSection(ring, curve.curve.value())});
    K_kappa = ring.stiffness.kappa *= std::exp(0.2 * random.normal());
    const model::Arm truth = known.withStiffness(ring.stiffness);
    ArmCaptures arm{kind.name, known, kind.muscles == 2, {}, {}, {}, {}};
    for (const Eigen::VectorXd& pressure : test::twelvePressures(known)) {
      const Eigen::VectorXd there = pressure.unaryExpr([&](double p) { return muscle.at(p); });
      const double bend = model::curvatureOf(truth.twistsOfLengths(there).col(0));
      test::addCapture(arm, pressure,
                       estimation::CurvatureReading{std::abs(bend + noise * random.normal())});
    }
    arm.free_curve = {curve.spline.value(), std::vector<bool>(kind.muscles, true)};
    arms.push_back(std::move(arm));
  }

  // K_kappa's error in its standard errors.
  double offBy(const Calibration& found) const {
    const estimation::Parameter& one = found.parameters.front();
    EXPECT_EQ(one.name, "K_kappa");
    return (one.value - K_kappa) / one.standard_error;
  }
};

struct Tally {
  int sets = 0, refused = 0;
  double taken = 0, kept = 0, kept_of_refused = 0;  // squares of K_kappa's error, of all
};

// K_kappa's error is that of the joint fit where the curve is taken, and that of the fit with the
// curve of the free lengths everywhere, since it is kept too rarely to tell of its own sets.
Tally tallyOf(const Kind& kind, double friction, int sets, unsigned seed) {
  Tally out;
  for (int k = 0; k < sets; ++k) {
    const Set set(kind, friction, seed + k);
    estimation::CalibrationOptions options;
    options.fit.erase(FitParameter::kGamma);
    options.curvature_noise = set.noise;
    const Calibration alone = estimation::calibrate(set.arms, options);
    EXPECT_EQ(alone.status, estimation::CalibrationStatus::kCalibrated) << k << alone.reason;
    if (alone.status != estimation::CalibrationStatus::kCalibrated) continue;
    const CurveFit fit =
        fitCurveInArm(set.arms, options, set.curve, set.lengths, estimation::Branch::kBoth, alone);
    ++out.sets;
    const double kept = std::pow(set.offBy(alone), 2);
    out.kept += kept;
    if (fit.verdict.taken) {
      out.taken += std::pow(set.offBy(fit.calibration), 2);
      continue;
    }
    ++out.refused;
    out.kept_of_refused += kept;
  }
  std::printf(
      "%s, friction %g Pa: %d of %d refused; K_kappa, RMS in standard errors: %.2f taken, "
      "%.2f kept, %.2f kept of refused\n",
      kind.name, friction, out.refused, out.sets,
      std::sqrt(out.taken / std::max(1, out.sets - out.refused)), std::sqrt(out.kept / out.sets),
      std::sqrt(out.kept_of_refused / std::max(1, out.refused)));
  return out;
}

TEST(CurveInArm, OfSoundMusclesIsTakenAndKKappaHoldsItsError) {
  const int sets = test::draws(20, 136);
  for (const Kind& kind : kKinds) {
    const Tally found = tallyOf(kind, 0, sets, 1000);
    EXPECT_EQ(found.sets, sets);
    // Two tests that each refuse 1 %: more than 8 of 136 have a probability of 0.2 %.
    EXPECT_LE(found.refused, test::isFullSize() ? 8 : test::mostOf(sets, 0.02)) << kind.name;
    const double taken = std::sqrt(found.taken / (found.sets - found.refused));
    const double kept = std::sqrt(found.kept / found.sets);
    for (const double rms : {taken, kept}) {
      // Of n errors it is 1 with a deviation of 0.7 / sqrt(n): of 20, four of these.
      EXPECT_GE(rms, test::isFullSize() ? 0.8 : 0.4) << kind.name;
      EXPECT_LE(rms, test::isFullSize() ? 1.3 : 1.6) << kind.name;
    }
  }
}

TEST(CurveInArm, OfMusclesWithFrictionInTheArmIsRefused) {
  for (const Kind& kind : kKinds) {
    const int sets = test::draws(6, 40);
    const Tally found = tallyOf(kind, 30e3, sets, 5000);
    EXPECT_GE(found.refused, test::isFullSize() ? 36 : test::leastOf(sets, 0.95)) << kind.name;
  }
}

}  // namespace
}  // namespace helix_arm::procedures
