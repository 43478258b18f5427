#include "helix_arm/simulation/plant.hpp"

#include <chrono>
#include <string>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/simulation/rig.hpp"
#include "support/has.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::test {
namespace {

using simulation::Plant;
using simulation::SimulatedRig;

const regulator::SimulatedRegulatorConfig kRegulator{0.12, 4.5e5, 4e3, 9};

// A plant that answers every line with the same poses: along z of the base, a quarter turn about y,
// as far out as the first pressure says [m/MPa].
std::string straightPlant(const std::string& more = "") {
  return R"(exec /usr/bin/python3 -c '
import json, sys
first = json.loads(sys.stdin.readline())
def poses(length):
    return [{"position_m": [0, 0, -length * (k + s)], "quaternion_xyzw": [0, 0.5 ** 0.5, 0, 0.5 ** 0.5]}
            for k, s in first["places"]]
print(json.dumps({"ready": True, "poses": poses(1)}), flush=True)
for line in sys.stdin:
    turn = json.loads(line)
    )" + more +
         R"(
    print(json.dumps({"poses": poses(1 + 1e-6 * turn["pressure_pa"][0])}), flush=True)
')";
}

// What a command is refused with as plant of an arm of two sections; a busy machine may take longer
// than the 10 s that are promised.
std::string refusalOf(const std::string& command, int steps = 0) {
  const auto begin = std::chrono::steady_clock::now();
  std::string refusal;
  try {
    Plant plant(command, ringArm(helicalRing(), 2), {});
    for (int k = 0; k < steps; ++k) plant.step(0.01, Eigen::VectorXd::Zero(6), {0, 0, 0.2});
  } catch (const simulation::PlantError& error) {
    refusal = error.what();
  }
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
  return refusal;
}

TEST(Plant, ItsPosesAreTheTrueArmOfTheRigThatGivesItPressures) {
  const model::Arm arm = ringArm(helicalRing(), 2);
  SimulatedRig rig(arm, kRegulator, {});
  rig.takeArm(
      std::make_unique<Plant>(straightPlant(), arm, std::vector<estimation::TagPlacement>()));
  rig.command(Eigen::VectorXd::Constant(6, 2e5));
  for (int k = 0; k < 20; ++k) rig.step(0.01);
  const double length = 1 + 1e-6 * rig.pressure()[0];
  ASSERT_GT(length, 1.1);
  for (const double s : {0.25, 1.0, 1.5, 2.0}) {
    const lie::SE3 X = model::poseAt(rig.shape(), s);
    EXPECT_LT((X.translation - Eigen::Vector3d(0, 0, -s * length)).norm(), 1e-9) << s;
  }
  const Eigen::Matrix3d tip = model::tipPose(rig.shape()).rotation;
  EXPECT_LT((tip.col(0) + Eigen::Vector3d::UnitZ()).norm(), 1e-9) << "x is not along the arm";
}

TEST(Plant, ItGetsTheForceAtTheTipAndTheTimeOfATurn) {
  const std::string refusal = refusalOf(
      straightPlant(R"(assert turn["force"] is None, json.dumps([turn["force"], turn["dt_s"]]))"),
      1);
  EXPECT_TRUE(has(refusal, "ended with exit code 1")) << refusal;
  const std::string same = straightPlant(
      R"(assert turn["force"] == {"section": 1, "s": 1.0, "force_n": [0, 0, 0.2]} and turn["dt_s"] == 0.01)");
  EXPECT_EQ(refusalOf(same, 3), "");
}

TEST(Plant, PiecesEndWhereTagsAre) {
  estimation::TagPlacement tag{};
  tag.section = 0;
  tag.s = 1.0 / 13;  // not at the end of a piece of the usual length
  const Plant plant(straightPlant(), ringArm(helicalRing(), 2), {tag});
  EXPECT_EQ(plant.shape().piecesPerSection() % 13, 0);
}

TEST(Plant, OneThatDiesStallsOrTalksNonsenseIsNamed) {
  struct Case {
    const char *command, *fault;
  };
  const std::string number = R"(echo '{"ready": true, "poses": [)";
  const Case cases[] = {
      {"exit 3", "ended with exit code 3"},
      {"kill -9 $$", "ended with Killed"},
      {"/nowhere/plant 2>/dev/null", "ended with exit code 127"},
      {"exec >&- <&-; sleep 60", "closed its output"},
      {"sleep 60", "was silent for 10 s"},
      {"while echo -n x; do sleep 0.5; done", "was silent for 10 s"},
      {"head -c 2000000 /dev/zero; sleep 60", "sent a line of more than 1 MB"},
      {"echo ready; sleep 60", "answered \"ready\"; expected one JSON object"},
      {"echo '{\"poses\": []}'; sleep 60", "expected \"ready\": true"},
      {"echo '{\"ready\": true, \"poses\": [{}]}'; sleep 60",
       "expected \"poses\" with one pose for each"},
  };
  for (const Case& one : cases) {
    const std::string refusal = refusalOf(one.command);
    EXPECT_TRUE(has(refusal, one.fault)) << one.command << ": " << refusal;
    EXPECT_TRUE(has(refusal, "plant \"" + std::string(one.command).substr(0, 6))) << refusal;
  }
}

TEST(Plant, APoseThatIsNoneIsNamed) {
  for (const char* const pose :
       {R"({"position_m": [0, 0], "quaternion_xyzw": [0, 0, 0, 1]})",
        R"({"position_m": [0, 0, 1e5], "quaternion_xyzw": [0, 0, 0, 1]})",
        R"({"position_m": [0, 0, 1], "quaternion_xyzw": [0, 0, 0, 2]})",
        R"({"position_m": ["0", 0, 1], "quaternion_xyzw": [0, 0, 0, 1]})"}) {
    const std::string refusal = refusalOf(
        "read first; /usr/bin/python3 -c 'import json, sys; print(json.dumps({\"ready\": True, "
        "\"poses\": [json.loads(sys.argv[1])] * len(json.loads(sys.argv[2])[\"places\"])}))' '" +
        std::string(pose) + "' \"$first\"; sleep 60");
    EXPECT_TRUE(has(refusal, "expected in pose 0 of \"poses\"")) << pose << ": " << refusal;
  }
}

}  // namespace
}  // namespace helix_arm::test
