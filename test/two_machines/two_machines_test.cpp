// launch/two_machines.launch on two machines, each a network namespace of this one: the camera
// machine commands the arm, its cable is pulled and put back.
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <optional>
#include <stdexcept>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <ros/master.h>
#include <ros/ros.h>
#include <sched.h>
#include <std_srvs/Trigger.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "helix_arm/SafetyState.h"
#include "helix_arm/io/scene.hpp"
#include "support/process.hpp"
#include "support/ros_rig.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

/// This process may not make network namespaces, or there is no program `ip` to fill them.
class NoNetworks : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

constexpr int kNotFound = 127;  // exit code

void run(const std::vector<std::string>& command) {
  Process process(command);
  const int code = process.exitCode();
  if (code == 0) return;
  std::string text;
  for (const std::string& word : command) text += word + " ";
  text += "failed: " + process.output();
  if (code == kNotFound) throw NoNetworks(text);
  throw std::runtime_error(text);
}

// The life of a child that holds a namespace: it says how making it went, and waits for its end.
[[noreturn]] void hold(int report, pid_t parent) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const int error = unshare(CLONE_NEWNET) == 0 ? 0 : errno;
  const bool said = write(report, &error, sizeof error) == sizeof error;
  close(report);
  while (said && error == 0 && getppid() == parent) pause();
  _exit(0);
}

/// A network namespace without a name, that of a child: it ends with the object or this process.
class NetworkNamespace {
 public:
  /// @throws NoNetworks          where the system refuses it.
  /// @throws std::runtime_error  where it cannot be made for another reason.
  NetworkNamespace() {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("no pipe for a network namespace");
    const pid_t parent = getpid();
    child_ = fork();
    if (child_ == 0) hold(ends[1], parent);
    close(ends[1]);
    int error = child_ < 0 ? errno : ECHILD;
    if (child_ > 0 && read(ends[0], &error, sizeof error) != sizeof error) error = ECHILD;
    close(ends[0]);
    if (error == 0) return;
    if (child_ > 0) waitpid(child_, nullptr, 0);
    const std::string text = std::string("no network namespace: ") + std::strerror(error);
    if (error == EPERM || error == EACCES) throw NoNetworks(text);
    throw std::runtime_error(text);
  }
  ~NetworkNamespace() {
    kill(child_, SIGKILL);
    waitpid(child_, nullptr, 0);
  }
  NetworkNamespace(const NetworkNamespace&) = delete;
  NetworkNamespace& operator=(const NetworkNamespace&) = delete;

  /// Of the child, by which `ip` knows the namespace.
  std::string id() const { return std::to_string(child_); }
  /// A command that runs in it.
  std::vector<std::string> inside(const std::vector<std::string>& command) const {
    std::vector<std::string> all = {"nsenter", "--target=" + id(), "--net"};
    all.insert(all.end(), command.begin(), command.end());
    return all;
  }
  /// Moves this thread there, and all that it starts from now on.
  void enter() const {
    const std::string path = "/proc/" + id() + "/ns/net";
    const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
    const bool entered = file >= 0 && setns(file, CLONE_NEWNET) == 0;
    const int error = errno;
    if (file >= 0) close(file);
    if (!entered) throw std::runtime_error(path + " cannot be entered: " + std::strerror(error));
  }

 private:
  pid_t child_ = -1;
};

/// Two machines and the switch between them, as network namespaces of this one.
class TwoNetworks {
 public:
  /// @throws NoNetworks          where this process may not make them.
  /// @throws std::runtime_error  where they cannot be connected, with what was refused.
  TwoNetworks() {
    run(switch_.inside({"ip", "link", "add", "bridge", "type", "bridge"}));
    run(switch_.inside({"ip", "link", "set", "bridge", "up"}));
    connect("control", control_, kControl);
    connect("camera", camera_, kCamera);
  }

  void enterControl() const { control_.enter(); }
  /// A command that runs on the camera machine.
  std::vector<std::string> onCamera(const std::vector<std::string>& command) const {
    return camera_.inside(command);
  }

  /// Pulls the camera machine's cable, and puts it back.
  void cut() const { run(switch_.inside({"ip", "link", "set", "camera", "down"})); }
  void heal() const { run(switch_.inside({"ip", "link", "set", "camera", "up"})); }

  static constexpr char kControl[] = "10.77.0.1";
  static constexpr char kCamera[] = "10.77.0.2";

 private:
  void connect(const char* port, const NetworkNamespace& machine, const char* address) const {
    run(switch_.inside({"ip", "link", "add", port, "type", "veth", "peer", "name", "eth0", "netns",
                        machine.id()}));
    run(switch_.inside({"ip", "link", "set", port, "master", "bridge"}));
    run(switch_.inside({"ip", "link", "set", port, "up"}));
    run(machine.inside({"ip", "address", "add", std::string(address) + "/24", "dev", "eth0"}));
    for (const char* device : {"lo", "eth0"}) {
      run(machine.inside({"ip", "link", "set", device, "up"}));
    }
  }

  NetworkNamespace switch_, control_, camera_;
};

constexpr double kTargetTimeout = 1.0;  // [s]
constexpr double kVentTime = 3.0;       // [s]
constexpr double kMoves = 3e4;          // far above what a series sends while it waits [Pa]
// Of all waits together, and of a roslaunch to end: it gives a node 15 s before it kills it, and a
// node outlives the roslaunch that is killed. Below the TIMEOUT of ctest [s].
constexpr double kAllWaits = 170;
constexpr double kEnd = 18;

std::optional<TwoNetworks>& networks() {
  static std::optional<TwoNetworks> instance;
  return instance;
}

// The rig of the demo, whose lease ends kTargetTimeout after the last target; all other timeouts
// are long.
std::string sceneText() {
  return io::sceneText(HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml",
                       {{"safety.target_timeout_s", "1"},
                        {"safety.vent_time_s", "3"},
                        {"safety.reading_timeout_s", "3"},
                        {"safety.follow.time_s", "3"}});
}

// One of the two launches, with the environment of its machine.
class Machine {
 public:
  Machine(const std::string& role, const std::string& address, const std::string& scene,
          const std::vector<std::string>& arguments)
      : process_(command(role, address, scene, arguments),
                 {{"ROS_MASTER_URI", "http://" + std::string(TwoNetworks::kControl) + ":11311"},
                  {"ROS_HOSTNAME", address}}) {}
  ~Machine() {
    process_.signal(SIGINT);
    process_.exitCode(kEnd);
  }
  const std::string& output() {
    process_.prints("(nothing prints this)", 0.2);
    return process_.output();
  }

 private:
  static std::vector<std::string> command(const std::string& role, const std::string& address,
                                          const std::string& scene,
                                          const std::vector<std::string>& arguments) {
    std::vector<std::string> all = {"roslaunch",           "--wait",        "helix_arm",
                                    "two_machines.launch", "role:=" + role, "host:=" + address,
                                    "scene:=" + scene};
    if (role == "control") all.erase(all.begin() + 1);  // the master is its own
    all.insert(all.end(), arguments.begin(), arguments.end());
    return role == "control" ? all : networks()->onCamera(all);
  }

  Process process_;
};

bool moves(const PressureArray& command) {
  return !command.pressure.empty() &&
         *std::max_element(command.pressure.begin(), command.pressure.end()) > kMoves;
}

bool rests(const PressureArray& command) {
  return std::all_of(command.pressure.begin(), command.pressure.end(),
                     [](double pressure) { return pressure == 0; });
}

void enable() {
  std_srvs::Trigger trigger;
  ros::service::call("/pressure_command/enable", trigger);
}

TEST(TwoMachines, TheArmVentsWhenTheLinkIsCutAndStaysVentedWhenItHeals) {
  const auto begin = std::chrono::steady_clock::now();
  const auto left = [begin] {
    const std::chrono::duration<double> gone = std::chrono::steady_clock::now() - begin;
    return kAllWaits - gone.count();
  };
  try {
    networks().emplace();
  } catch (const NoNetworks& error) {
    GTEST_SKIP() << error.what();
  }
  networks()->enterControl();
  const TemporaryFile scene(sceneText());
  Machine control("control", TwoNetworks::kControl, scene.path(), {"rig:=true"});
  Machine camera("camera", TwoNetworks::kCamera, scene.path(), {"commander:=true"});
  const auto told = [&] { return "control:\n" + control.output() + "camera:\n" + camera.output(); };

  setenv("ROS_MASTER_URI", ("http://" + std::string(TwoNetworks::kControl) + ":11311").c_str(), 1);
  setenv("ROS_HOSTNAME", TwoNetworks::kControl, 1);
  ros::init(ros::M_string(), "two_machines_test");
  ASSERT_TRUE(waitFor([] { return ros::master::check(); }, left())) << told();
  ros::NodeHandle node;
  Inbox<SafetyState> safety(node, names::kSafetyState);
  Inbox<PressureArray> command(node, names::kPressureCommand);
  Inbox<TargetStatus> status(node, names::kTargetStatus);
  Inbox<PressureArray> targets(node, names::kPressureTarget);
  Inbox<ArmShape> measured(node, names::kMeasured);
  const auto state = [&] { return safety.all().empty() ? "" : safety.last().state; };

  // On a busy machine a link of the chain may be late, which vents it: again, then.
  const auto goesOn = [&] {
    if (state() != "enabled") enable();
    return state() == "enabled" && moves(command.last());
  };

  // Nothing moves before it is enabled, although the commander commands.
  ASSERT_TRUE(waitFor(
      [&] {
        return !status.all().empty() && !measured.all().empty() && !command.all().empty() &&
               !targets.all().empty() && !safety.all().empty();
      },
      left()))
      << told();
  EXPECT_EQ(status.last().outcome, TargetStatus::DROPPED);
  EXPECT_EQ(state(), "disabled");
  ASSERT_TRUE(std::all_of(command.all().begin(), command.all().end(),
                          [](const auto& message) { return rests(*message); }));
  ASSERT_TRUE(waitFor(goesOn, left())) << told();

  networks()->cut();
  const ros::Time cut = ros::Time::now();
  // A second more than the rules allow, for the messages.
  ASSERT_TRUE(waitFor([&] { return state() == "vented"; }, kTargetTimeout + kVentTime + 1))
      << told();
  std::cout << "vented " << (safety.last().header.stamp - cut).toSec() << " s after the cut\n";
  EXPECT_EQ(safety.last().cause, "stale_target");
  EXPECT_LE((safety.last().header.stamp - cut).toSec(), kTargetTimeout + kVentTime);

  const std::size_t commands_before = command.all().size(), states_before = safety.all().size();
  const std::size_t answers_before = status.all().size(), targets_before = targets.all().size();
  const ros::Time heal = ros::Time::now();
  networks()->heal();
  // What the commander sends from now on is answered again, and pictures come.
  ASSERT_TRUE(waitFor(
      [&] { return status.all().size() > answers_before && status.last().target_stamp > heal; },
      left()))
      << told();
  ASSERT_TRUE(waitFor([&] { return measured.last().header.stamp > heal; }, left())) << told();
  const auto backlog = [&] {
    return std::count_if(targets.all().begin() + static_cast<std::ptrdiff_t>(targets_before),
                         targets.all().end(), [&](const auto& target) {
                           return target->header.stamp > cut && target->header.stamp < heal;
                         });
  };
  EXPECT_TRUE(waitFor([&] { return backlog() > 0; }, left())) << told();
  std::cout << backlog() << " targets of the time of the cut came late\n";
  for (std::size_t i = answers_before; i < status.all().size(); ++i) {
    EXPECT_EQ(status.all()[i]->outcome, TargetStatus::DROPPED);
  }
  ASSERT_GT(command.all().size(), commands_before);
  EXPECT_TRUE(std::all_of(command.all().begin() + static_cast<std::ptrdiff_t>(commands_before),
                          command.all().end(),
                          [](const auto& message) { return rests(*message); }));
  for (std::size_t i = states_before; i < safety.all().size(); ++i) {
    EXPECT_EQ(safety.all()[i]->state, "vented") << *safety.all()[i];
    EXPECT_EQ(safety.all()[i]->cause, "stale_target") << *safety.all()[i];
  }

  EXPECT_TRUE(waitFor(goesOn, left())) << told();
  ros::shutdown();
}

}  // namespace
}  // namespace helix_arm::test
