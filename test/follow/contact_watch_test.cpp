// Contacts where tags at the edge of sight come and go.
#include <Eigen/Eigenvalues>

#include <gtest/gtest.h>

#include "support/loop_fixture.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::follow {
namespace {

using test::LoopBench;

const std::vector<int> kUsual = {0, 4, 8, 12, 16, 20, 24, 28};
const std::vector<int> kFewer = {0, 4, 8, 12, 16, 20, 24};
const std::vector<int> kMore = {0, 4, 8, 12, 16, 20, 24, 28, 29};

class FlickeringTags : public test::LoopTest {
 protected:
  FlickeringTags() {
    VisualServoConfig config = LoopBench::config();
    config.placed = placed_;
    LoopBench::Options options;
    options.twist_noise_v = 3e-5;
    options.twist_noise_w = 3e-4;
    const model::Shape shape = model_.arm().twists(model_.arm().inputAt(0.4));
    // One standard deviation of what other tags err, along its largest direction.
    const auto error = [&](const std::vector<int>& tags) -> lie::Vector6 {
      const Eigen::MatrixXd covariance =
          estimation::placementDifference(placed_, model_.arm(), shape, kUsual, tags).value();
      const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> axes(covariance);
      return std::sqrt(axes.eigenvalues()[5]) * axes.eigenvectors().col(5);
    };
    options.tags = {kUsual, kFewer, kUsual, kMore};
    for (const auto& tags : options.tags) options.errors.push_back(error(tags));
    flickering_.emplace(model_, truthOf(model_.arm()), config, options);
    flickering_->loop.aimAt(here_);
    flickering_->run(14);
  }

  const estimation::ArmView view_ = test::sampleView(0.8, 1, 32);
  const estimation::PlacedView placed_{view_, {}, {view_.layout, {0.0005, 0.01}, {0.0, 0.0}}};
  std::optional<LoopBench> flickering_;
};

TEST_F(FlickeringTags, AreNoContact) {
  double most = 0;
  for (int k = 0; k < 3000; ++k) {
    flickering_->step();
    ASSERT_FALSE(flickering_->loop.load().contact) << flickering_->time();
    most = std::max(most, flickering_->loop.load().score);
  }
  EXPECT_GT(most, 1.0);
}

TEST_F(FlickeringTags, HideNoContact) {
  ASSERT_FALSE(flickering_->loop.load().contact);
  flickering_->options.push << 0, 0, 0, 0, 0.03, -0.02;
  const double begin = flickering_->time();
  while (!flickering_->loop.load().contact && flickering_->time() < begin + 2) flickering_->step();
  EXPECT_LT(flickering_->time() - begin, 0.5);
}

// A set of tags that stays is the usual one, whatever came before.
TEST_F(FlickeringTags, ThatStayAwayAreNoContact) {
  flickering_->options.errors.assign(1, flickering_->options.errors[1]);
  flickering_->options.tags.assign(1, kFewer);
  for (int k = 0; k < 1000; ++k) {
    flickering_->step();
    ASSERT_FALSE(flickering_->loop.load().contact) << flickering_->time();
  }
}

}  // namespace
}  // namespace helix_arm::follow
