// ~forward and ~inverse of pressure_command: the model of its scene, within bounds, while targets
// are served.
#include <Eigen/Geometry>
#include <atomic>
#include <limits>
#include <tuple>

#include <ros/service.h>

#include "helix_arm/Forward.h"
#include "helix_arm/Inverse.h"
#include "helix_arm/io/scene.hpp"
#include "support/random.hpp"
#include "support/ros_rig.hpp"

namespace helix_arm::test {
namespace {

constexpr char kForward[] = "pressure_command/forward";
constexpr char kInverse[] = "pressure_command/inverse";

template <class Service>
typename Service::Response call(const char* name, const typename Service::Request& request) {
  typename Service::Response response;
  EXPECT_TRUE(ros::service::waitForService(name, ros::Duration(20))) << name;
  Service both;
  both.request = request;
  EXPECT_TRUE(ros::service::call(name, both)) << name;
  return both.response;
}

const io::Scene& demo() {
  static const io::Scene scene = io::loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml");
  return scene;
}

std::vector<double> randomPressures(int rows, Random& random) {
  std::vector<double> out;
  for (int row = 0; row < rows; ++row) {
    for (int i = 0; i < demo().arm.actuatorCount(); ++i) {
      const model::Range& limits = demo().arm.actuator(i).limits;
      out.push_back(random.uniform(limits.lower, limits.upper));
    }
  }
  return out;
}

TEST(ModelService, ForwardIsTheModelOfTheScene) {
  Random random(1);
  Forward::Request request;
  request.pressure = randomPressures(200, random);
  const Forward::Response found = call<Forward>(kForward, request);
  ASSERT_TRUE(found.success) << found.message;
  ASSERT_EQ(found.rows, 200u);
  ASSERT_EQ(found.sections, 1u);
  ASSERT_EQ(found.position.size(), 600u);
  ASSERT_EQ(found.orientation.size(), 800u);
  ASSERT_EQ(found.twist.size(), 1200u);
  for (std::size_t row = 0; row < found.rows; ++row) {
    const Eigen::Vector3d q(&request.pressure[3 * row]);
    const lie::SE3 tip = demo().arm.tip(q);
    EXPECT_TRUE(found.converged[row]);
    EXPECT_LT((Eigen::Vector3d(&found.position[3 * row]) - tip.translation).norm(), 1e-14);
    const Eigen::Map<const Eigen::Quaterniond> turn(&found.orientation[4 * row]);
    EXPECT_LT((turn.toRotationMatrix() - tip.rotation).norm(), 1e-13);
    const Eigen::Map<const Eigen::VectorXd> twist(&found.twist[6 * row], 6);
    EXPECT_LT((twist - demo().arm.twists(q).col(0)).norm(), 1e-14);
  }
}

TEST(ModelService, InverseReachesWhatForwardGives) {
  Random random(2);
  Forward::Request request;
  request.pressure = randomPressures(50, random);
  const Forward::Response shapes = call<Forward>(kForward, request);
  Inverse::Request wanted;
  wanted.position = shapes.position;
  wanted.position.insert(wanted.position.end(), {5.0, 0.0, 0.0});
  const Inverse::Response found = call<Inverse>(kInverse, wanted);
  ASSERT_TRUE(found.success) << found.message;
  ASSERT_EQ(found.rows, 51u);
  for (std::size_t row = 0; row < 50; ++row) {
    EXPECT_EQ(found.status[row], "reached");
    const Eigen::Vector3d tip =
        demo().arm.tip(Eigen::Vector3d(&found.pressure[3 * row])).translation;
    EXPECT_LT((tip - Eigen::Vector3d(&wanted.position[3 * row])).norm(), 2e-6);
  }
  EXPECT_EQ(found.status[50], "unreachable");
  EXPECT_GT(found.position_error[50], 4.0);
}

TEST(ModelService, CallsThatBreakARuleAreAnsweredWithIt) {
  const auto expect = [](const auto& response, const std::string& words) {
    EXPECT_FALSE(response.success);
    EXPECT_TRUE(has(response.message, words));
    EXPECT_EQ(response.rows, 0u);
  };
  using Numbers = std::vector<double>;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const auto& [pressure, words] :
       {std::pair(Numbers{1e5, 2e5}, "expected rows of 3"),
        {{1e5, nan, 0}, "muscle_2 is asked for nan"},
        {{1e5, 0, 0, 1e5, -1, 0}, "muscle_2 is asked for -1; its limits are"},
        {Numbers(30'003, 0.0), "10001 rows; expected at most 10000"}}) {
    Forward::Request request;
    request.pressure = pressure;
    expect(call<Forward>(kForward, request), words);
  }
  for (const auto& [position, start, prefer, words] :
       {std::tuple(Numbers{0.3, 0}, Numbers{}, "", "expected rows of 3"),
        {{0.3, nan, 0}, {}, "", "position[1] is nan"},
        {{0.3, 0, 0}, {1e5}, "", "expected 3 or none"},
        {{0.3, 0, 0}, {1e5, -1, 0}, "", "start"},
        {{0.3, 0, 0}, {}, "low", "prefer is \"low\""},
        {Numbers(3'003, 0.0), {}, "", "1001 rows; expected at most 1000"}}) {
    Inverse::Request request;
    request.position = position;
    request.start = start;
    request.prefer = prefer;
    expect(call<Inverse>(kInverse, request), words);
  }
  EXPECT_TRUE(call<Forward>(kForward, {}).success);
  EXPECT_TRUE(call<Inverse>(kInverse, {}).success);
}

// A call that takes seconds, all of whose tips are out of reach, and targets meanwhile.
TEST(ModelService, ALargeBatchDelaysNoTarget) {
  Rig rig;
  rig.keepOn();
  ASSERT_TRUE(rig.connect());
  std::atomic<bool> done{false};
  std::thread caller([&done] {
    Inverse::Request request;
    for (int i = 0; i < 1000; ++i)
      request.position.insert(request.position.end(), {5.0 + i, 1.0, 2.0});
    EXPECT_TRUE(call<Inverse>(kInverse, request).success);
    done = true;
  });
  int answered = 0;
  while (!done && answered < 50) {
    const TargetStatus answer = rig.sendPressures({1e4, 0, 0});
    EXPECT_EQ(answer.outcome, TargetStatus::REACHED) << answer.message;
    ++answered;
  }
  EXPECT_GT(answered, 1) << "the batch was over at once";
  caller.join();
}

}  // namespace
}  // namespace helix_arm::test
