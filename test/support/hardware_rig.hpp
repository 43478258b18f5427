#pragma once

#include <std_srvs/SetBool.h>

#include "helix_arm/SafetyState.h"
#include "regulator/realtime.hpp"
#include "support/emulated_regulator.hpp"
#include "support/process.hpp"
#include "support/ros_rig.hpp"
#include "support/test_size.hpp"

namespace helix_arm::test {

inline std::string nameOfLine(const ::testing::TestParamInfo<Line>& line) {
  return nameOf(line.param);
}
/// Each kind of line, by default the given one: the drivers have their own tests of what differs.
inline std::vector<Line> linesBySize(Line by_default) {
  return isFullSize() ? std::vector<Line>(std::begin(kLines), std::end(kLines))
                      : std::vector<Line>{by_default};
}

/// Of a machine that is busy, beyond what a rule allows: tells late from never. How late it is, is
/// a figure [s].
inline constexpr double kSlack = 10;

/// Processes that guard the arm of a scene.
inline std::vector<pid_t> guardsOf(const std::string& scene) {
  const std::string wanted = '\0' + std::string("regulator") + '\0' + scene + '\0' + "guard" + '\0';
  std::vector<pid_t> found;
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    const std::string name = entry.path().filename();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    // A process may end while it is read: the stream then fails, a bare iterator would throw.
    std::ostringstream command;
    command << std::ifstream(entry.path() / "cmdline", std::ios::binary).rdbuf();
    if (command.str().find(wanted) != std::string::npos) found.push_back(std::stoi(name));
  }
  return found;
}

/// One pressure_command process, and a commander of it in this one, in a thread of its own: no call
/// that a test waits for silences it.
class HardwareRig {
 public:
  /// @param parameters  of the node, beside its scene: "_name:=value".
  HardwareRig(EmulatedRegulator& device, const std::string& ns,
              const std::vector<std::string>& parameters = {})
      : regulator(device),
        node(commandOf(device, ns, parameters)),
        node_("/" + ns),
        services_("/" + ns + "/pressure_command"),
        targets_(node_.advertise<PressureArray>(names::kPressureTarget, 10)),
        safety(node_, names::kSafetyState),
        status(node_, names::kTargetStatus),
        commander_([this] { send(); }) {}
  ~HardwareRig() {
    ends_ = true;
    commander_.join();
  }

  /// Whether the latched state is this one, within the deadline [s].
  bool comesTo(const std::string& state, double deadline = 60) {
    return waitFor([&] { return !safety.all().empty() && safety.last().state == state; }, deadline);
  }

  /// Whether the device has the vent order in, within a deadline [s] from `begin`, of
  /// regulator::steadyNow() [s].
  bool ventsBy(double begin, double deadline) {
    return waitFor([this] { return regulator.isVented(); },
                   begin + deadline - regulator::steadyNow());
  }

  std_srvs::TriggerResponse trigger(const std::string& service) {
    std_srvs::Trigger call;
    services_.serviceClient<std_srvs::Trigger>(service).call(call);
    return call.response;
  }
  std_srvs::SetBoolResponse stop(bool engaged) {
    std_srvs::SetBool call;
    call.request.data = engaged;
    services_.serviceClient<std_srvs::SetBool>(names::kEmergencyStop).call(call);
    return call.response;
  }

  /// Enables it, whatever it takes, and commands until the device is at the pressures [Pa].
  bool bringTo(const Eigen::Vector3d& pressure) {
    if (!ros::service::waitForService(services_.getNamespace() + "/" + names::kEnable,
                                      ros::Duration(20))) {
      return false;
    }
    command(pressure);
    double away = regulator::steadyNow();  // when it last was
    return waitFor(
        [&] {
          const bool enabled = !safety.all().empty() && safety.last().state == "enabled";
          if (!enabled)
            trigger(names::kEnable);  // a busy machine trips the brisk rules of the scene
          const double now = regulator::steadyNow();
          if (!enabled || (regulator.pressure() - pressure).cwiseAbs().maxCoeff() > 5e3) away = now;
          return now - away > 3 * kLag;  // the rule on leaks counts it as arrived
        },
        60);
  }
  /// That nothing moves, though the commander has gone on all the while, until the arm is enabled.
  void expectNothingMovesUntilEnabled(const Eigen::Vector3d& pressure) {
    const std::size_t answers = status.all().size();
    ASSERT_TRUE(waitFor([&] { return status.all().size() >= answers + 10; }));
    EXPECT_EQ(status.last().fault, "not_enabled");
    EXPECT_TRUE(regulator.isVented());
    EXPECT_TRUE(bringTo(pressure)) << safety.last().reason;
  }
  /// Sends these at 50 Hz from now on [Pa].
  void command(const Eigen::Vector3d& pressure) {
    const std::lock_guard<std::mutex> lock(mutex_);
    wanted_ = pressure;
  }
  void fallSilent() {
    const std::lock_guard<std::mutex> lock(mutex_);
    wanted_.reset();
  }
  double lastTarget() const { return last_target_; }  ///< when, of regulator::steadyNow() [s]

  EmulatedRegulator& regulator;
  Process node;

 private:
  static std::vector<std::string> commandOf(const EmulatedRegulator& device, const std::string& ns,
                                            const std::vector<std::string>& parameters) {
    std::vector<std::string> out = {HELIX_ARM_PRESSURE_COMMAND, "__ns:=/" + ns,
                                    "_scene:=" + device.scene(), "_frame_prefix:=" + ns + "_"};
    out.insert(out.end(), parameters.begin(), parameters.end());
    return out;
  }
  void send() {
    regulator::scheduleRealtime(regulator::kRealtimePriority);  // where it may
    for (; !ends_; std::this_thread::sleep_for(std::chrono::milliseconds(20))) {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (!wanted_) continue;
      PressureArray target;
      target.header.stamp = ros::Time::now();
      target.pressure.assign(wanted_->begin(), wanted_->end());
      last_target_ = regulator::steadyNow();
      targets_.publish(target);
    }
  }

  ros::NodeHandle node_, services_;
  ros::Publisher targets_;
  std::mutex mutex_;  // of the wanted ones
  std::optional<Eigen::Vector3d> wanted_;
  std::atomic<double> last_target_{0};
  std::atomic<bool> ends_{false};

 public:
  Inbox<SafetyState> safety;
  Inbox<TargetStatus> status;

 private:
  std::thread commander_;
};

/// A board as the arm of visual_servo, which has no camera and therefore stays open, and
/// follow_path as the client of a goal.
class HardwareLoop {
 public:
  HardwareLoop(EmulatedRegulator& device, const std::string& ns)
      : rig(device, ns),
        loop({HELIX_ARM_VISUAL_SERVO, "__ns:=/" + ns, "_scene:=" + device.scene(),
              "_frame_prefix:=" + ns + "_"}),
        ns_("/" + ns) {}

  /// Whether the arm comes to be enabled; it does not move yet.
  bool enable() {
    return ros::service::waitForService(ns_ + "/pressure_command/enable", ros::Duration(20)) &&
           waitFor([this] {
             rig.trigger(names::kEnable);
             return rig.comesTo("enabled", 0.5);
           });
  }

  /// Starts the client with a path along which the arm shortens: all pressures rise.
  /// @param duration  of the path [s].
  /// @param more      parameters of the client: "_name:=value".
  void follow(double duration, const std::vector<std::string>& more = {}) {
    std::ostringstream text;
    text << "time_s,x_m,y_m,z_m\n0,0.38,0,0\n" << duration << ",0.35,0,0\n";
    path_.emplace(text.str(), ".csv");
    ros::param::del(ns_ + "/follow_path");  // those of the run before would stay
    follow_ = {HELIX_ARM_FOLLOW_PATH, "__ns:=" + ns_, "_path:=" + path_->path()};
    follow_.insert(follow_.end(), more.begin(), more.end());
    client = std::make_unique<Process>(follow_);
  }

  /// Whether the path comes to move the arm. A busy machine may trip the brisk rules of the scene
  /// on the way: the client is then asked again.
  bool isUnderWay() {
    return waitFor(
        [this] {
          if (client->outputNow().find("the path was not followed") != std::string::npos) {
            if (!enable()) return false;
            client = std::make_unique<Process>(follow_);
          }
          return rig.regulator.pressure().minCoeff() > 6e4;
        },
        90);
  }

  HardwareRig rig;
  Process loop;
  std::unique_ptr<Process> client;

 private:
  std::vector<std::string> follow_;  // the client
  const std::string ns_;
  std::optional<TemporaryFile> path_;
};

}  // namespace helix_arm::test
