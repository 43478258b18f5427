#include "helix_arm/localization/rig_memory.hpp"

#include <gtest/gtest.h>

#include "support/sample_view.hpp"

namespace helix_arm::estimation {
namespace {

using Matrix = RigEstimate::Matrix;
using Vector = RigEstimate::Vector;

constexpr double kDegree = test::kPi / 180;

TwistFitOptions freeRig() {
  TwistFitOptions out;
  out.free_base = out.free_border_shift = true;
  out.base_prior = {0.002, 0.5 * kDegree};
  return out;
}

// A camera whose base is off by what a memory is to learn.
class Bench {
 public:
  explicit Bench(const Matrix& by_placements = Matrix::Zero())
      : memory(freeRig(), by_placements), fitter_(view_.layout, 1, freeRig()) {
    rig << 0.002, -0.001, 0.0015, 0.006, -0.004, 0.003, 0.0;
  }

  std::vector<CornerObservation> observe(const model::Shape& shape) {
    ArmView truth = view_;
    truth.X_CB = view_.X_CB * lie::SE3::exp(rig.head<6>());
    return test::observe(truth, visibleTags(truth, shape, 0.3), 0.3, random);
  }
  const TwistFit& fit(const model::Shape& shape) {
    fitter_.know(memory.estimate());
    return fitter_.fit(observe(shape), view_.X_CB, view_.camera.focal(), shape);
  }
  // A second of pictures of different shapes.
  void show(BaseWatch& watch) {
    for (int k = 0; k < 30; ++k) {
      const model::Shape shape = anyShape();
      watch.see(observe(shape), view_.X_CB, view_.camera.focal(), shape, shape);
    }
  }
  BaseWatch watch(const Matrix& by_placements) const {
    return {view_.layout, 1, freeRig(), by_placements};
  }
  void learn(const model::Shape& shape) {
    const TwistFit& result = fit(shape);
    ASSERT_EQ(result.status, FitStatus::kConverged);
    memory.learn(result);
  }
  void learnAll() {
    for (int k = 0; k < 2000 && !memory.isHeld(); ++k) learn(anyShape());
    ASSERT_TRUE(memory.isHeld());
  }
  model::Shape anyShape() { return arm_.twists(test::randomInput(arm_, random)); }
  // In deviations of the priors, the largest entry.
  double error() const {
    const Vector deviation = RigEstimate(freeRig()).covariance.diagonal().cwiseSqrt();
    return (memory.estimate().mean - rig).cwiseQuotient(deviation).cwiseAbs().maxCoeff();
  }

  RigMemory memory;
  Vector rig;
  test::Random random{3};

 private:
  const model::Arm arm_ = test::ringArm(test::helicalRing());
  const ArmView view_ = test::sampleView();
  TwistFitter fitter_;
};

TEST(RigMemory, LearnsBaseAndBleedFromDifferentShapes) {
  Bench bench;
  EXPECT_TRUE(bench.memory.estimate().mean.isZero(0));
  ASSERT_GT(bench.error(), 0.5);
  bench.learnAll();
  EXPECT_LT(bench.error(), 4 * RigMemory::kSurest);
}

TEST(RigMemory, APictureOfTheSameShapeTeachesNothing) {
  Bench bench;
  const model::Shape shape = bench.anyShape();
  bench.learn(shape);
  const Vector once = bench.memory.estimate().mean;
  EXPECT_FALSE(once.isZero(0));
  for (int k = 0; k < 20; ++k) bench.learn(shape);
  EXPECT_EQ(bench.memory.estimate().mean, once);
  EXPECT_FALSE(bench.memory.isHeld());
}

// Where placements may err as much as the priors allow, half of what pictures say is believed.
TEST(RigMemory, GoesNoFartherThanPlacementsLeaveReasonFor) {
  const Matrix prior = RigEstimate(freeRig()).covariance;
  Bench sure, unsure(prior);
  for (Bench* bench : {&sure, &unsure}) bench->learnAll();
  const Vector half = 0.5 * sure.memory.estimate().mean;
  EXPECT_LT((unsure.memory.estimate().mean - half).head<6>().norm(), 0.05 * half.norm());
  const Matrix errors = RigMemory::heldErrors(freeRig(), prior);
  EXPECT_LT((errors - 0.5 * prior).norm(), 0.01 * prior.norm());
}

TEST(RigMemory, BeginsAnewWherePicturesAreNotExplained) {
  Bench bench;
  bench.learnAll();
  TwistFit failed = bench.fit(bench.anyShape());
  for (const FitStatus status : {FitStatus::kNotConverged, FitStatus::kUnderdetermined}) {
    failed.status = status;
    for (int k = 0; k < 50; ++k) bench.memory.learn(failed);
    EXPECT_TRUE(bench.memory.isHeld());
  }
  failed.status = FitStatus::kUnexplained;
  for (int k = 0; k < 29; ++k) bench.memory.learn(failed);
  EXPECT_TRUE(bench.memory.isHeld());
  bench.memory.learn(failed);
  EXPECT_FALSE(bench.memory.isHeld());
  EXPECT_TRUE(bench.memory.estimate().mean.isZero(0));
}

TEST(BaseWatch, NamesABaseThatIsFartherThanThePriorAllows) {
  Bench bench;
  BaseWatch watch = bench.watch(Matrix::Zero());
  bench.show(watch);
  EXPECT_FALSE(watch.move()) << "a deviation of the prior";
  bench.rig.head<3>() += Eigen::Vector3d(0.012, -0.012, 0.010);
  bench.show(watch);
  ASSERT_TRUE(watch.move());
  EXPECT_LT((watch.move()->xi - bench.rig.head<6>()).head<3>().norm(), 0.002);
  EXPECT_GT(watch.move()->deviations, 5);
  bench.rig.head<3>() -= Eigen::Vector3d(0.012, -0.012, 0.010);
  bench.show(watch);
  EXPECT_FALSE(watch.move()) << "moved back";
}

// 20 mm are ten deviations of the prior, and three of it with placements that err as much.
TEST(BaseWatch, ErrorsByPlacementsExcuseAsMuchAsTheyMayCause) {
  for (const double factor : {0.0, 9.0}) {
    Bench bench;
    BaseWatch watch = bench.watch(factor * RigEstimate(freeRig()).covariance);
    bench.rig.head<3>() = Eigen::Vector3d(0.012, -0.012, 0.010);
    bench.show(watch);
    EXPECT_EQ(watch.move().has_value(), factor == 0) << factor;
  }
}

}  // namespace
}  // namespace helix_arm::estimation
