// Nodes and launch files as processes: their output, their exit, and their behaviour without a
// master.
#include <csignal>
#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>
#include <unistd.h>

#include "support/process.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

const std::string kScene = "_scene:=" HELIX_ARM_SOURCE_DIR "/config/scenes/spatial_50.yaml";
const std::string kReady = "loop at";

class NodeProcess : public ::testing::Test {
 protected:
  Process::Variables variables() const { return master_.variables(); }

  // Runs a node with these arguments; expects it to end with 2 and to print all the words.
  void expectRefused(std::vector<std::string> arguments, const std::vector<std::string>& words,
                     const char* program = HELIX_ARM_PRESSURE_COMMAND) {
    arguments.insert(arguments.begin(), program);
    const Master master;  // its own: parameters outlive the node that brought them
    Process node(arguments, master.variables());
    EXPECT_EQ(node.exitCode(), 2) << node.output();
    for (const std::string& word : words) {
      EXPECT_NE(node.output().find(word), std::string::npos) << word << " in:\n" << node.output();
    }
    EXPECT_EQ(node.output().find(kReady), std::string::npos) << "it started nevertheless";
  }

  Master master_;
};

// An arm of three muscles of one contraction; any of its lines may be another.
std::string ringScene(const std::string& contraction, const std::string& ring = "muscle",
                      const std::string& stiffness = "10, K_tau_m2: 0, K_kappa_m2: 1.0e-4",
                      const std::string& more = "") {
  return "name: ring\ncontractions:\n  muscle:\n    " + contraction +
         "\narm:\n  geometry: spatial\n  stiffness: {K_gamma: " + stiffness +
         "}\n  sections:\n    - name: arm\n      ring: {count: 3, radius_m: 0.03, contraction: " +
         ring + "}\n" + more;
}
constexpr char kTable[] = "table: {pressure_kpa: [0, 400], length_m: [0.40, 0.30]}";

// Every node, of two arms: one of spatial_50 that a series moves, and a simulated rig.
struct EveryNode {
  explicit EveryNode(const Process::Variables& variables)
      : command({HELIX_ARM_PRESSURE_COMMAND, kScene}, variables),
        series({HELIX_ARM_SERIES, kScene, "_loop:=true"}, variables),
        monitor({HELIX_ARM_MONITOR}, variables),
        rig({HELIX_ARM_SIMULATED_RIG, "__ns:=rig", "_scene:=demo"}, variables),
        vision({HELIX_ARM_VISION, "__ns:=rig", "_scene:=demo"}, variables),
        calibration({HELIX_ARM_CALIBRATION, "__ns:=rig", "_scene:=demo"}, variables) {}

  // Fails unless all of them work.
  void awaitWork() {
    ASSERT_TRUE(calibration.prints("ready to record")) << calibration.output();
    ASSERT_TRUE(series.prints("row 1")) << series.output();
    ASSERT_TRUE(monitor.prints("tip")) << monitor.output();
    ASSERT_TRUE(vision.prints("measured")) << vision.output();
  }

  std::vector<Process*> all() { return {&command, &series, &monitor, &rig, &vision, &calibration}; }

  Process command, series, monitor, rig, vision, calibration;
};

// Expects a node to end with 1 within a deadline [s], and to say why.
void expectFails(Process& node, const std::string& why, double deadline = 30) {
  EXPECT_EQ(node.exitCode(deadline), 1) << node.output();
  EXPECT_NE(node.output().find(why), std::string::npos) << node.output();
}

TEST_F(NodeProcess, ABadSceneEndsItWith2AndEveryFault) {
  const TemporaryFile scene(ringScene(kTable, "mussel, max_pressure_kpa: 400",
                                      "-3, K_tau_m2: 0, K_kappa_m2: .nan", "colour: green\n"));
  expectRefused({"_scene:=" + scene.path()},
                {"K_gamma", "-3", "K_kappa_m2", "mussel", "colour", scene.path() + ":"});
}

TEST_F(NodeProcess, EveryUnusableParameterIsNamed) {
  expectRefused({"_rate:=0", "_draw_rate:=often", "_frames:=1.5", "_world_frame:=/world"},
                {"~scene is missing", "~rate is 0", "~draw_rate is often", "~frames is 1.5",
                 "~world_frame is /world"});
  expectRefused({"_scene:=no_such_arm"}, {"~scene is no_such_arm", "config/scenes", "spatial_50"});
  expectRefused({kScene, "_regulator:=mine"}, {"~regulator is mine", "scene or topic"});
  expectRefused({kScene, "_rate:=0", "_camera_rate:=1000"}, {"~rate is 0", "~camera_rate is 1000"},
                HELIX_ARM_SIMULATED_RIG);
  expectRefused({"_scene:=demo", "_source:=camera", "_stale_after_s:=0"},
                {"~source is camera", "image/compressed", "~stale_after_s is 0"}, HELIX_ARM_VISION);
  expectRefused({"_pressure_tolerance_kpa:=0", "_window_s:=-1", "_patience_s:=long"},
                {"~scene is missing", "~pressure_tolerance_kpa is 0", "~window_s is -1",
                 "~patience_s is long"},
                HELIX_ARM_CALIBRATION);
  expectRefused({"_scene:=demo", "_time_factor:=5"}, {"~time_factor is 5", "/use_sim_time"},
                HELIX_ARM_SIMULATED_RIG);
  expectRefused({"_scene:=demo", "_regulator:=topic", "_time_factor:=2"}, {"~time_factor is 2"},
                HELIX_ARM_SIMULATED_RIG);
  expectRefused({"_scene:=demo", "_time_factor:=0.001"}, {"~time_factor is 0.001"},
                HELIX_ARM_SIMULATED_RIG);
  expectRefused({"_scene:=demo", "_source:=webcam"}, {"demo has no camera.webcam"},
                HELIX_ARM_VISION);
  expectRefused({"_scene:=demo", "_source:=/no/such/film.avi"}, {"/no/such/film.avi"},
                HELIX_ARM_VISION);
  expectRefused({"_scene:=demo", "_camera_info_url:=file:///tmp/camera.yaml"},
                {"~camera_info_url is file:///tmp/camera.yaml", "comes on camera_info"},
                HELIX_ARM_VISION);
  expectRefused({"_scene:=demo_serial", "_rate:=7"},
                {"vents by itself when no line comes for 0.5 s", "raise the rate of the loop"});
}

// In its log, as in those of other programs, a line of a node begins with its level.
TEST_F(NodeProcess, NothingOfASceneOrAParameterReachesTheLogAsItIs) {
  const std::string title = "\\e]0;x\\a\\rall is well\\n",
                    forged = "[ INFO] [1.0]: forged\u009b31m\u202e";
  const TemporaryFile scene("name: \"bad" + title + forged + "\"\narm: {}\n");
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"_scene:=" + scene.path()}, {"_scene:=" + forged}, {kScene, "_regulator:=" + forged}}) {
    const Master master;
    std::vector<std::string> call = {HELIX_ARM_PRESSURE_COMMAND};
    call.insert(call.end(), arguments.begin(), arguments.end());
    Process node(call, master.variables());
    EXPECT_EQ(node.exitCode(), 2) << node.output();
    const std::string output = node.output();
    EXPECT_EQ(output.find("]0;x\x07"), std::string::npos);
    EXPECT_EQ(output.find('\r'), std::string::npos);
    EXPECT_EQ(output.find("\u009b"), std::string::npos) << output;
    EXPECT_EQ(output.find("\n[ INFO] [1.0]: forged"), std::string::npos) << output;
  }
}

TEST_F(NodeProcess, ARelativePathStartsInTheFolderOfTheCaller) {
  const TemporaryFolder folder, home;
  Process::Variables called_there = variables();
  called_there["PWD"] = folder.path();
  called_there["ROS_HOME"] = home.path();
  const auto in = [](const std::string& place, std::vector<std::string> command) {
    command.insert(command.begin(), {"env", "-C", place});
    return command;
  };
  Process refused(in(home.path(), {HELIX_ARM_PRESSURE_COMMAND, "_scene:=rigs/../bad.yaml"}),
                  called_there);
  EXPECT_EQ(refused.exitCode(), 2);
  EXPECT_NE(refused.output().find(folder / "bad.yaml"), std::string::npos) << refused.output();

  std::filesystem::copy_file(HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml", folder / "my.yaml");
  Process taken(in(home.path(), {HELIX_ARM_CALIBRATION, "_scene:=./my.yaml", "_out_folder:=made"}),
                called_there);
  ASSERT_TRUE(taken.prints("ready to record")) << taken.output();
  EXPECT_NE(taken.output().find("~scene is ./my.yaml: " + (folder / "my.yaml")), std::string::npos)
      << taken.output();
  Process asked({"rosparam", "get", "/calibration/out_folder"}, called_there);
  EXPECT_TRUE(asked.prints(folder / "made")) << asked.output();

  // Elsewhere the node is where it was called, whatever PWD its parent has left it.
  const TemporaryFolder called;
  std::ofstream(called / "my.yaml") << "name: my_arm\ncolour: green\n";
  Process here(in(called.path(), {HELIX_ARM_PRESSURE_COMMAND, "_scene:=my.yaml"}), called_there);
  EXPECT_EQ(here.exitCode(), 2);
  EXPECT_NE(here.output().find(called / "my.yaml:"), std::string::npos) << here.output();

  called_there["PWD"] = "";  // as where a service starts it
  Process in_its_own({HELIX_ARM_VISION, "_scene:=demo", "_source:=film.avi"}, called_there);
  EXPECT_EQ(in_its_own.exitCode(), 2);
  EXPECT_NE(in_its_own.output().find(std::filesystem::current_path() / "film.avi"),
            std::string::npos)
      << in_its_own.output();
}

// A word that is none of the sources may be a folder of the caller.
TEST_F(NodeProcess, ABareFolderIsASource) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "pictures");
  Process taken({"env", "-C", folder.path(), HELIX_ARM_VISION, "_scene:=demo", "_source:=pictures"},
                variables());
  EXPECT_TRUE(taken.prints("~source is pictures: " + (folder / "pictures"))) << taken.output();
  expectRefused({"_scene:=demo", "_source:=no_such_folder"},
                {"~source is no_such_folder", "a path (with a / or a ., or of what is there)"},
                HELIX_ARM_VISION);
}

TEST_F(NodeProcess, ANodeletWithABadSceneNamesItAndItsManagerGoesOn) {
  Process manager({"rosrun", "nodelet", "nodelet", "manager", "__name:=eyes"}, variables());
  Process bad({"rosrun", "nodelet", "nodelet", "load", "helix_arm/vision", "/eyes", "__name:=bad",
               "_scene:=no_such_arm"},
              variables());
  EXPECT_TRUE(manager.prints("~scene is no_such_arm")) << manager.output();
  EXPECT_TRUE(manager.prints("/bad is not loaded")) << manager.output();
  EXPECT_GT(bad.exitCode(), 0) << bad.output();
  EXPECT_EQ(manager.exitCode(0.0), -1) << manager.output();
}

TEST_F(NodeProcess, WithoutACameraThereIsNothingToSee) {
  expectRefused({kScene}, {"spatial_50 has no `camera` and `tags`", "add what is missing"},
                HELIX_ARM_VISION);
  expectRefused({"_scene:=helical_50"}, {"helical_50 has no `camera`"}, HELIX_ARM_VISION);
  Process content({HELIX_ARM_VISION, kScene, "_optional:=true"}, variables());
  EXPECT_EQ(content.exitCode(), 0) << content.output();
  EXPECT_NE(content.output().find("nothing to see"), std::string::npos) << content.output();
}

TEST_F(NodeProcess, AnArmThatItCannotDriveIsRefused) {
  const TemporaryFile scene(
      ringScene("tendon: {length_m: 0.4, spool_radius_m: 0.01, max_angle_rad: 6}"));
  expectRefused({"_scene:=" + scene.path()}, {"muscle_1 is a tendon", "muscle_3 is a tendon"});
}

TEST_F(NodeProcess, ASupplyBelowTheLimitsIsReported) {
  const TemporaryFile scene(ringScene(kTable, "muscle, max_pressure_kpa: 400",
                                      "10, K_tau_m2: 0, K_kappa_m2: 1.0e-4",
                                      "regulator: {simulated: {supply_kpa: 300}}\n"));
  for (const char* program : {HELIX_ARM_PRESSURE_COMMAND, HELIX_ARM_SIMULATED_RIG}) {
    Process node({program, "_scene:=" + scene.path()}, variables());
    EXPECT_TRUE(node.prints(
        "muscle_3 has limits of 0 to 400 kPa, but the simulated supply gives 0 to 300 kPa"))
        << node.output();
  }
}

TEST_F(NodeProcess, ALostMasterEndsEveryNodeWith1) {
  EveryNode nodes(variables());
  ASSERT_TRUE(nodes.command.prints(kReady)) << nodes.command.output();
  ASSERT_NO_FATAL_FAILURE(nodes.awaitWork());
  master_.stop();
  for (Process* node : nodes.all()) expectFails(*node, "is gone");
}

TEST_F(NodeProcess, AHungMasterEndsEveryNodeWith1) {
  EveryNode nodes(variables());
  ASSERT_NO_FATAL_FAILURE(nodes.awaitWork());
  master_.signal(SIGSTOP);
  // One of them is asked to end before it could see that; it need not name the master.
  nodes.monitor.signal(SIGINT);
  for (Process* node : nodes.all()) {
    expectFails(*node, node == &nodes.monitor ? "" : "does not answer", 60);
  }
  master_.signal(SIGCONT);
}

TEST_F(NodeProcess, AMasterThatForgotTheNodeEndsIt) {
  Process node({HELIX_ARM_PRESSURE_COMMAND, kScene}, variables());
  ASSERT_TRUE(node.prints(kReady)) << node.output();
  node.signal(SIGSTOP);  // it is not to see that there is none for a while
  master_.stop();
  master_.start();
  node.signal(SIGCONT);
  expectFails(node, "does not know this node");
}

TEST_F(NodeProcess, TheMonitorFailsWhereThereIsNoArm) {
  Process monitor({HELIX_ARM_MONITOR, "_seconds:=1", "_startup_s:=1", "_scene:=demo"}, variables());
  EXPECT_EQ(monitor.exitCode(), 1);
  for (const char* words : {"nothing came on pressure_command", "nothing came on pressure_measured",
                            "nothing came on model", "nothing came on measured", "not healthy"}) {
    EXPECT_NE(monitor.output().find(words), std::string::npos) << words << monitor.output();
  }
}

TEST_F(NodeProcess, ASeriesThatLeavesTheLimitsIsRefused) {
  const TemporaryFile data("# made up\npressure_1_kpa,pressure_2_kpa\n100,0\n100,900\n");
  Process series({HELIX_ARM_SERIES, kScene, "_data:=" + data.path()}, variables());
  EXPECT_EQ(series.exitCode(), 2) << series.output();
  EXPECT_NE(series.output().find("row 2: muscle_2 is asked for 900000 Pa"), std::string::npos)
      << series.output();
}

class LaunchFile : public NodeProcess {
 protected:
  // Launches a file of the package; the arm must run well, and everything must end well.
  //
  // @param scene  that the monitor judges by.
  void expectRuns(const std::string& file, const std::vector<std::string>& arguments = {},
                  const std::string& scene = "spatial_50") {
    std::vector<std::string> command = {"roslaunch", "-p", std::to_string(master_.port()),
                                        HELIX_ARM_SOURCE_DIR "/launch/" + file, "rviz:=false"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    Ran ran = run(command, scene);
    if (wasHeldUp(ran.output)) ran = run(command, scene);
    EXPECT_EQ(ran.verdict, 0) << ran.output;
    EXPECT_EQ(ran.end, 0) << ran.output;
    for (const char* trouble : {"has died", "cannot launch", "ERROR", "FATAL"}) {
      EXPECT_EQ(ran.output.find(trouble), std::string::npos) << ran.output;
    }
  }

 private:
  struct Ran {
    int verdict;  // the monitor's
    int end;      // roslaunch's
    std::string output;
  };

  Ran run(const std::vector<std::string>& command, const std::string& scene) {
    Process launch(command, variables());
    Process monitor({HELIX_ARM_MONITOR, "_seconds:=3", "_min_rate:=1", "_scene:=" + scene},
                    variables());
    const int verdict = monitor.exitCode(45);
    launch.signal(SIGINT);
    const int end = launch.exitCode();
    return {verdict, end, monitor.output() + launch.output()};
  }

  // A machine that is busy with other tests stops a node for so long that the arm vents, as it is
  // to: that tells nothing of the launch file.
  static bool wasHeldUp(const std::string& output) {
    for (const char* fault : {"fault: no target came", "fault: the regulator's link went down",
                              "(safety.reading_timeout_s)"}) {
      if (output.find(fault) != std::string::npos) return true;
    }
    return false;
  }
};

TEST_F(LaunchFile, ArmRuns) { expectRuns("arm.launch"); }
TEST_F(LaunchFile, DemoRunsAndIsMeasured) { expectRuns("demo.launch", {}, "demo"); }
TEST_F(LaunchFile, DemoRunsWithoutACamera) { expectRuns("demo.launch", {"scene:=planar_76"}); }
TEST_F(LaunchFile, DemoRunsToBeCalibrated) {
  expectRuns("demo.launch", {"calibration:=true"}, "demo");
}
TEST_F(LaunchFile, ReplayRuns) { expectRuns("replay.launch"); }

// A program that starts roslaunch in another folder leaves it its own PWD.
TEST_F(LaunchFile, TakesPathsRelativeToTheFolderOfRoslaunchWhateverPwdSays) {
  const TemporaryFolder folder, of_parent;
  for (const TemporaryFolder* one : {&folder, &of_parent}) {
    std::ofstream(*one / "my_arm.yaml") << "name: my_arm\ncolour: green\n";
  }
  for (const TemporaryFolder* pwd : {&folder, &of_parent}) {
    Process::Variables left = variables();
    left["PWD"] = pwd->path();
    Process launch({"env", "-C", folder.path(), "roslaunch", "-p", std::to_string(master_.port()),
                    HELIX_ARM_SOURCE_DIR "/launch/arm.launch", "scene:=my_arm.yaml", "rviz:=false"},
                   left);
    EXPECT_TRUE(launch.prints(folder / "my_arm.yaml:")) << launch.output();
    EXPECT_EQ(launch.output().find(of_parent / "my_arm.yaml"), std::string::npos)
        << launch.output();
  }
}

TEST_F(LaunchFile, ReplayUsesTheMeasuredSeries) {
  const std::string data = HELIX_ARM_SOURCE_DIR "/../shared/data/planar_76_curvature.csv";
  if (access(data.c_str(), R_OK) != 0) GTEST_SKIP() << data << " is not here";
  expectRuns("replay.launch", {"scene:=planar_76", "data:=" + data, "hold_s:=0.1"});
}

}  // namespace
}  // namespace helix_arm::test
