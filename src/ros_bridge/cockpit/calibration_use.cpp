#include "ros_bridge/cockpit/calibration_use.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <set>
#include <utility>

#include <ros/names.h>
#include <ros/param.h>
#include <ros/service.h>

#include "helix_arm/Reload.h"
#include "helix_arm/Save.h"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/calibration_words.hpp"
#include "ros_bridge/cockpit/cockpit_words.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

// Of a file: digits and T, Z alone.
std::string timeStamp() {
  std::string out = procedures::utcNow();
  out.erase(
      std::remove_if(out.begin(), out.end(), [](unsigned char c) { return std::isalnum(c) == 0; }),
      out.end());
  return out;
}

}  // namespace

std::vector<std::string> parameterLines(const RunCalibrationResult& result) {
  const std::size_t count =
      std::min({result.names.size(), result.units.size(), result.initial.size(),
                result.values.size(), result.standard_errors.size(), result.identifiable.size()});
  std::vector<std::string> out;
  std::set<std::string> tags;
  std::string zeros;
  bool base = false;
  for (std::size_t i = 0; i < count; ++i) {
    if (!result.identifiable[i]) continue;
    const std::string& name = result.names[i];
    const double value = result.values[i], error = result.standard_errors[i];
    if (name.compare(0, 5, "base_") == 0) {
      base = true;
    } else if (name.compare(0, 4, "tag_") == 0) {
      tags.insert(name.substr(0, name.find('_', 4)));
    } else if (result.initial[i] == 0 && std::abs(value) < error) {
      zeros += (zeros.empty() ? "" : ", ") + shownText(name);
    } else {
      char numbers[120];
      std::snprintf(numbers, sizeof numbers, " %.4g -> %.4g +- %.2g", result.initial[i], value,
                    error);
      const std::string unit = result.units[i].empty() ? "" : " " + shownText(result.units[i]);
      out.push_back(shownText(name) + numbers + unit);
    }
  }
  for (std::string& text : procedures::placementTexts(base, tags.size())) {
    out.push_back(std::move(text));
  }
  if (!zeros.empty()) out.push_back("not distinguishable from 0: " + zeros);
  return out;
}

CallAnswer useLastCalibration(const std::string& ns) {
  CallAnswer out;
  const std::string node = ros::names::append(ns, names::kCalibrationNode);
  std::string folder;
  ros::param::get(ros::names::append(node, "out_folder"), folder);
  if (folder.empty()) ros::param::get(ros::names::append(node, "data_folder"), folder);
  if (folder.empty()) folder = defaultFolder();
  Save save;
  save.request.path = folder + "/calibrated_" + timeStamp() + ".yaml";
  const std::string save_name = ros::names::append(node, names::kSave);
  if (!ros::service::call(save_name, save)) {
    out.message = save_name + " is not there or does not answer";
    out.answered = false;
    return out;
  }
  if (!save.response.success) {
    out.message = "not written: " + shownText(save.response.message);
    return out;
  }
  std::string users;
  for (const char* user : {names::kPressureCommandNode, names::kVisionNode, names::kVisualServoNode,
                           names::kCalibrationNode}) {
    const std::string name = ros::names::append(ros::names::append(ns, user), names::kReload);
    if (!ros::service::exists(name, false)) continue;
    Reload reload;
    reload.request.scene = save.request.path;
    const bool called = ros::service::call(name, reload);
    if (!called || !reload.response.success) {
      out.message = save.request.path + (users.empty() ? "" : " is used by " + users + ", but") +
                    " is not loaded by " + user + ": " +
                    (called ? shownText(reload.response.message) : "no answer");
      return out;
    }
    users += (users.empty() ? "" : ", ") + std::string(user);
  }
  out.success = !users.empty();
  out.message = out.success ? save.request.path + " is used by " + users
                            : save.request.path + " is written, but no node is up that loads it";
  return out;
}

}  // namespace helix_arm::ros_bridge
