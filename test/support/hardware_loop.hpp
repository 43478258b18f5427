#pragma once

#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "support/hardware_rig.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {

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
    std::vector<std::string> command = {HELIX_ARM_FOLLOW_PATH, "__ns:=" + ns_,
                                        "_path:=" + path_->path()};
    command.insert(command.end(), more.begin(), more.end());
    client = std::make_unique<Process>(command);
  }

  bool isUnderWay() {
    return waitFor([this] { return rig.regulator.pressure().minCoeff() > 6e4; }, 60);
  }

  HardwareRig rig;
  Process loop;
  std::unique_ptr<Process> client;

 private:
  const std::string ns_;
  std::optional<TemporaryFile> path_;
};

}  // namespace helix_arm::test
