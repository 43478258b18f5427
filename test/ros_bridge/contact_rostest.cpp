// Something touches the arm: what the loop says of it, and what becomes of goals.
#include "helix_arm/ExternalLoad.h"
#include "support/loop_rig.hpp"

namespace helix_arm::test {
namespace {

using Result = FollowTipPathResult;

constexpr double kArming = 12.0;    // of pictures, and more than the loop asks for [s]
constexpr double kDeadline = 60.0;  // of a contact [s]

class Contact : public LoopRig {
 protected:
  Contact()
      : load_(node_, names::kExternalLoad),
        force_(node_.advertise<geometry_msgs::WrenchStamped>(
            std::string(names::kSimulatedRigNode) + "/" + names::kTipForce, 10)) {}

  void SetUp() override {
    LoopRig::SetUp();
    ASSERT_TRUE(waitFor([this] { return force_.getNumSubscribers() > 0; }));
    push(0);
    // The latched one, or the first: contacts of the test before end.
    ASSERT_TRUE(comesTo(LoopStatus::CLOSED, target_));
    ASSERT_TRUE(isTold(ExternalLoad::NONE));
    const ros::Time begin = ros::Time::now();
    ASSERT_TRUE(waitFor(
        [&] {
          repeat(target_);
          return (ros::Time::now() - begin).toSec() > kArming;
        },
        kDeadline));
    ASSERT_EQ(load_.last().state, ExternalLoad::NONE) << load_.last().message;
  }
  void TearDown() override { push(0); }

  // Across the hanging arm [N].
  void push(double force) {
    geometry_msgs::WrenchStamped wrench;
    wrench.wrench.force.y = force;
    force_.publish(wrench);
  }
  // Whether a state of the load is told, while the target is repeated.
  bool isTold(const std::string& state) {
    return waitFor(
        [&] {
          repeat(target_);
          return !load_.all().empty() && load_.last().state == state;
        },
        kDeadline);
  }
  // A goal is refused until safety.commander_timeout_s after the last target, and sent again.
  bool begins(const FollowTipPathGoal& goal) {
    send(goal);
    return waitFor(
        [&] {
          if (client_->getState().isDone()) send(goal);
          return feedback_.size() > 2;
        },
        kDeadline);
  }
  FollowTipPathGoal slowGoal(std::uint8_t on_contact) const {
    FollowTipPathGoal goal = goalAlong({kMiddle, kBeside}, 60.0);
    goal.on_contact = on_contact;
    goal.hold_s = 0;  // without end, as the arm is simulated
    return goal;
  }

  const TipTarget target_ = targetAt(kMiddle);
  Inbox<ExternalLoad> load_;
  ros::Publisher force_;
};

TEST_F(Contact, AForceIsToldWithItsSizeAndThatItIsGone) {
  push(0.8);
  ASSERT_TRUE(isTold(ExternalLoad::CONTACT));
  EXPECT_GT(load_.last().score, 7.8);
  EXPECT_EQ(load_.last().limit, 32);
  EXPECT_EQ(load_.last().header.frame_id, "arm_base");
  EXPECT_FALSE(load_.last().normalised);
  EXPECT_LT((load_.last().header.stamp - load_.last().onset).toSec(), 10);
  EXPECT_GT((load_.last().header.stamp - load_.last().onset).toSec(), 0);
  EXPECT_NE(load_.last().message.find("clear it"), std::string::npos);
  // The demo is simulated: contacts are reported, and the loop goes on.
  EXPECT_TRUE(waitFor(
      [this] {
        repeat(target_);
        const ExternalLoad& load = load_.last();
        return std::abs(load.force.y - 0.8) < 0.3 && std::abs(load.force.z) < 0.3 &&
               !load.determined.empty() && load.covariance[4] > 0;
      },
      kDeadline))
      << load_.last();
  EXPECT_EQ(loop_.last().state, LoopStatus::CLOSED);
  push(0);
  EXPECT_TRUE(isTold(ExternalLoad::NONE));
}

TEST_F(Contact, AGoalThatIsToStopEndsWithContact) {
  ASSERT_TRUE(begins(slowGoal(FollowTipPathGoal::STOP)));
  push(0.8);
  EXPECT_EQ(endOfGoal(), Result::CONTACT);
  EXPECT_EQ(client_->getState(), actionlib::SimpleClientGoalState::ABORTED);
  EXPECT_TRUE(has(client_->getResult()->error_string, "on_contact is STOP"));
  // The command is held, although contacts without a goal are only reported.
  const std::size_t before = loop_.all().size();
  ASSERT_TRUE(waitFor([&] { return loop_.all().size() > before + 20; }));
  EXPECT_EQ(loop_.last().state, LoopStatus::YIELDING) << loop_.last().message;
  push(0);
  ASSERT_TRUE(waitFor([this] { return load_.last().state == ExternalLoad::NONE; }, kDeadline));
  // What is held without end is ended by a vent.
  EXPECT_TRUE(call("pressure_command/vent"));
  EXPECT_TRUE(comesTo(LoopStatus::IDLE));
}

// The last test: it ends vision.
TEST_F(Contact, ADeadCameraIsToldDuringContactAndEndsTheGoal) {
  ASSERT_TRUE(begins(slowGoal(FollowTipPathGoal::YIELD)));
  push(0.8);
  ASSERT_TRUE(comesTo(LoopStatus::YIELDING, {}, kDeadline));
  vision_.reset();
  EXPECT_EQ(endOfGoal(), Result::VISION_LOST);
  EXPECT_TRUE(has(client_->getResult()->error_string, "camera"));
  ASSERT_TRUE(comesTo(LoopStatus::OPEN, {}, kDeadline));
  EXPECT_TRUE(has(loop_.last().message, "check the camera"));
  EXPECT_TRUE(waitFor([this] { return load_.last().state == ExternalLoad::UNSEEN; }, kDeadline))
      << load_.last();
}

}  // namespace
}  // namespace helix_arm::test
