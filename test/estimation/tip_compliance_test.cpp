#include "helix_arm/tracking/tip_compliance.hpp"

#include <string>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"
#include "localization/twist_equations.hpp"
#include "support/loaded_arm.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::estimation {
namespace {

using statics::ArmModel;
using statics::Correction;

constexpr double kK_eps = 900.0;  // [N]
constexpr double kForce = 0.05;   // of differences: so small that shapes are linear in it [N]

model::Arm helicalArm(int sections = 1) { return test::ringArm(test::helicalRing(), sections); }

ArmModel modelOf(int sections = 1, double K_eps = kK_eps) {
  return ArmModel(helicalArm(sections), std::nullopt, test::weightless(sections, K_eps));
}
Eigen::VectorXd pressureOf(const model::Arm& arm) {
  Eigen::VectorXd fraction(arm.actuatorCount());
  for (int i = 0; i < fraction.size(); ++i) fraction[i] = 0.2 + 0.15 * (i % 4);
  return arm.inputAt(fraction);
}

// The exact shape of an arm that a force pulls at one place.
model::Shape pulled(const model::Arm& arm, const ForcePlace& place, const Eigen::Vector3d& force,
                    double K_eps = kK_eps) {
  statics::Load load = test::weightless(arm.sectionCount(), K_eps);
  load.points.push_back({place.section, place.s, 0.0, force, {0, 0, 0}, {0, 0, 0}});
  const statics::Solution solution =
      statics::ExactArm(arm, load).solve(arm.twists(pressureOf(arm)));
  EXPECT_TRUE(solution.converged());
  return solution.shape;
}

// Change of something that a shape gives with a force along an axis [1/N].
template <class Of>
Eigen::VectorXd slope(const model::Arm& arm, const ForcePlace& place, int axis, const Of& of) {
  const Eigen::Vector3d force = kForce * Eigen::Vector3d::Unit(axis);
  return (of(pulled(arm, place, force)) - of(pulled(arm, place, -force))) / (2 * kForce);
}

Eigen::VectorXd meanStrain(const model::Shape& shape) { return shape.twists().reshaped(); }

class TipComplianceTest : public ::testing::Test {
 protected:
  const model::Arm arm_ = helicalArm();
  const ArmView view_ = test::sampleView();
  const Eigen::VectorXd pressure_ = pressureOf(arm_);
  const model::Shape unforced_ = arm_.twists(pressure_);
};

// v [m] and w [rad] are compared alike: this arm is 0.4 m long.
void expectNear(const Eigen::VectorXd& got, const Eigen::VectorXd& expected, double part,
                const std::string& what) {
  EXPECT_LT((got - expected).norm(), part * expected.norm())
      << what << "\n  got " << got.transpose() << "\n  expected " << expected.transpose();
}

// The lowest order balances a soft arm that hangs nowhere; that of its model does, up to a load
// under which none does.
TEST(TipCompliance, SaysWhetherASoftHangingArmBalancesAForce) {
  const model::Arm arm = helicalArm();
  for (const auto& [K_eps, mass, complete] :
       {std::tuple(30.0, 0.45, true), std::tuple(120.0, 0.45, true),
        std::tuple(30.0, 50.0, false)}) {
    statics::Load load = test::weightless(1, K_eps);
    load.gravity = {-9.81, 0, 3};
    load.mass = {mass};
    const statics::TierSetting tier{statics::Tier::kLoaded, 3};
    TipCompliance compliance(ArmModel(arm, std::nullopt, load, tier));
    compliance.moveTo(pressureOf(arm), Correction(arm));
    EXPECT_EQ(compliance.complete(), complete) << K_eps << " N, " << mass << " kg";
    EXPECT_EQ(compliance.atTip().isZero(0), !complete) << K_eps << " N, " << mass << " kg";
    for (int axis = 0; axis < 3 && complete; ++axis) {
      const auto strainUnder = [&](double force) {
        statics::Load pulled = load;
        pulled.points.push_back({});
        pulled.points.back().force = force * Eigen::Vector3d::Unit(axis);
        const statics::Solution solution =
            statics::ExactArm(arm, pulled).solve(arm.twists(pressureOf(arm)));
        EXPECT_TRUE(solution.converged());
        return meanStrain(solution.shape);
      };
      constexpr double kSmall = 1e-3;  // [N]
      expectNear(compliance.atTip().col(axis),
                 (strainUnder(kSmall) - strainUnder(-kSmall)) / (2 * kSmall), 0.1,
                 "axis " + std::to_string(axis));
    }
  }
}

TEST(TipCompliance, WithoutACameraItIsTheChangeOfTheMeanStrain) {
  for (const int sections : {1, 2}) {
    const model::Arm arm = helicalArm(sections);
    TipCompliance compliance(modelOf(sections));
    compliance.moveTo(pressureOf(arm), Correction(arm));
    ASSERT_EQ(compliance.places().size(), 4u * static_cast<std::size_t>(sections));
    for (std::size_t i = 0; i < compliance.places().size(); ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        expectNear(compliance.at(i).col(axis), slope(arm, compliance.places()[i], axis, meanStrain),
                   0.02,
                   std::to_string(sections) + " sections, place " + std::to_string(i) + ", axis " +
                       std::to_string(axis));
      }
    }
    EXPECT_EQ(compliance.atTip(), compliance.at(compliance.places().size() - 1));
    EXPECT_EQ(compliance.places().back().section, sections - 1);
    EXPECT_EQ(compliance.places().back().s, 1.0);
  }
}

// What a camera without noise sees of these tags, fitted.
class Eye {
 public:
  Eye(const ArmView& view, const TwistFitOptions& options)
      : view_(view), fitter_(view.layout, view.sections, options) {}

  Eigen::VectorXd fit(const model::Shape& shape, const std::vector<int>& tags,
                      const model::Shape& expected) {
    return fitted(shape, tags, expected).twists().reshaped();
  }
  model::Shape fitted(const model::Shape& shape, const std::vector<int>& tags,
                      const model::Shape& expected) {
    std::vector<CornerObservation> seen;
    for (const int tag : tags) seen.push_back(observe(view_.layout, shape, view_.X_CB, tag));
    const TwistFit& fit = fitter_.fit(seen, view_.X_CB, view_.camera.focal(), expected, expected);
    EXPECT_EQ(fit.status, FitStatus::kConverged);
    return fit.shape;
  }

 private:
  const ArmView view_;
  TwistFitter fitter_;
};

TwistFitOptions freeBase() {
  TwistFitOptions out;
  out.free_base = out.free_border_shift = true;
  return out;
}

std::vector<int> seenTags(const ArmView& view, const model::Shape& shape) {
  std::vector<int> out;
  for (const TagImage& placed : visibleTags(view, shape)) out.push_back(placed.tag);
  return out;
}

TEST_F(TipComplianceTest, WithACameraItIsTheChangeOfWhatIsFitted) {
  TipCompliance compliance(modelOf(), view_, freeBase());
  compliance.moveTo(pressure_, Correction(arm_));
  Eye eye(view_, freeBase());
  const std::vector<int> tags = seenTags(view_, unforced_);
  const auto fitted = [&](const model::Shape& shape) { return eye.fit(shape, tags, unforced_); };
  double other = 0;
  for (std::size_t i = 0; i < compliance.places().size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const Eigen::VectorXd expected = slope(arm_, compliance.places()[i], axis, fitted);
      // A force along the arm_ bends it little, and by its square too: less of it is linear.
      expectNear(compliance.at(i).col(axis), expected, axis == 0 ? 0.1 : 0.03,
                 "place " + std::to_string(i) + ", axis " + std::to_string(axis));
      const Eigen::VectorXd strain = slope(arm_, compliance.places()[i], axis, meanStrain);
      other = std::max(other, (strain - expected).norm() / expected.norm());
    }
  }
  EXPECT_GT(other, 0.1) << "the mean of the strain is something else";
}

// The exact tip under a force against that of what is fitted.
TEST_F(TipComplianceTest, TheTipMovesFartherThanTheFitSays) {
  const TwistFitOptions fixed;
  TipCompliance compliance(modelOf(), view_, fixed), blind(modelOf());
  for (TipCompliance* one : {&compliance, &blind}) one->moveTo(pressure_, Correction(arm_));
  Eye eye(view_, fixed);
  const std::vector<int> tags = seenTags(view_, unforced_);
  const auto beyond = [&](const model::Shape& shape) -> Eigen::VectorXd {
    return model::tipPose(shape).translation -
           model::tipPose(eye.fitted(shape, tags, unforced_)).translation;
  };
  const auto tip = [](const model::Shape& shape) -> Eigen::VectorXd {
    return model::tipPose(shape).translation;
  };
  for (std::size_t i = 1; i < compliance.places().size(); ++i) {
    for (const int axis : {1, 2}) {
      const Eigen::VectorXd whole = slope(arm_, compliance.places()[i], axis, tip);
      const Eigen::VectorXd expected = slope(arm_, compliance.places()[i], axis, beyond);
      EXPECT_LT((compliance.tipBeyondFit(i).col(axis) - expected).norm(), 0.01 * whole.norm())
          << "place " << i << ", axis " << axis;
      EXPECT_GT(expected.norm(), 0.02 * whole.norm()) << "there is something to know";
    }
  }
  EXPECT_TRUE(blind.tipBeyondFit(3).isZero(0)) << "what is measured without a view_ is not known";
}

TEST_F(TipComplianceTest, TheTagsThatAreFittedCount) {
  const std::vector<int> all = seenTags(view_, unforced_);
  const std::vector<int> half(all.begin(), all.begin() + static_cast<int>(all.size()) / 2);
  TipCompliance compliance(modelOf(), view_, freeBase());
  Eye eye(view_, freeBase());
  compliance.moveTo(pressure_, Correction(arm_), half);
  const Eigen::MatrixXd of_half = compliance.atTip();
  const auto fitted = [&](const model::Shape& shape) { return eye.fit(shape, half, unforced_); };
  for (const int axis : {1, 2}) {
    expectNear(of_half.col(axis), slope(arm_, {0, 1.0}, axis, fitted), 0.03, std::to_string(axis));
  }
  // Another set, at the same pressures, is noticed; those that face the camera are the default.
  compliance.moveTo(pressure_, Correction(arm_), all);
  const Eigen::MatrixXd of_all = compliance.atTip();
  EXPECT_GT((of_all - of_half).norm(), 0.05 * of_all.norm());
  compliance.moveTo(pressure_, Correction(arm_));
  EXPECT_LT((compliance.atTip() - of_all).norm(), 1e-12 * of_all.norm());
}

TEST_F(TipComplianceTest, AnArmOfUnknownKEpsCountsAsATypicalOne) {
  TipCompliance unknown{ArmModel(arm_)}, typical(modelOf(1, TipCompliance::kTypicalStiffness));
  EXPECT_TRUE(unknown.normalised());
  EXPECT_FALSE(typical.normalised());
  for (TipCompliance* one : {&unknown, &typical}) one->moveTo(pressure_, Correction(arm_));
  EXPECT_EQ(unknown.atTip(), typical.atTip());
}

}  // namespace
}  // namespace helix_arm::estimation
