#include "helix_arm/tracking/error_budget.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include "estimation/tracked_arm.hpp"
#include "helix_arm/localization/placed_view.hpp"
#include "helix_arm/model/curve.hpp"
#include "support/random.hpp"
#include "support/sample_view.hpp"
#include "support/test_size.hpp"
#include "support/tip_spread.hpp"

namespace helix_arm::estimation {
namespace {

using namespace statics;
using test::Random;

constexpr double kPressureNoise = 300.0;  // [Pa]
constexpr double kDegree = test::kPi / 180;

// Deviations so small that the tip is linear in them, and an arm that is always at rest.
ArmFilterOptions smallDeviations() {
  ArmFilterOptions out;
  out.hysteresis = out.stroke_deviation = 0;
  out.settling_time = 1e-9;
  out.stiffness_deviation = {0.03, 0.03, 0.03};
  out.K_eps_deviation = 0.03;
  out.length_deviation = 0.002;
  out.bias_translation = 0.0005;
  out.bias_rotation = 0.005;
  return out;
}

PlacedView viewOf(int sections = 1) {
  TwistFitOptions fit;
  fit.free_base = true;
  fit.base_prior = {0.0005, 0.2 * kDegree};
  const ArmView view = test::sampleView(0.8 * sections, sections, 32 / sections);
  return {view, fit, {view.layout, {0.0003, 0.3 * kDegree}, fit.base_prior}};
}

ArmFilter::Input pictureOf(const Eigen::VectorXd& pressure, const model::Twists& twists,
                           double time) {
  lie::Vector6 deviation;
  deviation << 2e-4, 2e-4, 2e-4, 2e-3, 2e-3, 2e-3;
  return {time, pressure,
          Eigen::VectorXd::Constant(pressure.size(), kPressureNoise * kPressureNoise), twists,
          deviation.cwiseAbs2().replicate(twists.cols(), 1).asDiagonal()};
}

Correction correctionOf(const ArmModel& model, const Eigen::VectorXd& theta,
                        const Eigen::VectorXd& bias) {
  Correction out(model.arm());
  const int n = model.arm().actuatorCount();
  const auto stiffness = theta.size() - n;  // K_gamma and K_kappa, and K_eps under a load
  out.stiffness_factors.gamma = std::exp(theta[0]);
  out.stiffness_factors.kappa = std::exp(theta[1]);
  if (stiffness == 3) out.K_eps_factor = std::exp(theta[2]);
  out.length_scale = theta.tail(n).array().exp();
  out.offset.reshaped() = bias;
  return out;
}

// A filter of `model` that has seen a true arm at some pressures, and its budget at the last one.
struct Watched {
  explicit Watched(const ArmModel& given, unsigned seed = 1, int pictures = 20)
      : model(given),
        filter(model, smallDeviations()),
        budget(model, smallDeviations(), viewOf(model.arm().sectionCount())) {
    Random random(seed);
    CorrectedModel truth(model);
    truth.set(correctionOf(model, test::drawNormal(thetaPrior(), random),
                           Eigen::VectorXd::Zero(6 * model.arm().sectionCount())));
    for (int k = 0; k < pictures; ++k) {
      const Eigen::VectorXd pressure = test::randomInput(model.arm(), random);
      picture = pictureOf(pressure, truth.shape(model.arm().lengths(pressure))->twists(), k);
      EXPECT_TRUE(filter.see(picture).accepted());
    }
    EXPECT_TRUE(budget.update(filter, picture));
  }

  Eigen::MatrixXd thetaPrior() const { return filter.parameterPrior().cwiseAbs2().asDiagonal(); }
  const Eigen::Matrix3d& part(BudgetPart which) const {
    return budget.current()->part(which).covariance;
  }
  // Tip for an error of the filter's state and of the pressures.
  Eigen::Vector3d tipOf(const Eigen::VectorXd& state, const Eigen::VectorXd& pressure) const {
    CorrectedModel corrected(model);
    const int m = filter.parameterCount();
    const Eigen::VectorXd all = filter.state().mean + state;
    corrected.set(correctionOf(model, all.head(m), all.tail(all.size() - m)));
    return model::tipPose(*corrected.shape(model.arm().lengths(model.arm().clamped(pressure))))
        .translation;
  }

  ArmModel model;
  ArmFilter filter;
  ErrorBudget budget;
  ArmFilter::Input picture;
};

struct ArmCase {
  const char* name;
  ArmModel (*model)();
};
std::string nameOfCase(const ::testing::TestParamInfo<ArmCase>& info) { return info.param.name; }

class ErrorBudgetOf : public ::testing::TestWithParam<ArmCase> {};
INSTANTIATE_TEST_SUITE_P(Arms, ErrorBudgetOf,
                         ::testing::Values(ArmCase{"Helical", helicalModel},
                                           ArmCase{"Loaded", loadedModel}),
                         nameOfCase);

TEST_P(ErrorBudgetOf, ThePartsAreTheSpreadsOfTipsForTheErrorsThatTheyStandFor) {
  const Watched watched(GetParam().model());
  const Eigen::MatrixXd& P = watched.filter.state().covariance;
  const int m = watched.filter.parameterCount();
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(P.rows());
  constexpr int kSamples = 4000;
  Random random(7);
  const auto byState = [&](const Eigen::MatrixXd& covariance) {
    return test::spreadOf(kSamples, [&] {
      return watched.tipOf(test::drawNormal(covariance, random), watched.picture.pressure);
    });
  };
  Eigen::MatrixXd theta = Eigen::MatrixXd::Zero(P.rows(), P.cols());
  theta.topLeftCorner(m, m) = P.topLeftCorner(m, m);
  test::expectSpread(byState(theta), watched.part(BudgetPart::kCalibration), 0.15);
  test::expectSpread(
      byState(P), watched.part(BudgetPart::kCalibration) + watched.part(BudgetPart::kUnexplained),
      0.15);
  test::expectSpread(test::spreadOf(kSamples,
                                    [&] {
                                      Eigen::VectorXd pressure = watched.picture.pressure;
                                      for (double& p : pressure) {
                                        p += kPressureNoise * random.normal();
                                      }
                                      return watched.tipOf(none, pressure);
                                    }),
                     watched.part(BudgetPart::kPressure), 0.15);
  const model::Shape shape = *watched.filter.shape(watched.picture.pressure);
  test::expectSpread(test::spreadOf(kSamples,
                                    [&] {
                                      model::Twists twists = shape.twists();
                                      twists.reshaped() +=
                                          test::drawNormal(watched.picture.covariance, random);
                                      return model::tipPose(shape.about(twists)).translation;
                                    }),
                     watched.part(BudgetPart::kCamera), 0.15);
}

// A measurement whose distance2 is this share of the limit.
ArmFilter::Input pictureAt(const ArmModel& model, const ArmFilter& filter, ErrorBudget& scratch,
                           double share, double time) {
  const Eigen::VectorXd pressure = model.arm().inputAt(0.4);
  const model::Twists expected = model.solve(pressure).shape.twists();
  double offset = 1e-4;
  for (int i = 0; i < 20; ++i) {
    model::Twists measured = expected;
    measured(1, 0) += offset;
    scratch.update(filter, pictureOf(pressure, measured, time));
    offset *= std::sqrt(share * scratch.current()->limit / scratch.current()->distance2);
  }
  model::Twists measured = expected;
  measured(1, 0) += offset;
  return pictureOf(pressure, measured, time);
}

TEST(ErrorBudget, ChangesItsStateAfterFivePicturesInARow) {
  const ArmModel model = helicalModel();
  const ArmFilter fresh(model, {});
  ErrorBudget budget(model, {}), scratch(model, {});
  const auto inside = pictureAt(model, fresh, scratch, 0.99, 0);
  const auto outside = pictureAt(model, fresh, scratch, 1.01, 0);
  const auto after = [&](const ArmFilter::Input& picture, int count) {
    for (int i = 0; i < count; ++i) EXPECT_TRUE(budget.update(fresh, picture));
    return budget.current()->state;
  };
  EXPECT_EQ(after(outside, 4), BudgetState::kInside);
  EXPECT_EQ(after(inside, 1), BudgetState::kInside);
  EXPECT_EQ(after(outside, 4), BudgetState::kInside);
  EXPECT_EQ(after(outside, 1), BudgetState::kOutside);
  EXPECT_EQ(after(inside, 4), BudgetState::kOutside);
  EXPECT_EQ(after(outside, 1), BudgetState::kOutside);
  EXPECT_EQ(after(inside, 5), BudgetState::kInside);
  EXPECT_EQ(after(outside, 4), BudgetState::kInside);
  budget.reset();
  EXPECT_EQ(after(outside, 4), BudgetState::kInside);
}

// Ten pictures of a true arm at rest, at pressures that are not quite the readings. Of truths as
// the calibration claims them the distance is a chi-square of three degrees.
TEST(ErrorBudget, IsOutsideAsRarelyAsChiSquareSaysAndWhereLengthsAreOffByTenStandardErrors) {
  ArmFilterOptions options;  // a careful calibration: hardly any hysteresis
  options.stroke_deviation = 0;
  options.stiffness_deviation = {0.01, 0.01, 0.01};
  options.length_deviation = 0.001;
  options.bias_translation = 0.0003;
  options.bias_rotation = 0.003;
  const ArmModel model = helicalModel();
  const auto seen = [&](const Correction& correction, Random& random) {
    CorrectedModel truth(model);
    truth.set(correction);
    ArmFilter filter(model, options);
    ErrorBudget budget(model, options);
    const Eigen::VectorXd pressure = test::randomInput(model.arm(), random);
    Eigen::VectorXd reading = pressure;
    for (double& p : reading) p += kPressureNoise * random.normal();
    const model::Twists twists = truth.shape(model.arm().lengths(pressure))->twists();
    for (int k = 0; k < 10; ++k) {
      ArmFilter::Input picture = pictureOf(reading, twists, k / 30.0);
      picture.twists.reshaped() += test::drawNormal(picture.covariance, random);
      filter.see(picture);
      EXPECT_TRUE(budget.update(filter, picture));
    }
    return *budget.current();
  };
  const int runs = test::draws(50, 200);
  int outside = 0, above_median = 0, above_95 = 0, longer = 0, shorter = 0;
  double sum = 0;
  const ArmFilter claim(model, options);
  for (unsigned seed = 1; seed <= static_cast<unsigned>(runs); ++seed) {
    Random random(1000 + seed);
    const auto draw = [&random](double deviation) { return deviation * random.normal(); };
    const Eigen::VectorXd theta = claim.parameterPrior().unaryExpr(draw),
                          bias = claim.biasDeviation().unaryExpr(draw);
    const TipErrorBudget budget = seen(correctionOf(model, theta, bias), random);
    outside += budget.state == BudgetState::kOutside;
    above_median += budget.distance2 > 2.366;
    above_95 += budget.distance2 > 7.815;
    sum += budget.distance2;
    Correction off(model.arm());
    off.length_scale.setConstant(1.01);
    longer += seen(off, random).state == BudgetState::kOutside;
    off.length_scale.setConstant(0.99);
    shorter += seen(off, random).state == BudgetState::kOutside;
  }
  EXPECT_LE(outside, 2);  // of 200, 0.2 are expected
  // The mean of so many has a deviation of sqrt(6 / runs); others are that of a count.
  const double wider = std::sqrt(200.0 / runs);
  EXPECT_NEAR(sum / runs, 3.0, 0.6 * wider);
  EXPECT_NEAR(above_median, 0.5 * runs, 0.1 * runs * wider);
  EXPECT_NEAR(above_95, 0.05 * runs, 0.04 * runs * wider);
  EXPECT_GE(std::min(longer, shorter), 0.9 * runs);
}

}  // namespace
}  // namespace helix_arm::estimation
