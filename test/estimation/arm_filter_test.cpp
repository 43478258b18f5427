#include "helix_arm/tracking/arm_filter.hpp"

#include <Eigen/Cholesky>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "estimation/tracked_arm.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::estimation {
namespace {

using namespace statics;

// A true arm that is measured with noise.
class Bench {
 public:
  Bench(const ArmModel& nominal, const Correction& truth, unsigned seed, double noise_v = 2e-4,
        double noise_w = 2e-3)
      : nominal_(nominal), truth_(nominal), random_(seed) {
    truth_.set(truth);
    const int sections = nominal.arm().sectionCount();
    deviation_.resize(6 * sections);
    for (int i = 0; i < deviation_.size(); ++i) deviation_[i] = i % 6 < 3 ? noise_v : noise_w;
  }

  model::Twists twists(const Eigen::VectorXd& pressure) const {
    return truth_.shape(nominal_.arm().lengths(pressure))->twists();
  }
  ArmFilter::Input at(double time, const Eigen::VectorXd& pressure) {
    ArmFilter::Input out;
    out.time = time;
    out.pressure = pressure;
    out.variance = Eigen::VectorXd::Zero(pressure.size());
    out.twists = twists(pressure);
    for (int i = 0; i < deviation_.size(); ++i) {
      out.twists.reshaped()[i] += deviation_[i] * random_.normal();
    }
    out.covariance = deviation_.cwiseAbs2().asDiagonal();
    return out;
  }
  test::Random& random() { return random_; }
  const model::Arm& arm() const { return nominal_.arm(); }

 private:
  const ArmModel nominal_;
  CorrectedModel truth_;
  test::Random random_;
  Eigen::VectorXd deviation_;
};

Correction truthOf(const model::Arm& arm) {
  Correction out(arm);
  out.stiffness_factors = {0.6, 1.0, 1.2};
  out.length_scale.setConstant(1.01);
  return out;
}

class HelicalArmFilter : public ::testing::Test {
 protected:
  const ArmModel model_ = helicalModel();
};

// Without growth of the bias the filter is recursive least squares.
TEST_F(HelicalArmFilter, EqualsLeastSquaresOverAllPictures) {
  ArmFilterOptions options;
  options.hysteresis = options.creep = options.stroke_deviation = 0;
  options.stiffness_deviation = {1e-4, 1e-4, 1e-4};  // so small that the model_ is linear
  options.length_deviation = 1e-6;
  options.settling_time = 1e-9;
  Bench bench(model_, Correction(model_.arm()), 1);
  ArmFilter filter(model_, options);
  const int m = filter.parameterCount();
  ASSERT_EQ(m, 5);
  Eigen::VectorXd prior(m + 6);
  prior << filter.parameterPrior(), filter.biasDeviation();
  Eigen::MatrixXd information = prior.cwiseAbs2().cwiseInverse().asDiagonal();
  Eigen::VectorXd right = Eigen::VectorXd::Zero(m + 6);
  for (int k = 0; k < 40; ++k) {
    const Eigen::VectorXd pressure = test::randomInput(bench.arm(), bench.random());
    const ArmFilter::Input input = bench.at(k + 1.0, pressure);
    ArmFilter fresh(model_, options);
    const auto linear = fresh.linearise(pressure);
    Eigen::MatrixXd H(6, m + 6);
    H << linear->by_theta, Eigen::MatrixXd::Identity(6, 6);
    const Eigen::MatrixXd weight = input.covariance.inverse();
    information += H.transpose() * weight * H;
    right += H.transpose() * weight * (input.twists.col(0) - linear->twists);
    ASSERT_TRUE(filter.see(input).accepted()) << k;
  }
  const Eigen::VectorXd expected = information.ldlt().solve(right);
  const Eigen::VectorXd scaled = (filter.state().mean - expected).cwiseQuotient(prior);
  EXPECT_LE(scaled.norm(), 1e-3 * expected.cwiseQuotient(prior).norm());
  const Eigen::MatrixXd covariance = information.inverse();
  EXPECT_LE((filter.state().covariance - covariance).norm(), 1e-3 * covariance.norm());
}

TEST_F(HelicalArmFilter, SkipsTwoOutliersAndBelievesAThird) {
  Bench bench(model_, Correction(model_.arm()), 3);
  ArmFilter filter(model_, {});
  const Eigen::VectorXd pressure = bench.arm().inputAt(0.5);
  for (int k = 0; k < 30; ++k) ASSERT_TRUE(filter.see(bench.at(0.03 * k, pressure)).accepted());
  const Eigen::VectorXd before = filter.state().mean;
  for (int k = 30; k < 33; ++k) {
    ArmFilter::Input input = bench.at(0.03 * k, pressure);
    input.twists(0, 0) += 0.05;
    const Observation observation = filter.see(input);
    EXPECT_GT(observation.distance2, outlierLimit(6));
    EXPECT_EQ(observation.fault, k < 32 ? ObservationFault::kOutlier : ObservationFault::kNone);
    EXPECT_EQ(filter.state().mean == before, k < 32);
  }
}

TEST(ArmFilter, LimitsOutliersByChance) {
  EXPECT_NEAR(outlierLimit(3) / 21.108, 1, 0.04);
  EXPECT_NEAR(outlierLimit(6) / 27.856, 1, 0.04);
  EXPECT_NEAR(outlierLimit(12) / 39.134, 1, 0.04);
}

// While the arm swings a static model explains little: such pictures teach little.
TEST_F(HelicalArmFilter, TrustsPicturesOfAMovingArmLess) {
  const auto distanceOfAnError = [&](bool moves) {
    Bench bench(model_, Correction(model_.arm()), 4);
    ArmFilter filter(model_, {});
    filter.see(bench.at(0.0, bench.arm().inputAt(moves ? 0.2 : 0.5)));
    ArmFilter::Input input = bench.at(0.03, bench.arm().inputAt(0.5));
    input.twists(4, 0) += 0.02;
    return filter.see(input).distance2;
  };
  EXPECT_LT(distanceOfAnError(true), 0.5 * distanceOfAnError(false));
}

TEST_F(HelicalArmFilter, NamesWhatItDoesNotTake) {
  using Input = ArmFilter::Input;
  using Fault = ObservationFault;
  Bench bench(model_, Correction(model_.arm()), 6);
  ArmFilter filter(model_, {});
  const Eigen::VectorXd pressure = bench.arm().inputAt(0.5);
  ASSERT_TRUE(filter.see(bench.at(1.0, pressure)).accepted());
  const Gaussian before = filter.state();
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const struct {
    const char* name;
    void (*spoil)(Input&);
    Fault fault;
  } cases[] = {
      {"repeated", [](Input& i) { i.time = 1.0; }, Fault::kNotNewer},
      {"sections", [](Input& i) { i.twists.setZero(6, 2); }, Fault::kWrongSize},
      {"not definite", [](Input& i) { i.covariance(2, 2) = -1; }, Fault::kNotPositive},
      // One half of the matrix alone says nothing of the other.
      {"not symmetric", [](Input& i) { i.covariance(0, 5) = 1.0; }, Fault::kNotPositive},
      {"one below a fiftieth of the wavelength of light",
       [](Input& i) { i.covariance *= 0.99e-16 / i.covariance.diagonal().minCoeff(); },
       Fault::kImplausible},
      {"no pressure", [](Input& i) { i.pressure[1] = kNaN; }, Fault::kNotFinite},
      {"no twist", [](Input& i) { i.twists(3, 0) = kNaN; }, Fault::kNotFinite},
      {"no covariance", [](Input& i) { i.covariance(1, 2) = kNaN; }, Fault::kNotFinite},
  };
  for (const auto& test : cases) {
    Input input = bench.at(2.0, pressure);
    test.spoil(input);
    EXPECT_EQ(filter.check(input), test.fault) << test.name;
    EXPECT_EQ(filter.see(input).fault, test.fault) << test.name;
  }
  EXPECT_EQ(filter.state().mean, before.mean);
  EXPECT_EQ(filter.state().covariance, before.covariance);
}

TEST(ArmFilter, OmitsTheEntriesThatAPlanarFitFixes) {
  const ArmModel model(model::embed(test::planarArm()), test::planarArm());
  ArmFilterOptions options;
  options.planar = true;
  ArmFilter filter(model, options);
  EXPECT_EQ(filter.rows(), (std::vector<int>{0, 1, 5}));
  Bench bench(model, truthOf(model.arm()), 8);
  for (int k = 0; k < 80; ++k) {
    ArmFilter::Input input = bench.at(k, test::randomInput(bench.arm(), bench.random()));
    for (const int row : {2, 3, 4}) {
      input.twists(row, 0) = 0;
      input.covariance.row(row).setZero();
      input.covariance.col(row).setZero();
    }
    ASSERT_TRUE(filter.see(input).accepted()) << k;
  }
  const Eigen::VectorXd pressure = bench.arm().inputAt(Eigen::Vector2d(0.2, 0.7));
  const Eigen::Vector3d truth = model::tipPose(bench.twists(pressure)).translation;
  const double before = (model.tip(pressure).tip.translation - truth).norm();
  EXPECT_LT((model::tipPose(*filter.shape(pressure)).translation - truth).norm(), before / 3);
}

}  // namespace
}  // namespace helix_arm::estimation
